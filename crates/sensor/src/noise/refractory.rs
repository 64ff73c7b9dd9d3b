//! The dead time after an event, during which a pixel makes no other event.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::Size;
//! # use gs2e_num::seed::Seed;
//! # use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
//! # use gs2e_sensor::{SensorSettings, esim::EsimModel, simulate_one};
//! # use std::ops::ControlFlow::Continue;
//! use gs2e_sensor::noise::{ReferenceRule, RefractoryPeriod};
//!
//! let refractory = RefractoryPeriod { period_us: 200.0, reference: ReferenceRule::AtEvent };
//! let settings = SensorSettings { refractory, ..SensorSettings::default() };
//! let model = EsimModel { settings, ..EsimModel::default() };
//! // A pixel that becomes 25 times as bright within a millisecond.
//! let samples = ArraySamples::Bytes(vec![10, 250]);
//! let mut frames = ArrayFrames::new(Size { width: 1, height: 1 }, samples, &[0, 1000])?;
//! let mut events = Vec::new();
//! simulate_one(&mut frames, &model, Seed(1), &mut events, &mut |_| Continue(()))?;
//! assert!(events.len() > 1 && events.windows(2).all(|pair| pair[1].t.0 - pair[0].t.0 >= 200_000));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

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
