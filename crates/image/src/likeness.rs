//! Similarity of two pictures: PSNR and SSIM of encoded colours on the scale 0..1.
//!
//! SSIM follows Z. Wang, A. C. Bovik, H. R. Sheikh and E. P. Simoncelli, "Image Quality Assessment:
//! From Error Visibility to Structural Similarity", IEEE Transactions on Image Processing 13
//! (2004), for each channel separately. Window and border are those of 3DGS (GitHub
//! graphdeco-inria/gaussian-splatting, `utils/loss_utils.py`), so that figures compare with its
//! literature: 11x11 pixels, a Gaussian of 1.5 px, black outside the border.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::likeness::{mean_square, psnr_db, ssim};
//! use gs2e_image::{Image, Size};
//!
//! let size = Size { width: 8, height: 8 };
//! let (dark, bright) = (Image::filled(size, [0.5; 3]), Image::filled(size, [0.6; 3]));
//! // A difference of 1/10 everywhere has a mean square of 1/100: 20 dB.
//! assert!((psnr_db(mean_square(&dark, &bright)) - 20.0).abs() < 1e-4);
//! assert!((ssim(&dark, &dark) - 1.0).abs() < 1e-12);
//! ```

use super::Image;
use rayon::prelude::*;

/// Highest reported PSNR, dB: an error of 1e-5 of the range, at which 32-bit pictures are equal.
pub(crate) const MAX_DB: f64 = 100.0;

/// Pixels of the window on each side of its centre.
const REACH: usize = 5;
/// Pixels of the window along each edge.
const EDGE: usize = 2 * REACH + 1;
/// Standard deviation of the window, px.
const DEVIATION: f64 = 1.5;
/// `(K1 L)^2` and `(K2 L)^2` of the paper, `K1 = 0.01`, `K2 = 0.03`, `L = 1`.
const STEADIERS: [f64; 2] = [1e-4, 9e-4];

/// The mean of the squared differences of two pictures, over pixels and channels.
///
/// # Panics
/// They differ in size.
#[must_use]
pub fn mean_square(a: &Image<[f32; 3]>, b: &Image<[f32; 3]>) -> f64 {
    let square = |(a, b): (&f32, &f32)| (f64::from(*a) - f64::from(*b)) * (f64::from(*a) - f64::from(*b));
    let row = |row| {
        let [a, b] = [a, b].map(|image| self::image_row(image, row).as_flattened());
        a.iter().zip(b).map(square).sum::<f64>()
    };
    mean_of_rows(a, b, row)
}

/// The peak signal-to-noise ratio of a mean square, dB: `10 log10(1 / mean square)`, at most
/// `MAX_DB`.
#[must_use]
pub fn psnr_db(mean_square: f64) -> f64 {
    // A mean square of 0 gives infinity, which the minimum ends.
    (-10.0 * libm::log10(mean_square)).min(MAX_DB)
}

/// The structural similarity of two pictures: the mean over pixels and channels, 1 for equal ones.
///
/// # Panics
/// They differ in size.
#[must_use]
pub fn ssim(a: &Image<[f32; 3]>, b: &Image<[f32; 3]>) -> f64 {
    let window = window_weights();
    mean_of_rows(a, b, |row| {
        let moments = column_moments(a, b, row, &window).map(|column| along_row(&column, &window));
        let at = |i: usize| similarity(moments.each_ref().map(|moment| moment[i]));
        (0..a.size().width as usize).map(|x| (3 * x..3 * x + 3).map(at).sum::<f64>()).sum()
    })
}

/// The weights of the window along an edge; their sum is 1.
fn window_weights() -> [f64; EDGE] {
    let weight = |k: usize| {
        let from_centre = (k as f64 - REACH as f64) / DEVIATION;
        libm::exp(-0.5 * from_centre * from_centre)
    };
    let weights: [f64; EDGE] = std::array::from_fn(weight);
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// Equation 13 of the paper, of the weighted means of `a`, `b`, `a^2`, `b^2` and `ab`.
fn similarity([a, b, aa, bb, ab]: [f64; 5]) -> f64 {
    let [c1, c2] = STEADIERS;
    let means = (2.0 * a * b + c1) / (a * a + b * b + c1);
    // Moments in 64 bits: a variance is the difference of two numbers near 1, and is compared
    // with a steadier of 9e-4.
    let spreads = (2.0 * (ab - a * b) + c2) / ((aa - a * a) + (bb - b * b) + c2);
    means * spreads
}

/// The weighted means of `a`, `b`, `a^2`, `b^2` and `ab` of each column around a row, channels next to each
/// other. The window is a product of two, so columns are summed first: 22 terms per pixel instead of 121.
fn column_moments(
    a: &Image<[f32; 3]>,
    b: &Image<[f32; 3]>,
    row: usize,
    window: &[f64; EDGE],
) -> [Vec<f64>; 5] {
    // One plane for each moment, so that the loops over it are loops over vectors.
    let mut moments = [(); 5].map(|()| vec![0.0; 3 * a.size().width as usize]);
    let rows = (row..).zip(window).filter_map(|(k, weight)| Some((k.checked_sub(REACH)?, *weight)));
    for (k, weight) in rows.filter(|(k, _)| *k < a.size().height as usize) {
        let [a, b] = [a, b].map(|image| self::image_row(image, k).as_flattened());
        let [of_a, of_b, of_aa, of_bb, of_ab] = &mut moments;
        for (i, (a, b)) in a.iter().zip(b).enumerate() {
            let (a, b) = (f64::from(*a), f64::from(*b));
            of_a[i] += weight * a;
            of_b[i] += weight * b;
            of_aa[i] += weight * (a * a);
            of_bb[i] += weight * (b * b);
            of_ab[i] += weight * (a * b);
        }
    }
    moments
}

/// Sums a moment over the window along the row. Black outside the border: pixels out there add nothing.
fn along_row(column: &[f64], window: &[f64; EDGE]) -> Vec<f64> {
    let mut sums = vec![0.0; column.len()];
    for (k, weight) in window.iter().enumerate() {
        // The shift of weight `k` is `k - REACH` pixels, of three channels each; one of both differences is
        // 0.
        let [before, after] = [3 * REACH.saturating_sub(k), 3 * k.saturating_sub(REACH)];
        let from = column.get(after..).into_iter().flatten();
        let to = sums.get_mut(before..).into_iter().flatten();
        to.zip(from).for_each(|(sum, moment)| *sum += weight * moment);
    }
    sums
}

fn image_row(image: &Image<[f32; 3]>, row: usize) -> &[[f32; 3]] {
    let width = image.size().width as usize;
    &image.pixels()[row * width..][..width]
}

/// The sum over rows, per pixel and channel, in a fixed order for any number of threads.
fn mean_of_rows(a: &Image<[f32; 3]>, b: &Image<[f32; 3]>, sum: impl Fn(usize) -> f64 + Sync + Send) -> f64 {
    assert_eq!(a.size(), b.size(), "pictures of one size are compared");
    // The rows are collected first. A parallel sum would have an order of its own.
    let rows: Vec<f64> = (0..a.size().height as usize).into_par_iter().map(sum).collect();
    rows.iter().sum::<f64>() / (3 * a.size().pixels()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    const SIZE: Size = Size { width: 24, height: 17 };

    /// The picture with these numbers modulo 32, divided by 31, as channels.
    fn picture(value: impl Fn(usize, usize, usize) -> usize) -> Image<[f32; 3]> {
        let shade = |k: usize| std::array::from_fn(|c| (value(k % 24, k / 24, c) % 32) as f32 / 31.0);
        Image::from_vec(SIZE, (0..SIZE.pixels()).map(shade).collect())
    }

    fn waves() -> Image<[f32; 3]> {
        picture(|x, y, c| x * 7 + y * 13 + c * 29)
    }

    #[test]
    fn an_offset_is_told_in_decibels() {
        for levels in [1.0f32, 5.0, 51.0, 255.0] {
            let (dark, bright) = (Image::filled(SIZE, [0.0; 3]), Image::filled(SIZE, [levels / 255.0; 3]));
            let wanted = 20.0 * libm::log10(255.0 / f64::from(levels));
            let found = psnr_db(mean_square(&dark, &bright));
            // A difference in 32 bits is rounded at 6e-8 of itself, which is 20 / ln(10) times that
            // in dB.
            assert!((found - wanted).abs() < 1e-6, "{levels}: {found}, {wanted}");
        }
        assert!((psnr_db(0.0) - MAX_DB).abs() < 1e-12);
    }

    /// From numpy and scipy: `convolve2d` of each channel with the window, zeros outside the
    /// border.
    #[test]
    fn similarity_is_that_of_another_implementation() {
        let t = |other: &Image<[f32; 3]>, wanted: f64| {
            let found = ssim(&waves(), other);
            // Colours are rounded to 32 bits; the error grows where variances are small, 1e-3.
            assert!((found - wanted).abs() < 1e-5, "{found}, {wanted}");
        };
        t(&waves(), 1.0);
        t(&picture(|x, y, c| x * 7 + y * 13 + c * 29 + (x * y) % 5), 0.778_350_919);
        t(&picture(|x, y, c| x * 5 + y * 11 + c * 17), 0.192_752_498);
        assert!(
            (mean_square(&waves(), &picture(|x, y, c| x * 7 + y * 13 + c * 29 + (x * y) % 5))
                - 0.044_966_096)
                .abs()
                < 1e-6
        );
    }

    /// Constant pictures have no variance: `(2 a b + C1) / (a^2 + b^2 + C1)`, away from the border.
    #[test]
    fn constant_pictures_are_as_alike_as_their_means() {
        let size = Size { width: 400, height: 400 };
        let [a, b] = [0.25f32, 0.75].map(|v| Image::filled(size, [v; 3]));
        // (0.375 + 0.0001) / (0.625 + 0.0001)
        let within = ssim(&a, &b) - 0.600_064;
        // Five of 400 pixels on each side see black outside: 5 % of all, each at most 1 off.
        assert!(within.abs() < 0.05, "{within}");
        let dots = [0.25f32, 0.75].map(|v| Image::filled(Size { width: 1, height: 1 }, [v; 3]));
        // The middle of the window weighs 0.26601172^2 = 0.0707622: means 0.0176906 and 0.0530717;
        // variances 0.0625 and 0.5625 times 0.0707622 minus the squared means; covariance 0.1875
        // times it minus the product of the means.
        let means = (0.001_877_735 + 0.0001) / (0.000_312_956 + 0.002_816_603 + 0.0001);
        let spreads = (0.024_658_103 + 0.0009) / (0.004_109_684 + 0.036_987_157 + 0.0009);
        let found = ssim(&dots[0], &dots[1]);
        assert!((found - means * spreads).abs() < 1e-6, "{found}");
    }

    #[test]
    fn likeness_does_not_depend_on_the_order_of_the_two() {
        let other = picture(|x, y, c| x * 5 + y * 11 + c * 17);
        assert_eq!(ssim(&waves(), &other).to_bits(), ssim(&other, &waves()).to_bits());
    }
}
