//! The dead time after an event, during which a pixel makes no other event.

use crate::screening::ScreenError;
use serde::{Deserialize, Serialize};

/// Longest period, microseconds: a thousand seconds.
const MAX_US: f64 = 1e9;

/// The length of the dead time, and the reference after it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RefractoryPeriod {
    /// Length of the dead time, microseconds; 0 for none.
    pub period_us: f64,
    /// The reference brightness after the dead time.
    pub reference: ReferenceRule,
}

impl RefractoryPeriod {
    /// The dead time in whole microseconds. Stamps are rounded down, so two of them may be closer
    /// than the period, but never by less than its whole microseconds.
    #[expect(clippy::cast_possible_truncation, reason = "a thousand seconds at most")]
    pub(crate) fn whole_us(self) -> i64 {
        self.period_us.floor() as i64
    }
}

/// The brightness with which a pixel compares after its dead time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReferenceRule {
    /// The level of the previous event. Thresholds that were crossed in the dead time make events
    /// at its end, one after the other (v2e).
    AtEvent,
    /// The brightness at the end of the dead time. Changes during the dead time are lost (IEBCS,
    /// and circuits that are held in reset).
    AtEnd,
    /// The last crossed threshold. Thresholds that were crossed in the dead time make no event but
    /// move the reference (ESIM).
    #[default]
    Passing,
}

impl RefractoryPeriod {
    /// The dead time in whole nanoseconds, rounded up.
    #[expect(clippy::cast_possible_truncation, reason = "periods are below 2^53 ns")]
    pub(crate) fn period_ns(&self) -> i64 {
        // Rounded up, so that whole nanoseconds never shorten the period.
        (self.period_us * 1e3).ceil() as i64
    }

    /// Checks the period.
    ///
    /// # Errors
    /// The period is outside its range.
    pub(crate) fn validate(&self) -> Result<(), ScreenError> {
        if !(0.0..=MAX_US).contains(&self.period_us) {
            let (name, wanted) = ("refractory.period_us", "a number from 0 to 1e9");
            return Err(ScreenError::Parameter { name, found: self.period_us, wanted });
        }
        Ok(())
    }
}
