//! The part of a path that a study looks at, and its finest frames.

use gs2e_num::units::{Hertz, Ratio};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_trajectory::sampled::SampledPath;

/// A part of a path, and its finest frames.
#[derive(Debug)]
pub struct FineWindow {
    /// The whole path.
    pub path: SampledPath,
    /// Begin of the window, s of the path.
    pub start: f64,
    /// Number of intervals between fine frames; even.
    pub intervals: usize,
    /// Fine frames per second.
    pub finest: u32,
}

impl FineWindow {
    pub(super) fn stamp_us(&self, frame: usize) -> i64 {
        let rate = Hertz(Ratio::new(self.finest.into(), 1).expect("it is a multiple of a rate above 0"));
        rate.stamp_us(frame as u64)
    }

    pub(super) fn seconds(&self) -> f64 {
        self.stamp_us(self.intervals) as f64 * 1e-6
    }

    /// The view at a fine frame. Its time is the rounded stamp, so that poses and events have the
    /// same time.
    pub(super) fn view(&self, camera: Camera, frame: usize) -> CameraView {
        let at = self.start + self.stamp_us(frame) as f64 * 1e-6;
        // A rounded stamp may lie beyond the end of the path.
        let (pose, velocity) = self.path.at(at.min(self.path.seconds()));
        CameraView { velocity, ..CameraView::at_rest(camera, pose) }
    }

    /// Up to `count` views, evenly spread.
    pub(super) fn views(&self, camera: Camera, count: usize) -> Vec<CameraView> {
        let count = count.min(self.intervals);
        (0..count).map(|k| self.view(camera, (2 * k + 1) * self.intervals / (2 * count))).collect()
    }
}
