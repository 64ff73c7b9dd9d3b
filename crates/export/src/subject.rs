//! What an export reads: one trajectory of a release, with one sensor.

use super::ExportError;
use super::source::SubjectFiles;
use glam::DVec3;
use gs2e_build::artifact::EventStream;
use gs2e_event::file::{EventFormat, OpenEventFile, ReadHints};
use gs2e_event::{Event, StreamHeader, file};
use gs2e_files as files;
use gs2e_image::light::MeanScale;
use gs2e_image::{Image, Size, npy, png};
use gs2e_release::include::ComposedScene;
use gs2e_release::{SceneRecord, diff, recipe_of_scene};
use gs2e_scene::camera::Camera;
use gs2e_sensor::SensorChoice;
use gs2e_trajectory::{Trajectory, imu};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::{Path, PathBuf};
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
    pub(super) files: SubjectFiles,
    /// Folder of the trajectory, in the release.
    pub(super) folder: String,
    /// Path of its events, in the release.
    pub(super) events: String,
}

/// A blurred picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exposure {
    /// The pose in the middle, which names the picture.
    pub pose: usize,
    /// Times at which the shutter opens and closes, in the times of the release, us.
    pub open_us: [i64; 2],
}

impl Exposure {
    /// An exposure from a frame of `transforms.json`.
    fn read(frame: &Value) -> Option<Self> {
        let name = frame["blur_file_path"].as_str()?.strip_prefix("blur/")?.strip_suffix(".png")?;
        let open_us = [frame["exposure_start_us"].as_i64()?, frame["exposure_end_us"].as_i64()?];
        Some(Self { pose: name.parse().ok()?, open_us })
    }

    /// Returns true if its pose exists and lies within the exposure, and the exposure within the poses.
    fn fits(&self, stamps_us: &[i64]) -> bool {
        let [start, end] = self.open_us;
        let within = |stamp: &i64| (start..=end).contains(stamp);
        let ends = stamps_us.first().zip(stamps_us.last());
        start < end
            && stamps_us.get(self.pose).is_some_and(within)
            && ends.is_some_and(|(first, last)| *first <= start && end <= *last)
    }
}

impl ExportSubject {
    /// Opens a trajectory of the release in `dir`.
    ///
    /// # Errors
    /// The folder is not a release, a file of it cannot be read, or the choice names nothing or
    /// leaves several possibilities.
    pub fn open(dir: &Path, choice: &SubjectChoice) -> Result<Self, ExportError> {
        let source = |e: diff::DiffError| ExportError::Source(e.to_string());
        let manifest = diff::read_manifest(dir).map_err(source)?;
        let ids: Vec<&str> = manifest.scenes.iter().map(|scene| scene.id.as_str()).collect();
        let at = choose(&ids, choice.scene.as_deref(), "scene", "the release")?;
        let record = diff::read_scene(dir, &manifest.scenes[at]).map_err(source)?;
        let release = json!({
            "release": manifest.name, "version": manifest.version, "tool": manifest.tool,
            "licence": manifest.licence, "scene_licence": record.licence, "recipe_sha256": record.recipe_sha256,
        });
        Self::of_record(SubjectFiles::Folder(dir.to_owned()), &record, release, choice)
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
        Self::of_record(SubjectFiles::Composed(Arc::clone(scene)), record, release, choice)
    }

    fn of_record(
        files: SubjectFiles,
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
        // Names of a release that others made may hold anything; each file is opened below its folder.
        let folder = format!("{id}/{}", part.name);
        let (sensor_name, sensor) = choose_sensor(record, &part.name, choice.sensor.as_deref())?;
        let events = format!("{folder}/{}", EventStream::released_name(sensor_name.as_deref()));
        let depth = part.statistics.depth_unit.map(|q| [f64::from(q.p5), f64::from(q.p95)]);
        let is_encoded = part.blur.as_ref().is_some_and(|blur| blur["mean"] == json!(MeanScale::Encoded));
        let readout_us = record.recipe["sharp"]["readout_us"].as_u64();
        let mut subject = Self {
            release,
            trajectory: part.name.clone(),
            camera: checked(record.camera_of(part).camera(), &files.shown(&format!("{id}/scene.json")))?,
            scene: id,
            sensor_name,
            poses: Trajectory { world_from_camera: Vec::new(), stamps_us: Vec::new() },
            sharp: Vec::new(),
            depth: Vec::new(),
            flow: Vec::new(),
            exposures: Vec::new(),
            blur_mean: if is_encoded { MeanScale::Encoded } else { MeanScale::Linear },
            readout_us: readout_us.and_then(|us| u32::try_from(us).ok()).unwrap_or(0),
            is_lit: !record.recipe["lights"].is_null(),
            depth_range: depth,
            sensor,
            files,
            folder,
            events,
        };
        subject.read_poses()?;
        subject.sharp = subject.pictures("sharp", "png");
        subject.depth = subject.pictures("depth", "npy");
        subject.flow = subject.pictures("flow", "npy");
        subject.exposures = subject.read_exposures()?;
        // A release may lack events that its sensor would make.
        if !subject.files.has(&subject.events) {
            subject.sensor = None;
        }
        Ok(subject)
    }

    fn read_poses(&mut self) -> Result<(), ExportError> {
        let bytes = self.read("poses.txt", files::MAX_DOCUMENT)?;
        let path = self.path("poses.txt");
        let poses =
            Trajectory::read_poses(bytes.as_slice()).map_err(|e| ExportError::unreadable(&path, e))?;
        if poses.stamps_us.len() < 2 {
            return Err(ExportError::unreadable(&path, "wanted two poses at least"));
        }
        self.poses = poses;
        Ok(())
    }

    /// The blurred pictures that `transforms.json` lists. A trajectory without a folder of them has none.
    fn read_exposures(&self) -> Result<Vec<Exposure>, ExportError> {
        let path = self.path("transforms.json");
        if !self.files.has(&format!("{}/blur", self.folder)) {
            return Ok(Vec::new());
        }
        let bytes = self.read("transforms.json", files::MAX_DOCUMENT)?;
        let listed: Value = serde_json::from_slice(&bytes).map_err(|e| ExportError::unreadable(&path, e))?;
        let frames = listed["frames"].as_array().map_or(&[][..], Vec::as_slice);
        let blurred = frames.iter().filter(|frame| frame.get("blur_file_path").is_some());
        let read = |frame: &Value| {
            let exposure = Exposure::read(frame).filter(|exposure| exposure.fits(&self.poses.stamps_us));
            let wanted = "a blurred picture has no pose, or no exposure around it within the poses";
            exposure.ok_or_else(|| ExportError::unreadable(&path, wanted))
        };
        let mut exposures = blurred.map(read).collect::<Result<Vec<_>, _>>()?;
        exposures.sort_by_key(|exposure| exposure.pose);
        Ok(exposures)
    }

    /// The poses with a picture of this kind.
    fn pictures(&self, kind: &str, extension: &str) -> Vec<usize> {
        let has = |pose: &usize| self.files.has(&format!("{}/{kind}/{pose:06}.{extension}", self.folder));
        (0..self.poses.stamps_us.len()).filter(has).collect()
    }

    /// The path of a file of the trajectory, for messages.
    fn path(&self, name: &str) -> PathBuf {
        self.files.shown(&format!("{}/{name}", self.folder))
    }

    /// Reads a file of the trajectory. Nothing outside the release is opened.
    pub(super) fn read(&self, name: &str, limit: u64) -> Result<Vec<u8>, ExportError> {
        let read = self.files.read(&format!("{}/{name}", self.folder), limit);
        read.map_err(|e| ExportError::unreadable(&self.path(name), e))
    }

    /// The file of the sharp picture of a pose, PNG in sRGB.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn sharp_file(&self, pose: usize) -> Result<Vec<u8>, ExportError> {
        self.read(&format!("sharp/{pose:06}.png"), files::MAX_PICTURE)
    }

    /// The sharp picture of a pose, sRGB.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn sharp_picture(&self, pose: usize) -> Result<Image<[u8; 3]>, ExportError> {
        let name = format!("sharp/{pose:06}.png");
        png::read_sized(Cursor::new(self.sharp_file(pose)?), self.camera.size)
            .map_err(|e| ExportError::unreadable(&self.path(&name), e))
    }

    /// The file of the blurred picture of a pose, PNG in sRGB.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn blurred_file(&self, pose: usize) -> Result<Vec<u8>, ExportError> {
        self.read(&format!("blur/{pose:06}.png"), files::MAX_PICTURE)
    }

    /// The blurred picture of a pose, sRGB.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn blurred_picture(&self, pose: usize) -> Result<Image<[u8; 3]>, ExportError> {
        let name = format!("blur/{pose:06}.png");
        png::read_sized(Cursor::new(self.blurred_file(pose)?), self.camera.size)
            .map_err(|e| ExportError::unreadable(&self.path(&name), e))
    }

    /// The optical flow at a pose, px/s to the right and down, row-major; NaN where it is undefined.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn flow_picture(&self, pose: usize) -> Result<Vec<[f32; 2]>, ExportError> {
        let name = format!("flow/{pose:06}.npy");
        let file = self.read(&name, files::MAX_PICTURE)?;
        let Size { width, height } = self.camera.size;
        let values = npy::read_floats(&[height.into(), width.into(), 2], &mut Cursor::new(file));
        let values = values.map_err(|e| ExportError::unreadable(&self.path(&name), e))?;
        Ok(values.as_chunks().0.to_vec())
    }

    /// The file of the depth picture of a pose, NumPy float32 (H, W).
    ///
    /// # Errors
    /// It cannot be read.
    pub fn depth_file(&self, pose: usize) -> Result<Vec<u8>, ExportError> {
        self.read(&format!("depth/{pose:06}.npy"), files::MAX_PICTURE)
    }

    /// Depth along the optical axis at a pose, in units of the poses; NaN where nothing is seen.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn depth_picture(&self, pose: usize) -> Result<Image<f32>, ExportError> {
        let name = format!("depth/{pose:06}.npy");
        let file = self.files.open(&format!("{}/{name}", self.folder));
        let file = file.map_err(|e| ExportError::unreadable(&self.path(&name), e))?;
        gs2e_dataset::depth::read_depth(&file, self.camera.size, None)
            .map_err(|e| ExportError::unreadable(&self.path(&name), e))
    }

    /// The inertial measurements: times from the first pose, ns, with body rates and specific forces; empty if the
    /// release has none.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn inertial(&self) -> Result<Vec<(i64, [DVec3; 2])>, ExportError> {
        let name = format!("imu/{}", imu::files::SAMPLES);
        let path = format!("{}/{name}", self.folder);
        if !self.files.has(&path) {
            return Ok(Vec::new());
        }
        let unreadable = |because: String| ExportError::unreadable(&self.path(&name), because);
        let bytes = self.files.read(&path, files::MAX_DOCUMENT).map_err(|e| unreadable(e.to_string()))?;
        let lines = imu::files::read_lines(&bytes, imu::files::SAMPLES_HEAD).map_err(unreadable)?;
        let vectors = |v: Vec<f64>| [DVec3::new(v[0], v[1], v[2]), DVec3::new(v[3], v[4], v[5])];
        Ok(lines.into_iter().map(|(stamp, values)| (stamp, vectors(values))).collect())
    }

    /// Statements of the file of events.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn event_header(&self) -> Result<StreamHeader, ExportError> {
        Ok(self.open_events()?.header)
    }

    fn open_events(&self) -> Result<OpenEventFile, ExportError> {
        let path = self.files.shown(&self.events);
        let unreadable = |because: String| ExportError::unreadable(&path, because);
        let file = self.files.open(&self.events).map_err(|e| unreadable(e.to_string()))?;
        let hints = ReadHints { size: Some(self.camera.size), ..ReadHints::default() };
        file::open(&file, EventFormat::H5, hints).map_err(|e| unreadable(e.to_string()))
    }

    /// Calls `see` with each event from `first_us` to `last_us`, both included, and its time in
    /// microseconds, in the order of the file. Chunks are read one at a time.
    ///
    /// # Errors
    /// The events cannot be read, are not sorted, or lie outside the sensor; or `see` fails.
    pub fn for_each_event(
        &self,
        [first_us, last_us]: [i64; 2],
        mut see: impl FnMut(&Event, i64) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let path = self.files.shown(&self.events);
        let unreadable = |because: String| ExportError::unreadable(&path, because);
        let size = self.camera.size;
        let mut opened = self.open_events()?;
        let (mut chunk, mut last) = (Vec::new(), i64::MIN);
        while opened.source.next_chunk(&mut chunk).map_err(|e| unreadable(e.to_string()))? {
            for event in &chunk {
                let t_us = event.t.floor_micros();
                if t_us < last || u32::from(event.x) >= size.width || u32::from(event.y) >= size.height {
                    let because = format!("an event at {t_us} us is not sorted, or is outside of {size}");
                    return Err(unreadable(because));
                }
                last = t_us;
                // The stream is sorted, so no later event lies in the interval.
                if t_us > last_us {
                    return Ok(());
                }
                if t_us >= first_us {
                    see(event, t_us)?;
                }
            }
        }
        Ok(())
    }
}

/// The camera of a scene, whose description is at `path`.
fn checked(camera: Camera, path: &Path) -> Result<Camera, ExportError> {
    // The size is a claim of a file, and memory grows with it.
    camera.size.check_sensor().map_err(|e| ExportError::unreadable(path, e))?;
    Ok(camera)
}

/// The index of the chosen name.
fn choose(names: &[&str], asked: Option<&str>, what: &str, of: &str) -> Result<usize, ExportError> {
    let listed = || {
        let shown = names.iter().take(12).copied().collect::<Vec<_>>().join(", ");
        if names.len() > 12 { format!("{shown} and {} more", names.len() - 12) } else { shown }
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
