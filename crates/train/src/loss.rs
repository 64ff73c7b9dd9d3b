//! The loss of an image against a photo, and its gradient by every pixel.
//!
//! ```text
//! L = 0.8 mean |a - b| + 0.2 (1 - mean SSIM(a, b))
//! ```
//!
//! over pixels and channels, as in B. Kerbl, G. Kopanas, T. Leimkühler and G. Drettakis, "3D
//! Gaussian Splatting for Real-Time Radiance Field Rendering", ACM Transactions on Graphics 42
//! (2023), equation 7. SSIM is that of [`gs2e_image::likeness`]: 11x11 pixels, a Gaussian of 1.5
//! px, black outside the border.
//!
//! With `E` the weighted mean over the window, `m = E[a]`, `n = E[b]`, `A1 = 2 m n + C1`,
//! `A2 = 2 (E[ab] - m n) + C2`, `B1 = m^2 + n^2 + C1` and `B2 = E[aa] - m^2 + E[bb] - n^2 + C2`, the
//! similarity of a window is `S = A1 A2 / (B1 B2)`. Its derivatives are
//!
//! ```text
//! R = dS/dE[ab] = 2 A1 / (B1 B2)
//! Q = dS/dE[aa] = -S / B2
//! P = dS/dm     = 2 n (A2 - A1) / (B1 B2) - 2 m S / B1 + 2 m S / B2
//! ```
//!
//! Each pixel is in all windows around it, so `dS/da = E[P] + 2 a E[Q] + b E[R]`.
//!
//! A window's means are separable. Each band of rows keeps the rows' horizontal means in a ring of
//! eleven, and takes the vertical means from there. Channels stay interleaved: the neighbours of a
//! value are three places apart. Every loop runs along a row, so it becomes vector code, and every
//! sum has a fixed order: the bits do not depend on the number of threads.

mod window;

use fearless_simd::{Level, dispatch};
use gs2e_image::{Image, Size};
use rayon::prelude::*;
use window::{CHANNELS, PaddedRow, REACH, RowRing, window_weights};

/// Share of SSIM in the loss.
pub(crate) const SIMILARITY_SHARE: f32 = 0.2;

/// Rows of a band. Each band computes the rows of its windows beyond its ends again.
const BAND: usize = 40;
/// `(K1 L)^2` and `(K2 L)^2` with `K1 = 0.01`, `K2 = 0.03`, `L = 1`.
const STEADIERS: [f32; 2] = [1e-4, 9e-4];
/// Lanes of the partial sums of a row.
const LANES: usize = 16;

/// A photo at the size of training.
#[derive(Debug, Clone)]
pub(crate) struct TrainingPhoto {
    /// Encoded colours.
    pub(crate) colours: Image<[u8; 3]>,
    /// Pixels that count; `None` if all do.
    pub(crate) counted: Option<Image<bool>>,
}

/// The loss of the last image, and the buffers of its gradient.
#[derive(Debug, Default)]
pub(crate) struct ImageLoss {
    /// `P`, `Q` and `R` of every pixel and channel, row by row.
    slopes: [Vec<f32>; 3],
    /// `dL/da` of every pixel.
    pub(crate) gradient: Vec<[f32; 3]>,
    /// Mean over the channels of `|a - b|` at every pixel.
    pub(crate) residual: Vec<f32>,
}

impl ImageLoss {
    /// Computes the loss of `rendering` against a photo, its gradient and the residual.
    ///
    /// # Panics
    /// The two differ in size.
    pub(crate) fn compare(&mut self, rendering: &Image<[f32; 3]>, photo: &TrainingPhoto) -> f64 {
        assert_eq!(rendering.size(), photo.colours.size(), "a rendering has the size of its photo");
        let size = rendering.size();
        let row = size.width as usize * CHANNELS;
        self.slopes.iter_mut().for_each(|plane| plane.resize(size.pixels() * CHANNELS, 0.0));
        self.gradient.resize(size.pixels(), [0.0; 3]);
        self.residual.resize(size.pixels(), 0.0);
        let pair = PhotoPair { rendering, photo, size, weights: window_weights() };
        let level = Level::new();
        let [p, q, r] = &mut self.slopes;
        let bands = p.par_chunks_mut(BAND * row).zip(q.par_chunks_mut(BAND * row));
        let bands = bands.zip(r.par_chunks_mut(BAND * row)).enumerate();
        let similarity: Vec<f64> = bands
            .map(|(k, ((p, q), r))| dispatch!(level, _simd => pair.similarity_band(k * BAND, [p, q, r])))
            .collect();
        let width = size.width as usize;
        let slopes = &self.slopes;
        let bands =
            self.gradient.par_chunks_mut(BAND * width).zip(self.residual.par_chunks_mut(BAND * width));
        let distance: Vec<f64> = bands
            .enumerate()
            .map(|(k, (gradient, residual))| {
                dispatch!(level, _simd => pair.gradient_band(k * BAND, slopes, gradient, residual))
            })
            .collect();
        let count = (size.pixels() * CHANNELS) as f64;
        let [distance, similarity] = [distance, similarity].map(|bands| bands.iter().sum::<f64>() / count);
        let share = f64::from(SIMILARITY_SHARE);
        (1.0 - share) * distance + share * (1.0 - similarity)
    }
}

/// An image and its photo.
struct PhotoPair<'a> {
    rendering: &'a Image<[f32; 3]>,
    photo: &'a TrainingPhoto,
    size: Size,
    weights: [f32; REACH + 1],
}

impl PhotoPair<'_> {
    /// Values of a row.
    fn row_len(&self) -> usize {
        self.size.width as usize * CHANNELS
    }

    /// The rows of the image and of the photo, both 0 at pixels that do not count.
    #[inline(always)]
    fn rows(&self, y: usize, rendering: &mut [f32], photo: &mut [f32]) {
        let range = y * self.size.width as usize..(y + 1) * self.size.width as usize;
        rendering.copy_from_slice(self.rendering.pixels()[range.clone()].as_flattened());
        let bytes = self.photo.colours.pixels()[range.clone()].as_flattened();
        for (to, byte) in photo.iter_mut().zip(bytes) {
            *to = f32::from(*byte) * (1.0 / 255.0);
        }
        if let Some(counted) = &self.photo.counted {
            let uncounted = counted.pixels()[range].iter().enumerate().filter(|(_, counted)| !**counted);
            for (x, _) in uncounted {
                rendering[x * CHANNELS..(x + 1) * CHANNELS].fill(0.0);
                photo[x * CHANNELS..(x + 1) * CHANNELS].fill(0.0);
            }
        }
    }

    /// Writes `P`, `Q` and `R` of the rows from `first` on, and returns the sum of the similarities.
    #[inline(always)]
    fn similarity_band(&self, first: usize, [p, q, r]: [&mut [f32]; 3]) -> f64 {
        let n = self.row_len();
        let mut ring = RowRing::<5>::new(n);
        let mut values: [PaddedRow; 5] = std::array::from_fn(|_| PaddedRow::new(n));
        let mut means: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; n]);
        let height = self.size.height as usize;
        let count = p.len() / n;
        let mut sum = 0.0;
        for y in first.saturating_sub(REACH)..first + REACH {
            self.take_row(y, height, &mut values, ring.place(y));
        }
        for y in first..first + count {
            self.take_row(y + REACH, height, &mut values, ring.place(y + REACH));
            for (k, mean) in means.iter_mut().enumerate() {
                ring.mean_into(k, y, &self.weights, mean);
            }
            let range = (y - first) * n..(y - first + 1) * n;
            let out = [&mut p[range.clone()], &mut q[range.clone()], &mut r[range]];
            sum += window_slopes(&means, out);
        }
        sum
    }

    /// The horizontal means of a row's `a`, `b`, `a^2`, `b^2`, `ab`; zeros below the image.
    #[inline(always)]
    fn take_row(&self, y: usize, height: usize, values: &mut [PaddedRow; 5], to: &mut [Vec<f32>; 5]) {
        if y >= height {
            to.iter_mut().for_each(|row| row.fill(0.0));
            return;
        }
        let [a, b, aa, bb, ab] = values;
        self.rows(y, a.inner_mut(), b.inner_mut());
        let (x, y) = (a.inner(), b.inner());
        let (aa, bb, ab) = (aa.inner_mut(), bb.inner_mut(), ab.inner_mut());
        for i in 0..x.len() {
            aa[i] = x[i] * x[i];
            bb[i] = y[i] * y[i];
            ab[i] = x[i] * y[i];
        }
        for (values, to) in values.iter().zip(to) {
            values.mean_into(&self.weights, to);
        }
    }

    /// The horizontal means of a row of `P`, `Q` and `R`; zeros below the image. A function and not a
    /// closure, which may be compiled without the instruction set in use.
    #[inline(always)]
    fn take_slopes(&self, y: usize, slopes: &[Vec<f32>; 3], values: &mut PaddedRow, to: &mut [Vec<f32>; 3]) {
        let n = self.row_len();
        for (slopes, to) in slopes.iter().zip(to) {
            if y < self.size.height as usize {
                values.inner_mut().copy_from_slice(&slopes[y * n..(y + 1) * n]);
                values.mean_into(&self.weights, to);
            } else {
                to.fill(0.0);
            }
        }
    }

    /// Writes the gradient and the residual of the rows from `first` on, and returns the sum of the
    /// absolute differences.
    #[inline(always)]
    fn gradient_band(
        &self,
        first: usize,
        slopes: &[Vec<f32>; 3],
        gradient: &mut [[f32; 3]],
        residual: &mut [f32],
    ) -> f64 {
        let n = self.row_len();
        let width = self.size.width as usize;
        let mut ring = RowRing::<3>::new(n);
        let mut values = PaddedRow::new(n);
        let mut means: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; n]);
        let [mut rendering, mut photo] = [vec![0.0; n], vec![0.0; n]];
        for y in first.saturating_sub(REACH)..first + REACH {
            self.take_slopes(y, slopes, &mut values, ring.place(y));
        }
        let mut sum = 0.0;
        for (k, (gradient, residual)) in
            gradient.chunks_mut(width).zip(residual.chunks_mut(width)).enumerate()
        {
            let y = first + k;
            self.take_slopes(y + REACH, slopes, &mut values, ring.place(y + REACH));
            for (q, mean) in means.iter_mut().enumerate() {
                ring.mean_into(q, y, &self.weights, mean);
            }
            self.rows(y, &mut rendering, &mut photo);
            sum += self.row_gradient(&rendering, &photo, &means, gradient.as_flattened_mut());
            for (to, (a, b)) in residual.iter_mut().zip(rendering.chunks_exact(3).zip(photo.chunks_exact(3)))
            {
                *to = ((a[0] - b[0]).abs() + (a[1] - b[1]).abs() + (a[2] - b[2]).abs()) * (1.0 / 3.0);
            }
            self.clear_uncounted(y, gradient);
        }
        sum
    }

    /// `dL/da` of a row, and the sum of its absolute differences.
    #[inline(always)]
    #[expect(clippy::cast_precision_loss, reason = "a scale, rounded once")]
    #[expect(clippy::float_cmp, reason = "only equal values have no slope")]
    fn row_gradient(&self, a: &[f32], b: &[f32], means: &[Vec<f32>; 3], out: &mut [f32]) -> f64 {
        let count = (self.size.pixels() * CHANNELS) as f32;
        let (near, alike) = ((1.0 - SIMILARITY_SHARE) / count, SIMILARITY_SHARE / count);
        let n = out.len();
        let [p, q, r] = [&means[0][..n], &means[1][..n], &means[2][..n]];
        let (a, b) = (&a[..n], &b[..n]);
        for i in 0..n {
            let difference = a[i] - b[i];
            // A selection, not a branch. Equal values have the slope 0.
            let sign = if difference > 0.0 { near } else { -near };
            let sign = if a[i] == b[i] { 0.0 } else { sign };
            out[i] = sign - alike * (p[i] + 2.0 * a[i] * q[i] + b[i] * r[i]);
        }
        lane_sum(n, |i| (a[i] - b[i]).abs())
    }

    /// Pixels that do not count have no gradient.
    fn clear_uncounted(&self, y: usize, gradient: &mut [[f32; 3]]) {
        let Some(counted) = &self.photo.counted else { return };
        let counted = &counted.pixels()[y * gradient.len()..][..gradient.len()];
        for (gradient, _) in gradient.iter_mut().zip(counted).filter(|(_, counted)| !**counted) {
            *gradient = [0.0; 3];
        }
    }
}

/// Writes `P`, `Q` and `R` of a row of windows, and returns the sum of their similarities.
#[inline(always)]
fn window_slopes(means: &[Vec<f32>; 5], [p, q, r]: [&mut [f32]; 3]) -> f64 {
    let [c1, c2] = STEADIERS;
    let n = p.len();
    let [a, b, aa, bb, ab] = [&means[0][..n], &means[1][..n], &means[2][..n], &means[3][..n], &means[4][..n]];
    let (q, r) = (&mut q[..n], &mut r[..n]);
    for i in 0..n {
        let (m, k) = (a[i], b[i]);
        let a1 = 2.0 * m * k + c1;
        let a2 = 2.0 * (ab[i] - m * k) + c2;
        // One division serves all: both factors are at least their steadiers.
        let b1 = m * m + k * k + c1;
        // Rounding leaves the variances off by some 1e-7 for values up to 1, so `b2` stays above 0.
        let b2 = (aa[i] - m * m) + (bb[i] - k * k) + c2;
        // A division costs as much as the ten multiplications that replace it.
        let inverse = 1.0 / (b1 * b2);
        let s = a1 * a2 * inverse;
        // `S / B1 = S B2 / (B1 B2)`.
        let (by_b1, by_b2) = (s * b2 * inverse, s * b1 * inverse);
        p[i] = 2.0 * k * (a2 - a1) * inverse + 2.0 * m * (by_b2 - by_b1);
        q[i] = -by_b2;
        r[i] = 2.0 * a1 * inverse;
    }
    // `S = -Q B2`, without a fourth buffer.
    lane_sum(n, |i| -q[i] * ((aa[i] - a[i] * a[i]) + (bb[i] - b[i] * b[i]) + c2))
}

/// The sum of `n` values: in lanes first, so that it becomes vector code, then in 64 bits.
#[inline(always)]
fn lane_sum(n: usize, value: impl Fn(usize) -> f32) -> f64 {
    let mut lanes = [0.0_f32; LANES];
    let whole = n / LANES * LANES;
    for i in (0..whole).step_by(LANES) {
        for (k, lane) in lanes.iter_mut().enumerate() {
            *lane += value(i + k);
        }
    }
    let rest: f64 = (whole..n).map(|i| f64::from(value(i))).sum();
    lanes.iter().map(|lane| f64::from(*lane)).sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::likeness::ssim;
    use gs2e_image::png;

    /// Pictures with edges and gentle slopes, larger than a band.
    #[expect(clippy::cast_possible_truncation, reason = "pictures hold 32 bits")]
    fn picture(size: Size, phase: f64) -> Image<[f32; 3]> {
        let at = |k: usize| {
            let (x, y) = ((k % size.width as usize) as f64, (k / size.width as usize) as f64);
            std::array::from_fn(|c| {
                let wave = libm::sin(0.31 * x + 0.17 * y + phase + c as f64);
                let edge = if (x + 2.0 * y + phase * 9.0) % 13.0 < 5.0 { 0.2 } else { 0.0 };
                (0.45 + 0.3 * wave + edge) as f32
            })
        };
        Image::from_vec(size, (0..size.pixels()).map(at).collect())
    }

    fn photo(size: Size, counted: bool) -> TrainingPhoto {
        let colours = png::to_bytes(&picture(size, 0.7));
        let mask = |k: usize| k % size.width as usize > 3 && k / (size.width as usize) < 44;
        let mask = Image::from_vec(size, (0..size.pixels()).map(mask).collect());
        TrainingPhoto { colours, counted: counted.then_some(mask) }
    }

    fn decoded(photo: &TrainingPhoto) -> Image<[f32; 3]> {
        // As the loss reads them: a quotient differs in the last bit, and the slope of an absolute
        // difference is that of its sign.
        let pixels =
            photo.colours.pixels().iter().map(|rgb| rgb.map(|v| f32::from(v) * (1.0 / 255.0))).collect();
        Image::from_vec(photo.colours.size(), pixels)
    }

    const SIZES: [Size; 3] =
        [Size { width: 33, height: 51 }, Size { width: 7, height: 4 }, Size { width: 40, height: 40 }];

    /// The similarity by another implementation, in f64 and without separable sums.
    #[test]
    fn the_loss_is_that_of_its_parts() {
        for size in SIZES {
            let (rendering, photo) = (picture(size, 0.0), photo(size, false));
            let wanted = decoded(&photo);
            let pairs = rendering.pixels().as_flattened().iter().zip(wanted.pixels().as_flattened());
            let distance = pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
            let distance = distance / (3 * size.pixels()) as f64;
            let expected = 0.8 * distance + 0.2 * (1.0 - ssim(&rendering, &wanted));
            let found = ImageLoss::default().compare(&rendering, &photo);
            // Variances are differences of 32-bit sums near 1, at 6e-8, over the steadier 9e-4.
            assert!((found - expected).abs() < 1e-4, "{size}: {found}, {expected}");
        }
    }

    #[test]
    fn equal_pictures_have_no_loss_and_no_gradient() {
        for size in SIZES {
            let photo = photo(size, true);
            let mut loss = ImageLoss::default();
            let value = loss.compare(&decoded(&photo), &photo);
            assert!(value.abs() < 1e-6, "{size}: {value}");
            let largest = loss.gradient.as_flattened().iter().fold(0.0_f32, |most, g| most.max(g.abs()));
            // The slopes P, 2 a Q and b R, up to 2 / 9e-4 each, cancel to their rounding.
            assert!(largest * 3.0 * (size.pixels() as f32) < 2e-2, "{size}: {largest}");
        }
    }

    /// Central differences of the loss itself, in directions that move many pixels at once, so that
    /// the difference stands out of the rounding.
    #[test]
    fn the_gradient_is_a_slope() {
        for (size, counted) in SIZES.into_iter().zip([false, false, true]) {
            let photo = photo(size, counted);
            let mut rendering = picture(size, 0.0);
            let wanted = decoded(&photo);
            let pairs =
                rendering.pixels_mut().as_flattened_mut().iter_mut().zip(wanted.pixels().as_flattened());
            // No absolute difference may change its sign within a step.
            for (a, b) in pairs.filter(|(a, b)| (**a - **b).abs() < 0.02) {
                *a = b + 0.02;
            }
            let mut loss = ImageLoss::default();
            loss.compare(&rendering, &photo);
            for direction in [0.3, 1.9, 4.2] {
                let along: Vec<f32> = picture(size, direction).pixels().as_flattened().to_vec();
                let along: Vec<f32> =
                    along.iter().enumerate().map(|(i, v)| if i % 7 < 3 { v - 0.9 } else { *v }).collect();
                let step = 2e-3;
                let at = |sign: f32| {
                    let mut moved = rendering.clone();
                    let pixels = moved.pixels_mut().as_flattened_mut().iter_mut();
                    pixels.zip(&along).for_each(|(v, d)| *v += sign * step * d);
                    ImageLoss::default().compare(&moved, &photo)
                };
                let difference = (at(1.0) - at(-1.0)) / (2.0 * f64::from(step));
                let slope = loss.gradient.as_flattened().iter().zip(&along);
                let slope: f64 = slope.map(|(g, d)| f64::from(*g) * f64::from(*d)).sum();
                // Rounding of variances, 1e-7 over the steadier, per step; and the third derivative.
                let limit = 1e-2 * slope.abs().max(0.05);
                assert!((difference - slope).abs() < limit, "{size}: {difference}, {slope}");
            }
        }
    }

    #[test]
    fn pixels_that_do_not_count_have_no_gradient() {
        let size = SIZES[0];
        let photo = photo(size, true);
        let mut loss = ImageLoss::default();
        let first = loss.compare(&picture(size, 0.0), &photo);
        let counted = photo.counted.as_ref().unwrap().pixels();
        assert!(
            loss.gradient
                .iter()
                .zip(counted)
                .all(|(g, counted)| *counted || g.iter().all(|v| v.to_bits() == 0))
        );
        let mut other = picture(size, 0.0);
        for (pixel, counted) in other.pixels_mut().iter_mut().zip(counted) {
            if !counted {
                *pixel = [9.0; 3];
            }
        }
        assert_eq!(loss.compare(&other, &photo).to_bits(), first.to_bits());
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let size = Size { width: 50, height: 130 };
        let (rendering, photo) = (picture(size, 0.0), photo(size, true));
        let by = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut loss = ImageLoss::default();
                (loss.compare(&rendering, &photo).to_bits(), loss.gradient)
            })
        };
        assert_eq!(by(1), by(3));
    }
}
