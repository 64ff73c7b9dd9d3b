//! Frames of a camera from its AEDAT 4 file, which may hold the events of the same pixels too.
//!
//! The file is read twice: once for the stamps, and once for the frames, each when it is needed. A stamp is
//! the middle of the exposure.

use super::stamps::{StampError, relative_stamps};
use super::{DenseFrame, FrameError, FrameSequence};
use gs2e_event::EventFileError;
use gs2e_event::aedat4::{FramePixels, FrameReader};
use gs2e_image::png::GreyWeights;
use gs2e_image::{Image, Size};
use gs2e_num::units::Timestamp;
use std::path::Path;

/// The reason why a file is not a sequence of frames.
#[derive(Debug, thiserror::Error)]
pub enum Aedat4Error {
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] EventFileError),
    /// Its frames do not make a sequence.
    #[error("{0}")]
    Frames(String),
    /// The stamps are not valid.
    #[error(transparent)]
    Stamps(#[from] StampError),
}

/// The frames at their stamps.
#[derive(Debug)]
pub struct Aedat4Frames {
    reader: FrameReader,
    size: Size,
    stamps_us: Vec<i64>,
    /// Stamps, ns since the first.
    stamps: Vec<i64>,
    /// Mean length of the exposures, if all frames state theirs.
    exposure_us: Option<i64>,
    next: usize,
    /// True if colours are requested.
    coloured: bool,
    /// Colours of the last frame.
    colour: Option<Image<[f32; 3]>>,
}

impl Aedat4Frames {
    /// Reads the stamps of all frames.
    ///
    /// # Errors
    /// The file has no frames or cannot be read, its frames differ in size, or their stamps do not increase.
    pub fn open(path: &Path) -> Result<Self, Aedat4Error> {
        let (mut reader, mut size) = (FrameReader::open(path)?, None);
        let (mut stamps_us, mut exposures) = (Vec::new(), Vec::new());
        while let Some(frame) = reader.next_frame()? {
            let wanted = *size.get_or_insert(frame.size);
            if frame.size != wanted {
                let (index, found) = (stamps_us.len(), frame.size);
                let because = format!("frame {index} has {found}, wanted {wanted} as the first");
                return Err(Aedat4Error::Frames(because));
            }
            stamps_us.push(frame.stamp_us);
            exposures.extend(frame.exposure_us);
        }
        let size = size.ok_or_else(|| Aedat4Error::Frames("its stream of frames is empty".to_owned()))?;
        // A sensor takes memory for each pixel before it sees the first frame.
        size.check_sensor().map_err(|e| Aedat4Error::Frames(format!("a frame of {e}")))?;
        let stamps = relative_stamps(&stamps_us)?;
        let count = i64::try_from(exposures.len()).unwrap_or(i64::MAX);
        let exposure_us =
            (exposures.len() == stamps.len()).then(|| exposures.iter().map(|us| us / count).sum());
        let reader = FrameReader::open(path)?;
        Ok(Self { reader, size, stamps_us, stamps, exposure_us, next: 0, coloured: false, colour: None })
    }

    /// The stamps in microseconds.
    #[must_use]
    pub fn stamps_us(&self) -> &[i64] {
        &self.stamps_us
    }

    /// Mean length of the exposures, whose middles are the stamps; `None` if frames state no exposure.
    #[must_use]
    pub fn exposure_us(&self) -> Option<i64> {
        self.exposure_us
    }
}

impl FrameSequence for Aedat4Frames {
    fn size(&self) -> Size {
        self.size
    }

    fn len(&self) -> usize {
        self.stamps.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let index = self.next;
        let Some(&t) = self.stamps.get(index) else { return Ok(None) };
        let invalid = |because| FrameError::Invalid { index, because };
        // The file may have been replaced since its stamps were read.
        let frame = self.reader.next_frame().map_err(|e| invalid(e.to_string()))?;
        let frame = frame.filter(|frame| frame.size == self.size);
        let frame = frame.ok_or_else(|| invalid("it is not there any more".to_owned()))?;
        self.colour = None;
        let luminance = match frame.pixels {
            FramePixels::Grey(greys) => greys.into_iter().map(f32::from).collect(),
            FramePixels::Rgb(colours) => {
                let rgb = |rgb: &[u8; 3]| rgb.map(f32::from);
                self.colour =
                    self.coloured.then(|| Image::from_vec(self.size, colours.iter().map(rgb).collect()));
                let weights = GreyWeights::default();
                colours.iter().map(|rgb| weights.weigh(rgb.map(f64::from))).collect()
            }
        };
        self.next += 1;
        let luminance = Image::from_vec(self.size, luminance);
        Ok(Some(DenseFrame { index, t: Timestamp(t), luminance, rate: None }))
    }

    fn want_colour(&mut self) {
        self.coloured = true;
    }

    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        self.colour.as_ref()
    }
}
