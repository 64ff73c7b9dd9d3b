//! Frames that arrive from the thread of the caller.

use gs2e_image::{Image, Size};
use gs2e_num::units::Timestamp;
use gs2e_sensor::frames::stamps::{StampError, relative_stamps};
use gs2e_sensor::frames::{DenseFrame, FrameError, FrameSequence, require_finite};
use std::sync::mpsc::Receiver;

/// A message of the caller's thread.
pub(crate) enum FrameMessage {
    /// The next frame in grey 0..255, and its change per second if the sensor needs it.
    Frame(Image<f32>, Option<Image<f32>>),
    /// No frame follows. Without this message, a closed channel means that the caller failed.
    End,
}

/// The frames of a channel, at their stamps.
#[derive(Debug)]
pub(crate) struct ReceivedFrames {
    receiver: Receiver<FrameMessage>,
    size: Size,
    /// Stamps, ns since the first.
    stamps: Vec<i64>,
    next: usize,
}

impl ReceivedFrames {
    pub(crate) fn new(
        receiver: Receiver<FrameMessage>,
        size: Size,
        stamps_us: &[i64],
    ) -> Result<Self, StampError> {
        Ok(Self { receiver, size, stamps: relative_stamps(stamps_us)?, next: 0 })
    }
}

impl FrameSequence for ReceivedFrames {
    fn size(&self) -> Size {
        self.size
    }

    fn len(&self) -> usize {
        self.stamps.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let index = self.next;
        let invalid = |because: &str| FrameError::Invalid { index, because: because.to_owned() };
        match self.receiver.recv() {
            Err(_) => Err(invalid("the caller stopped")),
            Ok(FrameMessage::End) => Ok(None),
            Ok(FrameMessage::Frame(luminance, rate)) => {
                let t = *self.stamps.get(index).ok_or_else(|| invalid("there is no stamp for it"))?;
                let luminance = require_finite(index, "pixel", luminance)?;
                let rate = rate.map(|rate| require_finite(index, "the rate of pixel", rate)).transpose()?;
                self.next += 1;
                Ok(Some(DenseFrame { index, t: Timestamp(t), luminance, rate }))
            }
        }
    }
}
