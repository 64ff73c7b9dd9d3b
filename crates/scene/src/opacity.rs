//! Opacities of the 8-bit formats.

use super::nearest_byte;

/// The logit of opacity `byte / 255`. The bytes 0 and 255, whose logits are infinite, count as 0.5
/// and 254.5.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
pub(super) fn logit_of_byte(byte: u8) -> f32 {
    let b = f64::from(byte).clamp(0.5, 254.5);
    libm::log(b / (255.0 - b)) as f32
}

/// The byte whose logit gives the nearest opacity. The ends count as half a step inside.
pub(super) fn byte_of_logit(logit: f32) -> u8 {
    let wanted = 255.0 / (1.0 + libm::exp(-f64::from(logit)));
    // Byte 0 counts as 0.5, so its range ends halfway between 0.5 and 1. Likewise for 255.
    if wanted < 0.75 {
        0
    } else if wanted > 254.25 {
        255
    } else {
        nearest_byte(wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logits_are_finite_monotonous_and_invert_the_sigmoid() {
        let mut last = f32::NEG_INFINITY;
        for byte in 0..=255 {
            let logit = logit_of_byte(byte);
            assert!(logit.is_finite() && logit > last, "{byte}");
            assert_eq!(byte_of_logit(logit), byte);
            last = logit;
            let wanted = f64::from(byte).clamp(0.5, 254.5) / 255.0;
            let opacity = 1.0 / (1.0 + (-f64::from(logit)).exp());
            // The logit is at most 6.3 with an error of half an ulp, 2.4e-7; the slope of the
            // sigmoid is at most 1/4.
            assert!((opacity - wanted).abs() < 6e-8, "{byte}: {opacity}");
        }
    }

    #[test]
    fn the_nearest_opacity_is_taken() {
        let t = |opacity: f64, byte: u8| {
            let logit = <f32 as crate::sh::Scalar>::nearest((opacity / (1.0 - opacity)).ln());
            assert_eq!(byte_of_logit(logit), byte, "{opacity}");
        };
        t(0.5, 128); // 127.5, up
        t(0.74 / 255.0, 0);
        t(0.76 / 255.0, 1);
        t(254.24 / 255.0, 254);
        t(254.26 / 255.0, 255);
        assert_eq!([f32::MIN, f32::MAX].map(byte_of_logit), [0, 255]);
    }
}
