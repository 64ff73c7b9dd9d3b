//! The interface between domain formats and the store: the files of each artifact, and how it is
//! opened.
//!
//! An artifact is a small set of named files. Small files are read whole. Large ones (events,
//! pictures) are opened as handles, and consumers stream their bytes.

use gs2e_check::Finding;
use gs2e_check::sampling::ResampledIntervals;
use gs2e_files as files;
use gs2e_image::{Image, npy};
use gs2e_num::se3::{Se3, Twist};
use gs2e_num::seed::Seed;
use gs2e_num::units::Ratio;
use gs2e_render::{OmissionPolicy, RenderWork};
use gs2e_sampling::SamplingChoice;
use gs2e_sampling::exposure::ExposureRecord;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraVelocity;
use gs2e_scene::dynamic::file::{DynamicsRecord, open_files};
use gs2e_scene::motion::SceneMotion;
use gs2e_scene::{Gaussians, SceneScreening};
use gs2e_sensor::frames::anchors::AnchorFrames;
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::{SensorChoice, SimulationAccount, front_end};
use gs2e_source::Capture;
use gs2e_source::colmap::ColmapModel;
use gs2e_source::foreign::ExternalReport;
use gs2e_store::record::{StoredOutput, content_digest};
use gs2e_store::{Digest, Store};
use gs2e_train::fidelity::PhotoFidelity;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::flow::FlowQuantiles;
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::speed::SpeedMeaning;
use gs2e_trajectory::twist::pose_twists;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The files of an artifact by name, with their paths in the store.
#[derive(Debug, Clone, Default)]
pub struct ArtifactFiles {
    files: BTreeMap<String, StoredFile>,
}

/// A file in the store.
#[derive(Debug, Clone)]
struct StoredFile {
    path: PathBuf,
    digest: Digest,
    size: u64,
}

impl ArtifactFiles {
    /// The files of a step, with their paths in the store.
    #[must_use]
    pub fn from_outputs(outputs: &[StoredOutput], store: &Store) -> Self {
        let stored = |o: &StoredOutput| {
            let StoredOutput { digest, size, .. } = *o;
            StoredFile { path: store.path_of(&digest), digest, size }
        };
        Self { files: outputs.iter().map(|o| (o.name.clone(), stored(o))).collect() }
    }

    /// The digest of the names and bytes of all files.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let outputs = self.files.iter().map(|(name, file)| {
            let StoredFile { digest, size, .. } = *file;
            StoredOutput { name: name.clone(), digest, size }
        });
        content_digest(&outputs.collect::<Vec<_>>())
    }

    /// Sum of the file sizes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.files.values().map(|file| file.size).sum()
    }

    /// Size of the file with this name, bytes; 0 if the artifact has no such file.
    #[must_use]
    pub fn size(&self, name: &str) -> u64 {
        self.files.get(name).map_or(0, |file| file.size)
    }

    /// Path of the file with this name.
    ///
    /// # Errors
    /// The artifact has no such file.
    pub fn path(&self, name: &str) -> Result<&Path, ArtifactError> {
        let found = self.files.get(name).map(|file| file.path.as_path());
        found.ok_or_else(|| ArtifactError {
            name: name.to_owned(),
            because: "the artifact has no such file".into(),
        })
    }

    /// All names and paths, sorted by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Path)> {
        self.files.iter().map(|(name, file)| (name.as_str(), file.path.as_path()))
    }

    fn read<T, E: ToString>(
        &self,
        name: &str,
        parse: impl FnOnce(BufReader<File>) -> Result<T, E>,
    ) -> Result<T, ArtifactError> {
        let failed = |because: String| ArtifactError { name: name.to_owned(), because };
        let file = files::open(self.path(name)?).map_err(|e| failed(e.to_string()))?;
        parse(BufReader::new(file)).map_err(|e| failed(e.to_string()))
    }

    /// Reads a JSON file.
    ///
    /// # Errors
    /// The file is absent or has another form.
    pub fn json<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T, ArtifactError> {
        self.read(name, |file| serde_json::from_reader(file))
    }
}

/// The reason why a stored artifact cannot be opened: it was altered, or another version wrote it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("open {name} in the store: {because}")]
pub struct ArtifactError {
    name: String,
    because: String,
}

/// Writes `value` as readable JSON: indented, with a final newline.
///
/// # Errors
/// The file cannot be written.
pub fn write_json<T: serde::Serialize>(path: &Path, value: &T) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    serde_json::to_writer_pretty(&mut file, value)?;
    file.write_all(b"\n")?;
    // Dropping the writer would flush it too, but lose the error.
    file.flush()
}

/// A product that steps pass to one another through the store.
pub trait Artifact: Sized {
    /// Name of the kind; also the role of the input that takes it.
    const KIND: &'static str;

    /// Opens the artifact.
    ///
    /// # Errors
    /// A file is absent or cannot be read.
    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError>;
}

impl Artifact for Capture {
    const KIND: &'static str = "capture";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("capture.json")
    }
}

/// Name of the records of the objects, next to a scene that has some. Products of every store have this name,
/// so it stays what it was when objects were called parts.
pub(crate) const SCENE_OBJECTS: &str = "parts.json";

/// Name of the record of the change of a scene that changes with time, next to the scene.
pub(crate) const SCENE_TIME: &str = "time.json";

/// Name of the places of the objects, next to the segmentation.
pub const OBJECT_PLACES: &str = "objects.csv";

/// Name of the record of a training, next to the scene that it made.
pub const TRAINING_FILE: &str = "training.json";

/// A COLMAP model that was made for photos without poses.
#[derive(Debug)]
pub struct SolvedModel {
    /// The model.
    pub model: ColmapModel,
    /// Its points.
    pub points: PathBuf,
}

impl Artifact for SolvedModel {
    const KIND: &'static str = "model";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        let file = |name| files.path(name).map(Path::to_owned);
        let points = file("points3D.bin")?;
        let model = ColmapModel::from_files(file("cameras.bin")?, file("images.bin")?, points.clone());
        Ok(Self { model, points })
    }
}

impl Artifact for Gaussians {
    const KIND: &'static str = "gaussians";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        let path = files.path("scene.ply")?;
        if files.size(SCENE_TIME) > 0 {
            let record: DynamicsRecord = files.json(SCENE_TIME)?;
            let failed = |because: String| ArtifactError { name: SCENE_TIME.into(), because };
            let listed = record.names().map(|name| files.path(&name).map(Path::to_owned));
            let listed: Vec<PathBuf> = listed.collect::<Result<_, _>>()?;
            return open_files(&record, &listed).map_err(|e| failed(e.to_string()));
        }
        let scene = gs2e_scene::read_file(path)
            .map_err(|e| ArtifactError { name: "scene.ply".into(), because: e.to_string() })?;
        if files.size(SCENE_OBJECTS) == 0 {
            return Ok(scene);
        }
        let motion = SceneMotion::prepare(files.json(SCENE_OBJECTS)?)
            .map_err(|e| ArtifactError { name: SCENE_OBJECTS.into(), because: e.to_string() })?;
        let starts = motion.records().map(|object| object.first);
        if !starts.is_sorted() || motion.records().any(|object| object.first > scene.len()) {
            let because = format!("a part begins outside of the {} Gaussians of the scene", scene.len());
            return Err(ArtifactError { name: SCENE_OBJECTS.into(), because });
        }
        Ok(Self { motion: Some(Arc::new(motion)), ..scene })
    }
}

/// A trajectory with its report.
#[derive(Debug)]
pub struct TrajectoryProduct {
    /// The poses.
    pub trajectory: Trajectory,
    /// Its `speed.json`.
    pub report: SpeedReport,
}

impl TrajectoryProduct {
    /// Time of each pose, s: its index divided by the frame rate, exactly, or its stamp if the rate
    /// varies.
    #[must_use]
    pub fn seconds(&self) -> Vec<f64> {
        let stamps = &self.trajectory.stamps_us;
        // A stamp is rounded to a microsecond, about 1e-3 of a step at 2400 Hz, and a velocity
        // divides by the step.
        match self.report.rate.parse::<Ratio>() {
            Ok(rate) if self.report.meaning != SpeedMeaning::FrameRate => {
                let [p, q] = [rate.numerator(), rate.denominator()].map(|n| n as f64);
                (0..stamps.len()).map(|j| j as f64 * q / p).collect()
            }
            _ => stamps.iter().map(|t| *t as f64 * 1e-6).collect(),
        }
    }

    /// Velocity of the camera at each pose, in its own axes.
    #[must_use]
    pub fn velocities(&self) -> Vec<CameraVelocity> {
        let poses = &self.trajectory.world_from_camera;
        // A twist has its linear rate in world axes, its angular rate in the camera's own.
        let own = |(pose, twist): (&Se3, Twist)| CameraVelocity {
            linear: pose.rotation.conjugate() * twist.linear,
            angular: twist.angular,
        };
        poses.iter().zip(pose_twists(poses, &self.seconds())).map(own).collect()
    }
}

impl Artifact for TrajectoryProduct {
    const KIND: &'static str = "trajectory";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        let trajectory = files.read("poses.txt", Trajectory::read_poses)?;
        Ok(Self { trajectory, report: files.json("speed.json")? })
    }
}

/// The event streams of a trajectory, and the counts of their simulation.
#[derive(Debug)]
pub struct EventStreams {
    /// The file of each stream of [`SimulationRecord::streams`].
    pub files: Vec<PathBuf>,
    /// Some frames as seen through each of [`SimulationRecord::front_ends`], float32 `[K, H, W]`:
    /// `brightness.npy` and so on.
    anchors: Vec<AnchorFrames>,
    /// Depth at [`SimulationRecord::depth_stamps_us`], units along the optical axis.
    pub depths: Vec<Image<f32>>,
    /// The record of the simulation.
    pub simulation: SimulationRecord,
}

/// One stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventStream {
    /// The sensor's name, if there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The sensor.
    pub sensor: SensorChoice,
    /// Its counts.
    pub account: SimulationAccount,
    /// Its events in some intervals with twice the frames; `None` if that was not simulated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resampled: Option<ResampledIntervals>,
}

impl EventStream {
    /// File name of a stream in the store.
    #[must_use]
    pub fn stored_name(name: Option<&str>) -> String {
        name.map_or_else(|| "events.h5".to_owned(), |name| format!("events-{name}.h5"))
    }
}

/// The record of a simulation: `simulation.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulationRecord {
    /// The camera.
    pub camera: Camera,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Degree of their harmonics.
    pub sh_degree: u8,
    /// Counts of what the reader of the scene left out or repaired.
    pub screening: SceneScreening,
    /// True if the antialiased rule was used.
    pub antialiased: bool,
    /// One stream per sensor, in the order of names.
    pub streams: Vec<EventStream>,
    /// Seed of their noise.
    pub seed: Seed,
    /// Work that the renderer left out.
    #[serde(default, skip_serializing_if = "OmissionPolicy::is_needless")]
    pub omit: OmissionPolicy,
    /// Work of the renderer, summed over all frames.
    pub work: RenderWork,
    /// Image motion between neighbouring poses, px; `None` if no pixel has a depth.
    pub flow_px: Option<FlowQuantiles>,
    /// Share of the blended weight from Gaussians too deep for their distance, at the same poses;
    /// `None` if nothing is blended.
    pub doubtful_share: Option<f64>,
    /// Depth at the same poses, units: 5 %, 50 % and 95 % quantiles.
    pub depth_unit: Option<[f32; 3]>,
    /// Stamps of the images in `brightness.npy` and the others.
    pub brightness_stamps_us: Vec<i64>,
    /// Index triples of closely spaced images, one per span.
    pub brightness_spans: Vec<[usize; 3]>,
    /// Stamps of the images in `depth.npy`: float32 `[K, H, W]`, units, NaN without depth.
    pub depth_stamps_us: Vec<i64>,
    /// The choice of frames, if the recipe gives a tolerance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen: Option<SamplingChoice>,
}

impl SimulationRecord {
    /// The distinct front ends of the sensors.
    #[must_use]
    pub fn front_ends(&self) -> Vec<FrontEnd> {
        front_end::distinct_front_ends(self.streams.iter().map(|stream| stream.sensor.as_model()))
    }
}

impl EventStreams {
    /// Name of the file with the depths.
    pub const DEPTH: &str = "depth.npy";

    /// Name of the file with the frames seen through the `i`-th front end.
    #[must_use]
    pub(crate) fn brightness_name(i: usize) -> String {
        if i == 0 { "brightness.npy".to_owned() } else { format!("brightness-{i}.npy") }
    }

    /// Some frames as the sensor of a stream saw them.
    #[must_use]
    pub fn anchors_of(&self, stream: &EventStream) -> &AnchorFrames {
        // Sensors with equal front ends see the same frames, which are stored once.
        let front_end = stream.sensor.as_model().front_end();
        let at = self.simulation.front_ends().iter().position(|other| *other == front_end);
        &self.anchors[at.expect("it is one of the simulation's streams")]
    }
}

impl Artifact for EventStreams {
    const KIND: &'static str = "events";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        let simulation: SimulationRecord = files.json("simulation.json")?;
        // The record comes first: it says how many files there are, and how many images each holds.
        let stamps = &simulation.brightness_stamps_us;
        let spans = &simulation.brightness_spans;
        let read = |file| AnchorFrames::read_images(stamps.clone(), spans.clone(), file);
        let anchors = |i| files.read(&Self::brightness_name(i), read);
        let anchors = (0..simulation.front_ends().len()).map(anchors).collect::<Result<_, _>>()?;
        let file = |stream: &EventStream| {
            files.path(&EventStream::stored_name(stream.name.as_deref())).map(Path::to_owned)
        };
        let stored = simulation.streams.iter().map(file).collect::<Result<_, _>>()?;
        let count = simulation.depth_stamps_us.len();
        let depths = files.read(Self::DEPTH, |file| npy::read_stack(count, file))?;
        Ok(Self { files: stored, anchors, depths, simulation })
    }
}

/// Pictures by name: PNG files or arrays of numbers.
#[derive(Debug)]
pub struct PictureSet {
    /// Name and path, sorted by name.
    pub files: Vec<(String, PathBuf)>,
}

impl Artifact for PictureSet {
    const KIND: &'static str = "pictures";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self { files: files.iter().map(|(name, path)| (name.to_owned(), path.to_owned())).collect() })
    }
}

/// Disparity images of a stereo pair. A kind of its own, so that a step can read them next to depth images.
#[derive(Debug)]
pub struct DisparityPictures(pub PictureSet);

impl Artifact for DisparityPictures {
    const KIND: &'static str = "disparity";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        PictureSet::open(files).map(Self)
    }
}

/// Sharp frames. A kind of its own, so that a step can read them next to depth images.
#[derive(Debug)]
pub struct SharpFrames(pub PictureSet);

impl Artifact for SharpFrames {
    const KIND: &'static str = "sharp";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        PictureSet::open(files).map(Self)
    }
}

/// The files of a scene, for a step that seldom reads them.
#[derive(Debug)]
pub struct SceneFiles(ArtifactFiles);

impl SceneFiles {
    /// Reads the scene.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn read(&self) -> Result<Gaussians, ArtifactError> {
        Gaussians::open(&self.0)
    }
}

impl Artifact for SceneFiles {
    const KIND: &'static str = Gaussians::KIND;

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self(files.clone()))
    }
}

/// Inertial data of a trajectory.
#[derive(Debug)]
pub struct ImuRecording {
    /// Name and path of each file.
    pub files: Vec<(String, PathBuf)>,
}

impl Artifact for ImuRecording {
    const KIND: &'static str = "imu";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self { files: files.iter().map(|(name, path)| (name.to_owned(), path.to_owned())).collect() })
    }
}

/// Blurred frames: PNG files, and the record of each exposure.
#[derive(Debug)]
pub struct BlurredFrames {
    /// Records in the order of poses.
    pub exposures: Vec<ExposureRecord>,
}

impl BlurredFrames {
    /// Name of the file with the records.
    pub const EXPOSURES: &str = "exposures.json";
}

impl Artifact for BlurredFrames {
    const KIND: &'static str = "blurred";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self { exposures: files.json(Self::EXPOSURES)? })
    }
}

/// The picture of held-out views next to `fidelity.json`, if there are any.
pub const HELD_OUT_PICTURE: &str = "held_out.png";

impl Artifact for PhotoFidelity {
    const KIND: &'static str = "fidelity";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("fidelity.json")
    }
}

impl Artifact for ExternalReport {
    const KIND: &'static str = "foreign";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("foreign.json")
    }
}

/// The findings on a trajectory or on a scene: `verdicts.json`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VerdictsRecord {
    /// One record per statement. Subjects contain only the name of a stream and the suffix of the
    /// statement.
    pub findings: Vec<Finding>,
    /// Largest number of events in one millisecond, per stream; empty for a scene.
    pub peaks_ev_per_ms: Vec<u64>,
}

impl VerdictsRecord {
    /// The findings on a scene, with its id.
    #[must_use]
    pub fn findings_of_scene(self, scene: &str) -> Vec<Finding> {
        // Findings are stored without the scene's id, because it is not part of the step.
        findings_below(scene, self.findings)
    }

    /// The findings, with the trajectory as their subject.
    #[must_use]
    pub fn findings_of(self, scene: &str, trajectory: &str) -> Vec<Finding> {
        // The names of scene and trajectory are not part of the step either.
        findings_below(&format!("{scene}/{trajectory}"), self.findings)
    }
}

fn findings_below(place: &str, findings: Vec<Finding>) -> Vec<Finding> {
    findings.into_iter().map(|found| Finding { subject: found.subject.below(place), ..found }).collect()
}

impl Artifact for VerdictsRecord {
    const KIND: &'static str = "checks";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("verdicts.json")
    }
}
