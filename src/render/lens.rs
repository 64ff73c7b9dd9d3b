//! Renderings through a lens that distorts: a pinhole image with a wider field, resampled at the places where the
//! lens shows its rays.
//!
//! ```text
//! pixel (u, v) ─ camera^-1 ─ (x', y') ─ lens^-1 ─ (x, y) ─ wide camera ─ place in the wide image
//! ```
//!
//! The wide camera has the lens's own magnification where that is largest, so no detail is lost. Brightness is
//! interpolated by Catmull and Rom's cubic over 4x4 pixels, which has no error for parabolas and keeps centroids. Depth
//! is that of the nearest pixel, since a mean of a near and a far depth is neither. The flow follows from that depth and
//! the ray of the pixel, through the derivatives of the lens.

use super::shared::MAX_EDGE;
use super::{CameraView, ChannelSet, OmissionPolicy, RenderError, RenderWork, RenderedImages, Renderer};
use crate::camera::Camera;
use crate::image::{Image, Size};
use crate::se3::Se3;
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;
use std::fmt;
use std::str::FromStr;

/// Largest coordinate of a ray at focal length 1 that a wide image holds: 76 degrees from the axis. Beyond it, the
/// wide image grows without bound.
const WIDEST: f64 = 4.0;
/// Largest number of pixels of a wide image.
const MAX_PIXELS: usize = 1 << 26;
/// Pixels around the field, for the interpolation.
const MARGIN: f64 = 3.0;
/// Largest number of Newton's steps, and the distance from the wanted point at which they end.
const STEPS: usize = 50;
const SETTLED: f64 = 1e-13;
/// Points on the way from the axis to a ray at which the lens must not fold.
const PROBES: u32 = 32;

/// A lens that distorts, with the models and coefficients of OpenCV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// Radial and tangential, or rational.
    Rational {
        /// Coefficients k1, k2, p1, p2, k3, k4, k5, k6.
        k: [f64; 8],
    },
    /// Fisheye (Kannala and Brandt 2006): `theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`.
    Fisheye {
        /// Coefficients k1 to k4.
        k: [f64; 4],
    },
}

impl Distortion {
    /// The image of a ray at focal length 1, and its derivatives by the ray.
    #[must_use]
    pub fn distort(&self, ray: DVec2) -> (DVec2, DMat2) {
        match self {
            Self::Rational { k } => rational(*k, ray),
            Self::Fisheye { k } => fisheye(*k, ray),
        }
    }

    /// The ray at focal length 1 whose image is at this point. `None` if no ray has it before the image folds.
    #[must_use]
    pub fn undistort(&self, image: DVec2) -> Option<DVec2> {
        let mut ray = self.start(image)?;
        for _ in 0..STEPS {
            let (found, slopes) = self.distort(ray);
            let off = found - image;
            if off.length() <= SETTLED * (1.0 + image.length()) {
                return self.is_unfolded(ray).then_some(ray);
            }
            let step = slopes.inverse() * off;
            // A step is at most half of the way to the axis and a half, so that the search stays near.
            let most = 0.5 * (ray.length() + 0.5);
            ray -= if step.length() > most { step * (most / step.length()) } else { step };
            if !ray.is_finite() {
                return None;
            }
        }
        None
    }

    /// The first guess of a ray.
    fn start(&self, image: DVec2) -> Option<DVec2> {
        match self {
            Self::Rational { .. } => Some(image),
            // The angle of a fisheye without coefficients, within the field of a pinhole.
            Self::Fisheye { .. } => {
                let angle = image.length().min(libm::atan(WIDEST));
                Some(image * if angle > 0.0 { libm::tan(angle) / image.length() } else { 1.0 })
            }
        }
    }

    /// Returns true if the lens keeps the order of the rays from the axis to this one.
    fn is_unfolded(&self, ray: DVec2) -> bool {
        (1..=PROBES).all(|probe| {
            let (_, slopes) = self.distort(ray * (f64::from(probe) / f64::from(PROBES)));
            slopes.determinant() > 0.0
        })
    }
}

/// OpenCV's rational model and its derivatives. `src/source/lens.rs` has the formula.
fn rational([k1, k2, p1, p2, k3, k4, k5, k6]: [f64; 8], ray: DVec2) -> (DVec2, DMat2) {
    let [x, y] = ray.to_array();
    let r2 = x * x + y * y;
    let (top, bottom) = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    let (top_slope, bottom_slope) =
        (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2), k4 + r2 * (2.0 * k5 + 3.0 * k6 * r2));
    let radial = top / bottom;
    // By x and by y: twice x and twice y, times this.
    let slope = 2.0 * (top_slope - radial * bottom_slope) / bottom;
    let image = DVec2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
    );
    let across = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
    let by_x = DVec2::new(radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x, across);
    let by_y = DVec2::new(across, radial + slope * y * y + 2.0 * p2 * x + 6.0 * p1 * y);
    (image, DMat2::from_cols(by_x, by_y))
}

fn fisheye([k1, k2, k3, k4]: [f64; 4], ray: DVec2) -> (DVec2, DMat2) {
    let r = ray.length();
    // Below this, the angle and its image are the radius to 64 bits.
    if r < 1e-9 {
        return (ray, DMat2::IDENTITY);
    }
    let angle = libm::atan(r);
    let a2 = angle * angle;
    let bent = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
    let bent_slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)));
    let (scale, along) = (bent / r, bent_slope / (1.0 + r * r));
    let axis = ray / r;
    // Along the radius the slope is that of the angle, across it the ratio of the radii.
    let outer = DMat2::from_cols(axis * axis.x, axis * axis.y);
    (ray * scale, DMat2::IDENTITY * scale + outer * (along - scale))
}

impl fmt::Display for Distortion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, numbers) = match self {
            Self::Rational { k } => ("opencv", k.to_vec()),
            Self::Fisheye { k } => ("fisheye", k.to_vec()),
        };
        let numbers: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        write!(f, "{name}:{}", numbers.join(","))
    }
}

impl FromStr for Distortion {
    type Err = String;

    /// Reads `opencv:k1,k2,p1,p2`, with `,k3` or `,k3,k4,k5,k6` after it, or `fisheye:k1,k2,k3,k4`.
    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = "wanted opencv:k1,k2,p1,p2[,k3[,k4,k5,k6]] or fisheye:k1,k2,k3,k4";
        let Some((name, numbers)) = text.split_once(':') else {
            return Err(format!("found no model, {wanted}"));
        };
        let number = |part: &str| {
            let value = part.trim().parse().ok().filter(|v: &f64| v.is_finite());
            value.ok_or_else(|| format!("`{part}` is not a finite number, {wanted}"))
        };
        let k: Vec<f64> = numbers.split(',').map(number).collect::<Result<_, _>>()?;
        match (name, k.len()) {
            ("opencv", 4 | 5 | 8) => {
                let mut all = [0.0; 8];
                all[..k.len()].copy_from_slice(&k);
                Ok(Self::Rational { k: all })
            }
            ("fisheye", 4) => Ok(Self::Fisheye { k: [k[0], k[1], k[2], k[3]] }),
            ("opencv" | "fisheye", found) => Err(format!("found {found} numbers, {wanted}")),
            _ => Err(format!("`{name}` is no model, {wanted}")),
        }
    }
}

/// The wide camera of a view, and the places of its pixels.
#[derive(Debug)]
pub struct LensMap {
    camera: Camera,
    /// The pinhole camera that is rendered.
    pub wide: Camera,
    rays: Vec<DVec2>,
}

impl LensMap {
    /// The map of a camera behind a lens.
    ///
    /// # Errors
    /// A pixel shows no ray, the field is too wide for a pinhole image, or the image would be too large.
    pub fn new(camera: Camera, lens: &Distortion) -> Result<Self, RenderError> {
        if camera.size.pixels() > MAX_PIXELS {
            let because = format!("a picture of {}, wanted at most {MAX_PIXELS} pixels", camera.size);
            return Err(RenderError::View(because));
        }
        let width = camera.size.width as usize;
        let found: Vec<Option<DVec2>> = (0..camera.size.pixels())
            .into_par_iter()
            .map(|i| {
                let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                let principal = DVec2::new(camera.cx, camera.cy);
                lens.undistort((pixel - principal) / DVec2::new(camera.fx, camera.fy))
            })
            .collect();
        if let Some(lost) = found.iter().position(Option::is_none) {
            let because = format!(
                "pixel ({}, {}) shows no ray: the lens {lens} folds, or bends by 90 degrees, before it",
                lost % width,
                lost / width
            );
            return Err(RenderError::View(because));
        }
        let rays: Vec<DVec2> = found.into_iter().flatten().collect();
        let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (low, high) = rays.iter().fold(start, |(low, high), ray| (low.min(*ray), high.max(*ray)));
        let furthest = rays.iter().map(|ray| ray.length()).fold(0.0, f64::max);
        if furthest > WIDEST {
            let degrees = libm::atan(furthest).to_degrees();
            return Err(RenderError::View(format!(
                "the field reaches {degrees:.1} degrees from the axis, wanted at most 76: no pinhole image holds it"
            )));
        }
        let wide = Self::wide_camera(camera, lens, &rays, [low, high])?;
        Ok(Self { camera, wide, rays })
    }

    /// The pinhole camera of these rays, with the largest magnification of the lens.
    fn wide_camera(
        camera: Camera,
        lens: &Distortion,
        rays: &[DVec2],
        [low, high]: [DVec2; 2],
    ) -> Result<Camera, RenderError> {
        let most = rays.par_iter().map(|ray| magnification(lens.distort(*ray).1)).reduce(|| 1.0, f64::max);
        let focal = DVec2::new(camera.fx, camera.fy) * most;
        let [least, extent] = [low * focal, (high - low) * focal];
        let [width, height] = [extent.x, extent.y].map(|side| libm::ceil(side + 2.0 * MARGIN));
        // Compared as numbers, since a cast would saturate.
        if width.max(height) > f64::from(MAX_EDGE) || width * height > MAX_PIXELS as f64 {
            return Err(RenderError::View(format!(
                "the field of the lens takes a pinhole image of {width} x {height} px, wanted at most {MAX_EDGE} px \
                 along each edge and {MAX_PIXELS} pixels"
            )));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "within the limits above"
        )]
        let size = Size { width: width as u32, height: height as u32 };
        Ok(Camera { size, fx: focal.x, fy: focal.y, cx: MARGIN - least.x, cy: MARGIN - least.y })
    }

    /// Place of a pixel in the wide image, px.
    fn place(&self, i: usize) -> DVec2 {
        let wide = &self.wide;
        self.rays[i] * DVec2::new(wide.fx, wide.fy) + DVec2::new(wide.cx, wide.cy)
    }

    fn each<T: Copy + Default + Send>(&self, value: impl Fn(usize) -> T + Sync + Send) -> Image<T> {
        let pixels = (0..self.rays.len()).into_par_iter().map(value).collect();
        Image::from_vec(self.camera.size, pixels)
    }

    /// Brightness at the pixels' places.
    fn resampled<const N: usize>(&self, wide: &[[f32; N]]) -> Vec<[f32; N]> {
        let width = self.wide.size.width as usize;
        let pixel = |i: usize| {
            let place = self.place(i) - 0.5;
            let corner = place.floor();
            let (across, down) = (cubic_weights(place.x - corner.x), cubic_weights(place.y - corner.y));
            let first = [corner.x, corner.y].map(index).map(|at| at - 1);
            let mut sums = [0.0; N];
            for (row, weight) in down.iter().enumerate() {
                let start = (first[1] + row) * width + first[0];
                for (pixel, share) in wide[start..start + 4].iter().zip(across) {
                    for (sum, value) in sums.iter_mut().zip(pixel) {
                        *sum += weight * share * f64::from(*value);
                    }
                }
            }
            sums.map(single)
        };
        (0..self.rays.len()).into_par_iter().map(pixel).collect()
    }

    fn single_resampled(&self, wide: &Image<f32>) -> Image<f32> {
        let (pixels, _) = wide.pixels().as_chunks::<1>();
        let pixels = self.resampled(pixels).into_iter().map(|[value]| value).collect();
        Image::from_vec(self.camera.size, pixels)
    }

    /// A share of the nearest pixels, without what a cubic overshoots.
    fn share_resampled(&self, wide: &Image<f32>) -> Image<f32> {
        let mut image = self.single_resampled(wide);
        image.pixels_mut().iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        image
    }

    /// The value of the nearest pixel: a depth, or a part.
    fn nearest<T: Copy + Default + Send + Sync>(&self, wide: &Image<T>) -> Image<T> {
        let width = self.wide.size.width as usize;
        self.each(|i| {
            let [x, y] = self.place(i).to_array().map(index);
            wide.pixels()[y * width + x]
        })
    }

    /// Image velocity of the point at each pixel's depth, px/s of the distorted image. The point rests in the axes
    /// of its part, which has one of `views`; without parts, it is still. What changes adds its velocity.
    fn flow(
        &self,
        lens: &Distortion,
        (depth, segments, drift): SeenMotion<'_>,
        views: &[CameraView],
    ) -> Image<[f32; 2]> {
        let focal = DVec2::new(self.camera.fx, self.camera.fy);
        self.each(|i| {
            let (ray, z) = (self.rays[i], f64::from(depth.pixels()[i]));
            let velocity = views[segments.map_or(0, |segments| usize::from(segments.pixels()[i]))].velocity;
            let point = DVec3::new(ray.x, ray.y, 1.0) * z;
            let own = drift.map_or(DVec3::ZERO, |drift| DVec3::from_array(drift.pixels()[i].map(f64::from)));
            let moved = own - velocity.linear - velocity.angular.cross(point);
            let along = (DVec2::new(moved.x, moved.y) - ray * moved.z) / z;
            (lens.distort(ray).1 * along * focal).to_array().map(single)
        })
    }
}

/// The largest magnification of a map.
fn magnification(slopes: DMat2) -> f64 {
    let [a, b] =
        [slopes.x_axis.length_squared() + slopes.y_axis.length_squared(), slopes.determinant().abs()];
    // The larger singular value of a 2x2 matrix.
    ((a + (a * a - 4.0 * b * b).max(0.0).sqrt()) / 2.0).sqrt()
}

/// Weights of the four pixels around a place; the second of them is `s` before it (Keys 1981, with a slope of -1/2).
fn cubic_weights(s: f64) -> [f64; 4] {
    let (s2, s3) = (s * s, s * s * s);
    [
        0.5 * (-s + 2.0 * s2 - s3),
        0.5 * (2.0 - 5.0 * s2 + 3.0 * s3),
        0.5 * (s + 4.0 * s2 - 3.0 * s3),
        0.5 * (s3 - s2),
    ]
}

/// The pixel of a coordinate that is within the image.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the margin keeps places inside")]
fn index(at: f64) -> usize {
    at as usize
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
fn single(value: f64) -> f32 {
    value as f32
}

/// Depth, parts and velocities of an image.
type SeenMotion<'a> = (&'a Image<f32>, Option<&'a Image<u8>>, Option<&'a Image<[f32; 3]>>);

/// A renderer behind a lens.
pub struct LensRenderer {
    inner: Box<dyn Renderer>,
    lens: Distortion,
    /// The map of the latest camera.
    map: Option<LensMap>,
    seen: RenderedImages,
}

impl fmt::Debug for LensRenderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LensRenderer").field("lens", &self.lens).finish_non_exhaustive()
    }
}

impl LensRenderer {
    /// The views of a renderer through this lens.
    #[must_use]
    pub fn new(inner: Box<dyn Renderer>, lens: Distortion) -> Self {
        Self { inner, lens, map: None, seen: RenderedImages::default() }
    }

    fn map_of(&mut self, camera: Camera) -> Result<(), RenderError> {
        if self.map.as_ref().is_none_or(|map| map.camera != camera) {
            super::check_view(&CameraView::at_rest(camera, Se3::IDENTITY))?;
            self.map = Some(LensMap::new(camera, &self.lens)?);
        }
        Ok(())
    }
}

impl Renderer for LensRenderer {
    fn fingerprint(&self) -> &str {
        self.inner.fingerprint()
    }

    fn omit(&mut self, omit: OmissionPolicy) {
        self.inner.omit(omit);
    }

    fn has_parts(&self) -> bool {
        self.inner.has_parts()
    }

    fn is_dynamic(&self) -> bool {
        self.inner.is_dynamic()
    }

    fn part_views(&self, view: &CameraView) -> Vec<CameraView> {
        self.inner.part_views(view)
    }

    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        self.map_of(view.camera)?;
        let Self { inner, lens, map, seen } = self;
        let map = map.as_ref().expect("it was made above");
        let wide = CameraView { camera: map.wide, ..*view };
        let asked = ChannelSet { depth: want.depth || want.flow, flow: false, ..want };
        let moving = if want.flow { inner.motion_channels() } else { ChannelSet::NONE };
        let work = inner.render(&wide, asked.with(moving), seen)?;
        let depth = seen.depth.as_ref().map(|depth| map.nearest(depth));
        let segments = seen.segments.as_ref().map(|segments| map.nearest(segments));
        let drift = seen.drift.as_ref().map(|drift| map.nearest(drift));
        let views = inner.part_views(&wide);
        *out = RenderedImages {
            rgb: seen.rgb.as_ref().map(|rgb| Image::from_vec(map.camera.size, map.resampled(rgb.pixels()))),
            luminance: seen.luminance.as_ref().map(|image| map.single_resampled(image)),
            alpha: seen.alpha.as_ref().map(|image| map.share_resampled(image)),
            flow: depth
                .as_ref()
                .filter(|_| want.flow)
                .map(|depth| map.flow(lens, (depth, segments.as_ref(), drift.as_ref()), &views)),
            depth: depth.filter(|_| want.depth),
            luminance_rate: seen.luminance_rate.as_ref().map(|image| map.single_resampled(image)),
            doubtful: seen.doubtful.as_ref().map(|image| map.share_resampled(image)),
            segments,
            drift,
        };
        out.clear_all_but(want);
        Ok(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { size: Size { width: 64, height: 48 }, fx: 40.0, fy: 42.0, cx: 31.0, cy: 25.0 };

    fn lens(text: &str) -> Distortion {
        text.parse().unwrap()
    }

    const LENSES: [&str; 4] = [
        "opencv:0.1,-0.05,0.002,-0.003",
        "opencv:-0.3,0.1,0.001,0.0005,-0.01",
        "opencv:0.2,-0.1,0.003,-0.002,0.05,0.11,-0.07,0.02",
        "fisheye:0.01,-0.02,0.003,0.001",
    ];

    #[test]
    fn rays_are_found_again_and_slopes_are_those_of_the_map() {
        for lens in LENSES.map(lens) {
            for i in 0..21 * 21 {
                let ray = DVec2::new(f64::from(i % 21) - 10.0, f64::from(i / 21) - 10.0) * 0.07;
                let (image, slopes) = lens.distort(ray);
                let found = lens.undistort(image).unwrap();
                assert!((found - ray).length() < 1e-11, "{lens}: {ray} {found}");
                // Central differences: an error of h^2 times third derivatives of a few.
                let h = 1e-5;
                for (axis, slope) in [(DVec2::X, slopes.x_axis), (DVec2::Y, slopes.y_axis)] {
                    let difference =
                        (lens.distort(ray + axis * h).0 - lens.distort(ray - axis * h).0) / (2.0 * h);
                    assert!((difference - slope).length() < 1e-8, "{lens}: {ray} {difference} {slope}");
                }
            }
        }
    }

    /// Reference values: `cv2.projectPoints` and `cv2.fisheye.projectPoints` of OpenCV 5.0 with an identity camera
    /// matrix, on (0.3, -0.2, 1), printed with eight digits.
    #[test]
    fn models_are_opencvs() {
        let t = |text: &str, wanted: [f64; 2]| {
            let found = lens(text).distort(DVec2::new(0.3, -0.2)).0;
            assert!((found - DVec2::from(wanted)).length() < 1e-8, "{text}: {found}");
        };
        t("opencv:0.0578,-0.0805,-0.00098,0.000156,0.01", [0.302_018_62, -0.201_459_62]);
        t("fisheye:0.01,-0.02,0.003,0.001", [0.288_192_21, -0.192_128_14]);
    }

    #[test]
    fn a_lens_that_folds_or_sees_too_far_is_refused_by_name() {
        let t = |text: &str, camera: Camera, because: &str| {
            let error = LensMap::new(camera, &lens(text)).unwrap_err().to_string();
            assert!(error.contains(because), "{text}: {error}");
        };
        t("opencv:-0.9,0,0,0", CAMERA, "shows no ray");
        t("opencv:0,0,0,0", Camera { fx: 5.0, fy: 5.0, ..CAMERA }, "wanted at most 76");
        t("fisheye:0,0,0,0", Camera { fx: 22.0, fy: 22.0, ..CAMERA }, "degrees");
        let edge = Camera {
            size: Size { width: 9000, height: 9000 },
            fx: 9000.0,
            fy: 9000.0,
            cx: 4500.0,
            cy: 4500.0,
        };
        t("opencv:0,0,0,0", edge, "wanted at most");
    }

    #[test]
    fn lenses_are_read_from_texts() {
        for text in LENSES {
            let read = lens(text);
            assert_eq!(lens(&read.to_string()), read);
        }
        let t = |text: &str, because: &str| {
            let error = text.parse::<Distortion>().unwrap_err();
            assert!(error.contains(because), "{text}: {error}");
        };
        t("0.1,0.2", "found no model");
        t("opencv:1,2,3", "found 3 numbers");
        t("brown:1,2,3,4", "`brown` is no model");
        t("fisheye:1,2,x,4", "`x` is not a finite number");
    }

    /// Paints a plane wave of this period over the wide image, so that the pixel of a ray is known in closed form.
    struct Wave {
        period_px: f64,
    }

    impl Wave {
        fn at(&self, ray: DVec2) -> f64 {
            0.5 + 0.4 * libm::sin(std::f64::consts::TAU * 40.0 * (ray.x + 0.7 * ray.y) / self.period_px)
        }
    }

    impl Renderer for Wave {
        fn fingerprint(&self) -> &'static str {
            "wave"
        }

        fn render(
            &mut self,
            view: &CameraView,
            _: ChannelSet,
            out: &mut RenderedImages,
        ) -> Result<RenderWork, RenderError> {
            let camera = view.camera;
            let ray = |i: usize| {
                let pixel =
                    [i % camera.size.width as usize, i / camera.size.width as usize].map(|k| k as f64 + 0.5);
                DVec2::new((pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy)
            };
            let pixels: Vec<f32> = (0..camera.size.pixels()).map(|i| single(self.at(ray(i)))).collect();
            out.luminance = Some(Image::from_vec(camera.size, pixels.clone()));
            out.depth = Some(Image::from_vec(camera.size, pixels));
            Ok(RenderWork::default())
        }
    }

    /// The cubic misses a wave with the phase `p` from pixel to pixel by at most `0.008 p^3 + 0.024 p^4` of its
    /// amplitude along each axis: below `p^3 / 8` for both.
    #[test]
    fn resampling_has_the_error_of_a_cubic() {
        let mut errors = Vec::new();
        for period_px in [8.0, 16.0, 32.0] {
            let mut worst = 0.0f64;
            for lens in LENSES.map(lens) {
                let mut renderer = LensRenderer::new(Box::new(Wave { period_px }), lens);
                let mut out = RenderedImages::default();
                let want = ChannelSet { luminance: true, depth: true, ..ChannelSet::NONE };
                renderer.render(&CameraView::at_rest(CAMERA, Se3::IDENTITY), want, &mut out).unwrap();
                let (map, wave) = (renderer.map.as_ref().unwrap(), Wave { period_px });
                for (i, found) in out.luminance.unwrap().pixels().iter().enumerate() {
                    worst = worst.max((f64::from(*found) - wave.at(map.rays[i])).abs());
                }
                // The nearest pixel is at most half a diagonal away, times the slope of the wave.
                let slope = 0.4 * std::f64::consts::TAU / period_px * 1.23;
                for (i, found) in out.depth.unwrap().pixels().iter().enumerate() {
                    let off = (f64::from(*found) - wave.at(map.rays[i])).abs();
                    assert!(off <= slope * std::f64::consts::FRAC_1_SQRT_2 + 1e-6, "{off}");
                }
            }
            let phase = std::f64::consts::TAU * 1.23 / period_px;
            assert!(worst < 0.4 * phase * phase * phase / 8.0 + 1e-6, "{period_px}: {worst}");
            errors.push(worst);
        }
        // Third order: a factor of eight from one to the next.
        assert!(errors[0] / errors[1] > 6.0 && errors[1] / errors[2] > 6.0, "{errors:?}");
    }
}
