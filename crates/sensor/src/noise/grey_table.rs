//! Values that follow the light on a pixel: points of a table, and a fine table by grey for the inner loops.

use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, f64x8};

/// The values at a light, from points at rising lights. Between two points, the logarithm of a value is
/// linear in the logarithm of the light; outside the points, the values of the nearest hold. All 0 without
/// points.
pub(crate) fn between_lights<P, const N: usize>(
    points: &[P],
    lux: f64,
    light: impl Fn(&P) -> f64,
    values: impl Fn(&P) -> [f64; N],
) -> [f64; N] {
    let above = points.partition_point(|point| light(point) <= lux);
    let [Some(low), Some(high)] =
        [above.saturating_sub(1), above.min(points.len().saturating_sub(1))].map(|i| points.get(i))
    else {
        return [0.0; N];
    };
    let [from, to] = [low, high].map(&values);
    // Outside the points both are the same point, and the share below would be 0/0.
    let [darker, brighter] = [low, high].map(&light);
    if darker >= brighter || lux <= darker {
        return from;
    }
    let share = libm::log(lux / darker) / libm::log(brighter / darker);
    std::array::from_fn(|i| {
        let (a, b) = (from[i], to[i]);
        // The logarithm of 0 has no place on the line, so a value that vanishes falls linearly.
        if a > 0.0 && b > 0.0 { a * libm::pow(b / a, share) } else { a + (b - a) * share }
    })
}

/// `N` values for every grey.
#[derive(Debug, Clone)]
pub(crate) struct GreyTable<const N: usize> {
    /// One entry per range of greys.
    values: Vec<[f64; N]>,
}

/// Bits of a 32-bit float that are left out of an index: 7 bits of the mantissa remain, so that a
/// range of greys is at most 1/128 wide.
const DROPPED_BITS: u32 = 16;
/// Darkest and brightest grey of the table, powers of two: 2^-20 and 2^20.
const ENDS: [u32; 2] = [0x3580_0000, 0x4980_0000];

impl<const N: usize> GreyTable<N> {
    /// The table of a function of the grey.
    pub(crate) fn new(of_grey: impl Fn(f64) -> [f64; N]) -> Self {
        let [first, last] = ENDS.map(|bits| bits >> DROPPED_BITS);
        let middle = |index: u32| f32::from_bits((index << DROPPED_BITS) + (1 << (DROPPED_BITS - 1)));
        Self { values: (first..=last).map(|index| of_grey(f64::from(middle(index)))).collect() }
    }

    /// The values at a grey.
    #[inline]
    pub(crate) fn at(&self, grey: f32) -> [f64; N] {
        let [first, last] = ENDS.map(f32::from_bits);
        // A grey below 0 or NaN is black: the sensor has refused or counted it.
        // The bits of positive floats rise with their values, so the upper bits number ranges of greys.
        let index = (grey.max(first).min(last).to_bits() >> DROPPED_BITS) - (ENDS[0] >> DROPPED_BITS);
        self.values[index as usize]
    }

    /// The values at eight greys.
    #[expect(clippy::cast_possible_truncation, reason = "the table has a few thousand ranges")]
    #[inline(always)]
    pub(crate) fn eight<S: Simd>(&self, greys: f64x8<S>) -> [f64x8<S>; N] {
        /// A 64-bit float has 29 more bits of mantissa than one of 32.
        const DROPPED: u32 = DROPPED_BITS + 29;
        let [first, last] = ENDS.map(|bits| f64::from(f32::from_bits(bits)));
        let ranges = (greys.max(first).min(last).to_bits() >> DROPPED) - (first.to_bits() >> DROPPED);
        let mut values = [[0.0; 8]; N];
        for lane in 0..8 {
            for (to, value) in values.iter_mut().zip(&self.values[ranges[lane] as usize]) {
                to[lane] = *value;
            }
        }
        let mut wide = [f64x8::splat(greys.simd, 0.0); N];
        for (to, eight) in wide.iter_mut().zip(&values) {
            *to = f64x8::from_slice(greys.simd, eight);
        }
        wide
    }
}

/// A continuous value for every grey: linear between the entries of a fine table.
#[derive(Debug, Clone)]
pub(crate) struct GreyCurve {
    /// The values at the darkest grey of each range, and at the end of the last.
    values: Vec<f64>,
}

impl GreyCurve {
    /// The curve of a function of the grey.
    pub(crate) fn new(of_grey: impl Fn(f64) -> f64) -> Self {
        let [first, last] = ENDS.map(|bits| bits >> DROPPED_BITS);
        let start = |index: u32| f64::from(f32::from_bits(index << DROPPED_BITS));
        Self { values: (first..=last + 1).map(|index| of_grey(start(index))).collect() }
    }

    /// The values at eight greys, rounded to the nearest 32-bit floats.
    #[expect(clippy::cast_possible_truncation, reason = "the table has a few thousand ranges")]
    #[inline(always)]
    pub(crate) fn eight<S: Simd>(&self, greys: f64x8<S>) -> f64x8<S> {
        /// A 64-bit float has 29 more bits of mantissa than one of 32.
        const DROPPED: u32 = DROPPED_BITS + 29;
        /// Multiplied and subtracted, it rounds to 24 bits (Dekker, Numerische Mathematik 18, 1971).
        const SPLITTER: f64 = ((1 << 29) + 1) as f64;
        let [first, last] = ENDS.map(|bits| f64::from(f32::from_bits(bits)));
        let shifted = greys * SPLITTER;
        let rounded = (shifted - (shifted - greys)).max(first).min(last);
        let bits = rounded.to_bits() - first.to_bits();
        let ranges = bits >> DROPPED;
        // The dropped bits as the mantissa of a number from 1 to 2.
        let share =
            f64x8::from_bits((bits & ((1 << DROPPED) - 1)) << (52 - DROPPED) | 1.0f64.to_bits()) - 1.0;
        let [mut from, mut to] = [[0.0; 8]; 2];
        for lane in 0..8 {
            let range = ranges[lane] as usize;
            [from[lane], to[lane]] = [self.values[range], self.values[range + 1]];
        }
        let [from, to] = [f64x8::from_slice(greys.simd, &from), f64x8::from_slice(greys.simd, &to)];
        from + (to - from) * share
    }

    /// The value at a grey.
    #[cfg(test)]
    fn at(&self, grey: f32) -> f64 {
        let [first, last] = ENDS.map(f32::from_bits);
        // A grey below 0 or NaN is black.
        let bits = grey.max(first).min(last).to_bits() - ENDS[0];
        let range = (bits >> DROPPED_BITS) as usize;
        // Within a range of greys, the dropped bits grow evenly with the grey.
        let share = f64::from(bits & ((1 << DROPPED_BITS) - 1)) / f64::from(1 << DROPPED_BITS);
        let [from, to] = [self.values[range], self.values[range + 1]];
        from + (to - from) * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    #[test]
    fn eight_greys_have_the_values_of_each() {
        let table = GreyTable::new(|grey| [grey, 1.0 / grey]);
        let greys = [-1.0, 0.0, 1e-9, 0.3, 1.004, 77.0, 254.99, 1e9];
        let found = dispatch!(Level::new(), simd => {
            table.eight(f64x8::from_slice(simd, &greys)).map(<[f64; 8]>::from)
        });
        for (lane, grey) in greys.into_iter().enumerate() {
            #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
            let grey = grey as f32;
            assert_eq!(table.at(grey).map(f64::to_bits), found.map(|values| values[lane].to_bits()));
        }
    }

    #[test]
    fn eight_greys_are_on_the_curve_of_each() {
        let curve = GreyCurve::new(|grey| libm::pow(grey, 0.7));
        for i in 0..4000u32 {
            // Over the whole table, and beyond its ends.
            let grey = |lane: u32| libm::exp2(f64::from(8 * i + lane) * 45.0 / 32_000.0 - 22.0);
            let mut greys: [f64; 8] = std::array::from_fn(|lane| grey(u32::try_from(lane).unwrap()));
            greys[3] = if i == 0 { -1.0 } else { 0.0 };
            let found: [f64; 8] = dispatch!(Level::new(), simd => {
                curve.eight(f64x8::from_slice(simd, &greys)).into()
            });
            for (grey, found) in greys.into_iter().zip(found) {
                #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
                let grey = grey as f32;
                assert_eq!(curve.at(grey).to_bits(), found.to_bits(), "{grey}");
            }
        }
    }

    /// A power of a grey over a range that is 1/128 wide strays from its chord by `p (p - 1) / 8 / 128^2`.
    #[test]
    fn a_curve_is_close_to_its_function() {
        let of_grey = |grey: f64| libm::pow(grey.clamp(1e-3, 1e3), 0.7);
        let curve = GreyCurve::new(of_grey);
        let mut grey = 2e-3f32;
        while grey < 900.0 {
            let (found, wanted) = (curve.at(grey), of_grey(f64::from(grey)));
            assert!((found / wanted - 1.0).abs() < 0.21 / 8.0 / 128.0 / 128.0, "{grey}: {found} {wanted}");
            grey *= 1.0007;
        }
        for dark in [-1.0, 0.0, f32::NAN] {
            assert!((curve.at(dark) - of_grey(0.0)).abs() < 1e-15, "{dark}");
        }
        assert!((curve.at(1e9) - of_grey(1e9)).abs() < 1e-12);
    }
}
