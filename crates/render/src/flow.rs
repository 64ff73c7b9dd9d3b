//! Measures optical flow by small renderings.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{LayerOrder, RenderRules, RenderStyle, backend::Backend};
//! use gs2e_render::flow::PixelFlowMeter;
//! use gs2e_scene::camera::{Camera, view::CameraVelocity};
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 4.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! let mut meter = PixelFlowMeter::new(Backend::Cpu.renderer(scene.into(), style)?, camera);
//! // Sideways by 1 unit per second, past a Gaussian at depth 2: 9 / 2 px/s.
//! let velocity = CameraVelocity { linear: DVec3::X, angular: DVec3::ZERO };
//! let speed = meter.speed_px(&Se3::IDENTITY, velocity, 50)?.ok_or("nothing in view")?;
//! assert!((speed - 4.5).abs() < 1e-5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{ChannelSet, RenderError, RenderedImages, Renderer};
use gs2e_image::Size;
use gs2e_num::se3::{Se3, Twist};
use gs2e_num::stats::nearest_ranks;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_trajectory::flow::FlowMeter;

/// Measures the flow of a moving camera on small images.
pub struct PixelFlowMeter {
    renderer: Box<dyn Renderer>,
    small: Camera,
    /// Pixels of the full image per pixel of the small one.
    pixels: f64,
    rendered: RenderedImages,
}

/// Width of the small images, px. Enough for a quantile over their pixels.
const METER_WIDTH: u32 = 160;

impl PixelFlowMeter {
    /// A meter for the views of `camera`. Results are in pixels of `camera`.
    #[must_use]
    pub fn new(renderer: Box<dyn Renderer>, camera: Camera) -> Self {
        let Size { width, height } = camera.size;
        let columns = width.min(METER_WIDTH);
        // The product of two edges can exceed 32 bits. Rounding up keeps at least one row.
        let rows = (u64::from(height) * u64::from(columns)).div_ceil(u64::from(width));
        let small = camera.resized(Size { width: columns, height: u32::try_from(rows).unwrap_or(height) });
        Self {
            renderer,
            small,
            pixels: f64::from(width) / f64::from(small.size.width),
            rendered: RenderedImages::default(),
        }
    }
}

impl std::fmt::Debug for PixelFlowMeter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let fingerprint = self.renderer.fingerprint();
        f.debug_struct("PixelFlowMeter")
            .field("renderer", &fingerprint)
            .field("small", &self.small)
            .finish_non_exhaustive()
    }
}

impl PixelFlowMeter {
    /// Quantile of the image speed of a moving camera, px per unit of the velocity's time: this
    /// percentage of the pixels moves no faster. `None` if no pixel has a depth.
    ///
    /// # Errors
    /// The frame cannot be rendered.
    pub fn speed_px(
        &mut self,
        world_from_camera: &Se3,
        velocity: CameraVelocity,
        percent: usize,
    ) -> Result<Option<f64>, RenderError> {
        // The small image has the field of view of the full one, so speeds differ by the ratio of
        // widths.
        let still = CameraView::at_rest(self.small, *world_from_camera);
        let view = CameraView { velocity, ..still };
        let want = ChannelSet { flow: true, ..ChannelSet::default() };
        self.renderer.render(&view, want, &mut self.rendered)?;
        let flow = self.rendered.flow.as_ref().expect("flow was asked for").pixels();
        let speeds = flow.iter().map(|[x, y]| (x * x + y * y).sqrt()).collect();
        Ok(nearest_ranks(speeds, [percent]).map(|[speed]| f64::from(speed) * self.pixels))
    }
}

impl FlowMeter for PixelFlowMeter {
    fn median_px(&mut self, world_from_camera: &Se3, twist: &Twist) -> Result<Option<f64>, String> {
        // The linear part of a twist is in world axes; its angular part is already in the body's.
        let linear = world_from_camera.rotation.conjugate() * twist.linear;
        let velocity = CameraVelocity { linear, angular: twist.angular };
        self.speed_px(world_from_camera, velocity, 50).map_err(|e| e.to_string())
    }
}
