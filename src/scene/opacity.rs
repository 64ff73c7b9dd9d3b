//! Opacities of the 8-bit formats.

/// The logit of opacity `byte / 255`; the bytes 0 and 255, whose logits are infinite, count as 0.5 and 254.5.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
pub(super) fn logit_of_byte(byte: u8) -> f32 {
    let b = f64::from(byte).clamp(0.5, 254.5);
    libm::log(b / (255.0 - b)) as f32
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
            last = logit;
            let wanted = f64::from(byte).clamp(0.5, 254.5) / 255.0;
            let opacity = 1.0 / (1.0 + (-f64::from(logit)).exp());
            // The logit is at most 6.3 and carries half an ulp, 2.4e-7; the sigmoid's slope is at most 1/4.
            assert!((opacity - wanted).abs() < 6e-8, "{byte}: {opacity}");
        }
    }
}
