//! Checks of event datasets that other programs or cameras made: no recipe, no scene, an unknown
//! sensor.
//!
//! ```text
//! events ─┬─ passes over a stream (order, duplicates, rate, balance, hot pixels, structure)
//!         ├─ stamps, pauses and isolated events of pixels         [`stream`]
//!         ├─ holes: times without events                          `gaps`
//!         └─ with frames: [`alignment`], clock `clock`, `noise`, thresholds [`response`]
//! poses ──── continuity
//! frames, poses, depth, camera ── geometry of the pictures, motion of the events  [`views`]
//! ```
//! What a build states about its sensor is estimated here, with a standard error: the thresholds in
//! the logarithm of brightness, the offset of the clocks, the resolution of the stamps, the dead time
//! and the noise. An estimate has no limit and passes; only faults that no camera explains warn or
//! fail.
//!
//! The passes are those of `gs2e-check`. Events come from `gs2e-event`, poses from `gs2e-trajectory`,
//! the camera from `gs2e-scene`, frames from `gs2e-image` and `gs2e-sensor`, and units from `gs2e-num`;
//! `gs2e-files` looks for the files of a layout. `gs2e-release` writes a page about the report, and
//! `gs2e-export` uses the reader of depth images.
//!
//! # Examples
//!
//! ```
//! # use gs2e_check::Verdict;
//! use gs2e_dataset::{EventDataset, check_dataset};
//! use gs2e_event::{EventSource, text::Reader};
//! use gs2e_image::Size;
//!
//! // The last event is earlier than the event before it.
//! let csv = "# t x y p in us; sensor 4x3\n5 0 1 1\n9 3 2 0\n7 3 2 1\n";
//! let events = || Ok(Box::new(Reader::new(csv.as_bytes(), None, None)?) as Box<dyn EventSource>);
//! let size = Size { width: 4, height: 3 };
//! let dataset = EventDataset { name: "x", size, events: &events, frames: None, poses: None, views: None };
//! let report = check_dataset(&dataset)?;
//! let order = report.findings.iter().find(|f| f.subject.statement == "order").ok_or("not judged")?;
//! assert_eq!((order.verdict, order.measured), (Verdict::Fail, Some(1.0)));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod alignment;
mod bursts;
pub mod camera;
mod clock;
pub mod depth;
mod gaps;
pub mod layout;
mod noise;
pub mod npy_events;
mod places;
pub mod response;
pub mod samples;
pub mod stream;
pub mod text;
pub mod views;

pub use alignment::AlignmentCurve;
use gs2e_check::motion::warp::FlowAt;
use gs2e_check::tally::{StreamObserver, TallyReference};
use gs2e_check::{Finding, Judgement, JudgementResult, Limits, TrajectorySubject, Verdict, judge_trajectory};
use gs2e_event::survey::EventSurvey;
use gs2e_event::{Event, EventFileError, EventSource};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_num::units::{Hertz, Ratio, Timestamp};
use gs2e_trajectory::Trajectory;
pub use samples::DatasetFrames;

use alignment::Alignment;
use clock::EventClock;
use gaps::StreamPauses;
use noise::StreamNoise;
use response::SensorResponse;
use stream::StreamFacts;
use views::ViewMeasures;

/// Opens the events of a dataset from the start. They are read several times.
pub type OpenEvents<'a> = &'a dyn Fn() -> Result<Box<dyn EventSource>, EventFileError>;

/// A dataset on one clock, in microseconds with any origin.
pub struct EventDataset<'a> {
    /// Name in findings.
    pub name: &'a str,
    /// Size of the sensor.
    pub size: Size,
    /// The events.
    pub events: OpenEvents<'a>,
    /// Frames of the same pixels, if there are any.
    pub frames: Option<&'a DatasetFrames>,
    /// Camera poses with their stamps, if there are any.
    pub poses: Option<&'a Trajectory>,
    /// Measurements on the pictures by poses, depth and camera, if there are all of them.
    pub views: Option<&'a ViewMeasures>,
}

impl EventDataset<'_> {
    /// The finding of a check, with the name of the statement if the check makes several.
    fn finding(&self, check: &str, statement: &str, judged: JudgementResult) -> Finding {
        judged.unwrap_or_else(Judgement::not_run).finding(self.name, check, statement)
    }
}

impl std::fmt::Debug for EventDataset<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("EventDataset")
            .field("name", &self.name)
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

/// The findings on a dataset, with what a page shows of it.
#[derive(Debug, Clone)]
pub struct DatasetReport {
    /// Verdicts and estimates.
    pub findings: Vec<Finding>,
    /// Counts of the stream.
    pub survey: EventSurvey,
    /// Events per millisecond-long or longer bin over the whole time, for a picture.
    pub rate: RateCurve,
    /// Correlation of events with frames over the time offset, if there are frames.
    pub alignment: Option<AlignmentCurve>,
}

impl DatasetReport {
    /// One sentence: the dataset looks sound, or what is wrong.
    #[must_use]
    pub fn verdict(&self) -> String {
        let with = |verdict: Verdict| self.findings.iter().filter(move |f| f.verdict == verdict);
        let wrong: Vec<&str> = with(Verdict::Fail).map(|finding| finding.because.as_str()).collect();
        let doubtful: Vec<&str> = with(Verdict::Warn).map(|finding| finding.because.as_str()).collect();
        let warned = match doubtful.len() {
            0 => String::new(),
            1 => format!(". A warning: {}", doubtful[0]),
            many => format!(". {many} warnings: {}", doubtful.join("; ")),
        };
        match wrong.len() {
            0 => format!("This dataset looks sound, as far as the checks that ran can see{warned}."),
            1 => format!("One thing is wrong: {}{warned}.", wrong[0]),
            many => format!("These {many} things are wrong: {}{warned}.", wrong.join("; ")),
        }
    }
}

/// Number of events over time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RateCurve {
    /// First event, us.
    pub start_us: i64,
    /// Length of a bin, us.
    pub bin_us: i64,
    /// Events per bin.
    pub events: Vec<u64>,
}

/// Number of bins of a rate curve.
const BINS: u16 = 200;
/// Frame rate for the phases of a stream without frames. No statement depends on it.
const RATE: u64 = 1000;

/// Checks a dataset.
///
/// # Errors
/// The events cannot be read.
pub fn check_dataset(dataset: &EventDataset<'_>) -> Result<DatasetReport, EventFileError> {
    let survey = EventSurvey::measure_stream(&mut *(dataset.events)()?)?;
    let Some((first, last)) = survey.span else {
        let empty = Judgement::without_value(Verdict::Fail, "1", "the stream has no events".to_owned());
        let finding = dataset.finding("event_rate", "", Ok(empty));
        let rate = RateCurve { start_us: 0, bin_us: 1, events: Vec::new() };
        return Ok(DatasetReport { findings: vec![finding], survey, rate, alignment: None });
    };
    let span_us = [first.floor_micros(), last.floor_micros()];
    let StreamPass { rate, facts, pauses, mut findings } = read_stream(dataset, span_us)?;
    findings.extend(facts.findings(dataset));
    // Pauses and offsets are differences of times, which say nothing about a stream out of order.
    let sorted = survey.backward == 0;
    findings.push(judge_order(dataset, &survey));
    if sorted {
        findings.push(pauses.judge(dataset, span_us)?);
    }
    let aligned = match dataset.frames {
        Some(frames) if sorted => {
            let rate = survey.events as f64 / dataset.size.pixels() as f64;
            let rate = rate / (span_us[1] - span_us[0]).max(1) as f64;
            align(dataset, frames, rate, &mut findings)?
        }
        frames => {
            let because = match frames {
                Some(_) => "the events are not sorted by time",
                None => "there are no frames; --frames names them",
            };
            findings.push(dataset.finding("event_frame", "", Err(because.to_owned())));
            None
        }
    };
    Ok(DatasetReport { findings, survey, rate, alignment: aligned })
}

/// Order in time. The order within a microsecond is that of this program's files only.
fn judge_order(dataset: &EventDataset<'_>, survey: &EventSurvey) -> Finding {
    let backward = survey.backward;
    let verdict = if backward > 0 { Verdict::Fail } else { Verdict::Pass };
    let because = format!("{backward} of {} events are earlier than the event before them", survey.events);
    dataset.finding("schema", "order", Ok(Judgement::new(verdict, backward as f64, 0.0, "1", because)))
}

impl RateCurve {
    fn new([start_us, end_us]: [i64; 2]) -> Self {
        // One more than a part, so that the last event lies in the last bin.
        let bin_us = (end_us - start_us) / i64::from(BINS) + 1;
        Self { start_us, bin_us, events: vec![0; usize::from(BINS)] }
    }

    fn see(&mut self, t_us: i64) {
        let bin = usize::try_from((t_us - self.start_us).div_euclid(self.bin_us)).unwrap_or(0);
        if let Some(count) = self.events.get_mut(bin) {
            *count += 1;
        }
    }
}

/// The result of one pass over the stream.
struct StreamPass {
    rate: RateCurve,
    facts: StreamFacts,
    pauses: StreamPauses,
    findings: Vec<Finding>,
}

/// The passes over the stream that need no sensor, its rate over time, and its facts.
fn read_stream(dataset: &EventDataset<'_>, span_us: [i64; 2]) -> Result<StreamPass, EventFileError> {
    let (trajectory, origin) = dataset_path(dataset, span_us);
    let last_us = trajectory.stamps_us.last().copied().unwrap_or(0);
    let rate = Hertz(Ratio::new(RATE, 1).expect("it is above 0"));
    let flows = flows_since(dataset, origin);
    let against = TallyReference { flows: &flows, ..TallyReference::default() };
    let mut observer = StreamObserver::new(dataset.size, rate, last_us, against);
    let (mut facts, mut pauses) = (StreamFacts::new(dataset.size), StreamPauses::new());
    let mut curve = RateCurve::new(span_us);
    let (mut source, mut chunk) = ((dataset.events)()?, Vec::new());
    while source.next_chunk(&mut chunk)? {
        for event in &mut chunk {
            let t_us = event.t.floor_micros();
            facts.see(event, t_us);
            pauses.see(t_us);
            curve.see(t_us);
            // The passes count from the first stamp.
            event.t = Timestamp::from_micros(t_us - origin);
        }
        observer.append(&chunk);
    }
    let (tally, limits) = (observer.finish(), Limits::default());
    let subject = TrajectorySubject {
        tally: Some(&tally),
        is_release: true,
        ..TrajectorySubject::new(dataset.name, rate, &trajectory, &limits)
    };
    let wanted = |finding: &Finding| is_of_dataset(dataset, finding);
    let mut findings: Vec<Finding> =
        judge_trajectory(&subject, &[subject]).into_iter().filter(wanted).collect();
    if let Some(views) = dataset.views {
        findings.extend(judge_views(views, &subject));
    }
    Ok(StreamPass { rate: curve, facts, pauses, findings })
}

/// The passes over pictures with poses and depth.
fn judge_views(views: &ViewMeasures, stream: &TrajectorySubject<'_>) -> Vec<Finding> {
    let subject = TrajectorySubject {
        trajectory: &views.trajectory,
        geometry: Some(&views.geometry),
        blocks: None,
        tally: None,
        ..*stream
    };
    let judged = judge_trajectory(&subject, &[]).into_iter();
    judged.filter(|finding| VIEW_PASSES.contains(&finding.check.as_str())).collect()
}

/// Passes of a release that judge pictures by their poses.
const VIEW_PASSES: [&str; 2] = ["photometric", "depth_consistency"];

/// The image motion, at times since the origin.
fn flows_since(dataset: &EventDataset<'_>, origin: i64) -> Vec<FlowAt> {
    let flows = dataset.views.map_or(&[][..], |views| &views.flows);
    // The windows of the checks are of the sensor's size; those of other pictures say nothing of it.
    let of_sensor = flows.iter().filter(|flow| flow.px_s.size() == dataset.size);
    of_sensor.map(|flow| FlowAt { t_us: flow.t_us - origin, px_s: flow.px_s.clone() }).collect()
}

/// Returns true if a pass of a build applies to a dataset with these inputs.
fn is_of_dataset(dataset: &EventDataset<'_>, finding: &Finding) -> bool {
    let of_poses = finding.check == "pose_continuity";
    finding.subject.statement != "order"
        && (STREAM_PASSES.contains(&finding.check.as_str()) && finding.verdict != Verdict::NotRun)
        || of_poses && dataset.poses.is_some()
        || finding.check == "motion" && dataset.views.is_some()
}

/// Passes of a build that judge a stream without its sensor.
const STREAM_PASSES: [&str; 6] =
    ["schema", "duplicates", "event_rate", "polarity", "hot_pixels", "structure"];

/// The poses from the first stamp of the dataset on, and that stamp. Without poses there are two,
/// at the ends of the stream.
fn dataset_path(dataset: &EventDataset<'_>, [start_us, end_us]: [i64; 2]) -> (Trajectory, i64) {
    match dataset.poses {
        Some(poses) => {
            let first = poses.stamps_us.first().copied().unwrap_or(0);
            let stamps_us = poses.stamps_us.iter().map(|t| t - first).collect();
            (Trajectory { world_from_camera: poses.world_from_camera.clone(), stamps_us }, first)
        }
        None => {
            let stamps_us = vec![0, (end_us - start_us).max(1)];
            (Trajectory { world_from_camera: vec![Se3::IDENTITY; 2], stamps_us }, start_us)
        }
    }
}

/// Orientation, clock, noise and thresholds from the frames. `rate` is in events per pixel and us.
fn align(
    dataset: &EventDataset<'_>,
    frames: &DatasetFrames,
    rate: f64,
    findings: &mut Vec<Finding>,
) -> Result<Option<AlignmentCurve>, EventFileError> {
    if let Err(because) = frames.require_change(dataset.size) {
        findings.push(dataset.finding("event_frame", "", Err(because)));
        return Ok(None);
    }
    let alignment = Alignment::measure(dataset.events, frames, dataset.size)?;
    findings.push(dataset.finding("event_frame", "correlation", Ok(alignment.judge())));
    if alignment.changed.is_some() {
        let because = "events follow changed frames only".to_owned();
        findings.push(dataset.finding("time_offset", "", Err(because)));
        return Ok(Some(alignment.curve));
    }
    // A clock of another speed spoils the correlation over the whole time, but not over a run of frames.
    let rough_us = alignment.rough_offset().unwrap_or(0.0);
    let clock = EventClock::measure(dataset.events, &frames.bursts, rough_us)?;
    if let Some(clock) = &clock {
        findings.extend(clock.findings(dataset, frames));
        let noise = StreamNoise::measure(dataset.events, &frames.bursts, clock, rate)?;
        findings.extend(noise.findings(dataset));
    } else {
        let because = "too few pairs of events lie where the frames are known".to_owned();
        findings.push(dataset.finding("time_offset", "", Err(because)));
    }
    if let Some(rough_us) = alignment.rough_offset() {
        let offset = clock.map_or(rough_us, |clock| clock.offset_us[0]);
        let responses = SensorResponse::measure(dataset.events, frames, offset)?;
        if let Some((best, others)) = responses.split_first() {
            findings.extend(best.findings(others.first(), dataset));
        } else {
            let because = "too few pixels change steadily by a threshold from frame to frame".to_owned();
            findings.push(dataset.finding("event_frame", "threshold-on", Err(because)));
        }
    }
    Ok(Some(alignment.curve))
}

/// Standard error of a statistic, from its values without each block in turn (the jackknife).
fn jackknife_error(blocks: usize, without: &dyn Fn(usize) -> f64) -> f64 {
    let values: Vec<f64> = (0..blocks).map(without).filter(|value| value.is_finite()).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    if values.len() < 2 { f64::INFINITY } else { (squares * (n - 1.0) / n).sqrt() }
}

/// Calls `see` for each event, with its time in microseconds.
fn for_each_event(events: OpenEvents<'_>, mut see: impl FnMut(&Event, i64)) -> Result<(), EventFileError> {
    let (mut source, mut chunk) = (events()?, Vec::new());
    while source.next_chunk(&mut chunk)? {
        chunk.iter().for_each(|event| see(event, event.t.floor_micros()));
    }
    Ok(())
}
