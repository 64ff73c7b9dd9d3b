//! The reference back end: f64, every pixel by itself, no lists, no shortcuts. It is slow; the
//! other back ends are compared with it.
//!
//! The rate of the luminance comes from dual numbers: the operations that make the image,
//! differentiated automatically.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{LayerOrder, RenderRules, RenderStyle};
//! # use gs2e_scene::camera::{Camera, view::CameraView};
//! use gs2e_render::reference::ReferenceRenderer;
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! # let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! // The only Gaussian of `scene` is grey, and covers half of the black in the middle pixel.
//! let renderer = ReferenceRenderer::new(scene.into(), style)?;
//! let pixels = renderer.luminance(&CameraView::at_rest(camera, Se3::IDENTITY))?;
//! let [value, rate] = pixels[4 * 9 + 4];
//! // Half of a half, and no change for a camera at rest.
//! assert!((value - 0.25).abs() < 1e-12 && rate == 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![expect(clippy::cast_possible_truncation, reason = "images hold 32 bits")]

#[cfg(test)]
pub(crate) mod adjoint;
mod parameters;
mod project;

use super::dual::{DualNumber, RealNumber};
use super::shared::{BLENDED_DEPTHS, DEPTH_MIN_ALPHA, MAX_ALPHA, STOP};
use super::{
    ChannelSet, LayerOrder, RenderError, RenderRules, RenderStyle, RenderWork, RenderedImages, Renderer,
    objects,
};
use glam::DVec3;
use gs2e_image::{Image, Size};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::flow::{flow_of_objects, with_drift};
use gs2e_scene::camera::view::CameraView;
pub use parameters::GaussianRates;
use parameters::RatedGaussian;
use project::{CullReason, ReferenceLayer, ReferenceView, least_alpha};
use rayon::prelude::*;
use std::sync::Arc;

/// The numerical class.
pub const FINGERPRINT: &str = "reference/1";

/// Memory for rendering a scene of this many bytes at this size, in bytes: a layer of 256 bytes per
/// Gaussian, which is stored in at least 56 bytes, and two copies of each pixel.
#[must_use]
pub fn memory_needed(scene_bytes: u64, size: Size) -> u64 {
    const BYTES_A_PIXEL: u64 = 256;
    6 * scene_bytes + BYTES_A_PIXEL * u64::from(size.width) * u64::from(size.height)
}

/// In f32, `1 - 0.99` squared is below the stop; in f64 it is not. This factor makes both stop
/// alike.
const STOP_SLACK: f64 = 1.000_001;

/// A value with its rate.
type D = DualNumber<f64>;

/// A scene for rendering.
#[derive(Debug)]
pub struct ReferenceRenderer {
    scene: Arc<Gaussians>,
    style: RenderStyle,
}

impl ReferenceRenderer {
    /// Takes a scene.
    ///
    /// # Errors
    /// The background is not finite.
    pub fn new(scene: Arc<Gaussians>, style: RenderStyle) -> Result<Self, RenderError> {
        super::check_style(&style)?;
        Ok(Self { scene, style })
    }

    /// Luminance and its rate at every pixel, row by row, in f64.
    ///
    /// # Errors
    /// The view cannot be rendered.
    pub fn luminance(&self, view: &CameraView) -> Result<Vec<[f64; 2]>, RenderError> {
        let (pixels, _) = self.pixels(view)?;
        Ok(pixels.iter().map(ReferencePixel::luminance).map(|grey| [grey.value, grey.rate]).collect())
    }

    /// Colour of every pixel, row by row, in f64, and the counts of the rendering.
    ///
    /// # Errors
    /// The view cannot be rendered.
    pub fn colours(&self, view: &CameraView) -> Result<(Vec<[f64; 3]>, RenderWork), RenderError> {
        let (pixels, work) = self.pixels(view)?;
        Ok((pixels.iter().map(|pixel| pixel.colour.map(|c| c.value)).collect(), work))
    }

    /// Colour of every pixel and its rate, row by row, in f64, while the parameters of the scene
    /// change and the camera moves. `rates` has one entry per Gaussian; a scene that changes with time has
    /// its own.
    #[cfg(test)]
    pub(super) fn colour_rates(
        &self,
        view: &CameraView,
        rates: &[GaussianRates],
    ) -> Result<Vec<[[f64; 2]; 3]>, RenderError> {
        assert_eq!(rates.len(), self.scene.len(), "one entry per Gaussian");
        let (layers, _) = self.layers(view, |i| rates[i])?;
        let pixels = self.all_pixels(&layers, view.camera.size);
        Ok(pixels.iter().map(|pixel| pixel.colour.map(|c| [c.value, c.rate])).collect())
    }

    /// All pixels, row by row, and the counts of Gaussians.
    fn pixels(&self, view: &CameraView) -> Result<(Vec<ReferencePixel>, RenderWork), RenderError> {
        let (layers, mut work) = self.layers(view, |_| GaussianRates::default())?;
        let pixels = self.all_pixels(&layers, view.camera.size);
        work.blended = pixels.iter().map(|p| p.blended).sum();
        work.stopped = pixels.iter().filter(|p| p.stopped).count() as u64;
        Ok((pixels, work))
    }

    /// The layers of a view, front to back, and the counts of Gaussians.
    fn layers(
        &self,
        view: &CameraView,
        rates: impl Fn(usize) -> GaussianRates + Sync,
    ) -> Result<(Vec<ReferenceLayer>, RenderWork), RenderError> {
        super::check_view(view)?;
        let views = objects::object_views(&self.scene, view)?;
        let eyes: Vec<ReferenceView<'_>> =
            views.iter().map(|view| ReferenceView::new(view, self.style, self.scene.origin)).collect();
        let changing = self.scene.at(view.seconds);
        let gaussian = |i: usize| match changing {
            Some(at) => RatedGaussian::at_moment(&self.scene, i, at),
            None => RatedGaussian::new(&self.scene, i, &rates(i)),
        };
        let all: Vec<Result<ReferenceLayer, CullReason>> = (0..self.scene.len())
            .into_par_iter()
            .map(|i| eyes[self.scene.object_of(i)].layer(&self.scene, i, &gaussian(i)))
            .collect();
        let work = count_outcomes(&all);
        let mut layers: Vec<ReferenceLayer> = all.into_iter().flatten().collect();
        layers.sort_by_key(|layer| layer.order);
        Ok((layers, work))
    }

    fn all_pixels(&self, layers: &[ReferenceLayer], size: Size) -> Vec<ReferencePixel> {
        let [width, height] = [size.width, size.height].map(|edge| edge as usize);
        let rows: Vec<Vec<ReferencePixel>> =
            (0..height).into_par_iter().map(|y| self.row(layers, y, width)).collect();
        rows.into_iter().flatten().collect()
    }
}

/// Counts of all Gaussians, and of those left out by reason.
fn count_outcomes(all: &[Result<ReferenceLayer, CullReason>]) -> RenderWork {
    let culled = |why| all.iter().filter(|one| one.as_ref().err() == Some(&why)).count() as u64;
    let drawn =
        |is: fn(&ReferenceLayer) -> bool| all.iter().flatten().filter(|layer| is(layer)).count() as u64;
    RenderWork {
        gaussians: all.len() as u64,
        behind: culled(CullReason::Behind),
        degenerate: culled(CullReason::Degenerate),
        outside: culled(CullReason::Outside),
        affine_doubtful: drawn(|layer| layer.doubtful),
        affine_invalid: drawn(|layer| layer.invalid),
        ..RenderWork::default()
    }
}

impl Renderer for ReferenceRenderer {
    fn fingerprint(&self) -> &str {
        FINGERPRINT
    }

    fn motion_channels(&self) -> ChannelSet {
        ChannelSet::of_motion(&self.scene)
    }

    fn object_views(&self, view: &CameraView) -> Vec<CameraView> {
        objects::held_object_views(&self.scene, view)
    }

    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        let (pixels, work) = self.pixels(view)?;
        let size = view.camera.size;
        let image = |value: &dyn Fn(&ReferencePixel) -> f64| {
            Image::from_vec(size, pixels.iter().map(|pixel| value(pixel) as f32).collect())
        };
        out.rgb = want.rgb.then(|| {
            Image::from_vec(size, pixels.iter().map(|p| p.colour.map(|c| c.value as f32)).collect())
        });
        out.luminance = want.luminance.then(|| image(&|p| p.luminance().value));
        out.doubtful = want.doubtful.then(|| image(&|p| p.doubtful));
        out.luminance_rate = want.luminance_rate.then(|| image(&|p| p.luminance().rate));
        out.alpha = want.alpha.then(|| image(&|p| 1.0 - p.rest.value));
        // Flow is computed from depth, so depth is made for it too.
        let depth = (want.depth || want.flow).then(|| image(&ReferencePixel::depth));
        let segmentation = Image::from_vec(size, pixels.iter().map(|pixel| pixel.object).collect());
        let views = self.object_views(view);
        let drift = Image::from_vec(size, pixels.iter().map(ReferencePixel::drift).collect());
        let flow = |depth| {
            let still = flow_of_objects(depth, Some(&segmentation), &views);
            with_drift(still, depth, Some(&drift).filter(|_| self.scene.dynamics().is_some()), &view.camera)
        };
        out.flow = want.flow.then_some(()).and(depth.as_ref()).map(flow);
        out.drift = want.drift.then_some(drift);
        out.segmentation = want.segmentation.then_some(segmentation);
        out.depth = depth.filter(|_| want.depth);
        Ok(work)
    }
}

/// The blended values of a pixel.
struct ReferencePixel {
    colour: [D; 3],
    rest: D,
    depth: f64,
    doubtful: f64,
    drift: DVec3,
    /// The object that the pixel shows.
    object: u8,
    blended: u64,
    stopped: bool,
}

impl ReferencePixel {
    fn luminance(&self) -> D {
        let [r, g, b] = self.colour;
        let weighted = |weight: f64, c: D| D::constant(weight) * c;
        weighted(0.299, r) + weighted(0.587, g) + weighted(0.114, b)
    }

    /// The mean velocity by weight; NaN where the depth is.
    fn drift(&self) -> [f32; 3] {
        let alpha = 1.0 - self.rest.value;
        let mean = if alpha < f64::from(DEPTH_MIN_ALPHA) { DVec3::NAN } else { self.drift / alpha };
        mean.as_vec3().to_array()
    }

    fn depth(&self) -> f64 {
        let alpha = 1.0 - self.rest.value;
        if alpha < f64::from(DEPTH_MIN_ALPHA) { f64::NAN } else { self.depth / alpha }
    }
}

impl ReferenceRenderer {
    fn row(&self, layers: &[ReferenceLayer], y: usize, width: usize) -> Vec<ReferencePixel> {
        let here: Vec<&ReferenceLayer> = layers.iter().filter(|layer| layer.rows.contains(&y)).collect();
        (0..width).map(|x| self.pixel(&here, x, y)).collect()
    }

    fn pixel(&self, layers: &[&ReferenceLayer], x: usize, y: usize) -> ReferencePixel {
        let (blend, rest, stopped) = self.blended_layers(layers, [x, y]);
        let nothing = D::constant(0.0);
        let blended = blend.len() as u64;
        let mut pixel = ReferencePixel {
            colour: [nothing; 3],
            rest,
            depth: 0.0,
            doubtful: 0.0,
            drift: DVec3::ZERO,
            object: 0,
            blended,
            stopped,
        };
        let mut shares = vec![0.0; self.scene.object_count()];
        for (layer, weight) in self.weights(&blend) {
            for (sum, c) in pixel.colour.iter_mut().zip(layer.colour) {
                *sum = *sum + weight * c;
            }
            pixel.depth += weight.value * layer.depth.value;
            pixel.drift += layer.drift * weight.value;
            pixel.doubtful += if layer.doubtful { weight.value } else { 0.0 };
            let object = self.scene.object_of(layer.order.1).checked_sub(1);
            object.into_iter().for_each(|object| shares[object] += weight.value);
        }
        pixel.object = largest_object(&shares);
        for (sum, behind) in pixel.colour.iter_mut().zip(self.style.background) {
            *sum = *sum + pixel.rest * D::constant(f64::from(behind));
        }
        pixel
    }

    /// The layers blended at a pixel with their opacities, front to back; the transmittance behind
    /// them; and true if the pixel stopped before the last layer.
    fn blended_layers<'a>(
        &self,
        layers: &[&'a ReferenceLayer],
        [x, y]: [usize; 2],
    ) -> (Vec<(&'a ReferenceLayer, D)>, D, bool) {
        // The plain order decides which layers a pixel has and where it stops, also under the
        // blended order.
        let mut blend = Vec::new();
        let mut rest = D::constant(1.0);
        for &layer in layers.iter().filter(|layer| layer.columns.contains(&x)) {
            let Some(alpha) = self.alpha(layer, [x, y]) else { continue };
            let after = rest * (D::constant(1.0) - alpha);
            if self.stops(after.value) {
                return (blend, rest, true);
            }
            blend.push((layer, alpha));
            rest = after;
        }
        (blend, rest, false)
    }

    /// The weight of each layer at the pixel: its opacity times the transmittance in front of it.
    fn weights<'a>(&self, blend: &[(&'a ReferenceLayer, D)]) -> Vec<(&'a ReferenceLayer, D)> {
        let mut before = D::constant(1.0);
        let mut first = 0;
        let weight = |(i, &(layer, alpha)): (usize, &(&'a ReferenceLayer, D))| {
            // A layer that covers this one wholly also covers all deeper ones wholly, so its factor
            // is kept.
            while first < i && self.cover(blend[first].0, layer).value >= 1.0 {
                before = before * (D::constant(1.0) - blend[first].1);
                first += 1;
            }
            // The other layers, in front and behind. They are in order of depth, so the first one
            // that covers nothing ends the search.
            let near =
                (first..blend.len()).filter(|j| *j != i).map(|j| (self.cover(blend[j].0, layer), blend[j].1));
            let near = near.take_while(|(cover, _)| cover.value > 0.0);
            let light = near.fold(before, |light, (cover, alpha)| light * (D::constant(1.0) - cover * alpha));
            (layer, alpha * light)
        };
        blend.iter().enumerate().map(weight).collect()
    }

    /// The share of its opacity with which one layer dims another.
    fn cover(&self, of: &ReferenceLayer, other: &ReferenceLayer) -> D {
        match self.style.order {
            LayerOrder::Depth => D::constant(f64::from(u8::from(of.order < other.order))),
            LayerOrder::Blended => {
                let ahead = (other.depth - of.depth) / (D::constant(2.0 * BLENDED_DEPTHS) * other.depth);
                smooth_step(ahead + D::constant(0.5))
            }
        }
    }

    /// The opacity of a layer at a pixel; `None` if it is skipped.
    fn alpha(&self, layer: &ReferenceLayer, pixel: [usize; 2]) -> Option<D> {
        let [dx, dy] = [0, 1].map(|k| D::constant(pixel[k] as f64 + 0.5) - layer.mean[k]);
        let [w1, w2, w3] = layer.w;
        let power = D::constant(-0.5) * ((w1 * dx + w2 * dy).squared() + (w3 * dy).squared());
        // The clamp of a dual number gives a capped opacity the rate 0.
        let alpha = (layer.opacity * power.exponential()).clamp(0.0, f64::from(MAX_ALPHA));
        if alpha.value < least_alpha(self.style.rules) {
            return None;
        }
        Some(if self.style.rules == RenderRules::Soft { alpha * soft_ramp(alpha) } else { alpha })
    }

    fn stops(&self, rest: f64) -> bool {
        let stop = f64::from(STOP) * STOP_SLACK;
        if self.style.rules == RenderRules::Gsplat { rest <= stop } else { rest < stop }
    }
}

/// The object with the largest of these shares, from 1; 0 if the rest of 1 is larger. Of equal ones, the
/// first.
fn largest_object(shares: &[f64]) -> u8 {
    let rest = 1.0 - shares.iter().sum::<f64>();
    let larger =
        |most: (f64, u8), (share, object): (&f64, u8)| if *share > most.0 { (*share, object) } else { most };
    shares.iter().zip(1..).fold((rest, 0), larger).1
}

/// `3u^2 - 2u^3` with `u` clamped to 0..1.
fn smooth_step(x: D) -> D {
    let u = x.clamp(0.0, 1.0);
    u * u * (D::constant(3.0) - D::constant(2.0) * u)
}

/// The ramp of the rules `soft`: 0 at half a grey step, 1 at one and a half.
fn soft_ramp(alpha: D) -> D {
    smooth_step(D::constant(255.0) * alpha - D::constant(0.5))
}
