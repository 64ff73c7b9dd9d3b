//! Sequences of luminance frames, pulled one at a time: a sequence is never whole in memory.

pub mod anchors;
pub mod array;
pub mod folder;
pub mod npy;
pub mod rendered;
pub mod stamps;

use crate::image::{Image, Size};
use crate::units::Timestamp;

/// One frame.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Its number in the sequence, from 0.
    pub index: usize,
    /// When, in nanoseconds since the sequence's first stamp.
    pub t: Timestamp,
    /// Luminance on the grey scale 0..255, as rendered: it may exceed 255, and be negative only by rounding.
    pub luminance: Image<f32>,
    /// Its change per second on the same scale, where the sequence has it: what `between: hermite` goes by.
    pub rate: Option<Image<f32>>,
}

/// Why the next frame could not be had.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// Reading the sequence failed.
    #[error("frame {index}: {source}")]
    Io {
        /// Number of the frame.
        index: usize,
        /// Cause.
        source: std::io::Error,
    },
    /// Rendering the frame failed.
    #[error("frame {index}: {source}")]
    Render {
        /// Number of the frame.
        index: usize,
        /// Cause.
        source: crate::render::RenderError,
    },
    /// The frame's content cannot be used.
    #[error("frame {index}: {because}")]
    Invalid {
        /// Number of the frame.
        index: usize,
        /// What was found and what was wanted.
        because: String,
    },
}

/// A sequence of frames with strictly increasing stamps, the first at 0.
pub trait Frames {
    /// Size of every frame.
    fn size(&self) -> Size;

    /// Number of frames in the whole sequence.
    fn len(&self) -> usize;

    /// Whether the sequence has no frame.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The next frame, or `None` after the last.
    ///
    /// # Errors
    /// When it cannot be read or rendered, or holds a value that is not finite.
    fn next(&mut self) -> Result<Option<Frame>, FrameError>;

    /// Says, before the first frame, that the colours of frames are wanted beside their luminance.
    fn want_colour(&mut self) {}

    /// The colours that the luminance of the last frame was made of, where they are wanted and the frame is not grey:
    /// display-encoded, each channel on the luminance's scale.
    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        None
    }
}

/// An image, all of whose values are finite; an error with the first that is not, `what` saying what the values are.
fn finite(index: usize, what: &str, image: Image<f32>) -> Result<Image<f32>, FrameError> {
    let Some(bad) = image.pixels().iter().position(|v| !v.is_finite()) else { return Ok(image) };
    let width = image.size().width as usize;
    let because = format!("{what} ({}, {}) is {}", bad % width, bad / width, image.pixels()[bad]);
    Err(FrameError::Invalid { index, because })
}
