//! Measures optical flow by small renderings.

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
        f.debug_struct("Meter")
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
