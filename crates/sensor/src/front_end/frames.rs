//! Frames as seen through front ends.

use super::FrontEnd;
use crate::SensorModel;
use crate::frames::{DenseFrame, FrameError, FrameSequence};
use gs2e_image::Size;

/// The distinct front ends of these sensors, in the order of their first use.
pub fn distinct_front_ends<'a>(sensors: impl IntoIterator<Item = &'a dyn SensorModel>) -> Vec<FrontEnd> {
    let mut found: Vec<FrontEnd> = Vec::new();
    for front_end in sensors.into_iter().map(SensorModel::front_end) {
        if !found.contains(&front_end) {
            found.push(front_end);
        }
    }
    found
}

/// Frames as seen through a front end.
#[derive(Debug)]
pub struct FrontEndFrames<'a> {
    frames: &'a mut dyn FrameSequence,
    front_end: FrontEnd,
}

impl<'a> FrontEndFrames<'a> {
    /// Wraps frames from which none was taken yet.
    pub fn new(frames: &'a mut dyn FrameSequence, front_end: FrontEnd) -> Self {
        if front_end.needs_colour() {
            frames.want_colour();
        }
        Self { frames, front_end }
    }
}

impl FrameSequence for FrontEndFrames<'_> {
    fn size(&self) -> Size {
        self.frames.size()
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let Some(frame) = self.frames.next()? else { return Ok(None) };
        if self.front_end.is_plain() {
            return Ok(Some(frame));
        }
        Ok(Some(self.front_end.see(&frame, self.frames.colour())))
    }
}
