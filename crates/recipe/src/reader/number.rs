//! Numbers as YAML writes them. The schema decides the meaning of a number.

/// Parses a finite real in decimal form; -0 becomes 0. Returns `None` for `.nan`, `.inf`, overflow,
/// and text that is no number.
pub(crate) fn parse_real(text: &str) -> Option<f64> {
    // Rust's parser also reads `inf`, `infinity` and `nan`.
    let spelled = text.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
    let value: f64 = text.parse().ok().filter(|v: &f64| spelled && v.is_finite())?;
    Some(if value == 0.0 { 0.0 } else { value })
}

/// Parses a whole number: decimal, `0x`, `0o`, or a real without a fraction below 2^53, for example
/// `2e3`.
pub(super) fn parse_whole(text: &str) -> Option<i128> {
    if let Some(digits) = text.strip_prefix("0x") {
        return i128::from_str_radix(digits, 16).ok();
    }
    if let Some(digits) = text.strip_prefix("0o") {
        return i128::from_str_radix(digits, 8).ok();
    }
    text.parse().ok().or_else(|| {
        let value = parse_real(text)?;
        let exact = value.fract() == 0.0 && value.abs() < (1_u64 << 53) as f64;
        #[expect(clippy::cast_possible_truncation, reason = "a whole number below 2^53")]
        exact.then_some(value as i128)
    })
}

/// The digits after the zeros with which a decimal number begins: YAML 1.1 reads `0123` as an octal number,
/// YAML 1.2 as a decimal one.
pub(super) fn after_zeros(text: &str) -> Option<&str> {
    let digits = text.strip_prefix('0')?.trim_start_matches('0');
    (!digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())).then_some(digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reals_are_finite_and_decimal() {
        let t = |text: &str, wanted: Option<f64>| {
            assert_eq!(parse_real(text).map(f64::to_bits), wanted.map(f64::to_bits), "{text}");
        };
        for text in ["0.5", "0.50", ".5", "5e-1", "+0.5", "5E-1"] {
            t(text, Some(0.5));
        }
        t("-0.0", Some(0.0));
        t("1e-400", Some(0.0));
        for text in
            ["", "nan", "NaN", ".nan", "inf", "infinity", ".inf", "1e999", "-1e999", "0x10", "1_000", "1,5"]
        {
            t(text, None);
        }
    }

    #[test]
    fn whole_numbers_are_told_by_value_not_by_spelling() {
        let t = |text: &str, wanted: Option<i128>| assert_eq!(parse_whole(text), wanted, "{text}");
        t("30", Some(30));
        t("30.0", Some(30));
        t("3e1", Some(30));
        t("0x1F", Some(31));
        t("0o17", Some(15));
        t("-7", Some(-7));
        t("18446744073709551615", Some(u64::MAX.into()));
        t("1.5", None);
        t("1e17", None);
        t("0xg", None);
        t("seven", None);
    }
}
