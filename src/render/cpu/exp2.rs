//! `2^-q` for the opacity of a layer: the same bits on every machine, and simple enough for the compiler to
//! evaluate several at a time.

/// Minimax polynomial of `2^f` over [-1/2, 1/2] with constant term 1, coefficients of `f` to `f^5`, each rounded to
/// 32 bits before the next was fitted; relative error 9.2e-8 before rounding.
#[expect(clippy::approx_constant, reason = "fitted: six units in the last place below ln 2")]
const POWER: [f32; 5] = [0.693_147, 0.240_222_47, 0.055_507_11, 0.009_671_291, 0.001_326_952_1];

/// Adding `1.5 * 2^23` rounds to an integer, ties to even, and leaves it in the low bits.
const ROUNDER: f32 = 12_582_912.0;

/// Larger arguments count as this one; their layers are far below the least opacity that is blended.
const LARGEST: f32 = 125.0;

/// `2^-q` for `q >= 0`, relative error at most 2e-7 (tested) up to `q = 125`, and `2^-125` beyond and for NaN.
/// `q = 0` gives exactly 1.
#[inline(always)]
pub(super) fn exp2_neg(q: f32) -> f32 {
    let y = if q < LARGEST { -q } else { -LARGEST };
    let shifted = y + ROUNDER;
    let f = y - (shifted - ROUNDER);
    let [c1, c2, c3, c4, c5] = POWER;
    let p = 1.0 + f * (c1 + f * (c2 + f * (c3 + f * (c4 + f * c5))));
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_stays_within_the_bound() {
        let mut worst = 0.0_f64;
        // every 1/8192: all fractions that the reduction can leave near its ends and in between
        for k in 0..(125 * 8192) {
            let q = k as f32 / 8192.0 + 1e-5 * (k % 7) as f32;
            let exact = libm::exp2(-f64::from(q));
            worst = worst.max((f64::from(exp2_neg(q)) / exact - 1.0).abs());
        }
        assert!(worst <= 2e-7, "largest relative error {worst:e}");
    }

    #[test]
    fn powers_of_two_are_exact_and_no_value_exceeds_one() {
        for n in 0..=125_u32 {
            assert_eq!(exp2_neg(n as f32).to_bits(), (127 - n) << 23, "2^-{n}");
        }
        for q in [0.0, f32::MIN_POSITIVE, 1e-9, 1e-7, 1e-3, 0.49, 0.51] {
            assert!(exp2_neg(q) <= 1.0, "{q}");
        }
    }

    #[test]
    fn huge_arguments_and_nan_give_next_to_nothing() {
        for q in [125.5, 1e30, f32::INFINITY, f32::NAN] {
            assert_eq!(exp2_neg(q).to_bits(), 2.0_f32.powi(-125).to_bits(), "{q}");
        }
    }
}
