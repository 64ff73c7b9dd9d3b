//! Frames from arrays `[N, H, W]` in `.npy` files, read one by one.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::{Image, Size, npy};
//! use gs2e_sensor::frames::FrameSequence;
//! use gs2e_sensor::frames::array::FullScale;
//! use gs2e_sensor::frames::npy::{FrameStack, NpyFrames, brightest_sample};
//!
//! let file = tempfile::NamedTempFile::new()?;
//! let images = [0.25, 1.0].map(|grey| Image::filled(Size { width: 2, height: 1 }, grey));
//! npy::write_stack(&images, file.as_file())?;
//! // The brightest sample is 1, so white is 1 and not 255.
//! let full_scale = FullScale::decide(brightest_sample(file.path())?).ok_or("both are possible")?;
//! let mut frames = NpyFrames::new(FrameStack::open(file.path())?, full_scale, &[0, 1000])?;
//! let first = frames.next()?.ok_or("there is no frame")?;
//! assert_eq!(first.luminance.pixels(), [63.75, 63.75]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::array::FullScale;
use super::stamps::{StampError, relative_stamps};
use super::{DenseFrame, FrameError, FrameSequence, require_finite};
use gs2e_files as files;
use gs2e_files::{PathError, budget};
use gs2e_image::{Image, MAX_SENSOR_PIXELS, Size, npy};
use gs2e_num::units::Timestamp;
use npyz::{NpyHeader, Order};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// Maximum number of stamps in a list: 2 GiB of 64-bit integers.
const MAX_STAMPS: u64 = 1 << 28;

/// Number of frames whose brightest sample decides the full scale of floats.
pub const LOOKED_AT: usize = 2;

/// The reason why a `.npy` file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] PathError),
    /// The file has another type or shape.
    #[error("{}: {because}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The value found and the value wanted.
        because: String,
    },
    /// The stamps are not valid.
    #[error(transparent)]
    Stamps(#[from] StampError),
}

/// An array that is open at its first element.
#[derive(Debug)]
struct OpenArray {
    path: PathBuf,
    data: BufReader<File>,
    /// Type of the elements, from the header.
    kind: String,
    shape: Vec<u64>,
}

impl OpenArray {
    fn open(path: &Path) -> Result<Self, NpyError> {
        let unreadable = |source| PathError::new(path, source);
        let refusal = |because| NpyError::Content { path: path.to_owned(), because };
        let file = files::open(path).map_err(unreadable)?;
        let len = file.metadata().map_err(unreadable)?.len();
        let mut data = BufReader::with_capacity(1 << 20, file);
        let head =
            npy::checked_header(&mut data).map_err(|e| refusal(format!("not a supported .npy file: {e}")))?;
        let header = NpyHeader::from_reader(&head[..]).map_err(|e| refusal(e.to_string()))?;
        let kind = header.dtype().descr().trim_matches('\'').to_owned();
        if header.order() != Order::C {
            return Err(refusal(
                "it is in Fortran order, wanted C order (numpy.ascontiguousarray)".to_owned(),
            ));
        }
        // A type is a byte order, a letter and the width in bytes. Types of another form are
        // refused by the readers.
        let width: u64 = kind.get(2..).and_then(|digits| digits.parse().ok()).unwrap_or(1);
        let elements = header.shape().iter().try_fold(width, |n, &side| n.checked_mul(side));
        let wanted = elements.and_then(|n| n.checked_add(head.len() as u64));
        // The length must fit exactly, so that a truncated file is found before its last frame is
        // read.
        if wanted != Some(len) {
            let wanted = wanted.map_or("more".to_owned(), |wanted| wanted.to_string());
            return Err(refusal(format!("{len} bytes, wanted {wanted} according to its header")));
        }
        Ok(Self { path: path.to_owned(), data, kind, shape: header.shape().to_vec() })
    }

    fn refusal(&self, wanted: &str) -> NpyError {
        let because =
            format!("an array of {} and shape {:?}, wanted {wanted}", dtype_name(&self.kind), self.shape);
        NpyError::Content { path: self.path.clone(), because }
    }
}

/// numpy's name of a common type.
fn dtype_name(kind: &str) -> &str {
    match kind {
        "|u1" => "uint8",
        "<f4" => "float32",
        "<f8" => "float64",
        "<i8" => "int64",
        "<u2" => "uint16",
        kind => kind,
    }
}

/// The samples of a stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleKind {
    /// Grey 0..255, unchanged.
    Bytes,
    /// Floats on a scale that the file does not state.
    Floats,
}

/// An array `[N, H, W]` of uint8 or float32, frame after frame.
#[derive(Debug)]
pub struct FrameStack {
    array: OpenArray,
    kind: SampleKind,
    frames: usize,
    size: Size,
}

impl FrameStack {
    /// Opens a file.
    ///
    /// # Errors
    /// The file cannot be read, is truncated, or has an array of another type or shape.
    pub fn open(path: &Path) -> Result<Self, NpyError> {
        let array = OpenArray::open(path)?;
        let kind = match array.kind.as_str() {
            "|u1" => SampleKind::Bytes,
            "<f4" => SampleKind::Floats,
            _ => return Err(array.refusal("uint8 or float32 of shape [N, H, W]")),
        };
        let &[frames, height, width] = array.shape.as_slice() else {
            return Err(array.refusal("the shape [N, H, W]"));
        };
        let side = |n: u64| u32::try_from(n).ok().filter(|n| (1..=1 << 16).contains(n));
        let (Some(width), Some(height)) = (side(width), side(height)) else {
            return Err(array.refusal("1 to 65536 columns and rows"));
        };
        let size = Size { width, height };
        if size.check_sensor().is_err() {
            return Err(array.refusal(&format!("at most {MAX_SENSOR_PIXELS} pixels per frame")));
        }
        let frames = usize::try_from(frames).map_err(|_| array.refusal("fewer frames"))?;
        Ok(Self { array, kind, frames, size })
    }

    /// Number of frames.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Size of each frame.
    #[must_use]
    pub fn size(&self) -> Size {
        self.size
    }

    /// Type of the samples.
    #[must_use]
    pub fn kind(&self) -> SampleKind {
        self.kind
    }

    /// The next frame, with each sample multiplied by `scale`.
    fn next(&mut self, scale: f32) -> io::Result<Image<f32>> {
        let n = self.size.pixels();
        let values = match self.kind {
            SampleKind::Bytes => {
                let mut bytes = budget::try_filled(0, n)?;
                self.array.data.read_exact(&mut bytes)?;
                bytes.into_iter().map(|v| scale * f32::from(v)).collect()
            }
            SampleKind::Floats => {
                let mut bytes = budget::try_filled([0; 4], n)?;
                self.array.data.read_exact(bytes.as_flattened_mut())?;
                bytes.into_iter().map(|v| scale * f32::from_le_bytes(v)).collect()
            }
        };
        Ok(Image::from_vec(self.size, values))
    }
}

/// The brightest sample of the first two frames of a file, from which the scale of floats is
/// guessed. NaN is ignored.
///
/// # Errors
/// As [`FrameStack::open`], or the samples cannot be read.
pub fn brightest_sample(path: &Path) -> Result<f32, NpyError> {
    let mut stack = FrameStack::open(path)?;
    let mut most = f32::NEG_INFINITY;
    for _ in 0..LOOKED_AT.min(stack.frames) {
        let frame = stack.next(1.0).map_err(|source| PathError::new(path, source))?;
        most = frame.pixels().iter().copied().fold(most, f32::max);
    }
    Ok(most)
}

/// The stamps of a `.npy` of int64, in microseconds.
///
/// # Errors
/// The file cannot be read, or has another array.
pub fn read_stamps(path: &Path) -> Result<Vec<i64>, NpyError> {
    let mut array = OpenArray::open(path)?;
    let &[count] = array.shape.as_slice() else { return Err(array.refusal("int64 of shape [N]")) };
    if array.kind != "<i8" || count > MAX_STAMPS {
        return Err(array.refusal("int64 of shape [N], N at most 2^28"));
    }
    // The array's shape was compared with the length of the file, so this memory is not just a
    // claim.
    let mut read = || -> io::Result<Vec<i64>> {
        let mut stamps = budget::try_with_room(usize::try_from(count).unwrap_or(usize::MAX))?;
        for _ in 0..count {
            let mut bytes = [0; 8];
            array.data.read_exact(&mut bytes)?;
            stamps.push(i64::from_le_bytes(bytes));
        }
        Ok(stamps)
    };
    Ok(read().map_err(|source| PathError::new(path, source))?)
}

/// The frames of a stack at their stamps.
#[derive(Debug)]
pub struct NpyFrames {
    stack: FrameStack,
    /// Number of greys per unit of the samples.
    scale: f32,
    /// Stamps, ns since the first.
    stamps: Vec<i64>,
    next: usize,
}

impl NpyFrames {
    /// The frames of an open stack, one per stamp. The first stamp may have any value. `full_scale`
    /// is the scale of floats.
    ///
    /// # Errors
    /// The numbers of stamps and frames differ, or the stamps do not strictly increase.
    pub fn new(stack: FrameStack, full_scale: FullScale, stamps_us: &[i64]) -> Result<Self, NpyError> {
        if stamps_us.len() != stack.frames {
            let because = format!("{} frames, but {} stamps", stack.frames, stamps_us.len());
            return Err(NpyError::Content { path: stack.array.path, because });
        }
        let scale = if stack.kind == SampleKind::Floats { full_scale.grey() } else { 1.0 };
        Ok(Self { stack, scale, stamps: relative_stamps(stamps_us)?, next: 0 })
    }
}

impl FrameSequence for NpyFrames {
    fn size(&self) -> Size {
        self.stack.size
    }

    fn len(&self) -> usize {
        self.stamps.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let index = self.next;
        let Some(&t) = self.stamps.get(index) else { return Ok(None) };
        let frame = self.stack.next(self.scale).map_err(|source| FrameError::Io { index, source })?;
        let luminance = require_finite(index, "pixel", frame)?;
        self.next += 1;
        Ok(Some(DenseFrame { index, t: Timestamp(t), luminance, rate: None }))
    }
}

/// Frames with the luminance's change per second at every pixel, on the scale of the file.
#[derive(Debug)]
pub struct RatedFrames {
    frames: Box<dyn FrameSequence>,
    rates: FrameStack,
    scale: f32,
}

impl RatedFrames {
    /// Combines frames and rates. `full_scale` is that of the frames' file.
    ///
    /// # Errors
    /// The rates are not floats, or their number or size differs from that of the frames.
    pub fn new(
        frames: Box<dyn FrameSequence>,
        rates: FrameStack,
        full_scale: FullScale,
    ) -> Result<Self, NpyError> {
        let (count, Size { width, height }) = (frames.len(), frames.size());
        if rates.kind != SampleKind::Floats || (rates.frames, rates.size) != (count, frames.size()) {
            let wanted = format!("float32 of the frames' shape [{count}, {height}, {width}]");
            return Err(rates.array.refusal(&wanted));
        }
        Ok(Self { frames, rates, scale: full_scale.grey() })
    }
}

impl FrameSequence for RatedFrames {
    fn size(&self) -> Size {
        self.frames.size()
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let Some(frame) = self.frames.next()? else { return Ok(None) };
        let index = frame.index;
        let rate = self.rates.next(self.scale).map_err(|source| FrameError::Io { index, source })?;
        let rate = Some(require_finite(index, "the rate of pixel", rate)?);
        Ok(Some(DenseFrame { rate, ..frame }))
    }

    fn want_colour(&mut self) {
        self.frames.want_colour();
    }

    fn colour(&self) -> Option<&Image<[f32; 3]>> {
        self.frames.colour()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use npyz::{AutoSerialize, WriterBuilder as _};
    use tempfile::TempDir;

    fn write<T: AutoSerialize + Copy>(dir: &TempDir, name: &str, shape: &[u64], values: &[T]) -> PathBuf {
        let path = dir.path().join(name);
        let out = File::create(&path).unwrap();
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(shape).writer(out).begin_nd().unwrap();
        writer.extend(values.iter().copied()).unwrap();
        writer.finish().unwrap();
        path
    }

    fn greys(mut frames: NpyFrames) -> Vec<(i64, Vec<f32>)> {
        std::iter::from_fn(|| frames.next().unwrap())
            .map(|frame| (frame.t.0, frame.luminance.into_pixels()))
            .collect()
    }

    #[test]
    fn frames_come_on_the_grey_scale_with_stamps_from_zero() {
        let dir = tempfile::tempdir().unwrap();
        let path = write(&dir, "f.npy", &[2, 1, 2], &[0.0f32, 1.0, 0.5, 2.0]);
        assert!((brightest_sample(&path).unwrap() - 2.0).abs() < f32::EPSILON);
        let of =
            |scale| NpyFrames::new(FrameStack::open(&path).unwrap(), scale, &[1_000_000, 1_000_417]).unwrap();
        assert_eq!(greys(of(FullScale::One)), [(0, vec![0.0, 255.0]), (417_000, vec![127.5, 510.0])]);
        assert_eq!(greys(of(FullScale::Grey255)), [(0, vec![0.0, 1.0]), (417_000, vec![0.5, 2.0])]);
        let path = write(&dir, "b.npy", &[1, 2, 1], &[7u8, 255]);
        let frames = NpyFrames::new(FrameStack::open(&path).unwrap(), FullScale::One, &[-5]).unwrap();
        assert_eq!((frames.size(), frames.len()), (Size { width: 1, height: 2 }, 1));
        assert_eq!(greys(frames), [(0, vec![7.0, 255.0])], "bytes are grey as they stand");
    }

    #[test]
    fn rates_come_on_the_scale_of_the_samples() {
        let dir = tempfile::tempdir().unwrap();
        let frames = write(&dir, "f.npy", &[1, 1, 2], &[0.0f32, 1.0]);
        let rates = write(&dir, "r.npy", &[1, 1, 2], &[2.0f32, -0.5]);
        let with = |rates: &Path| {
            let frames = NpyFrames::new(FrameStack::open(&frames).unwrap(), FullScale::One, &[0]).unwrap();
            RatedFrames::new(Box::new(frames), FrameStack::open(rates).unwrap(), FullScale::One)
        };
        let mut both = with(&rates).unwrap();
        assert_eq!(both.next().unwrap().unwrap().rate.unwrap().into_pixels(), [510.0, -127.5]);
        let other = write(&dir, "o.npy", &[1, 2, 1], &[2.0f32, -0.5]);
        let error = with(&other).unwrap_err().to_string();
        let wanted = "an array of float32 and shape [1, 2, 1], wanted float32 of the frames' shape [1, 1, 2]";
        assert!(error.ends_with(wanted), "{error}");
    }

    #[test]
    fn what_is_no_stack_of_frames_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let t = |path: &Path, wanted: &str| {
            let error = FrameStack::open(path).map(|_| ()).unwrap_err().to_string();
            assert!(error.ends_with(wanted), "{error}");
        };
        let doubles = "an array of float64 and shape [1, 1, 1], wanted uint8 or float32 of shape [N, H, W]";
        t(&write(&dir, "d.npy", &[1, 1, 1], &[1.0f64]), doubles);
        t(&write(&dir, "s.npy", &[2, 1], &[1u8, 2]), "shape [2, 1], wanted the shape [N, H, W]");
        t(&write(&dir, "e.npy", &[2, 0, 1], &[0u8; 0]), "wanted 1 to 65536 columns and rows");
        let whole = write(&dir, "w.npy", &[2, 1, 2], &[1.0f32; 4]);
        let bytes = std::fs::read(&whole).unwrap();
        for cut in 0..bytes.len() {
            std::fs::write(&whole, &bytes[..cut]).unwrap();
            assert!(FrameStack::open(&whole).is_err(), "{cut} of {} bytes", bytes.len());
        }
        std::fs::write(&whole, &bytes[..bytes.len() - 3]).unwrap();
        t(&whole, ": 141 bytes, wanted 144 according to its header");
        let error = read_stamps(&write(&dir, "t.npy", &[2], &[0.5f64, 1.0])).unwrap_err().to_string();
        assert!(
            error.ends_with("an array of float64 and shape [2], wanted int64 of shape [N], N at most 2^28")
        );
    }

    #[test]
    fn a_sample_that_is_no_number_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = write(&dir, "f.npy", &[2, 1, 2], &[0.0, 0.0, 0.0, f32::NAN]);
        let mut frames = NpyFrames::new(FrameStack::open(&path).unwrap(), FullScale::One, &[0, 1]).unwrap();
        frames.next().unwrap();
        assert_eq!(frames.next().unwrap_err().to_string(), "frame 1: pixel (1, 0) is NaN");
    }
}
