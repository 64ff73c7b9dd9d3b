//! Rates of a noise floor by luminance, as a table.

use gs2e_sensor::voltmeter::VoltmeterModel;

/// Rates of a noise floor at greys a factor of two apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FloorRates {
    /// ON and OFF events per second at grey `255 / 2^i`.
    hz: [[f64; 2]; Self::LEN],
}

impl FloorRates {
    const LEN: usize = 16;

    pub(super) fn new(sensor: &VoltmeterModel) -> Option<Self> {
        let white_lux = sensor.settings.front_end.white_lux();
        let rate = |i: usize| {
            let grey = 255.0 * libm::exp2(-(i as f64));
            sensor.floor.rates_at_grey(grey, white_lux)
        };
        (!sensor.floor.is_absent()).then(|| Self { hz: std::array::from_fn(rate) })
    }

    /// ON and OFF events per second at a luminance, linear between two greys of the table.
    pub(super) fn at(self, luminance: f64) -> [f64; 2] {
        const LAST: usize = FloorRates::LEN - 1;
        /// Bits of a fraction, and the exponent of 1.
        const FRACTION: u32 = 52;
        const BIAS: usize = 1023;
        let value = luminance / 255.0;
        // The greys are powers of two, so the exponent of a number is its place in the table, and its
        // fraction the share of the brighter grey.
        let bits = value.max(0.0).to_bits();
        let darker = BIAS.saturating_sub((bits >> FRACTION) as usize);
        if darker == 0 {
            return self.hz[0];
        }
        if darker > LAST {
            return self.hz[LAST];
        }
        let share = f64::from_bits((bits & ((1 << FRACTION) - 1)) | 1.0f64.to_bits()) - 1.0;
        let [dark, bright] = [self.hz[darker], self.hz[darker - 1]];
        [0, 1].map(|side| dark[side] * (1.0 - share) + bright[side] * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_those_of_the_table_and_linear_between() {
        // ON events `10 i` per second at the grey of place `i`, OFF events a hundred more.
        let row = |i: usize| [10.0 * i as f64, 100.0 + 10.0 * i as f64];
        let rates = FloorRates { hz: std::array::from_fn(row) };
        for (luminance, on) in [
            (1e9, 0.0),
            (255.0, 0.0),
            (0.75 * 255.0, 5.0),
            (0.5 * 255.0, 10.0),
            (0.3 * 255.0, 18.0),
            (255.0 / 16.0, 40.0),
            (255.0 / 32_768.0, 150.0),
            (1e-9, 150.0),
            (0.0, 150.0),
            (-3.0, 150.0),
            (f64::NAN, 150.0),
        ] {
            let found = rates.at(luminance);
            let wanted = [on, 100.0 + on];
            // The share is exact to a few roundings.
            let near = |side: usize| (found[side] - wanted[side]).abs() < 1e-12 * 200.0;
            assert!(near(0) && near(1), "{luminance}: {found:?}");
        }
    }
}
