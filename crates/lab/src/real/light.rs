//! Pixels whose frames stand still, and pixels whose frames move.

use gs2e_calibrate::{GreyCourse, is_usable_grey};
use serde::Serialize;

/// What the frames of a pixel do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PixelLight {
    /// They differ by noise alone.
    Still,
    /// They change.
    Moving,
    /// They are black or white, so nobody knows.
    Clipped,
}

/// The courses of all pixels.
#[derive(Debug, Clone)]
pub(super) struct PixelCourses(Vec<GreyCourse>);

impl PixelCourses {
    pub(super) fn new(pixels: usize) -> Self {
        Self(vec![GreyCourse::default(); pixels])
    }

    /// Adds a frame.
    pub(super) fn see(&mut self, greys: &[f32]) {
        self.0.iter_mut().zip(greys).for_each(|(course, grey)| course.push(f64::from(*grey)));
    }

    /// What the frames of each pixel did.
    pub(super) fn lights(&self) -> Vec<PixelLight> {
        let light = |course: &GreyCourse| match () {
            () if !is_usable_grey(course.mean()) => PixelLight::Clipped,
            () if course.is_still() => PixelLight::Still,
            () => PixelLight::Moving,
        };
        self.0.iter().map(light).collect()
    }
}

/// Number of pixels by what their frames do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct LightCounts {
    /// Pixels whose frames differ by noise alone.
    pub still: usize,
    /// Pixels whose frames change.
    pub moving: usize,
    /// Pixels whose frames are black or white.
    pub clipped: usize,
}

impl LightCounts {
    pub(super) fn of(lights: &[PixelLight]) -> Self {
        let count = |of: PixelLight| lights.iter().filter(|light| **light == of).count();
        Self {
            still: count(PixelLight::Still),
            moving: count(PixelLight::Moving),
            clipped: count(PixelLight::Clipped),
        }
    }
}
