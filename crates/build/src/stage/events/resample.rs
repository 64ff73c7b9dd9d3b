//! Some intervals of a stream with twice the frames, to measure the effect of frames in between.

use super::EventsStage;
use crate::stage::{StageContext, StageError};
use gs2e_check::drift;
use gs2e_check::sampling::ResampledIntervals;
use gs2e_event::{Event, EventLabel, EventSink};
use gs2e_num::units::Timestamp;
use gs2e_render::Renderer;
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraVelocity;
use gs2e_sensor::frames::{DenseFrame, FrameSequence as _};
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_sensor::{SensorChoice, SensorError, SensorModel};
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::sampled::SampledPath;

/// Number of intervals.
const INTERVALS: usize = 4;
/// One row in this many is compared: where the image moves fast, there are many events in few
/// intervals.
const ROWS: u16 = 4;

/// The events of the compared rows.
#[derive(Default)]
struct ResampledRows(Vec<Event>);

impl EventSink for ResampledRows {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        // Noise falls at the same times with any frames, and would hide how far the others move.
        self.0.extend(events.iter().filter(|event| event.y % ROWS == 0 && event.label == EventLabel::Signal));
        Ok(())
    }
}

/// The middle of a path with twice the frames.
pub(super) struct DoubledPath {
    intervals: usize,
    trajectory: Trajectory,
    velocities: Vec<CameraVelocity>,
}

impl DoubledPath {
    /// `None` without an interval between frames.
    pub(super) fn new(path: &SampledPath, stamps_us: &[i64]) -> Option<Self> {
        let last = stamps_us.len().checked_sub(1).filter(|last| *last > 0)?;
        let intervals = INTERVALS.min(last);
        let from = (last - intervals) / 2;
        let (trajectory, velocities) = path.sampled(&doubled_stamps(&stamps_us[from..=from + intervals]));
        Some(Self { intervals, trajectory, velocities })
    }
}

impl EventsStage {
    /// The events of each sensor in the middle of the sequence, with its frames and with twice as
    /// many. `None` for a sensor that follows the frames, or one that sees colour.
    pub(super) fn resample(
        &self,
        doubled: DoubledPath,
        camera: Camera,
        renderer: Box<dyn Renderer>,
        cx: &StageContext<'_>,
    ) -> Result<Vec<Option<ResampledIntervals>>, StageError> {
        let sensors: Vec<&SensorChoice> = self.sensors().map(|(_, sensor)| sensor).collect();
        if !sensors.iter().any(|sensor| is_comparable(sensor)) {
            return Ok(vec![None; sensors.len()]);
        }
        let DoubledPath { intervals, trajectory, velocities } = doubled;
        let mut rendered = RenderedFrames::new(renderer, camera, trajectory).lit_by(self.lights.clone());
        if sensors.iter().any(|sensor| sensor.between() == BetweenFrames::Hermite) {
            rendered = rendered.with_rates(velocities);
        }
        let mut frames = Vec::new();
        while let Some(frame) = rendered.next().map_err(StageError::work_failed("render"))? {
            cx.go_on()?;
            frames.push(frame);
        }
        let tolerance = self.tolerance.map(|asked| asked.rms);
        let of = |sensor: &&SensorChoice| {
            // Every second of these frames is a frame of the stream, so one rendering serves both.
            // Without latency, whose jitter says nothing of the frames.
            let at_once = sensor.without_latency().with_labels();
            let both = |step| self.events_of(at_once.as_model(), frames.iter().step_by(step));
            is_comparable(sensor)
                .then(|| {
                    Ok(ResampledIntervals {
                        tolerance,
                        ..ResampledIntervals::pair_events(intervals, both(2)?, both(1)?)
                    })
                })
                .transpose()
        };
        let tried: Result<_, SensorError> = sensors.iter().map(of).collect();
        tried.map_err(StageError::work_failed("simulate events"))
    }

    fn events_of<'a>(
        &self,
        model: &dyn SensorModel,
        frames: impl Iterator<Item = &'a DenseFrame>,
    ) -> Result<Vec<Event>, SensorError> {
        let (front_end, mut events, mut pixels) = (model.front_end(), ResampledRows::default(), None);
        let mut start = None;
        for (index, frame) in frames.enumerate() {
            // Sensors count time from their first frame.
            let t = Timestamp(frame.t.0 - start.get_or_insert(frame.t).0);
            let frame = DenseFrame { index, t, ..frame.clone() };
            let brightness = if front_end.is_plain() { frame } else { front_end.see(&frame, None) };
            let pixels = match &mut pixels {
                Some(pixels) => pixels,
                // With the seed of the stream, two runs differ by their frames only.
                none => none.insert(model.start(brightness.luminance.size(), [0, 0], self.seed)?),
            };
            pixels.advance(&brightness, &mut events)?;
        }
        if let Some(mut pixels) = pixels {
            pixels.finish(&mut events)?;
        }
        Ok(events.0)
    }
}

/// Returns true if a sensor does not depend on the rate of the frames, and sees luminance only.
fn is_comparable(sensor: &SensorChoice) -> bool {
    drift::is_frame_independent(sensor) && !sensor.as_model().front_end().needs_colour()
}

/// The stamps, and those halfway between them.
fn doubled_stamps(stamps_us: &[i64]) -> Vec<i64> {
    let between = stamps_us.windows(2).flat_map(|w| [w[0], i64::midpoint(w[0], w[1])]);
    let mut all: Vec<i64> = between.chain(stamps_us.last().copied()).collect();
    // Neighbours 1 us apart have no stamp between them.
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_halved() {
        assert_eq!(doubled_stamps(&[100, 517, 933]), [100, 308, 517, 725, 933]);
        assert_eq!(doubled_stamps(&[5, 6]), [5, 6]);
    }
}
