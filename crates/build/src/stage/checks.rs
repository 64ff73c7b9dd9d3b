//! Stage `checks`: runs the validation passes over a trajectory and its streams.
//!
//! The scene id and the name of the trajectory are not part of the input, so findings are stored
//! with an empty subject, which is added for display. Pictures of some passes lie next to them as
//! `<check>.png`, or `<sensor>.<check>.png` for several sensors.

mod flash;
mod pictures;
mod products;

use flash::FlashProducts;
use products::CheckedProducts;

use super::{OpenedInputs, Stage, StageContext, StageError, StageFacts, StepNeed, StepTarget};
use crate::artifact::{
    ArtifactFiles, EventStream, EventStreams, SimulationRecord, TrajectoryProduct, VerdictsRecord,
};
use flash::FlashGround;
use gs2e_check::coverage::ViewCoverage;
use gs2e_check::drift::DriftLaw;
use gs2e_check::motion::warp::{FlowAt, observed_px};
use gs2e_check::tally::{StreamObserver, TallyReference};
use gs2e_check::{Limits, StreamTally, TrajectorySubject, judge_trajectory};
use gs2e_event::{EventSource, h5};
use gs2e_image::Image;
use gs2e_num::se3::Se3;
use gs2e_num::units::{Hertz, Ratio};
use gs2e_render::RenderChoice;
use gs2e_scene::camera::CameraChoice;
use gs2e_scene::camera::flow::flow_rates;
use gs2e_scene::camera::view::CameraView;
use gs2e_source::foreign::ExternalReport;
use gs2e_trajectory::imu::ImuModel;
use gs2e_trajectory::mount::CameraMount;
use serde::Serialize;
use std::path::PathBuf;

/// Name of the stage.
pub const NAME: &str = "checks";

/// Parameters: limits and waivers of the recipe.
#[derive(Debug, Serialize)]
pub(crate) struct ChecksStage {
    /// Limits and waivers.
    pub limits: Limits,
    /// True if the light of the scene changes.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub light_changes: bool,
    /// True if things move on paths of their own, or the scene changes with time. Keys have the older name.
    #[serde(rename = "own_motion", skip_serializing_if = "std::ops::Not::not")]
    pub moves_by_itself: bool,
    /// The inertial sensor, if its data are checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu: Option<ImuModel>,
    /// The stereo pair, if disparity is checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pair: Option<CheckedPair>,
    /// The rendering, which finds the Gaussian that made a flash. The products depend on it, and they are
    /// inputs.
    #[serde(skip)]
    pub render: RenderChoice,
}

/// The cameras of a stereo pair, and their places on the body.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct CheckedPair {
    /// The first camera, if it differs from that of the source.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first: Option<CameraChoice>,
    /// The second camera, if it differs from that of the source.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second: Option<CameraChoice>,
    /// Places of the first and the second camera.
    pub mounts: [CameraMount; 2],
    /// The motion between them.
    #[serde(skip)]
    pub second_from_first: Se3,
}

impl StageFacts for ChecksStage {
    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        // The stream is read in chunks. Some frames as the sensor saw them, and the counts of each
        // pixel, are in memory.
        let brightness = |files: &ArtifactFiles| -> u64 {
            let held = |name: &str| name.starts_with("brightness") || name == EventStreams::DEPTH;
            let images = files.iter().filter(|(name, _)| held(name));
            images.map(|(name, _)| files.size(name)).sum()
        };
        // The flow computed from a depth takes two numbers per pixel.
        let flows = files.iter().map(|files| 2 * files.size(EventStreams::DEPTH)).sum::<u64>();
        let held = files.iter().map(|files| brightness(files) + files.size("poses.txt")).sum::<u64>() + flows;
        // The scene is read after an alarm only.
        let scene = files.iter().map(|files| files.size("scene.ply")).max().unwrap_or(0);
        StepNeed::for_memory([held, held, held, 4 * scene])
    }
}

impl Stage for ChecksStage {
    const NAME: &'static str = NAME;
    const REVISION: u32 = 16;
    type Inputs = (
        StepTarget<TrajectoryProduct>,
        Option<StepTarget<EventStreams>>,
        Option<StepTarget<ExternalReport>>,
        (CheckedProducts, FlashProducts),
    );
    type Output = VerdictsRecord;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (motion, events, foreign, (products, flash_products)) = inputs;
        let rate: Ratio =
            motion.report.rate.parse().map_err(StageError::work_failed("read the frame rate"))?;
        let rate = Hertz(rate);
        let flows = events.as_ref().map_or_else(Vec::new, |streams| measured_flows(streams, &motion));
        let tallies = match &events {
            Some(streams) => count_streams(streams, &flows, &motion, rate, cx)?,
            None => Vec::new(),
        };
        let simulation = events.as_ref().map(|streams| &streams.simulation);
        let disparities = self.compare_disparities(&products, &motion, events.as_ref(), cx)?;
        let blocks = self.frame_blocks(flash_products.0.as_ref(), cx)?;
        let whole = TrajectorySubject {
            speed: Some(&motion.report),
            flow: simulation.and_then(|s| s.flow_px),
            moved_px: simulation.and_then(|simulation| moved_px(simulation, &flows, &motion)),
            tolerance: simulation.and_then(|s| Some(s.chosen.as_ref()?.tolerance)),
            coverage: events.as_ref().and_then(view_coverage),
            doubtful_share: simulation.and_then(|s| s.doubtful_share),
            blocks: blocks.as_deref(),
            disparities: disparities.as_ref(),
            foreign: foreign.as_ref(),
            light_changes: self.light_changes,
            moves_by_itself: self.moves_by_itself,
            ..TrajectorySubject::new("", rate, &motion.trajectory, &self.limits)
        };
        let streams = simulation.map_or(&[][..], |simulation| &simulation.streams);
        let named: Vec<String> = streams.iter().map(|s| stream_suffix(s.name.as_deref())).collect();
        let streams: Vec<TrajectorySubject<'_>> = streams
            .iter()
            .zip(&tallies)
            .zip(&named)
            .map(|((EventStream { sensor, account, resampled, .. }, tally), name)| TrajectorySubject {
                name,
                sensor: Some(sensor),
                account: Some(account),
                resampled: resampled.as_ref(),
                tally: Some(tally),
                ..whole
            })
            .collect();
        let mut findings = judge_trajectory(&whole, &streams);
        let ground = FlashGround::new(simulation, flash_products.1.as_ref(), &motion);
        self.name_sources(&mut findings, &std::iter::once(&whole).chain(&streams), ground.as_ref())?;
        findings.extend(self.judge_inertial(products.0.as_ref(), &motion)?);
        write_stream_pictures(&streams, &tallies, cx)?;
        let verdicts =
            VerdictsRecord { findings, peaks_ev_per_ms: tallies.iter().map(|t| t.peak_per_ms).collect() };
        cx.write_record("verdicts.json", &verdicts)
    }
}

/// Writes the pictures of each stream.
fn write_stream_pictures(
    streams: &[TrajectorySubject<'_>],
    tallies: &[StreamTally],
    cx: &StageContext<'_>,
) -> Result<(), StageError> {
    streams.iter().zip(tallies).try_for_each(|(subject, tally)| {
        let law = subject.sensor.map(DriftLaw::for_sensor);
        // The colours of residuals need events that balance the drift.
        let balanced = law.is_some_and(|law| law.loose.is_none());
        pictures::write_pictures(subject.name, tally, balanced, cx)
    })
}

/// The part of a finding's subject for the stream of this name.
fn stream_suffix(name: Option<&str>) -> String {
    name.map_or_else(String::new, |name| format!("/{name}"))
}

/// The image motion at the instants with a known depth, from the poses and stamps of the
/// trajectory. The pose is the one with the nearest stamp, which is within half a frame.
fn measured_flows(streams: &EventStreams, motion: &TrajectoryProduct) -> Vec<FlowAt> {
    let (stamps, velocities) = (&motion.trajectory.stamps_us, motion.velocities());
    let at = |(t_us, depth): (&i64, &Image<f32>)| {
        let after = stamps.partition_point(|t| t < t_us).min(stamps.len() - 1);
        // Chosen frames lie between poses, so stamps need not be equal.
        let near =
            if after > 0 && t_us - stamps[after - 1] < stamps[after] - t_us { after - 1 } else { after };
        let camera = streams.simulation.camera;
        let pose = motion.trajectory.world_from_camera[near];
        let view = CameraView { velocity: velocities[near], ..CameraView::at_rest(camera, pose) };
        FlowAt { t_us: *t_us, px_s: flow_rates(depth, &view) }
    };
    streams.simulation.depth_stamps_us.iter().zip(&streams.depths).map(at).collect()
}

/// The image motion over the whole trajectory.
fn moved_px(simulation: &SimulationRecord, flows: &[FlowAt], motion: &TrajectoryProduct) -> Option<f64> {
    let stamps_us = &motion.trajectory.stamps_us;
    let frames = simulation.chosen.as_ref().map_or(stamps_us.len(), |chosen| chosen.frames);
    observed_px(flows, stamps_us.last().copied().unwrap_or(0), simulation.flow_px, frames)
}

/// The emptiest of the views with a known depth.
fn view_coverage(streams: &EventStreams) -> Option<ViewCoverage> {
    ViewCoverage::from_depths(streams.simulation.depth_stamps_us.iter().copied().zip(&streams.depths))
}

/// Counts each stream in one pass.
fn count_streams(
    streams: &EventStreams,
    flows: &[FlowAt],
    motion: &TrajectoryProduct,
    rate: Hertz,
    cx: &StageContext<'_>,
) -> Result<Vec<StreamTally>, StageError> {
    let simulation = &streams.simulation;
    let end_us = motion.trajectory.stamps_us.last().copied().unwrap_or(0);
    let count = |(stream, file): (&EventStream, &PathBuf)| {
        let against = TallyReference {
            observed: Some((DriftLaw::for_sensor(&stream.sensor), streams.anchors_of(stream))),
            flows,
            dead_us: stream.sensor.dead_us(),
            hot_hz: &[],
            labelled: false,
        };
        let mut observer = StreamObserver::new(simulation.camera.size, rate, end_us, against);
        let mut reader = h5::Reader::open(file).map_err(StageError::work_failed("read events"))?;
        let (mut chunk, mut next) = (Vec::new(), Vec::new());
        let mut is_more = reader.next_chunk(&mut chunk);
        while is_more.map_err(StageError::work_failed("read events"))? {
            cx.go_on()?;
            // The next chunk is decompressed while this one is counted.
            is_more = rayon::in_place_scope(|scope| {
                scope.spawn(|_| observer.append(&chunk));
                reader.next_chunk(&mut next)
            });
            std::mem::swap(&mut chunk, &mut next);
        }
        Ok(observer.finish())
    };
    simulation.streams.iter().zip(&streams.files).map(count).collect()
}
