//! `gs2e trajectory`: computes the poses of one trajectory of a recipe on the user's own capture.

mod account;

use super::console::Console;
use super::message::{MessageLevel, UserMessage};
use super::output::{self, OutputFile};
use super::problem::{ExitKind, VerbError};
use super::{CommonArgs, input};
use crate::camera::{self, Camera};
use crate::files::is_there;
use crate::recipe::{self, TrajectoryFragment, TrajectoryRecipe};
use crate::render::backend::Backend;
use crate::render::flow::PixelFlowMeter;
use crate::source::Capture;
use crate::source::kind::CaptureKind;
use crate::speed::SpeedChoice;
use crate::trajectory::flow::FlowMeter;
use crate::trajectory::novel::BaseTrajectory;
use crate::trajectory::path;
use crate::trajectory::{MadeTrajectory, NamedPose, PoseTiming, picture};
use account::TrajectoryAccount;
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
        common.limit_cores();
        let fragment = recipe::read_fragment(&self.recipe)?;
        let chosen = find_trajectory(&fragment, &self.name)?;
        let chain = base_chain(&fragment, chosen)?;
        let mut warnings = Vec::new();
        let captured = self.captured(&chain, &mut warnings)?;
        let camera = viewing_camera(&fragment, captured.as_ref().map(|c| &c.capture), &mut warnings);
        let meter = self.meter(&fragment, &chain, camera, &common.backend()?)?;
        let made =
            TrajectoryMaker { fragment: &fragment, captured: captured.as_ref(), meter }.make(&chain)?;
        warnings.extend(made.before);
        let account = TrajectoryAccount::new(
            &self.name,
            captured.as_ref().map(|c| c.kind),
            &made.made,
            camera,
            warnings,
        );
        self.write(&made.made)?;
        account.tell(console);
        if console.json {
            console.result(&account.to_json(self.files()));
        }
        Ok(ExitKind::Done)
    }

    /// The outputs, by option.
    fn files(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let optional = [("report", &self.report), ("svg", &self.svg), ("stamps", &self.stamps)];
        let given = optional.into_iter().filter_map(|(option, path)| Some((option, path.as_deref()?)));
        std::iter::once(("out", self.out.as_path())).chain(given)
    }

    fn write(&self, made: &MadeTrajectory) -> Result<(), VerbError> {
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
        let outputs: Vec<OutputFile<'_>> =
            fills.iter().map(|(path, fill)| OutputFile { path, fill }).collect();
        output::write_outputs(&outputs)
    }

    /// The capture, if one is given.
    ///
    /// # Errors
    /// A path needs a capture and none is given, or the capture cannot be read.
    fn captured(
        &self,
        chain: &[&TrajectoryRecipe],
        warnings: &mut Vec<String>,
    ) -> Result<Option<CaptureInput>, VerbError> {
        let Some(place) = &self.capture else {
            // The whole chain is searched: a base may need a capture even if its follower does not.
            return match chain.iter().find(|recipe| path_of(recipe).0.needs_views()) {
                None => Ok(None),
                Some(recipe) => {
                    let what = format!("the trajectory `{}` needs a capture, and none is given", recipe.name);
                    Err(VerbError::usage("input-missing", what).help(
                        "pass --capture with a COLMAP model, a transforms.json, or a 3DGS model folder",
                    ))
                }
            };
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
        chain: &[&TrajectoryRecipe],
        camera: Option<Camera>,
        backend: &Backend,
    ) -> Result<Option<PixelFlowMeter>, VerbError> {
        let Some(recipe) = chain.iter().find(|recipe| matches!(recipe.speed, SpeedChoice::Flow(_))) else {
            return Ok(None);
        };
        let missing = |what: &str, help: &str| {
            let what = format!("the speed of `{}` is in pixels per second, and {what}", recipe.name);
            VerbError::usage("input-missing", what).help(help)
        };
        let scene = self.scene.as_ref();
        let scene = scene
            .ok_or_else(|| missing("no scene is given", "pass --scene with a .ply, .splat, .spz or .sog"))?;
        let camera = camera.ok_or_else(|| {
            let help = "pass --capture, or write in the recipe camera: { width, height, fx, fy, cx, cy }";
            missing("there is no camera", help)
        })?;
        if !is_there(scene) {
            return Err(input::missing_file("scene", scene));
        }
        let gaussians = crate::scene::read_file(scene).map_err(|e| input::unreadable_file("scene", &e))?;
        let style = fragment.render.resolve(gaussians.antialiased);
        let renderer = backend.renderer(Arc::new(gaussians), style);
        let renderer =
            renderer.map_err(|e| VerbError::failed("step-failed", format!("failed to render: {e}")))?;
        Ok(Some(PixelFlowMeter::new(renderer, camera)))
    }
}

/// A capture and its kind.
struct CaptureInput {
    kind: CaptureKind,
    capture: Capture,
}

/// The path of a trajectory, and the name of the trajectory that it is drawn from.
fn path_of(recipe: &TrajectoryRecipe) -> (path::CameraPath, Option<&str>) {
    (recipe.path.clone(), recipe.base.as_deref())
}

fn find_trajectory<'a>(
    fragment: &'a TrajectoryFragment,
    name: &str,
) -> Result<&'a TrajectoryRecipe, VerbError> {
    fragment.trajectories.iter().find(|recipe| recipe.name == name).ok_or_else(|| {
        let names: Vec<&str> = fragment.trajectories.iter().map(|recipe| recipe.name.as_str()).collect();
        let message = format!("the recipe has no trajectory `{name}`");
        VerbError::usage("no-trajectory", message).help(&format!("its trajectories: {}", names.join(", ")))
    })
}

/// A trajectory and its bases. Each base precedes the trajectory that is drawn from it.
fn base_chain<'a>(
    fragment: &'a TrajectoryFragment,
    chosen: &'a TrajectoryRecipe,
) -> Result<Vec<&'a TrajectoryRecipe>, VerbError> {
    let mut chain = vec![chosen];
    while let (_, Some(base)) = path_of(chain[chain.len() - 1]) {
        let base = find_trajectory(fragment, base)?;
        // A chain that returns to itself would never end.
        if chain.iter().any(|recipe| recipe.name == base.name) {
            let message = format!("the trajectory `{}` is drawn from itself", base.name);
            return Err(VerbError::usage("recipe-invalid", message));
        }
        chain.push(base);
    }
    chain.reverse();
    Ok(chain)
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

/// The inputs of trajectories.
struct TrajectoryMaker<'a> {
    fragment: &'a TrajectoryFragment,
    captured: Option<&'a CaptureInput>,
    meter: Option<PixelFlowMeter>,
}

/// A trajectory, and the warnings about its bases.
struct TrajectoryChoice {
    made: MadeTrajectory,
    before: Vec<String>,
}

impl TrajectoryMaker<'_> {
    /// Makes the last of these trajectories. Each is drawn from the one before it.
    fn make(mut self, chain: &[&TrajectoryRecipe]) -> Result<TrajectoryChoice, VerbError> {
        let (mut made, mut before): (Option<MadeTrajectory>, Vec<String>) = (None, Vec::new());
        for (i, recipe) in chain.iter().enumerate() {
            let base = made.take();
            // The base itself is not written, so its warnings carry its name.
            let noticed = base.iter().flat_map(|base| &base.report.warnings);
            before.extend(noticed.map(|warning| format!("{}: {warning}", chain[i - 1].name)));
            made = Some(self.one(recipe, base.as_ref())?);
        }
        Ok(TrajectoryChoice { made: made.expect("a chain holds the trajectory that was chosen"), before })
    }

    fn one(
        &mut self,
        recipe: &TrajectoryRecipe,
        base: Option<&MadeTrajectory>,
    ) -> Result<MadeTrajectory, VerbError> {
        let views = self.captured.map_or(&[][..], |captured| &captured.capture.views);
        let views: Vec<NamedPose<'_>> = views
            .iter()
            .map(|v| NamedPose { name: &v.name, world_from_camera: v.world_from_camera })
            .collect();
        let base = base.map(|made| BaseTrajectory {
            poses: &made.trajectory.world_from_camera,
            scale: made.report.scale_distance,
        });
        let TrajectoryFragment { rate, law, .. } = *self.fragment;
        let timing = PoseTiming { speed: &recipe.speed, rate, law };
        let meter = self.meter.as_mut().map(|meter| meter as &mut dyn FlowMeter);
        let made =
            path_of(recipe).0.make(path::PathInputs { views: &views, base, scene: None }, timing, meter);
        made.map_err(|error| {
            let what = format!("failed to make the trajectory `{}`", recipe.name);
            VerbError::from_message(
                ExitKind::Failed,
                UserMessage::new(MessageLevel::Error, "step-failed", what).because(error.to_string()),
            )
        })
    }
}
