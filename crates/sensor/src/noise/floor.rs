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

use super::grey_table::{GreyTable, between_lights};
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
        between_lights(&self.0, lux, |point| point.lux, |point| [point.on, point.off])
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
        if self.0.is_sorted_by(|before, after| before.lux < after.lux) {
            return Ok(());
        }
        Err(ScreenError::Combination("the lights of `floor` must rise from point to point"))
    }
}

/// Events per ns of 1 Hz.
const PER_NS: f64 = 1e-9;

impl NoiseFloor {
    /// Rates of ON and OFF events by grey, per ns, where white is `white_lux`.
    pub(crate) fn table(&self, white_lux: f64) -> GreyTable<2> {
        GreyTable::new(|grey| self.rates_at_grey(grey, white_lux).map(|hz| hz * PER_NS))
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
        let table = floor().table(255.0);
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
