//! `gs2e render`: renders one channel of one view of the user's own scene.

mod account;
mod numbers;
mod picture;

use super::words::{RENDERED, Word, one_of};
use super::{BackendArg, CommonArgs, Console, ExitKind, VerbError, input, output, path};
use account::RenderAccount;
use gs2e_files::is_there;
use gs2e_gpu as gpu;
use gs2e_render::backend::Backend;
use gs2e_render::{
    AntialiasMode, LayerOrder, RenderChoice, RenderError, RenderRules, RenderStyle, RenderWork,
    RenderedImages,
};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::lens::Distortion;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_scene::dynamic::file::read_dynamic;
use gs2e_scene::dynamic::{SceneSpan, SceneTime};
use gs2e_scene::{self as scene, Gaussians};
use gs2e_source::{self as source, view};
use picture::{ChannelArg, ChannelImage, PictureFormat};
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Maximum number of pixels in a picture: 16,384 on both sides, the limit of recipes.
const MAX_PIXELS: usize = 1 << 28;

/// Arguments of `render`.
#[derive(Debug, clap::Args)]
pub(super) struct RenderArgs {
    /// Scene file: .ply, .splat, .spz or .sog; with --at-time, a .ply or .splatv with tracks, or a folder
    /// with a sequence of scene files
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// Moment of a scene that changes with time, s
    #[arg(long, value_name = "S", value_parser = numbers::parse_moment)]
    at_time: Option<f64>,
    /// Time from the beginning to the end of a scene with tracks, s [default: 1]
    #[arg(long, value_name = "S", requires = "at_time", conflicts_with = "frame_rate", value_parser = numbers::parse_positive)]
    duration: Option<f64>,
    /// Frames per second of a sequence of scene files, instead of --duration
    #[arg(long, value_name = "HZ", requires = "at_time", value_parser = numbers::parse_positive)]
    frame_rate: Option<f64>,
    /// Camera JSON { W, H, fx, fy, cx, cy, R, t } (world to camera), transforms.json, or folder
    /// with a capture
    #[arg(long, value_name = "FILE or DIR")]
    view: PathBuf,
    /// View of a capture, from 0 in natural order of the image names
    #[arg(long, value_name = "K", default_value_t = 0)]
    index: usize,
    /// Conventions for extents, culling and stops
    #[arg(long, value_parser = one_of(&RENDERED), default_value = "official")]
    rules: RenderRules,
    /// Order of layers of nearly the same depth; blended needs --rules soft
    #[arg(long, value_parser = one_of(&ORDERS), default_value = "depth")]
    order: LayerOrder,
    /// Compensate opacity for the screen-space dilation [default: as the scene file says, else off]
    #[arg(long)]
    antialiased: bool,
    /// Colour behind the scene, each channel 0..1
    #[arg(long, value_name = "R,G,B", default_value = "0,0,0", value_parser = numbers::parse_colour, allow_hyphen_values = true)]
    background: [f64; 3],
    /// Channel to render
    #[arg(long, value_enum, default_value_t = ChannelArg::Rgb)]
    channel: ChannelArg,
    /// Linear (units/s) and angular (rad/s) velocity of the camera in camera axes, for
    /// luminance-rate and flow
    #[arg(long, value_name = "vx,vy,vz,wx,wy,wz", value_parser = numbers::parse_velocity, allow_hyphen_values = true)]
    velocity: Option<CameraVelocity>,
    /// Lens that distorts the picture, with OpenCV's coefficients: opencv:k1,k2,p1,p2[,k3[,k4,k5,k6]] or
    /// fisheye:k1,k2,k3,k4 [default: none, as a pinhole]
    #[arg(long, value_name = "MODEL:K1,K2,...", allow_hyphen_values = true)]
    lens: Option<Distortion>,
    /// File for the picture: a .npy (float32, neither clamped nor encoded), a .png (8 bits), or `-`
    /// for a .npy to stdout
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// The orders of layers.
const ORDERS: [Word<LayerOrder>; 2] = [
    ("depth", "By the depth of the means", LayerOrder::Depth),
    ("blended", "Blended: each layer covers the other in part", LayerOrder::Blended),
];

/// The rendered scene, and the settings of the renderer.
struct SceneShot {
    scene: Arc<Gaussians>,
    style: RenderStyle,
    view: CameraView,
}

/// The images of a shot, the class of the back end, and its work.
struct RenderedShot {
    backend: String,
    work: RenderWork,
    images: RenderedImages,
}

impl RenderArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let inputs = [self.scene.as_path(), self.view.as_path()];
        output::screen_outputs([self.out.as_path()], inputs, console.json)?;
        // Options are checked before the scene is read, which may take long.
        let format = PictureFormat::for_path(&self.out, self.channel)?;
        let (velocity, mut warnings) = self.motion()?;
        common.limit_cores();

        let started = Instant::now();
        let (chosen, noticed) = self.chosen()?;
        warnings.extend(noticed.iter().map(ToString::to_string));
        let gaussians = self.gaussians()?;
        let (screening, reading) = (gaussians.screening, started.elapsed());

        let started = Instant::now();
        let style = self.style(&gaussians);
        let camera = Camera { lens: self.lens, ..chosen.camera };
        let still = CameraView::at_rest(camera, chosen.world_from_camera);
        let view = CameraView { velocity, ..still };
        let shot = SceneShot { scene: Arc::new(gaussians), style, view };
        let RenderedShot { backend, work, images } = self.rendered(common, &shot, console)?;
        let rendering = started.elapsed();

        let picture = ChannelImage::from_rendered(self.channel, images).expect("the channel was asked for");
        output::write_output(&self.out, |out| picture.write(format, out))?;
        let (channel, view, size) = (self.channel.name(), chosen.name, chosen.camera.size);
        let account =
            RenderAccount { channel, backend, view, size, work, screening, reading, rendering, warnings };
        account.report(console);
        let mut value = account.to_json();
        (value["file"], value["style"]) = (json!(path(&self.out)), json!(style));
        if let Some(lens) = self.lens {
            value["lens"] = json!(lens.to_string());
        }
        console.result(&value);
        Ok(ExitKind::Done)
    }

    /// The velocity of the camera, and warnings about it.
    ///
    /// # Errors
    /// The channel needs a velocity, and none is given.
    fn motion(&self) -> Result<(CameraVelocity, Vec<String>), VerbError> {
        let name = self.channel.name();
        let help = "pass --velocity vx,vy,vz,wx,wy,wz in camera axes; 0,0,0,0,0,0 is a camera at rest";
        match self.velocity {
            None if self.channel.moves() => {
                let what = format!("{name} needs the velocity of the camera");
                Err(VerbError::usage("velocity-missing", what).help(help))
            }
            Some(_) if !self.channel.moves() => {
                Ok((CameraVelocity::default(), vec![format!("{name} does not depend on --velocity")]))
            }
            velocity => Ok((velocity.unwrap_or_default(), Vec::new())),
        }
    }

    /// The view with the requested index, and warnings about it.
    fn chosen(&self) -> Result<(source::CapturedView, Vec<source::SourceWarning>), VerbError> {
        let read = view::read_views(&self.view);
        let (capture, warnings) = read.map_err(|e| input::no_source("view", &e, &self.view))?;
        let count = capture.views.len();
        let chosen = view::choose_view(capture, warnings, self.index).ok_or_else(|| {
            let views = if count == 1 { "1 view".to_owned() } else { format!("{count} views") };
            let what = format!("{} has {views}, but none with index {}", self.view.display(), self.index);
            let help = format!("pass --index from 0 to {}", count.saturating_sub(1));
            VerbError::usage("no-view", what).help(help)
        })?;
        // Refused before the scene is read: a wrong size in a camera file could ask for any amount
        // of memory.
        let size = chosen.0.camera.size;
        if size.pixels() > MAX_PIXELS {
            let because = format!("a picture of {size}, wanted at most {MAX_PIXELS} pixels");
            return Err(render_failed(RenderError::View(because)));
        }
        Ok(chosen)
    }

    fn gaussians(&self) -> Result<Gaussians, VerbError> {
        if !is_there(&self.scene) {
            return Err(input::missing_file("scene", &self.scene));
        }
        let read = match self.time() {
            Some(time) => read_dynamic(&self.scene, time),
            None => scene::read_file(&self.scene),
        };
        read.map_err(|e| input::unreadable_file("scene", &e))
    }

    /// The time of a scene that changes. It passes as in a trajectory that starts at the moment.
    fn time(&self) -> Option<SceneTime> {
        let span = match self.frame_rate {
            Some(hertz) => SceneSpan::Rate(hertz),
            None => SceneSpan::Duration(self.duration.unwrap_or(1.0)),
        };
        self.at_time.map(|start| SceneTime { start, speed: 1.0, span })
    }

    fn style(&self, gaussians: &Gaussians) -> RenderStyle {
        let antialiased = if self.antialiased { AntialiasMode::On } else { AntialiasMode::Auto };
        let Self { rules, order, background, .. } = *self;
        RenderChoice { rules, order, antialiased, background, near: None }.resolve(gaussians.antialiased)
    }

    /// Renders with the requested back end.
    fn rendered(
        &self,
        common: &CommonArgs,
        shot: &SceneShot,
        console: &Console,
    ) -> Result<RenderedShot, VerbError> {
        let SceneShot { scene, style, view } = shot;
        let by = |backend: &Backend| {
            let mut images = RenderedImages::default();
            let mut renderer = backend.renderer(scene.clone(), *style)?;
            renderer.omit(common.omit());
            let work = renderer.render(view, self.channel.wanted(), &mut images)?;
            Ok::<_, RenderError>(RenderedShot { backend: backend.class(), work, images })
        };
        if common.backend != BackendArg::Auto {
            return by(&common.backend()?).map_err(render_failed);
        }
        // A GPU has neither blended orders nor scenes that change, so `auto` need not open one.
        if !Backend::gpu_supports_order(style.order) || scene.dynamics().is_some() {
            return by(&Backend::Cpu).map_err(render_failed);
        }
        // A software GPU is slower than the CPU renderer.
        let device = common.device(&gpu::DeviceChoice::Hardware).map_err(RenderError::from);
        // Only a failure of the GPU itself is tried again; a wrong view fails on the CPU too.
        let done = device.and_then(|device| by(&device.into())).or_else(|error| {
            let RenderError::Gpu(because) = &error else { return Err(error) };
            console.note(&format!("rendering on the CPU, because {because}"));
            by(&Backend::Cpu)
        });
        done.map_err(render_failed)
    }
}

#[expect(clippy::needless_pass_by_value, reason = "it is what is handled here")]
fn render_failed(error: RenderError) -> VerbError {
    let problem = VerbError::failed("step-failed", "failed to render").because(&error);
    if let RenderError::Gpu(because) = &error { problem.help(because.help()) } else { problem }
}
