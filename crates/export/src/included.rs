//! Exports that are part of a release.

use super::{
    ExportError, ExportFormat, ExportLoss, ExportPlan, ExportProgress, ExportSubject, Exposure, LossKind,
    SubjectChoice, TestViews, format_named, write_export,
};
use glam::{DQuat, DVec3};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_recipe::{HELD_OUT_EVERY, IncludedExport, Recipe};
use gs2e_release::include::{
    ComposedScene, ExportOrder, IncludeFailure, IncludeRefusal, ReleaseExporter, export_name,
};
use gs2e_scene::camera::{Camera, choose_camera};
use gs2e_trajectory::Trajectory;
use gs2e_tree::{ListedFiles, TrajectoryFiles};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;

/// Revision of all formats. It is raised when a release gives other bytes in one of them, because
/// stored exports of an earlier revision would be taken otherwise.
const REVISION: u32 = 1;

/// Writes the exports of a release, and reports their progress.
pub struct IncludedExporter<'a> {
    /// Receives the progress, and may stop it.
    pub progress: &'a (dyn ExportProgress + Sync),
}

impl std::fmt::Debug for IncludedExporter<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("IncludedExporter").finish_non_exhaustive()
    }
}

impl ReleaseExporter for IncludedExporter<'_> {
    fn identity(&self, format: &str) -> (u32, &'static str) {
        (REVISION, named(format).consumer)
    }

    fn foresee(
        &self,
        recipe: &Recipe,
        trajectory: &str,
        include: &IncludedExport,
    ) -> Result<(), IncludeRefusal> {
        let refusal = |error| refusal(&recipe.scene, trajectory, include, error);
        let format = named(&include.format);
        let subject = promised_subject(recipe, trajectory, include.sensor.as_deref()).map_err(refusal)?;
        let test = match &include.test_from {
            None => TestViews::Every(held_out_every(include)),
            Some(other) => {
                let other = promised_subject(recipe, other, include.sensor.as_deref()).map_err(refusal)?;
                TestViews::From(Box::new(other))
            }
        };
        let plan = ExportPlan::new(&subject, &test, None).map_err(refusal)?;
        let unmet = format.unmet_needs(&plan);
        if unmet.is_empty() {
            Ok(())
        } else {
            Err(refusal(ExportError::Unmet { format: format.name, unmet }))
        }
    }

    fn write(
        &self,
        scene: &Arc<ComposedScene>,
        trajectory: &str,
        include: &IncludedExport,
        to: &Path,
    ) -> Result<(), IncludeRefusal> {
        export(ExportOrder { scene, trajectory, include }, to, self.progress)
    }

    fn rewrite(
        &self,
        order: ExportOrder<'_>,
        to: &Path,
        is_over: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), IncludeRefusal> {
        export(order, to, &BoundedExport { is_over })
    }
}

/// Stops an export once enough was written.
struct BoundedExport<'a> {
    is_over: &'a (dyn Fn() -> bool + Sync),
}

impl ExportProgress for BoundedExport<'_> {
    fn advance(&self, _: u64) {}

    fn is_cancelled(&self) -> bool {
        (self.is_over)()
    }
}

fn export(order: ExportOrder<'_>, to: &Path, progress: &dyn ExportProgress) -> Result<(), IncludeRefusal> {
    let ExportOrder { scene, trajectory, include } = order;
    let write = || -> Result<Value, ExportError> {
        let choice = |trajectory: &str| SubjectChoice {
            scene: None,
            trajectory: Some(trajectory.to_owned()),
            sensor: include.sensor.clone(),
        };
        let subject = ExportSubject::of_scene(scene, &choice(trajectory))?;
        let test = match &include.test_from {
            None => TestViews::Every(held_out_every(include)),
            Some(other) => TestViews::From(Box::new(ExportSubject::of_scene(scene, &choice(other))?)),
        };
        let plan = ExportPlan::new(&subject, &test, None)?;
        write_export(named(&include.format), &plan, to, include.lossy, progress)
    };
    write().map(drop).map_err(|error| refusal(&scene.record.id, trajectory, include, error))
}

/// The format of this name.
///
/// # Panics
/// There is no such format. The reader of `release.yaml` accepts known names only.
fn named(format: &str) -> &'static ExportFormat {
    format_named(format).expect("release.yaml names known formats")
}

fn held_out_every(include: &IncludedExport) -> usize {
    include.test_every.unwrap_or(HELD_OUT_EVERY) as usize
}

fn refusal(scene: &str, trajectory: &str, include: &IncludedExport, error: ExportError) -> IncludeRefusal {
    let because = error.to_string();
    let (details, kind) = match error {
        ExportError::Unmet { unmet, .. } => {
            let lines = unmet.iter().map(|need| format!("{}: {}", need.what, need.remedy));
            (lines.collect(), IncludeFailure::Refused)
        }
        ExportError::Lossy { losses, .. } => {
            let is_approximate = |loss: &&ExportLoss| loss.kind == LossKind::Approximate;
            let lines =
                losses.iter().filter(is_approximate).map(|loss| format!("{}: {}", loss.field, loss.what));
            let accept = format!("write {{ format: {}, lossy: true }} to include it anyway", include.format);
            (lines.chain([accept]).collect(), IncludeFailure::Refused)
        }
        ExportError::Selection(_) => (Vec::new(), IncludeFailure::Refused),
        ExportError::Interrupted => (Vec::new(), IncludeFailure::Interrupted),
        ExportError::Source(_) | ExportError::Data(_) => (Vec::new(), IncludeFailure::Failed),
        ExportError::Exists { .. } | ExportError::Write { .. } => (Vec::new(), IncludeFailure::Unwritten),
    };
    IncludeRefusal { export: export_name(scene, trajectory, &include.format), because, details, kind }
}

/// Number of poses of a promised subject: enough for every format.
const PROMISED_POSES: usize = 1024;
/// Distance of its poses, us.
const PROMISED_STEP_US: i64 = 1000;

/// The best trajectory that a recipe can have: a picture of each requested kind at every pose, and
/// the camera as far as the recipe states it. A need that it does not meet is met by no build.
fn promised_subject(
    recipe: &Recipe,
    trajectory: &str,
    sensor: Option<&str>,
) -> Result<ExportSubject, ExportError> {
    if recipe.trajectories.iter().all(|path| path.name != trajectory) {
        return Err(ExportError::Selection(format!("{} has no trajectory `{trajectory}`", recipe.scene)));
    }
    let size = Size { width: 640, height: 480 };
    let default = Camera { size, fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, lens: None };
    let sensors = recipe.sensors_of(trajectory);
    let names: Vec<&str> = sensors.iter().filter_map(|(name, _)| name).collect();
    let chosen = match (sensor, names.as_slice()) {
        (None, []) => sensors.iter().next(),
        (Some(asked), _) => sensors.iter().find(|(name, _)| *name == Some(asked)),
        (None, [_]) => sensors.iter().next(),
        (None, _) => None,
    };
    let Some((sensor_name, sensor)) = chosen else {
        let wanted = names.join(", ");
        let found = sensor.map_or("no sensor".to_owned(), |name| format!("the sensor `{name}`"));
        let because = format!("found {found}, wanted `sensor:` with one of: {wanted}");
        return Err(ExportError::Selection(because));
    };
    let outputs = recipe.outputs_of(trajectory);
    let has = |name: &str| outputs.iter().any(|output| output.name() == name);
    let poses = |output: &str| if has(output) { (0..PROMISED_POSES).collect() } else { Vec::new() };
    let stamp = |pose: usize| i64::try_from(pose).unwrap_or_default() * PROMISED_STEP_US;
    let exposure = |pose: usize| Exposure { pose, open_us: [stamp(pose - 1), stamp(pose + 1)] };
    // An exposure needs a pose on each side, so the first and the last have none. Every third keeps them
    // apart.
    let exposed = (1..PROMISED_POSES - 1).step_by(3).filter(|_| has("blur")).map(exposure);
    let still = Se3 { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };
    let camera = choose_camera(recipe.camera_along(trajectory), Some(&default)).unwrap_or(default);
    let no_files = Arc::new(ListedFiles::default());
    Ok(ExportSubject {
        release: Value::Null,
        scene: recipe.scene.clone(),
        trajectory: trajectory.to_owned(),
        sensor_name: sensor_name.map(str::to_owned),
        camera,
        poses: Trajectory {
            world_from_camera: vec![still; PROMISED_POSES],
            stamps_us: (0..PROMISED_POSES).map(stamp).collect(),
        },
        sharp: poses("sharp"),
        depth: poses("depth"),
        flow: poses("flow"),
        exposures: exposed.collect(),
        blur_mean: recipe.shutter.mean,
        readout_us: recipe.readout_us.unwrap_or(0),
        is_lit: recipe.lights.is_some(),
        // The release may state it without the output.
        depth_range: Some([1.0, 2.0]),
        sensor: has("events").then(|| sensor.clone()),
        tree: TrajectoryFiles::new(no_files, &recipe.scene, trajectory, camera)?,
    })
}
