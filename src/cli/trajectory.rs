//! `gs2e trajectory`: computes the poses of one trajectory of a recipe on the user's own capture.

mod account;

use super::output::{self, OutputFile};
use super::{CommonArgs, Console, ExitKind, VerbError, input};
use account::TrajectoryAccount;
use gs2e_recipe::{self as recipe, ChainError, TrajectoryChain, TrajectoryFragment};
use gs2e_render::backend::Backend;
use gs2e_render::flow::PixelFlowMeter;
use gs2e_scene::camera::{self, Camera};
use gs2e_source::Capture;
use gs2e_source::kind::CaptureKind;
use gs2e_trajectory::flow::FlowMeter;
use gs2e_trajectory::{TrajectoryBuild, picture};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of `trajectory`.
#[derive(Debug, clap::Args)]
pub(super) struct TrajectoryArgs {
    /// Capture: a COLMAP model, a transforms.json, or a 3DGS model folder; not needed for orbits
    /// and key frames
    #[arg(long, value_name = "FILE or DIR")]
    capture: Option<PathBuf>,
    /// Recipe, or a file with its trajectories only; its source, sensor and outputs are not read
    #[arg(long, value_name = "RECIPE")]
    recipe: PathBuf,
    /// Trajectory of the recipe
    #[arg(long, value_name = "NAME")]
    name: String,
    /// File for the poses, one line `t_us tx ty tz qx qy qz qw` each; `-` is stdout
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// File for the report on the speed, in the form of speed.json in a release
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// File for the picture of the path
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// File for the time stamps, one per line
    #[arg(long, value_name = "FILE")]
    stamps: Option<PathBuf>,
    /// Scene file, for a speed in pixels: .ply, .splat, .spz or .sog
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
}

impl TrajectoryArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let inputs = [Some(&self.recipe), self.capture.as_ref(), self.scene.as_ref()];
        let inputs = inputs.into_iter().flatten().map(PathBuf::as_path);
        output::screen_outputs(self.files().map(|(_, path)| path), inputs, console.json)?;
        self.scene.iter().try_for_each(|scene| input::require_file("scene", scene))?;
        common.limit_cores();
        let fragment = recipe::read_fragment(&self.recipe)?;
        let chain = fragment.chain(&self.name).map_err(|error| chain_error(&error))?;
        let mut warnings = Vec::new();
        let captured = self.captured(&chain, &mut warnings)?;
        let camera = viewing_camera(&fragment, captured.as_ref().map(|c| &c.capture), &mut warnings);
        let mut meter = self.meter(&fragment, &chain, camera, &common.backend()?)?;
        let views = captured.as_ref().map_or(&[][..], |captured| &captured.capture.views);
        let meter = meter.as_mut().map(|meter| meter as &mut dyn FlowMeter);
        let (made, before) = chain.make(views, meter).map_err(|error| chain_error(&error))?;
        warnings.extend(before);
        let account =
            TrajectoryAccount::new(&self.name, captured.as_ref().map(|c| c.kind), &made, camera, warnings);
        self.write(&made)?;
        account.report(console);
        console.result(&account.to_json(self.files()));
        Ok(ExitKind::Done)
    }

    /// The outputs, by option.
    fn files(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let optional = [("report", &self.report), ("svg", &self.svg), ("stamps", &self.stamps)];
        let given = optional.into_iter().filter_map(|(option, path)| Some((option, path.as_deref()?)));
        std::iter::once(("out", self.out.as_path())).chain(given)
    }

    fn write(&self, made: &TrajectoryBuild) -> Result<(), VerbError> {
        let fill = |option: &'static str| {
            move |out: &mut dyn io::Write| match option {
                "report" => {
                    serde_json::to_writer_pretty(&mut *out, &made.report)?;
                    out.write_all(b"\n")
                }
                "svg" => out.write_all(picture::trajectory_svg(&made.trajectory, &made.report).as_bytes()),
                "stamps" => made.trajectory.write_stamps(out),
                _ => made.trajectory.write_poses(out),
            }
        };
        let fills: Vec<_> = self.files().map(|(option, path)| (path, fill(option))).collect();
        let outputs: Vec<_> = fills.iter().map(|(path, fill)| OutputFile { path, fill }).collect();
        output::write_outputs(&outputs)
    }

    /// The capture, if one is given.
    ///
    /// # Errors
    /// A path needs a capture and none is given, or the capture cannot be read.
    fn captured(
        &self,
        chain: &TrajectoryChain<'_>,
        warnings: &mut Vec<String>,
    ) -> Result<Option<CaptureInput>, VerbError> {
        let Some(place) = &self.capture else {
            let Some(name) = chain.needs_views() else { return Ok(None) };
            let what = format!("the trajectory `{name}` needs a capture, and none is given");
            let help = "pass --capture with a COLMAP model, a transforms.json, or a 3DGS model folder";
            return Err(VerbError::usage("input-missing", what).help(help));
        };
        let kind = CaptureKind::kind_of(place).map_err(|e| input::no_source("capture", &e, place))?;
        let (capture, noticed) = kind.read(place).map_err(|e| input::unreadable_file("capture", &e))?;
        warnings.extend(noticed.iter().map(ToString::to_string));
        Ok(Some(CaptureInput { kind, capture }))
    }

    /// The meter of the optical flow, if a speed is a flow speed.
    fn meter(
        &self,
        fragment: &TrajectoryFragment,
        chain: &TrajectoryChain<'_>,
        camera: Option<Camera>,
        backend: &Backend,
    ) -> Result<Option<PixelFlowMeter>, VerbError> {
        let Some(name) = chain.needs_meter() else { return Ok(None) };
        let missing = |what: &str, help: &str| {
            let what = format!("the speed of `{name}` is in pixels per second, and {what}");
            VerbError::usage("input-missing", what).help(help)
        };
        let help = "pass --scene with a .ply, .splat, .spz or .sog";
        let scene = self.scene.as_ref().ok_or_else(|| missing("no scene is given", help))?;
        let help = "pass --capture, or write in the recipe camera: { width, height, fx, fy, cx, cy }";
        let camera = camera.ok_or_else(|| missing("there is no camera", help))?;
        let gaussians = gs2e_scene::read_file(scene).map_err(|e| input::unreadable_file("scene", &e))?;
        let style = fragment.render.resolve(gaussians.antialiased);
        let failed = |e| VerbError::failed("step-failed", format!("failed to render: {e}"));
        let renderer = backend.renderer(Arc::new(gaussians), style).map_err(failed)?;
        Ok(Some(PixelFlowMeter::new(renderer, camera)))
    }
}

/// A capture and its kind.
struct CaptureInput {
    kind: CaptureKind,
    capture: Capture,
}

/// A failure of a chain, for users.
fn chain_error(error: &ChainError) -> VerbError {
    match error {
        ChainError::Unknown { names, .. } => VerbError::usage("no-trajectory", error.to_string())
            .help(format!("its trajectories: {}", names.join(", "))),
        ChainError::Circular { .. } => VerbError::usage("recipe-invalid", error.to_string()),
        ChainError::Make { source, .. } => {
            VerbError::failed("step-failed", error.to_string()).because(source)
        }
    }
}

/// The camera that sees the trajectory. Without a capture, it is the recipe's camera if that is
/// complete.
fn viewing_camera(
    fragment: &TrajectoryFragment,
    capture: Option<&Capture>,
    warnings: &mut Vec<String>,
) -> Option<Camera> {
    let (own, noticed) = capture.and_then(Capture::camera).unzip();
    warnings.extend(noticed.flatten().map(|warning| warning.to_string()));
    camera::choose_camera(fragment.camera, own.as_ref())
}
