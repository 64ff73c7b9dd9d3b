//! Renderings through a lens that distorts: a pinhole image with a wider field, resampled at the places where
//! the lens shows its rays.
//!
//! ```text
//! pixel (u, v) ─ camera^-1 ─ (x', y') ─ lens^-1 ─ (x, y) ─ wide camera ─ place in the wide image
//! ```
//!
//! The wide camera has the lens's own magnification where that is largest, so no detail is lost. Brightness
//! is interpolated by Catmull and Rom's cubic over 4x4 pixels, which has no error for parabolas and keeps
//! centroids. The cubic is the same at all times, so that rates stay the derivatives of what they belong to.
//! Depth is that of the nearest pixel, since a mean of a near and a far depth is neither. The flow follows
//! from that depth and the ray of the pixel, through the derivatives of the lens.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
//! use gs2e_render::{cpu::CpuRenderer, lens::LensRenderer};
//! use gs2e_scene::camera::{Camera, lens::Distortion, view::CameraView};
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 4.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! # let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! let fisheye = Camera { lens: Some(Distortion::Fisheye([0.0; 4])), ..camera };
//! let mut renderer = LensRenderer::new(Box::new(CpuRenderer::new(scene.into(), style)?));
//! let (want, mut images) = (ChannelSet { depth: true, ..ChannelSet::NONE }, RenderedImages::default());
//! renderer.render(&CameraView::at_rest(fisheye, Se3::IDENTITY), want, &mut images)?;
//! // The only Gaussian of `scene` is on the axis at depth 2, and the lens does not bend this ray.
//! let depth = images.depth.ok_or("no depth")?;
//! assert!((depth.pixels()[4 * 9 + 4] - 2.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::sample::TileSample;
use super::shared::MAX_EDGE;
use super::{ChannelSet, OmissionPolicy, RenderError, RenderWork, RenderedImages, Renderer};
use glam::{DMat2, DVec2, DVec3};
use gs2e_image::{Image, Size};
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::lens::{Distortion, WIDEST};
use gs2e_scene::camera::view::CameraView;
use rayon::prelude::*;
use std::fmt;
use std::sync::Arc;

/// Largest number of pixels of a wide image.
const MAX_PIXELS: usize = 1 << 26;
/// Pixels around the field, for the interpolation.
const MARGIN: f64 = 3.0;
/// Pixels along each axis from which a pixel is interpolated.
const TAPS: usize = 4;

/// The wide camera of a view, and the places of its pixels.
#[derive(Debug)]
struct LensMap {
    camera: Camera,
    /// The pinhole camera that is rendered.
    wide: Camera,
    rays: Vec<DVec2>,
}

impl LensMap {
    /// The map of a camera behind this lens, which it has.
    ///
    /// # Errors
    /// A pixel shows no ray, the field is too wide for a pinhole image, or the image would be too large.
    fn new(camera: Camera, lens: &Distortion) -> Result<Self, RenderError> {
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
        let furthest = rays.iter().map(|ray| ray.length()).fold(0.0, f64::max);
        if furthest > WIDEST {
            let degrees = libm::atan(furthest).to_degrees();
            return Err(RenderError::View(format!(
                "the field reaches {degrees:.1} degrees from the axis, wanted at most 76: no pinhole image holds it"
            )));
        }
        let wide = Self::wide_camera(camera, lens, &rays)?;
        Ok(Self { camera, wide, rays })
    }

    /// The pinhole camera of these rays, with the largest magnification of the lens.
    fn wide_camera(camera: Camera, lens: &Distortion, rays: &[DVec2]) -> Result<Camera, RenderError> {
        let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (low, high) = rays.iter().fold(start, |(low, high), ray| (low.min(*ray), high.max(*ray)));
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
        // The principal point puts the leftmost and the uppermost ray `MARGIN` px inside the edges.
        Ok(Camera::pinhole(size, [focal.x, focal.y, MARGIN - least.x, MARGIN - least.y]))
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
            // The cubic takes one pixel before the place and two behind. `MARGIN` keeps all of them inside.
            let first = [corner.x, corner.y].map(index).map(|at| at - 1);
            let mut sums = [0.0; N];
            for (row, weight) in down.iter().enumerate() {
                let start = (first[1] + row) * width + first[0];
                for (pixel, share) in wide[start..start + TAPS].iter().zip(across) {
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

    /// The value of the nearest pixel: a depth, or the number of an object.
    fn nearest<T: Copy + Default + Send + Sync>(&self, wide: &Image<T>) -> Image<T> {
        let width = self.wide.size.width as usize;
        self.each(|i| {
            let [x, y] = self.place(i).to_array().map(index);
            wide.pixels()[y * width + x]
        })
    }

    /// Image velocity of the point at each pixel's depth, px/s of the distorted image. The point rests in the
    /// axes of its object, which has one of `views`; without objects, it is still. What changes adds its
    /// velocity.
    fn flow(&self, depth: &Image<f32>, images: &RenderedImages, views: &[CameraView]) -> Image<[f32; 2]> {
        let (segmentation, drift) = (images.segmentation.as_ref(), images.drift.as_ref());
        self.each(|i| {
            let velocity =
                views[segmentation.map_or(0, |segmentation| usize::from(segmentation.pixels()[i]))].velocity;
            let point = self.rays[i].extend(1.0) * f64::from(depth.pixels()[i]);
            let own = drift.map_or(DVec3::ZERO, |drift| DVec3::from_array(drift.pixels()[i].map(f64::from)));
            let moving = own - velocity.linear - velocity.angular.cross(point);
            self.camera.velocity(point, moving).to_array().map(single)
        })
    }

    /// The tiles of the wide image from which the pixels of a sample are interpolated.
    fn sampled(&self, sample: &TileSample) -> Arc<TileSample> {
        let corner = |i: usize| (self.place(i) - 0.5).floor().to_array().map(|at| index(at) - 1);
        Arc::new(TileSample::under(self.wide.size, sample.pixels().into_iter().map(corner), TAPS))
    }
}

/// Size of the picture that is rendered for a camera: that of the wide camera, by the rays of its edge, or
/// its own.
#[must_use]
pub fn rendered_size(camera: &Camera) -> Size {
    let Some(lens) = &camera.lens else { return camera.size };
    let rays: Vec<DVec2> =
        camera.edge().map(|pixel| camera.ray(pixel.map(|at| f64::from(at) + 0.5))).collect();
    LensMap::wide_camera(*camera, lens, &rays).map_or(camera.size, |wide| wide.size)
}

/// The largest magnification of a map.
fn magnification(slopes: DMat2) -> f64 {
    let [a, b] =
        [slopes.x_axis.length_squared() + slopes.y_axis.length_squared(), slopes.determinant().abs()];
    // The larger singular value: the squares of both sum to `a`, and both multiply to `b`. Where they are
    // equal, the difference may round below 0.
    ((a + (a * a - 4.0 * b * b).max(0.0).sqrt()) / 2.0).sqrt()
}

/// Weights of the four pixels around a place; the second of them is `s` before it (Keys 1981, with a slope of
/// -1/2).
fn cubic_weights(s: f64) -> [f64; TAPS] {
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

/// A renderer that sees cameras with a lens through it, and others as they are.
pub struct LensRenderer {
    inner: Box<dyn Renderer>,
    /// The map of the latest camera with a lens.
    map: Option<LensMap>,
    /// The promised sample of later frames.
    sample: Option<Arc<TileSample>>,
    wide_images: RenderedImages,
}

impl fmt::Debug for LensRenderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fingerprint = self.inner.fingerprint();
        f.debug_struct("LensRenderer").field("inner", &fingerprint).finish_non_exhaustive()
    }
}

impl LensRenderer {
    /// The views of this renderer, which knows pinhole cameras.
    #[must_use]
    pub fn new(inner: Box<dyn Renderer>) -> Self {
        Self { inner, map: None, sample: None, wide_images: RenderedImages::default() }
    }

    /// Makes the map of a camera, unless it has no lens.
    fn map_of(&mut self, camera: Camera) -> Result<Option<&LensMap>, RenderError> {
        let Some(lens) = camera.lens else { return Ok(None) };
        if self.map.as_ref().is_none_or(|map| map.camera != camera) {
            super::check_view(&CameraView::at_rest(Camera { lens: None, ..camera }, Se3::IDENTITY))?;
            if !lens.coefficients().iter().all(|k| k.is_finite()) {
                return Err(RenderError::View(format!("the coefficients of the lens {lens} are not finite")));
            }
            let map = LensMap::new(camera, &lens)?;
            if let Some(sample) = &self.sample {
                self.inner.sample(Some(map.sampled(sample)));
            }
            self.map = Some(map);
        }
        Ok(self.map.as_ref())
    }

    /// The pinhole camera that is rendered for a camera; the camera itself if no picture can be made with its
    /// lens, which rendering reports.
    fn rendered_camera(&mut self, camera: &Camera) -> Camera {
        match self.map_of(*camera) {
            Ok(Some(map)) => map.wide,
            Ok(None) | Err(_) => Camera { lens: None, ..*camera },
        }
    }

    /// The images that the pinhole camera renders for these.
    fn asked(&self, want: ChannelSet) -> ChannelSet {
        let moving = if want.flow { self.inner.motion_channels() } else { ChannelSet::NONE };
        ChannelSet { depth: want.depth || want.flow, flow: false, ..want }.with(moving)
    }
}

impl Renderer for LensRenderer {
    fn fingerprint(&self) -> &str {
        self.inner.fingerprint()
    }

    fn omit(&mut self, omit: OmissionPolicy) {
        self.inner.omit(omit);
    }

    fn keep_to(&mut self, camera: &Camera, poses: &[Se3]) {
        let pinhole = self.rendered_camera(camera);
        self.inner.keep_to(&pinhole, poses);
    }

    fn keep_also(&mut self, camera: &Camera, poses: &[Se3]) {
        let pinhole = self.rendered_camera(camera);
        self.inner.keep_also(&pinhole, poses);
    }

    fn work_within(&self, work: RenderWork) -> RenderWork {
        self.inner.work_within(work)
    }

    fn sample(&mut self, sample: Option<Arc<TileSample>>) {
        let mapped = match (&self.map, &sample) {
            (Some(map), Some(sample)) => Some(map.sampled(sample)),
            _ => sample.clone(),
        };
        self.sample = sample;
        self.inner.sample(mapped);
    }

    fn motion_channels(&self) -> ChannelSet {
        self.inner.motion_channels()
    }

    fn object_views(&self, view: &CameraView) -> Vec<CameraView> {
        self.inner.object_views(view)
    }

    fn expect(&mut self, view: &CameraView, want: ChannelSet) {
        if view.camera.lens.is_none() {
            return self.inner.expect(view, want);
        }
        let wide = CameraView { camera: self.rendered_camera(&view.camera), ..*view };
        let asked = self.asked(want);
        self.inner.expect(&wide, asked);
    }

    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        if self.map_of(view.camera)?.is_none() {
            return self.inner.render(view, want, out);
        }
        let asked = self.asked(want);
        let Self { inner, map, wide_images, .. } = self;
        let map = map.as_ref().expect("it was made above");
        let wide = CameraView { camera: map.wide, ..*view };
        let work = inner.render(&wide, asked, wide_images)?;
        *out = RenderedImages {
            rgb: wide_images
                .rgb
                .as_ref()
                .map(|rgb| Image::from_vec(map.camera.size, map.resampled(rgb.pixels()))),
            luminance: wide_images.luminance.as_ref().map(|image| map.single_resampled(image)),
            alpha: wide_images.alpha.as_ref().map(|image| map.share_resampled(image)),
            flow: None,
            depth: wide_images.depth.as_ref().map(|depth| map.nearest(depth)),
            luminance_rate: wide_images.luminance_rate.as_ref().map(|image| map.single_resampled(image)),
            doubtful: wide_images.doubtful.as_ref().map(|image| map.share_resampled(image)),
            segmentation: wide_images.segmentation.as_ref().map(|segmentation| map.nearest(segmentation)),
            drift: wide_images.drift.as_ref().map(|drift| map.nearest(drift)),
        };
        let depth = out.depth.as_ref().filter(|_| want.flow);
        out.flow = depth.map(|depth| map.flow(depth, out, &inner.object_views(&wide)));
        out.clear_all_but(want);
        Ok(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_testing::LENSES;

    const CAMERA: Camera =
        Camera { size: Size { width: 64, height: 48 }, fx: 40.0, fy: 42.0, cx: 31.0, cy: 25.0, lens: None };

    fn lens(text: &str) -> Distortion {
        text.parse().unwrap()
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
        let edge = Camera::pinhole(Size { width: 9000, height: 9000 }, [9000.0, 9000.0, 4500.0, 4500.0]);
        t("opencv:0,0,0,0", edge, "wanted at most");
    }

    /// Paints a plane wave of this period over the wide image, so that the pixel of a ray is known in closed
    /// form.
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

    /// The cubic misses a wave with the phase `p` from pixel to pixel by at most `0.008 p^3 + 0.024 p^4` of
    /// its amplitude along each axis: below `p^3 / 8` for both.
    #[test]
    fn resampling_has_the_error_of_a_cubic() {
        let mut errors = Vec::new();
        for period_px in [8.0, 16.0, 32.0] {
            let mut worst = 0.0f64;
            for lens in LENSES.map(lens) {
                let mut renderer = LensRenderer::new(Box::new(Wave { period_px }));
                let mut out = RenderedImages::default();
                let want = ChannelSet { luminance: true, depth: true, ..ChannelSet::NONE };
                let camera = Camera { lens: Some(lens), ..CAMERA };
                renderer.render(&CameraView::at_rest(camera, Se3::IDENTITY), want, &mut out).unwrap();
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
