//! Labels of the events, by what is known of their pixels.

use crate::drift::DriftLaw;
use gs2e_event::EventLabel;
use gs2e_sensor::frames::anchors::AnchorFrames;

/// Numbers of events labelled as noise and as signal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LabelCounts {
    /// At hot pixels.
    pub hot: [u64; 2],
    /// At pixels that see no change.
    pub still: [u64; 2],
    /// At all pixels that are not hot.
    pub others: [u64; 2],
    /// Expected number of events that hot pixels make by themselves.
    pub expected_hot: f64,
    /// Upper bound of the expected number of events that noise makes at the pixels that are not hot.
    pub most_noise: f64,
}

/// Counts labels.
#[derive(Debug)]
pub(super) struct LabelWatch<'a> {
    hot_hz: &'a [f64],
    found: LabelCounts,
}

impl<'a> LabelWatch<'a> {
    pub(super) fn new(end_us: i64, law: &DriftLaw, anchors: &AnchorFrames, hot_hz: &'a [f64]) -> Self {
        let us = end_us as f64;
        let images = anchors.images.len().max(1) as f64;
        let pixels = anchors.images.first().map_or(0, |image| image.pixels().len());
        let mean = |i: usize| {
            let at = |image: &gs2e_image::Image<f32>| f64::from(image.pixels()[i].max(0.0));
            anchors.images.iter().map(at).sum::<f64>() / images
        };
        let is_hot = |i: usize| hot_hz.get(i).is_some_and(|hz| *hz > 0.0);
        let noise = (0..pixels).filter(|i| !is_hot(*i)).map(|i| law.most_noise_events(mean(i), us));
        let found = LabelCounts {
            expected_hot: 1e-6 * us * hot_hz.iter().sum::<f64>(),
            most_noise: noise.sum(),
            ..LabelCounts::default()
        };
        Self { hot_hz, found }
    }

    pub(super) fn see(&mut self, pixel: usize, label: EventLabel, is_still: bool) {
        let of = usize::from(label == EventLabel::Signal);
        if self.hot_hz.get(pixel).is_some_and(|hz| *hz > 0.0) {
            self.found.hot[of] += 1;
            return;
        }
        self.found.others[of] += 1;
        self.found.still[of] += u64::from(is_still);
    }

    pub(super) fn finish(self) -> LabelCounts {
        self.found
    }
}
