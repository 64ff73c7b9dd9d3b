//! The one seam between domain codecs and the store: which files an artifact consists of, and how it is opened.
//!
//! An artifact is a handful of named files. Small ones are read whole; large ones (events, pictures) are opened as
//! handles, and their bytes are streamed by whoever needs them.

use crate::camera::Camera;
use crate::check::Finding;
use crate::check::sampling::Resampled;
use crate::files;
use crate::foreign::Foreign;
use crate::frames::anchors::Anchors;
use crate::image::{Image, npy};
use crate::render::fidelity::Fidelity;
use crate::render::flow::Quantiles;
use crate::render::{Omit, Velocity, Work};
use crate::sampling::Chosen;
use crate::sampling::exposure::Exposure;
use crate::scene::{Gaussians, Screening};
use crate::se3::{Se3, Twist};
use crate::seed::Seed;
use crate::sensor::front_end::{self, FrontEnd};
use crate::sensor::{Account, Sensor};
use crate::source::Capture;
use crate::speed::Meaning;
use crate::store::Store;
use crate::store::record::Output;
use crate::trajectory::Trajectory;
use crate::trajectory::report::Report;
use crate::trajectory::twist::twists;
use crate::units::Ratio;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

/// The files of an artifact by name, wherever the store keeps them.
#[derive(Debug, Clone, Default)]
pub struct Files {
    files: BTreeMap<String, Stored>,
}

/// A file in the store.
#[derive(Debug, Clone)]
struct Stored {
    path: PathBuf,
    size: u64,
}

impl Files {
    /// The files that a step made, where the store keeps them.
    #[must_use]
    pub fn of(outputs: &[Output], store: &Store) -> Self {
        let stored = |o: &Output| Stored { path: store.path_of(&o.digest), size: o.size };
        Self { files: outputs.iter().map(|o| (o.name.clone(), stored(o))).collect() }
    }

    /// Sum of their lengths.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.files.values().map(|file| file.size).sum()
    }

    /// Length of the file of this name; 0 where there is none.
    #[must_use]
    pub fn size(&self, name: &str) -> u64 {
        self.files.get(name).map_or(0, |file| file.size)
    }

    /// Where the file of this name lies.
    ///
    /// # Errors
    /// When the artifact has no such file.
    pub fn path(&self, name: &str) -> Result<&Path, ArtifactError> {
        let found = self.files.get(name).map(|file| file.path.as_path());
        found.ok_or_else(|| ArtifactError { name: name.to_owned(), because: "it is not there".into() })
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
    /// When it is absent or of another form.
    pub fn json<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T, ArtifactError> {
        self.read(name, |file| serde_json::from_reader(file))
    }
}

/// Why a stored artifact cannot be opened: it was altered behind the store's back, or another version wrote it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("open {name} in the store: {because}")]
pub struct ArtifactError {
    name: String,
    because: String,
}

/// Writes `value` as JSON for people and programs: indented, final newline.
///
/// # Errors
/// When the file cannot be written.
pub fn write_json<T: serde::Serialize>(path: &Path, value: &T) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    serde_json::to_writer_pretty(&mut file, value)?;
    file.write_all(b"\n")?;
    file.flush()
}

/// Something that steps hand to one another through the store.
pub trait Artifact: Sized {
    /// What it is; the role of the input that holds it.
    const KIND: &'static str;

    /// Opens it.
    ///
    /// # Errors
    /// When a file is absent or cannot be read.
    fn open(files: &Files) -> Result<Self, ArtifactError>;
}

impl Artifact for Capture {
    const KIND: &'static str = "capture";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        files.json("capture.json")
    }
}

impl Artifact for Gaussians {
    const KIND: &'static str = "gaussians";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        let path = files.path("scene.ply")?;
        crate::scene::read(path)
            .map_err(|e| ArtifactError { name: "scene.ply".into(), because: e.to_string() })
    }
}

/// A trajectory with its report.
#[derive(Debug)]
pub struct Motion {
    /// The poses.
    pub trajectory: Trajectory,
    /// Its `speed.json`.
    pub report: Report,
}

impl Motion {
    /// When each pose is, s: at its number over the frame rate, exactly, or at its stamp where the rate varies.
    #[must_use]
    pub fn seconds(&self) -> Vec<f64> {
        let stamps = &self.trajectory.stamps_us;
        match self.report.rate.parse::<Ratio>() {
            Ok(rate) if self.report.meaning != Meaning::FrameRate => {
                let [p, q] = [rate.numerator(), rate.denominator()].map(|n| n as f64);
                (0..stamps.len()).map(|j| j as f64 * q / p).collect()
            }
            _ => stamps.iter().map(|t| *t as f64 * 1e-6).collect(),
        }
    }

    /// How the camera moves at each pose, in its own axes.
    #[must_use]
    pub fn velocities(&self) -> Vec<Velocity> {
        let poses = &self.trajectory.world_from_camera;
        let own = |(pose, twist): (&Se3, Twist)| Velocity {
            linear: pose.rotation.conjugate() * twist.linear,
            angular: twist.angular,
        };
        poses.iter().zip(twists(poses, &self.seconds())).map(own).collect()
    }
}

impl Artifact for Motion {
    const KIND: &'static str = "trajectory";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        let trajectory = files.read("poses.txt", Trajectory::read_poses)?;
        Ok(Self { trajectory, report: files.json("speed.json")? })
    }
}

/// The event streams of a trajectory and what was counted while they were made.
#[derive(Debug)]
pub struct EventStreams {
    /// The file of each of [`Simulation::streams`].
    pub files: Vec<PathBuf>,
    /// What was seen at a few frames through each of [`Simulation::front_ends`]: `brightness.npy` and so on, float32
    /// `[K, H, W]`.
    anchors: Vec<Anchors>,
    /// Depth at [`Simulation::depth_stamps_us`], units along the optical axis.
    pub depths: Vec<Image<f32>>,
    /// The rest.
    pub simulation: Simulation,
}

/// One of the streams.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stream {
    /// The sensor's name, where there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The sensor.
    pub sensor: Sensor,
    /// What it counted.
    pub account: Account,
    /// What it sees at twice the frames, in a few intervals; `None` where that was not tried.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resampled: Option<Resampled>,
}

impl Stream {
    /// The name of a stream's file in the store.
    #[must_use]
    pub fn stored(name: Option<&str>) -> String {
        name.map_or_else(|| "events.h5".to_owned(), |name| format!("events-{name}.h5"))
    }

    /// The name of a stream's file in a trajectory's folder of a release.
    #[must_use]
    pub fn released(name: Option<&str>) -> String {
        name.map_or_else(|| "events.h5".to_owned(), |name| format!("events/{name}.h5"))
    }
}

/// How event streams were made: `simulation.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simulation {
    /// The camera that was rendered.
    pub camera: Camera,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Degree of their harmonics.
    pub sh_degree: u8,
    /// What the reader of the scene left out or mended.
    pub screening: Screening,
    /// Whether the antialiased rule was used.
    pub antialiased: bool,
    /// The streams, one a sensor, in the order of names.
    pub streams: Vec<Stream>,
    /// Seed of their noise.
    pub seed: Seed,
    /// What the renderer left out.
    #[serde(default, skip_serializing_if = "Omit::is_needless")]
    pub omit: Omit,
    /// What the renderer counted, over all frames.
    pub work: Work,
    /// How far the picture moves between neighbouring poses, px; `None` where no pixel has a depth.
    pub flow_px: Option<Quantiles>,
    /// Share of the blended weight that comes from Gaussians too deep for their distance, at the same poses; `None` where
    /// nothing is blended.
    pub doubtful_share: Option<f64>,
    /// Depth at the same poses, units: 5 %, 50 % and 95 % quantile.
    pub depth_unit: Option<[f32; 3]>,
    /// Stamps of the images in `brightness.npy` and its like.
    pub brightness_stamps_us: Vec<i64>,
    /// Of these images three each that lie close together.
    pub brightness_spans: Vec<[usize; 3]>,
    /// Stamps of the images in `depth.npy`: float32 `[K, H, W]`, unit, NaN where there is none.
    pub depth_stamps_us: Vec<i64>,
    /// When frames were rendered, where the recipe asks for an error and not for a rate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen: Option<Chosen>,
}

impl Simulation {
    /// The front ends of the sensors, each once.
    #[must_use]
    pub fn front_ends(&self) -> Vec<FrontEnd> {
        front_end::distinct(self.streams.iter().map(|stream| stream.sensor.as_model()))
    }
}

impl EventStreams {
    /// The name of the file with the depths.
    pub const DEPTH: &str = "depth.npy";

    /// The name of the file with what was seen through the `i`-th front end.
    #[must_use]
    pub fn brightness(i: usize) -> String {
        if i == 0 { "brightness.npy".to_owned() } else { format!("brightness-{i}.npy") }
    }

    /// What the sensor of a stream saw at a few frames.
    #[must_use]
    pub fn seen_by(&self, stream: &Stream) -> &Anchors {
        let front_end = stream.sensor.as_model().front_end();
        let at = self.simulation.front_ends().iter().position(|other| *other == front_end);
        &self.anchors[at.expect("it is one of the simulation's streams")]
    }
}

impl Artifact for EventStreams {
    const KIND: &'static str = "events";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        let simulation: Simulation = files.json("simulation.json")?;
        let stamps = &simulation.brightness_stamps_us;
        let spans = &simulation.brightness_spans;
        let read = |file| Anchors::read(stamps.clone(), spans.clone(), file);
        let anchors = |i| files.read(&Self::brightness(i), read);
        let anchors = (0..simulation.front_ends().len()).map(anchors).collect::<Result<_, _>>()?;
        let file = |stream: &Stream| files.path(&Stream::stored(stream.name.as_deref())).map(Path::to_owned);
        let stored = simulation.streams.iter().map(file).collect::<Result<_, _>>()?;
        let count = simulation.depth_stamps_us.len();
        let depths = files.read(Self::DEPTH, |file| npy::read_stack(count, file))?;
        Ok(Self { files: stored, anchors, depths, simulation })
    }
}

/// Pictures by name: PNG, or arrays of numbers.
#[derive(Debug)]
pub struct Pictures {
    /// Name and path, sorted by name.
    pub files: Vec<(String, PathBuf)>,
}

impl Artifact for Pictures {
    const KIND: &'static str = "pictures";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        Ok(Self { files: files.iter().map(|(name, path)| (name.to_owned(), path.to_owned())).collect() })
    }
}

/// Blurred frames: PNG files, and how each was exposed.
#[derive(Debug)]
pub struct Blurred {
    /// In the order of poses.
    pub exposures: Vec<Exposure>,
}

impl Blurred {
    /// The name of the file that says how they were exposed.
    pub const EXPOSURES: &str = "exposures.json";
}

impl Artifact for Blurred {
    const KIND: &'static str = "blurred";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        Ok(Self { exposures: files.json(Self::EXPOSURES)? })
    }
}

impl Artifact for Fidelity {
    const KIND: &'static str = "fidelity";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        files.json("fidelity.json")
    }
}

impl Artifact for Foreign {
    const KIND: &'static str = "foreign";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        files.json("foreign.json")
    }
}

/// The verdicts on a trajectory, or on a scene: `verdicts.json`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdicts {
    /// One record a statement; the subjects are empty but for the name of a stream and a statement's own suffix.
    pub findings: Vec<Finding>,
    /// Most events in one millisecond, a stream; none of a scene.
    pub peaks_ev_per_ms: Vec<u64>,
}

impl Verdicts {
    /// The findings on a scene, with its id.
    #[must_use]
    pub fn findings_of_scene(mut self, scene: &str) -> Vec<Finding> {
        for finding in &mut self.findings {
            finding.subject.insert_str(0, scene);
        }
        self.findings
    }

    /// The findings, with the trajectory that they are about.
    #[must_use]
    pub fn findings_of(mut self, scene: &str, trajectory: &str) -> Vec<Finding> {
        for finding in &mut self.findings {
            finding.subject.insert_str(0, &format!("{scene}/{trajectory}"));
        }
        self.findings
    }
}

impl Artifact for Verdicts {
    const KIND: &'static str = "checks";

    fn open(files: &Files) -> Result<Self, ArtifactError> {
        files.json("verdicts.json")
    }
}
