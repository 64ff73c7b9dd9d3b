//! Some numbers by luminance, as a table.

/// `N` numbers at greys a factor of two apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LightTable<const N: usize> {
    /// The numbers at grey `255 / 2^i`.
    values: [[f64; N]; LEN],
}

/// Greys of a table.
const LEN: usize = 16;

impl<const N: usize> LightTable<N> {
    pub(super) fn new(of_grey: impl Fn(f64) -> [f64; N]) -> Self {
        Self { values: std::array::from_fn(|i| of_grey(255.0 * libm::exp2(-(i as f64)))) }
    }

    /// The largest first number.
    pub(super) fn most(self) -> f64 {
        self.values.iter().map(|numbers| numbers[0]).fold(0.0, f64::max)
    }

    /// The numbers at a luminance, linear between two greys of the table.
    pub(super) fn at(self, luminance: f64) -> [f64; N] {
        const LAST: usize = LEN - 1;
        /// Bits of a fraction, and the exponent of 1.
        const FRACTION: u32 = 52;
        const BIAS: usize = 1023;
        let value = luminance / 255.0;
        // The greys are powers of two, so the exponent of a number is its place in the table, and its
        // fraction the share of the brighter grey.
        let bits = value.max(0.0).to_bits();
        let darker = BIAS.saturating_sub((bits >> FRACTION) as usize);
        if darker == 0 {
            return self.values[0];
        }
        if darker > LAST {
            return self.values[LAST];
        }
        let share = f64::from_bits((bits & ((1 << FRACTION) - 1)) | 1.0f64.to_bits()) - 1.0;
        let [dark, bright] = [self.values[darker], self.values[darker - 1]];
        std::array::from_fn(|i| dark[i] * (1.0 - share) + bright[i] * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_table_and_linear_between() {
        // `10 i` at the grey of place `i`, and a hundred more.
        let row = |i: usize| [10.0 * i as f64, 100.0 + 10.0 * i as f64];
        let table = LightTable { values: std::array::from_fn(row) };
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
            let found = table.at(luminance);
            let wanted = [on, 100.0 + on];
            // The share is exact to a few roundings.
            let near = |side: usize| (found[side] - wanted[side]).abs() < 1e-12 * 200.0;
            assert!(near(0) && near(1), "{luminance}: {found:?}");
        }
    }
}
