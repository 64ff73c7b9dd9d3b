//! The blurred pictures of a trajectory, and their exposures.

use super::{ExportError, ExportSubject};
use crate::budget;
use crate::files;
use crate::image::{Image, png};
use serde::Deserialize;
use std::io::Cursor;

/// A blurred picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlurredFrame {
    /// The pose in the middle of the exposure; its number is in the name of the file.
    pub pose: usize,
    /// Opening and closing of the shutter, in the times of the release, us.
    pub exposure_us: [i64; 2],
}

/// The file that lists them.
#[derive(Deserialize)]
struct Listing {
    frames: Vec<ListedFrame>,
}

#[derive(Deserialize)]
struct ListedFrame {
    blur_file_path: Option<String>,
    exposure_start_us: Option<i64>,
    exposure_end_us: Option<i64>,
}

impl ListedFrame {
    /// The blurred picture of a frame; `None` if it has none, or its fields are damaged.
    fn blurred(&self, poses: usize) -> Option<BlurredFrame> {
        let name = self.blur_file_path.as_ref()?.strip_prefix("blur/")?.strip_suffix(".png")?;
        let pose = name.parse().ok().filter(|pose| *pose < poses)?;
        let exposure_us = [self.exposure_start_us?, self.exposure_end_us?];
        (exposure_us[0] <= exposure_us[1]).then_some(BlurredFrame { pose, exposure_us })
    }
}

impl ExportSubject {
    /// The blurred pictures by time; empty if the release has none.
    ///
    /// # Errors
    /// `transforms.json` cannot be read, or does not state an exposure.
    pub fn blurred_frames(&self) -> Result<Vec<BlurredFrame>, ExportError> {
        const NAME: &str = "transforms.json";
        if !files::is_there(&self.path("blur")) {
            return Ok(Vec::new());
        }
        let bytes = self.read(NAME, files::MAX_DOCUMENT)?;
        let unreadable = |because: String| ExportError::unreadable(&self.path(NAME), because);
        budget::check_json(&bytes).map_err(|e| unreadable(e.to_string()))?;
        let listing: Listing = serde_json::from_slice(&bytes).map_err(|e| unreadable(e.to_string()))?;
        let named = listing.frames.iter().filter(|frame| frame.blur_file_path.is_some());
        let poses = self.poses.stamps_us.len();
        let wrong = || unreadable("a blurred frame without a pose or an exposure".to_owned());
        named.map(|frame| frame.blurred(poses).ok_or_else(wrong)).collect()
    }

    /// The blurred picture of a pose, sRGB.
    ///
    /// # Errors
    /// It cannot be read, or has another size than the camera.
    pub fn blurred_picture(&self, pose: usize) -> Result<Image<[u8; 3]>, ExportError> {
        let name = format!("blur/{pose:06}.png");
        let bytes = self.read(&name, files::MAX_PICTURE)?;
        png::read_sized(Cursor::new(bytes), self.camera.size)
            .map_err(|e| ExportError::unreadable(&self.path(&name), e))
    }
}
