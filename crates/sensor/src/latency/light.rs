//! The light of the last frames, at the times for which a sensor still passes on events.

use crate::WHITE;
use crate::frames::DenseFrame;
use std::collections::VecDeque;

/// Longest time by which a sensor passes on events after the frames that determine them, ns: two root cells
/// of the clock of a voltmeter.
const BEHIND_NS: i64 = 1 << 21;
/// Number of frames that a cubic between two frames waits for, and one more.
const FRAMES_BEHIND: usize = 3;

/// Brightness at the last frames.
#[derive(Debug)]
pub(super) struct RecentLight {
    white_lux: f64,
    frames: VecDeque<(i64, Vec<f32>)>,
}

impl RecentLight {
    pub(super) fn new(white_lux: f64) -> Self {
        Self { white_lux, frames: VecDeque::new() }
    }

    /// Adds a frame, and drops those that no event needs any more.
    pub(super) fn add(&mut self, frame: &DenseFrame) {
        let oldest = self.frames.len().checked_sub(FRAMES_BEHIND).map(|at| self.frames[at].0 - BEHIND_NS);
        let mut spare = Vec::new();
        // The frame before `oldest` stays, because light between two frames needs both.
        while oldest.is_some_and(|oldest| self.frames.get(1).is_some_and(|next| next.0 <= oldest)) {
            spare = self.frames.pop_front().map_or_else(Vec::new, |(_, greys)| greys);
        }
        spare.clear();
        spare.extend_from_slice(frame.luminance.pixels());
        self.frames.push_back((frame.t.0, spare));
    }

    /// The light of a pixel at a time, lux, linear between two frames.
    pub(super) fn at(&self, t_ns: i64, pixel: usize) -> f64 {
        let after = self.frames.partition_point(|(t, _)| *t <= t_ns);
        let before = after.saturating_sub(1);
        let after = after.min(self.frames.len().saturating_sub(1));
        // A frame of another size is refused by the sensor.
        let at = |frame: usize| {
            let (t, greys) = self.frames.get(frame)?;
            Some((*t, f64::from(*greys.get(pixel)?)))
        };
        let (Some((start, from)), Some((end, to))) = (at(before), at(after)) else { return 0.0 };
        let share = if end > start { (t_ns - start) as f64 / (end - start) as f64 } else { 0.0 };
        self.white_lux * (from + (to - from) * share) / WHITE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::{Image, Size};
    use gs2e_num::units::Timestamp;

    fn frame(t_ns: i64, greys: [f32; 2]) -> DenseFrame {
        let luminance = Image::from_vec(Size { width: 2, height: 1 }, greys.to_vec());
        DenseFrame { index: 0, t: Timestamp(t_ns), luminance, rate: None }
    }

    #[test]
    fn light_is_linear_between_frames_and_old_frames_are_dropped() {
        let mut light = RecentLight::new(510.0);
        // White is 510 lux, so that a grey is 2 lux. One frame per ms, a grey brighter each.
        for i in 0..100u16 {
            light.add(&frame(i64::from(i) * 1_000_000, [f32::from(i), 7.0]));
        }
        assert!((light.at(98_250_000, 0) - 196.5).abs() < 1e-9);
        assert!((light.at(98_250_000, 1) - 14.0).abs() < 1e-9);
        // The oldest time at which an event can be passed on: 2 frames and 2.1 ms before the last.
        assert!((light.at(95_000_000, 0) - 190.0).abs() < 1e-9);
        assert!((light.at(99_000_000, 0) - 198.0).abs() < 1e-9);
        assert!(light.frames.len() <= 8, "{}", light.frames.len());
    }
}
