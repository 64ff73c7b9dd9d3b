//! The dead time after an event, in which a pixel makes no other.

use serde::{Deserialize, Serialize};

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
    /// That of the event before; what has passed a threshold by then makes an event at the end of the dead time, one
    /// after the other (v2e).
    AtEvent,
    /// What it sees when its dead time ends: changes in the dead time are lost (IEBCS, and circuits that are held in
    /// reset).
    AtEnd,
    /// The last threshold that was passed: those passed in the dead time make no event, and move the reference (ESIM).
    #[default]
    Passing,
}

impl Refractory {
    /// The dead time in whole nanoseconds, rounded up.
    #[expect(clippy::cast_possible_truncation, reason = "periods are below 2^53 ns")]
    pub(in crate::sensor) fn period_ns(&self) -> i64 {
        (self.period_us * 1e3).ceil() as i64
    }
}
