//! Frames that Python gives one by one, as an array or an iterator, and their conversion to luminance.

use gs2e_image::{Image, Size};
use gs2e_sensor::frames::array::FullScale;
use gs2e_sensor::frames::npy::LOOKED_AT;
use numpy::{PyArray2, PyArrayMethods as _, PyReadonlyArray2, PyUntypedArray, PyUntypedArrayMethods as _};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyIterator;
use std::collections::VecDeque;

/// The samples of one frame as they came.
pub(crate) enum FrameSamples {
    Bytes(Vec<u8>),
    Floats(Vec<f32>),
}

impl FrameSamples {
    fn dtype(&self) -> &'static str {
        match self {
            Self::Bytes(_) => "uint8",
            Self::Floats(_) => "float32",
        }
    }

    fn brightest(&self) -> f32 {
        match self {
            Self::Bytes(values) => values.iter().copied().max().map_or(0.0, f32::from),
            Self::Floats(values) => values.iter().copied().fold(f32::NEG_INFINITY, f32::max),
        }
    }

    /// Grey 0..255, in the arithmetic of the frames of a `.npy`.
    fn to_grey(&self, scale: f32) -> Vec<f32> {
        match self {
            Self::Bytes(values) => values.iter().map(|v| f32::from(*v)).collect(),
            Self::Floats(values) => values.iter().map(|v| scale * v).collect(),
        }
    }
}

/// The frames of an iterator: all of one size and type.
pub(crate) struct FrameIterator<'py> {
    /// The object of the caller, named in messages.
    what: &'static str,
    items: Bound<'py, PyIterator>,
    /// Frames that were looked at to decide the scale.
    previewed: VecDeque<FrameSamples>,
    next: usize,
    dtype: &'static str,
    pub(crate) size: Size,
    /// Greys per unit.
    pub(crate) scale: f32,
}

impl<'py> FrameIterator<'py> {
    /// Starts with the frames of an array [N, H, W] or of any iterable, and decides the scale of floats.
    pub(crate) fn start(
        what: &'static str,
        frames: &Bound<'py, PyAny>,
        full_scale: Option<u32>,
    ) -> PyResult<Self> {
        let mut found = Self {
            what,
            items: items_of(what, frames)?,
            previewed: VecDeque::new(),
            next: 0,
            dtype: "",
            size: Size { width: 0, height: 0 },
            scale: 1.0,
        };
        for _ in 0..LOOKED_AT {
            let Some(samples) = found.take()? else { break };
            found.next += 1;
            found.previewed.push_back(samples);
        }
        if found.previewed.is_empty() {
            return Err(PyValueError::new_err(format!("{what} has no frame")));
        }
        // The frames that were looked at are given out again from `seen`, and counted then.
        found.next = 0;
        if found.dtype == "float32" {
            found.scale = found.decide(full_scale)?.grey();
        }
        Ok(found)
    }

    fn decide(&self, full_scale: Option<u32>) -> PyResult<FullScale> {
        let brightest = self.previewed.iter().map(FrameSamples::brightest).fold(f32::NEG_INFINITY, f32::max);
        match full_scale {
            Some(1) => Ok(FullScale::One),
            Some(255) => Ok(FullScale::Grey255),
            Some(other) => Err(PyValueError::new_err(format!("full_scale is {other}, wanted 1 or 255"))),
            None => FullScale::decide(brightest).ok_or_else(|| {
                PyValueError::new_err(format!(
                    "white may be 1 or 255: the brightest value of the first two frames is {brightest}; \
                     pass full_scale=1 or full_scale=255"
                ))
            }),
        }
    }

    /// The next frame in grey 0..255; `None` after the last.
    pub(crate) fn next_frame(&mut self) -> PyResult<Option<Image<f32>>> {
        let samples = match self.previewed.pop_front() {
            Some(samples) => Some(samples),
            None => self.take()?,
        };
        self.next += 1;
        Ok(samples.map(|samples| Image::from_vec(self.size, samples.to_grey(self.scale))))
    }

    fn take(&mut self) -> PyResult<Option<FrameSamples>> {
        // An exception of the caller's iterator passes through as it is.
        let Some(item) = self.items.next().transpose()? else { return Ok(None) };
        self.convert(&item).map(Some)
    }

    fn convert(&mut self, item: &Bound<'py, PyAny>) -> PyResult<FrameSamples> {
        let Ok(array) = item.cast::<PyUntypedArray>() else {
            let kind = item.get_type().name()?;
            return Err(PyTypeError::new_err(format!("{} is a {kind}, wanted a numpy array", self.place())));
        };
        let &[height, width] = array.shape() else {
            let colours = matches!(array.shape(), [_, _, 3 | 4]);
            let help = if colours { "; convert colours to grey first" } else { "" };
            let shape = array.shape();
            return Err(PyValueError::new_err(format!(
                "{} has the shape {shape:?}, wanted [H, W]{help}",
                self.place()
            )));
        };
        self.check_size(height, width)?;
        // Any strides are accepted: a frame that is not contiguous is copied.
        let samples = if let Ok(bytes) = item.cast::<PyArray2<u8>>() {
            FrameSamples::Bytes(contiguous(bytes)?.as_slice()?.to_vec())
        } else if let Ok(floats) = item.cast::<PyArray2<f32>>() {
            FrameSamples::Floats(contiguous(floats)?.as_slice()?.to_vec())
        } else {
            let what = format!("{} is {}, wanted uint8 or float32", self.place(), array.dtype());
            return Err(PyTypeError::new_err(what));
        };
        if self.dtype.is_empty() {
            self.dtype = samples.dtype();
        } else if self.dtype != samples.dtype() {
            let what =
                format!("{} is {}, wanted {} like the first", self.place(), samples.dtype(), self.dtype);
            return Err(PyTypeError::new_err(what));
        }
        Ok(samples)
    }

    fn check_size(&mut self, height: usize, width: usize) -> PyResult<()> {
        let refusal = |what: String| Err(PyValueError::new_err(what));
        let side = |n: usize| u32::try_from(n).ok().filter(|n| (1..=1 << 16).contains(n));
        let (Some(width), Some(height)) = (side(width), side(height)) else {
            return refusal(format!(
                "{} is {width}x{height}, wanted 1 to 65536 columns and rows",
                self.place()
            ));
        };
        let size = Size { width, height };
        if self.dtype.is_empty() {
            size.check_sensor().map_err(|e| PyValueError::new_err(format!("{} has {e}", self.place())))?;
            self.size = size;
        }
        if self.size == size {
            return Ok(());
        }
        refusal(format!("{} is {size}, wanted {} like the first", self.place(), self.size))
    }

    /// The frame that is being taken, for messages.
    fn place(&self) -> String {
        format!("{}[{}]", self.what, self.next)
    }
}

/// The frame in one piece, row after row.
fn contiguous<'py, T: numpy::Element>(array: &Bound<'py, PyArray2<T>>) -> PyResult<PyReadonlyArray2<'py, T>> {
    // A slice of numbers that do not lie at multiples of their size would be unsound.
    let aligned = array.getattr("flags")?.getattr("aligned")?.is_truthy()?;
    if aligned && array.is_c_contiguous() {
        return Ok(array.try_readonly()?);
    }
    let copied = array.call_method1("copy", ("C",))?;
    Ok(copied.cast_into::<PyArray2<T>>()?.try_readonly()?)
}

fn items_of<'py>(what: &str, frames: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyIterator>> {
    if let Ok(array) = frames.cast::<PyUntypedArray>() {
        // The elements of other arrays are no frames, so the whole is named.
        if array.shape().len() != 3 {
            let shape = array.shape();
            let help = if shape.len() == 4 { "; convert colours to grey first" } else { "" };
            return Err(PyValueError::new_err(format!(
                "{what} has the shape {shape:?}, wanted [N, H, W]{help}"
            )));
        }
    }
    frames.try_iter().map_err(|_| {
        let kind = frames.get_type().name().map_or_else(|_| "?".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!(
            "{what} is a {kind}, wanted an array [N, H, W] or an iterable of arrays [H, W]"
        ))
    })
}
