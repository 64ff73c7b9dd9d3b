//! A short rendering of the embedded scene.

use gs2e_demo::{StillLife, still_capture, still_life};
use gs2e_image::{Image, likeness};
use gs2e_render::backend::Backend;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time of a trial after its first frame.
const TIME: Duration = Duration::from_secs(1);
const STYLE: RenderStyle = RenderStyle {
    rules: RenderRules::Official,
    order: LayerOrder::Depth,
    antialiased: false,
    background: [0.0; 3],
};

/// The scene and its views, 640x360 pixels.
pub(super) struct TrialScene {
    scene: Arc<Gaussians>,
    views: Vec<CameraView>,
}

/// The result of a trial.
pub(super) struct TrialPicture {
    /// The first view.
    picture: Image<[f32; 3]>,
    frames: u32,
    seconds: f64,
}

impl TrialScene {
    pub(super) fn new() -> Self {
        let life = StillLife::default();
        let view = |view: gs2e_source::CapturedView| CameraView::at_rest(view.camera, view.world_from_camera);
        let views = still_capture(&life).views.into_iter().map(view).collect();
        Self { scene: Arc::new(still_life(&life)), views }
    }

    /// Renders for about a second, after a first frame that is not counted.
    pub(super) fn render(&self, backend: &Backend) -> Result<TrialPicture, String> {
        let failed = |e: &dyn std::error::Error| e.to_string();
        let mut renderer = backend.renderer(Arc::clone(&self.scene), STYLE).map_err(|e| failed(&e))?;
        let want = ChannelSet { rgb: true, ..ChannelSet::NONE };
        let mut out = RenderedImages::default();
        renderer.render(&self.views[0], want, &mut out).map_err(|e| failed(&e))?;
        let picture = out.rgb.clone().ok_or("the renderer made no picture")?;
        if picture.pixels().as_flattened().iter().any(|value| !value.is_finite()) {
            return Err("the picture has values that are not finite: update the driver".to_owned());
        }
        let start = Instant::now();
        let mut frames = 0;
        while start.elapsed() < TIME {
            let view = &self.views[frames as usize % self.views.len()];
            renderer.render(view, want, &mut out).map_err(|e| failed(&e))?;
            frames += 1;
        }
        Ok(TrialPicture { picture, frames, seconds: start.elapsed().as_secs_f64() })
    }
}

impl TrialPicture {
    pub(super) fn rate(&self) -> String {
        format!("{:.1} frames/s of 640x360 px, 20,000 Gaussians", f64::from(self.frames) / self.seconds)
    }

    pub(super) fn likeness(&self, other: &Self) -> String {
        let db = likeness::psnr_db(likeness::mean_square(&self.picture, &other.picture));
        let pairs = self.picture.pixels().as_flattened().iter().zip(other.picture.pixels().as_flattened());
        let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0_f32, f32::max);
        format!("{db:.1} dB to the CPU, largest difference {most:.1e} of full scale")
    }
}
