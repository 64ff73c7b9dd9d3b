//! Sequences of luminance frames, read one at a time: a sequence is never in memory as a whole.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::Size;
//! use gs2e_sensor::frames::FrameSequence;
//! use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
//!
//! let samples = ArraySamples::Bytes(vec![10, 30, 50, 70]);
//! let mut frames = ArrayFrames::new(Size { width: 2, height: 1 }, samples, &[0, 1000])?;
//! let mut means = Vec::new();
//! while let Some(frame) = frames.next()? {
//!     means.push(frame.luminance.pixels().iter().sum::<f32>() / 2.0);
//! }
//! assert_eq!((frames.len(), means), (2, vec![20.0, 60.0]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod aedat4;
pub mod anchors;
pub mod array;
pub mod folder;
pub mod motion;
pub mod npy;
pub mod stamps;
pub mod video;

use gs2e_image::{Image, Size};
use gs2e_num::units::Timestamp;

/// One frame.
#[derive(Debug, Clone)]
pub struct DenseFrame {
    /// Index in the sequence, from 0.
    pub index: usize,
    /// Time in nanoseconds since the sequence's first stamp.
    pub t: Timestamp,
    /// Luminance on the grey scale 0..255, as rendered: it may exceed 255, and may be negative by
    /// rounding only.
    pub luminance: Image<f32>,
    /// Its change per second on the same scale, if the sequence has it. `between: hermite` needs
    /// it.
    pub rate: Option<Image<f32>>,
}

/// The reason why there is no next frame.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// Reading the sequence failed.
    #[error("frame {index}: {source}")]
    Io {
        /// Index of the frame.
        index: usize,
        /// Cause.
        source: std::io::Error,
    },
    /// Rendering the frame failed.
    #[error("frame {index}: {source}")]
    Render {
        /// Index of the frame.
        index: usize,
        /// Cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The content of the frame cannot be used.
    #[error("frame {index}: {because}")]
    Invalid {
        /// Index of the frame.
        index: usize,
        /// The value found and the value wanted.
        because: String,
    },
}

/// A sequence of frames with strictly increasing stamps, the first at 0.
pub trait FrameSequence: std::fmt::Debug {
    /// Size of all frames.
    fn size(&self) -> Size;

    /// Number of frames in the whole sequence.
    fn len(&self) -> usize;

    /// Returns true if the sequence has no frames.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The next frame, or `None` after the last.
    ///
    /// # Errors
    /// The frame cannot be read or rendered, or has a value that is not finite.
    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError>;

    /// Requests, before the first frame, the colours of frames in addition to their luminance.
    fn want_colour(&mut self) {}

    /// The colours of the last frame, if they were requested and the frame is not grey:
    /// display-encoded, each channel on the scale of the luminance.
    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        None
    }
}

/// Checks that all values of an image are finite. The error has the first that is not; `what` names
/// the values.
///
/// # Errors
/// A value is infinite or not a number.
pub fn require_finite(index: usize, what: &str, image: Image<f32>) -> Result<Image<f32>, FrameError> {
    let Some(bad) = image.pixels().iter().position(|v| !v.is_finite()) else { return Ok(image) };
    let width = image.size().width as usize;
    let because = format!("{what} ({}, {}) is {}", bad % width, bad / width, image.pixels()[bad]);
    Err(FrameError::Invalid { index, because })
}
