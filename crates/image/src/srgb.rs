//! The transfer curve of sRGB (IEC 61966-2-1): display value 0..1 to linear light 0..1, and back.
//!
//! Above 1, both directions continue the power law; below 0, the linear piece. Renderings leave the
//! range.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::srgb;
//!
//! // Black and white stay, and a grey between them has less light than its display value says.
//! assert_eq!(srgb::decode(0.0), 0.0);
//! assert!((srgb::decode(1.0) - 1.0).abs() < 1e-12);
//! assert!(srgb::decode(0.5) < 0.5);
//! assert!((srgb::encode(srgb::decode(0.5)) - 0.5).abs() < 1e-12);
//! ```

use fearless_simd::{Select as _, Simd, SimdBase as _, f64x8};
use gs2e_num::elementary::{exp_eight, ln_eight};

/// Display value up to which the curve is linear.
pub const STRAIGHT: f64 = 0.04045;
/// Linear light up to which the curve is linear.
const STRAIGHT_LIGHT: f64 = 0.003_130_8;
const SLOPE: f64 = 12.92;
/// Offset `a` of the curve `(1 + a) light^(1 / gamma) - a`.
pub const OFFSET: f64 = 0.055;
/// Exponent of the curve.
pub const GAMMA: f64 = 2.4;

/// The display value of linear light.
#[must_use]
pub fn encode(light: f64) -> f64 {
    // The standard rounds its constants, so the two pieces miss each other here by 3e-8.
    if light <= STRAIGHT_LIGHT {
        SLOPE * light
    } else {
        (1.0 + OFFSET) * libm::pow(light, 1.0 / GAMMA) - OFFSET
    }
}

/// The linear light of a display value.
#[must_use]
pub fn decode(v: f64) -> f64 {
    if v <= STRAIGHT { v / SLOPE } else { libm::pow((v + OFFSET) / (1.0 + OFFSET), GAMMA) }
}

/// The derivative of linear light by the display value.
#[must_use]
pub fn decode_slope(v: f64) -> f64 {
    if v <= STRAIGHT {
        1.0 / SLOPE
    } else {
        GAMMA / (1.0 + OFFSET) * libm::pow((v + OFFSET) / (1.0 + OFFSET), GAMMA - 1.0)
    }
}

/// [`decode`] for eight finite values: within a few ulp of it, and the same bits with every
/// instruction set.
#[inline(always)]
pub fn decode_eight<S: Simd>(v: f64x8<S>) -> f64x8<S> {
    let straight = v.simd_le(STRAIGHT);
    // Values on the linear piece are replaced, because they may have no logarithm.
    let base = (v.max(STRAIGHT) + OFFSET) / (1.0 + OFFSET);
    straight.select(v / SLOPE, exp_eight(ln_eight(base) * GAMMA))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    /// Light of 8-bit display values to six digits, from the table in nothings/stb,
    /// `stb_image_resize.h`.
    const PUBLISHED: [(u8, f64); 10] = [
        (0, 0.0),
        (1, 0.000_304),
        (10, 0.003_035),
        (11, 0.003_347),
        (22, 0.008_023),
        (32, 0.014_444),
        (55, 0.038_204),
        (77, 0.074_214),
        (88, 0.097_587),
        (255, 1.0),
    ];

    #[test]
    fn light_is_that_of_a_published_table() {
        for (byte, light) in PUBLISHED {
            let found = decode(f64::from(byte) / 255.0);
            // Half a unit of the last digit.
            assert!((found - light).abs() <= 0.5e-6 + 1e-12, "{byte}: {found}");
        }
    }

    #[test]
    fn what_is_encoded_is_decoded() {
        for i in 0..=1_500_u16 {
            let v = f64::from(i) / 1000.0;
            // The rounded constants of the standard leave a step of 3e-8 where its pieces meet.
            assert!((encode(decode(v)) - v).abs() < 1e-7, "{v}");
        }
        assert!((decode(-0.1) + 0.1 / 12.92).abs() < 1e-15, "straight below 0");
    }

    /// Central differences: their error is `h^2/6` times a third derivative of at most 8, plus
    /// rounding divided by `h`.
    #[test]
    fn the_slope_is_that_of_the_curve() {
        let h = 1e-5;
        for i in (1..150_u8).filter(|i| *i != 4) {
            let v = f64::from(i) / 100.0;
            let found = (decode(v + h) - decode(v - h)) / (2.0 * h);
            assert!((found - decode_slope(v)).abs() < 1e-9, "{v}: {found}, {}", decode_slope(v));
        }
    }

    /// An error of one ulp in the logarithm, which is at most 3, is 2.4 times that in the power: a
    /// few ulp.
    #[test]
    fn eight_at_once_are_decoded_alike() {
        let level = Level::new();
        for start in 0..200_u16 {
            let v = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| f64::from(8 * start + i) / 1000.0 - 0.1);
            let mut found = [0.0; 8];
            dispatch!(level, simd => decode_eight(f64x8::from_slice(simd, &v)).store_slice(&mut found));
            for (v, found) in v.iter().zip(found) {
                let wanted = decode(*v);
                assert!(
                    (found - wanted).abs() <= 16.0 * f64::EPSILON * wanted.abs(),
                    "{v}: {found}, {wanted}"
                );
            }
        }
    }
}
