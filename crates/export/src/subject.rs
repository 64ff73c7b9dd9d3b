//! What an export reads: one trajectory of a release, with one sensor.

use super::ExportError;
use gs2e_event::{Event, StreamHeader};
use gs2e_image::Image;
use gs2e_image::light::MeanScale;
use gs2e_release::include::ComposedScene;
use gs2e_release::{ReleaseManifest, SceneRecord, recipe_of_scene};
use gs2e_scene::camera::Camera;
use gs2e_sensor::SensorChoice;
use gs2e_trajectory::Trajectory;
use gs2e_tree::{
    Exposure, PictureKind, ReleaseFiles, ReleaseFolder, TrajectoryFiles, event_file, read_manifest,
    read_scene,
};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// The names that a person chose. One that is absent may be left out if there is only one.
#[derive(Debug, Clone, Default)]
pub struct SubjectChoice {
    /// Scene id.
    pub scene: Option<String>,
    /// Name of the trajectory.
    pub trajectory: Option<String>,
    /// Name of the sensor.
    pub sensor: Option<String>,
}

/// One trajectory of a release, with one sensor.
#[derive(Debug)]
pub struct ExportSubject {
    /// Name, version and program of the release, licence and recipe digest of the scene, and the
    /// licence of the whole release unless the export is part of it.
    pub release: Value,
    /// Scene id.
    pub scene: String,
    /// Name of the trajectory.
    pub trajectory: String,
    /// Name of the sensor, if the trajectory has several.
    pub sensor_name: Option<String>,
    /// The camera of all pictures and events.
    pub camera: Camera,
    /// All poses, in microseconds.
    pub poses: Trajectory,
    /// Poses with a sharp picture, ascending.
    pub sharp: Vec<usize>,
    /// Poses with a depth picture, ascending.
    pub depth: Vec<usize>,
    /// Poses with a picture of the optical flow, ascending.
    pub flow: Vec<usize>,
    /// The blurred pictures, ascending.
    pub exposures: Vec<Exposure>,
    /// The scale on which the blurred pictures are means.
    pub blur_mean: MeanScale,
    /// Time from the first row of a sharp picture to the last, us; 0 if all rows are of one moment.
    pub readout_us: u32,
    /// True if the light of the scene changes with time.
    pub is_lit: bool,
    /// Percentiles 5 and 95 of the depth, if the release states them.
    pub depth_range: Option<[f64; 2]>,
    /// The sensor, if the trajectory has events.
    pub sensor: Option<SensorChoice>,
    pub(super) tree: TrajectoryFiles<'static>,
}

impl ExportSubject {
    /// Opens a trajectory of the release in `dir`.
    ///
    /// # Errors
    /// The folder is not a release, a file of it cannot be read, or the choice names nothing or
    /// leaves several possibilities.
    pub fn open(dir: &Path, choice: &SubjectChoice) -> Result<Self, ExportError> {
        let manifest: ReleaseManifest = read_manifest(dir)?;
        let ids: Vec<&str> = manifest.scenes.iter().map(|scene| scene.id.as_str()).collect();
        let at = choose(&ids, choice.scene.as_deref(), "scene", "the release")?;
        let record: SceneRecord = read_scene(dir, ids[at])?;
        let release = json!({
            "release": manifest.name, "version": manifest.version, "tool": manifest.tool,
            "licence": manifest.licence, "scene_licence": record.licence, "recipe_sha256": record.recipe_sha256,
        });
        Self::of_record(Arc::new(ReleaseFolder(dir.to_owned())), &record, release, choice)
    }

    /// Opens a trajectory of a scene that is not released yet.
    ///
    /// # Errors
    /// As [`ExportSubject::open`].
    pub fn of_scene(scene: &Arc<ComposedScene>, choice: &SubjectChoice) -> Result<Self, ExportError> {
        let record = &scene.record;
        // Without the licence of the whole release: the same scene may be released with others.
        let release = json!({
            "release": scene.release, "version": scene.version, "tool": scene.tool,
            "scene_licence": record.licence, "recipe_sha256": record.recipe_sha256,
        });
        Self::of_record(scene.files.clone(), record, release, choice)
    }

    fn of_record(
        files: Arc<dyn ReleaseFiles>,
        record: &SceneRecord,
        release: Value,
        choice: &SubjectChoice,
    ) -> Result<Self, ExportError> {
        let id = record.id.clone();
        let names: Vec<&str> = record.trajectories.iter().map(|part| part.name.as_str()).collect();
        let at = choose(&names, choice.trajectory.as_deref(), "trajectory", &id)?;
        let part = &record.trajectories[at];
        if !part.cameras.is_empty() {
            let cameras: Vec<String> =
                part.cameras.iter().map(|name| format!("{}/{name}", part.name)).collect();
            let because =
                format!("{} is the path of a body, wanted one of: {}", part.name, cameras.join(", "));
            return Err(ExportError::Selection(because));
        }
        let (sensor_name, sensor) = choose_sensor(record, &part.name, choice.sensor.as_deref())?;
        let tree = TrajectoryFiles::new(files, &record.id, &part.name, record.camera_of(part).camera())?;
        let poses = tree.poses()?;
        if poses.stamps_us.len() < 2 {
            return Err(tree.refusal("poses.txt", "wanted two poses at least").into());
        }
        let with = |kind| tree.poses_with(kind, 0..poses.stamps_us.len());
        let depth = part.statistics.depth_unit.map(|q| [f64::from(q.p5), f64::from(q.p95)]);
        let is_encoded = part.blur.as_ref().is_some_and(|blur| blur["mean"] == json!(MeanScale::Encoded));
        let readout_us = record.recipe["sharp"]["readout_us"].as_u64();
        // A release may lack events that its sensor would make.
        let has_events = tree.has(&event_file(sensor_name.as_deref()))?;
        Ok(Self {
            release,
            scene: id,
            trajectory: part.name.clone(),
            camera: tree.camera,
            sharp: with(PictureKind::Sharp)?,
            depth: with(PictureKind::Depth)?,
            flow: with(PictureKind::Flow)?,
            exposures: tree.exposures(&poses.stamps_us)?,
            blur_mean: if is_encoded { MeanScale::Encoded } else { MeanScale::Linear },
            readout_us: readout_us.and_then(|us| u32::try_from(us).ok()).unwrap_or(0),
            is_lit: !record.recipe["lights"].is_null(),
            depth_range: depth,
            sensor: sensor.filter(|_| has_events),
            sensor_name,
            poses,
            tree,
        })
    }

    /// The file of the sharp picture of a pose, PNG in sRGB.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn sharp_file(&self, pose: usize) -> Result<Vec<u8>, ExportError> {
        Ok(self.tree.picture(PictureKind::Sharp, pose)?)
    }

    /// The sharp picture of a pose, sRGB.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub(super) fn sharp_picture(&self, pose: usize) -> Result<Image<[u8; 3]>, ExportError> {
        Ok(self.tree.colours(PictureKind::Sharp, pose)?)
    }

    /// Depth along the optical axis at a pose, in units of the poses; NaN where nothing is seen.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub(super) fn depth_picture(&self, pose: usize) -> Result<Image<f32>, ExportError> {
        let mut depth = self.tree.values(PictureKind::Depth, pose)?;
        let unseen = depth.pixels_mut().iter_mut().filter(|depth| !(**depth > 0.0 && depth.is_finite()));
        unseen.for_each(|depth| *depth = f32::NAN);
        Ok(depth)
    }

    /// The optical flow at a pose, px/s to the right and down, row-major; NaN where it is undefined.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub(super) fn flow_picture(&self, pose: usize) -> Result<Vec<[f32; 2]>, ExportError> {
        Ok(self.tree.flow(pose)?.into_pixels())
    }

    /// Statements of the file of events.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn event_header(&self) -> Result<StreamHeader, ExportError> {
        let events = self.tree.events(self.sensor_name.as_deref())?;
        let unstated = StreamHeader { size: self.camera.size, law: None, labelled: events.labelled() };
        Ok(events.header().unwrap_or(unstated))
    }

    /// Calls `see` with each event from `first_us` to `last_us`, both included, and its time in
    /// microseconds, in the order of the file. Chunks are read one at a time.
    ///
    /// # Errors
    /// The events cannot be read, are not sorted, or lie outside the sensor; or `see` fails.
    pub(super) fn for_each_event(
        &self,
        window_us: [i64; 2],
        see: impl FnMut(&Event, i64) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        self.tree.for_each_event(self.sensor_name.as_deref(), window_us, see)
    }
}

/// The index of the chosen name.
fn choose(names: &[&str], asked: Option<&str>, what: &str, of: &str) -> Result<usize, ExportError> {
    let listed = || {
        let listed = names.iter().take(12).copied().collect::<Vec<_>>().join(", ");
        if names.len() > 12 { format!("{listed} and {} more", names.len() - 12) } else { listed }
    };
    match asked {
        Some(asked) => names.iter().position(|name| *name == asked).ok_or_else(|| {
            ExportError::Selection(format!("{of} has no {what} `{asked}`; it has: {}", listed()))
        }),
        None if names.len() == 1 => Ok(0),
        None => Err(ExportError::Selection(format!(
            "{of} has {} {}; choose one with --{what}: {}",
            names.len(),
            if what == "trajectory" { "trajectories".to_owned() } else { format!("{what}s") },
            listed()
        ))),
    }
}

fn choose_sensor(
    record: &SceneRecord,
    trajectory: &str,
    asked: Option<&str>,
) -> Result<(Option<String>, Option<SensorChoice>), ExportError> {
    let recipe = recipe_of_scene(record).map_err(|e| ExportError::Source(format!("{}: {e}", record.id)))?;
    let sensors: Vec<(Option<&str>, &SensorChoice)> = recipe.sensors_of(trajectory).iter().collect();
    let names: Vec<&str> = sensors.iter().filter_map(|(name, _)| *name).collect();
    if names.is_empty() && asked.is_none() {
        return Ok((None, sensors.first().map(|(_, sensor)| (*sensor).clone())));
    }
    let at = choose(&names, asked, "sensor", trajectory)?;
    Ok((Some(names[at].to_owned()), Some(sensors[at].1.clone())))
}
