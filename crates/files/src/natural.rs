//! Natural order: runs of digits compare as numbers, so that `9.jpg` comes before `10.jpg`.

use std::cmp::Ordering;

/// Compares two names; total, and equal only for equal names.
///
/// Among equal numbers, the number with fewer leading zeros comes first, if no later part decides.
#[must_use]
pub fn compare_names(a: &str, b: &str) -> Ordering {
    let (mut rest_a, mut rest_b) = (a.as_bytes(), b.as_bytes());
    while let (Some(&first_a), Some(&first_b)) = (rest_a.first(), rest_b.first()) {
        let order = if first_a.is_ascii_digit() && first_b.is_ascii_digit() {
            compare_numbers(take_digits(&mut rest_a), take_digits(&mut rest_b))
        } else {
            (rest_a, rest_b) = (&rest_a[1..], &rest_b[1..]);
            first_a.cmp(&first_b)
        };
        if order.is_ne() {
            return order;
        }
    }
    // Names that end together differ in leading zeros only: the longer name has more of them.
    rest_a.len().cmp(&rest_b.len()).then_with(|| a.len().cmp(&b.len())).then_with(|| a.cmp(b))
}

fn take_digits<'a>(rest: &mut &'a [u8]) -> &'a [u8] {
    let end = rest.iter().position(|b| !b.is_ascii_digit()).unwrap_or(rest.len());
    let (digits, after) = rest.split_at(end);
    *rest = after;
    digits
}

fn compare_numbers(a: &[u8], b: &[u8]) -> Ordering {
    let significant = |digits: &[u8]| digits.iter().position(|&d| d != b'0').unwrap_or(digits.len());
    let (a, b) = (&a[significant(a)..], &b[significant(b)..]);
    // Without leading zeros, the longer number is the larger one. No number overflows this way.
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count() {
        let sorted = [
            "",
            "0.jpg",
            "00.jpg",
            "1.jpg",
            "01.jpg",
            "9.jpg",
            "10.jpg",
            "99999999999999999999999.jpg",
            "100000000000000000000000.jpg",
            "IMG_2 b.png",
            "IMG_10 a.png",
            "a",
            "a/1",
            "a/2/x",
            "a/10/a",
            "b1a",
            "b1b2",
            "b1b10",
            "é",
        ];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                assert_eq!(compare_names(a, b), i.cmp(&j), "{a} and {b}");
            }
        }
    }
}
