//! The event streams of a trajectory and the record of their simulation.

use super::{Artifact, ArtifactError, ArtifactFiles};
use gs2e_check::sampling::ResampledIntervals;
use gs2e_image::{Image, npy};
use gs2e_num::seed::Seed;
use gs2e_render::{OmissionPolicy, RenderWork};
use gs2e_sampling::SamplingChoice;
use gs2e_scene::SceneScreening;
use gs2e_scene::camera::Camera;
use gs2e_sensor::frames::anchors::AnchorFrames;
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::{SensorChoice, SimulationAccount, front_end};
use gs2e_trajectory::flow::FlowQuantiles;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

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
