//! Expected sizes of products, from parameters alone: no step of their kind need have run before.

use crate::camera::CameraChoice;

/// Length of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathLength {
    /// Number of poses.
    pub poses: f64,
    /// Time from the first to the last pose, s.
    pub seconds: f64,
}

/// Expected size of a product.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedSize {
    /// Number of its pictures; `None` for a product of other files.
    pub pictures: Option<f64>,
    /// Its bytes; `None` if only the source states the size of the pictures.
    pub bytes: Option<f64>,
}

impl PathLength {
    /// The length of `poses` poses at `rate` poses per second.
    #[must_use]
    pub fn at_rate(poses: f64, rate: f64) -> Self {
        Self { poses, seconds: (poses - 1.0).max(0.0) / rate }
    }

    /// Number of pictures at every `every`-th pose.
    pub(super) fn pictures(self, every: u32) -> f64 {
        (self.poses / f64::from(every)).ceil()
    }

    /// Number of exposures of `frames` poses: see [`crate::sampling::exposure::exposure_centres`].
    pub(super) fn exposures(self, frames: u32) -> f64 {
        let beyond = f64::from(frames / 2 + 1);
        ((self.poses - 2.0 * beyond).max(0.0) / f64::from(frames)).ceil()
    }
}

impl ExpectedSize {
    /// Text of `lines` lines.
    pub(super) fn of_text(lines: f64, bytes_a_line: f64) -> Self {
        Self { pictures: None, bytes: Some(lines * bytes_a_line) }
    }

    /// Pictures by a camera, or by that of the source.
    pub(super) fn of_pictures(pictures: f64, camera: Option<CameraChoice>, bytes_a_pixel: f64) -> Self {
        let pixels = camera.map(|camera| f64::from(camera.width) * f64::from(camera.height));
        Self { pictures: Some(pictures), bytes: pixels.map(|pixels| pictures * pixels * bytes_a_pixel) }
    }
}

/// Bytes per pixel of a PNG of a rendering, which has 3 before compression; an estimate.
pub(super) const PNG_BYTES: f64 = 1.0;
