//! The noise floor of a sensor: random events of both polarities, at rates that follow the light on
//! the pixel.
//!
//! The floor is a table of measured rates. Between two points, the logarithm of a rate is linear in
//! the logarithm of the light; outside the table, the rate of the nearest point holds. The events
//! are an independent Poisson process, as the shot noise of v2e is. They do not change the voltage of
//! the pixel.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::noise::{FloorPoint, NoiseFloor};
//!
//! let point = |lux, on, off| FloorPoint { lux, on, off };
//! let floor = NoiseFloor(vec![point(1.0, 1.0, 4.0), point(100.0, 0.01, 0.04)]);
//! // Halfway between 1 and 100 lux on a logarithmic axis is 10 lux.
//! let [on, off] = floor.rates_hz(10.0);
//! assert!((on - 0.1).abs() < 1e-12 && (off - 0.4).abs() < 1e-12);
//! // Outside the table, the nearest point holds.
//! assert_eq!(floor.rates_hz(0.0), [1.0, 4.0]);
//! ```

use crate::WHITE;
use crate::screening::{ScreenError, at_least_zero};
use serde::{Deserialize, Serialize};

/// Rates of noise events against light.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct NoiseFloor(pub Vec<FloorPoint>);

/// Rates of noise events at one light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FloorPoint {
    /// Light on the sensor, lux.
    pub lux: f64,
    /// ON events per second.
    pub on: f64,
    /// OFF events per second.
    pub off: f64,
}

impl NoiseFloor {
    /// Returns true if there are no noise events at any light.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        self.0.iter().all(|point| point.on == 0.0 && point.off == 0.0)
    }

    /// Rates of ON and OFF events at this light, Hz.
    #[must_use]
    pub fn rates_hz(&self, lux: f64) -> [f64; 2] {
        let above = self.0.partition_point(|point| point.lux <= lux);
        let [Some(low), Some(high)] =
            [above.saturating_sub(1), above.min(self.0.len().saturating_sub(1))].map(|i| self.0.get(i))
        else {
            return [0.0; 2];
        };
        // Outside the table both are the same point, and the share below would be 0/0.
        if low.lux >= high.lux || lux <= low.lux {
            return [low.on, low.off];
        }
        let share = libm::log(lux / low.lux) / libm::log(high.lux / low.lux);
        [(low.on, high.on), (low.off, high.off)].map(|(a, b)| {
            // The logarithm of 0 has no place on the line, so a rate that vanishes falls linearly.
            if a > 0.0 && b > 0.0 { a * libm::pow(b / a, share) } else { a + (b - a) * share }
        })
    }

    /// [`NoiseFloor::rates_hz`] at a grey, where white is `white_lux`.
    #[must_use]
    pub fn rates_at_grey(&self, grey: f64, white_lux: f64) -> [f64; 2] {
        self.rates_hz(white_lux * grey / WHITE)
    }

    /// Checks the points.
    ///
    /// # Errors
    /// A number is outside its range, or the lights do not rise.
    pub(crate) fn validate(&self) -> Result<(), ScreenError> {
        for FloorPoint { lux, on, off } in &self.0 {
            for (name, found) in [("floor.on", *on), ("floor.off", *off)] {
                at_least_zero(name, found)?;
            }
            if !(*lux > 0.0 && lux.is_finite()) {
                let wanted = "a finite number above 0";
                return Err(ScreenError::Parameter { name: "floor.lux", found: *lux, wanted });
            }
        }
        if self.0.windows(2).all(|pair| pair[0].lux < pair[1].lux) {
            return Ok(());
        }
        Err(ScreenError::Combination("the lights of `floor` must rise from point to point"))
    }
}

/// The rates of a floor for all greys, as a table.
#[derive(Debug, Clone)]
pub(crate) struct FloorTable {
    /// Rates of ON and OFF events per ns, one entry per range of greys.
    rates: Vec<[f64; 2]>,
}

/// Bits of a 32-bit float that are left out of an index: 7 bits of the mantissa remain, so that a
/// range of greys is at most 1/128 wide.
const DROPPED_BITS: u32 = 16;
/// Darkest and brightest grey of the table, powers of two: 2^-20 and 2^20.
const ENDS: [u32; 2] = [0x3580_0000, 0x4980_0000];
/// Events per ns of 1 Hz.
const PER_NS: f64 = 1e-9;

impl FloorTable {
    /// The table of a floor, where white is `white_lux`.
    pub(crate) fn new(floor: &NoiseFloor, white_lux: f64) -> Self {
        let [first, last] = ENDS.map(|bits| bits >> DROPPED_BITS);
        let middle = |index: u32| f32::from_bits((index << DROPPED_BITS) + (1 << (DROPPED_BITS - 1)));
        let rates = |index| floor.rates_at_grey(f64::from(middle(index)), white_lux).map(|hz| hz * PER_NS);
        Self { rates: (first..=last).map(rates).collect() }
    }

    /// Rates of ON and OFF events at a grey, per ns.
    #[inline]
    pub(crate) fn at(&self, grey: f32) -> [f64; 2] {
        let [first, last] = ENDS.map(f32::from_bits);
        // A grey below 0 or NaN is black: the sensor has refused or counted it.
        // The bits of positive floats rise with their values, so the upper bits number ranges of greys.
        let index = (grey.max(first).min(last).to_bits() >> DROPPED_BITS) - (ENDS[0] >> DROPPED_BITS);
        self.rates[index as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floor() -> NoiseFloor {
        let point = |lux, on, off| FloorPoint { lux, on, off };
        NoiseFloor(vec![point(1.0, 1.0, 4.0), point(100.0, 0.01, 0.0)])
    }

    #[test]
    fn rates_are_straight_between_points_on_logarithmic_axes() {
        let near = |lux: f64, wanted: [f64; 2]| {
            let found = floor().rates_hz(lux);
            assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-12), "{lux}: {found:?}");
        };
        near(0.0, [1.0, 4.0]);
        near(1.0, [1.0, 4.0]);
        near(10.0, [0.1, 2.0]);
        near(100.0, [0.01, 0.0]);
        near(1e6, [0.01, 0.0]);
        let [on, off] = NoiseFloor::default().rates_hz(1.0);
        assert!(NoiseFloor::default().is_absent() && on + off <= 0.0);
    }

    #[test]
    fn the_table_follows_the_floor() {
        let table = FloorTable::new(&floor(), 255.0);
        for grey in [0.0f32, 0.3, 1.0, 2.0, 77.7, 100.0, 255.0, 1e9] {
            let [on, off] = floor().rates_at_grey(f64::from(grey), 255.0);
            let [found_on, found_off] = table.at(grey).map(|rate| rate * 1e9);
            // Half of a range of greys, to the power of the steepest slope, which is 1.
            assert!((found_on - on).abs() <= 4e-3 * on && (found_off - off).abs() <= 2e-2, "{grey}");
        }
    }

    #[test]
    fn lights_that_do_not_rise_are_refused() {
        let mut wrong = floor();
        wrong.0.reverse();
        assert!(wrong.validate().is_err() && floor().validate().is_ok());
    }
}
