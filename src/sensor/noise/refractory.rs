//! The dead time after an event, in which a pixel makes no other.

use crate::sensor::screening::ScreenError;
use serde::{Deserialize, Serialize};

/// A thousand seconds.
const LONGEST_US: f64 = 1e9;

/// How long a pixel is dead after an event, and what it compares with afterwards.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Refractory {
    /// Microseconds in which no other event happens; 0 for none.
    pub period_us: f64,
    /// The brightness that changes count from afterwards.
    pub reference: Reference,
}

/// The brightness that a pixel compares with after its dead time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reference {
    /// The level of the last event; a threshold that was crossed in the dead time fires at its end (v2e).
    AtEvent,
    /// The brightness at the end of the dead time; changes in it are lost (IEBCS, and circuits held in reset).
    AtEnd,
    /// The last threshold that was crossed; a crossing in the dead time fires no event but moves the reference (ESIM).
    #[default]
    Passing,
}

impl Refractory {
    /// The dead time in whole nanoseconds, rounded up.
    #[expect(clippy::cast_possible_truncation, reason = "periods are below 2^53 ns")]
    pub(in crate::sensor) fn period_ns(&self) -> i64 {
        (self.period_us * 1e3).ceil() as i64
    }

    /// Whether the period is one.
    ///
    /// # Errors
    /// Where it is not.
    pub(in crate::sensor) fn validate(&self) -> Result<(), ScreenError> {
        if !(0.0..=LONGEST_US).contains(&self.period_us) {
            let (name, wanted) = ("refractory.period_us", "a number from 0 to 1e9");
            return Err(ScreenError::Parameter { name, found: self.period_us, wanted });
        }
        Ok(())
    }
}
