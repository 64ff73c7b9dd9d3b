//! Places of pictures in a stream of events, and grey pictures: what reconstruction networks read.

use crate::{ExportError, ExportPlan};
use gs2e_event::{Event, Polarity};
use gs2e_image::{luminance, to_byte};

/// The number of events before each of some stamps, from a stream that is seen once.
#[derive(Debug)]
pub(super) struct EventMarks {
    /// Stamps, us from the start of the interval, ascending.
    pub(super) stamps_us: Vec<i64>,
    /// Numbers of events before the stamps so far. An event at a stamp is not before it.
    pub(super) before: Vec<u64>,
}

impl EventMarks {
    /// Marks at the stamps of these poses.
    pub(super) fn at(plan: &ExportPlan<'_>, poses: &[usize]) -> Self {
        Self { stamps_us: poses.iter().map(|pose| plan.stamp_us(*pose)).collect(), before: Vec::new() }
    }

    /// Sees an event at `t_us`, before which there are `count` events.
    pub(super) fn see(&mut self, t_us: i64, count: u64) {
        while self.stamps_us.get(self.before.len()).is_some_and(|stamp| *stamp <= t_us) {
            self.before.push(count);
        }
    }

    /// Marks the stamps after the last event.
    pub(super) fn finish(&mut self, count: u64) {
        self.before.resize(self.stamps_us.len(), count);
    }
}

/// 1 for ON and -1 for OFF.
pub(super) fn event_sign<T: From<i8>>(event: &Event) -> T {
    T::from(if event.polarity == Polarity::On { 1 } else { -1 })
}

/// A line per sharp frame with its stamp.
pub(super) fn frame_lines(plan: &ExportPlan<'_>, stamp_text: impl Fn(i64) -> String) -> String {
    plan.frames.iter().map(|frame| stamp_text(plan.stamp_us(*frame)) + "\n").collect()
}

/// The sharp picture of a pose as grey bytes, encoded as it is, row-major.
pub(super) fn grey_picture(plan: &ExportPlan<'_>, pose: usize) -> Result<Vec<u8>, ExportError> {
    let picture = plan.subject.sharp_picture(pose)?;
    let share = |v: u8| f32::from(v) / f32::from(u8::MAX);
    Ok(picture.pixels().iter().map(|rgb| to_byte(luminance(rgb.map(share)))).collect())
}
