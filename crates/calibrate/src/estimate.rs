//! An estimate and how far it can be trusted.

use serde::Serialize;

/// The value of a parameter with its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The value; that of a preset if there is no error.
    pub value: f64,
    /// Its standard error; null if the recording says nothing about the parameter.
    pub se: Option<f64>,
    /// False if the recording does not determine the parameter. With an error, the value is a rough one,
    /// whose error may be larger than stated.
    pub determined: bool,
}

impl Estimate {
    /// A value that the recording determines.
    #[must_use]
    pub fn found(value: f64, se: f64) -> Self {
        if value.is_finite() && se.is_finite() {
            Self { value, se: Some(se), determined: true }
        } else {
            Self::unknown(0.0)
        }
    }

    /// The value of the preset, because the recording does not determine it.
    #[must_use]
    pub fn unknown(preset: f64) -> Self {
        Self { value: preset, se: None, determined: false }
    }

    /// This estimate as a rough one.
    #[must_use]
    pub(crate) fn rough(self) -> Self {
        Self { determined: false, ..self }
    }

    /// This estimate, or that of the preset if this one does not pass.
    #[must_use]
    pub(crate) fn only_if(self, passes: bool, preset: f64) -> Self {
        if passes { self } else { Self::unknown(preset) }
    }
}

/// Length of the hypotenuse: independent errors add as squares.
pub(crate) fn together(errors: &[f64]) -> f64 {
    errors.iter().map(|e| e * e).sum::<f64>().sqrt()
}

/// The median; NaN of nothing.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
