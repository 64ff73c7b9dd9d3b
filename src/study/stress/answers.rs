//! The answers that were computed beforehand, with 120 digits.

/// `answers.py` writes it.
const TABLE: &str = include_str!("answers.txt");

/// What is known of one point.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// What the program is given.
    pub given: Vec<f64>,
    /// What it should answer.
    pub wanted: Vec<f64>,
}

/// The answers of this name.
///
/// # Panics
/// Where there are none: the table is a part of the program.
#[must_use]
pub fn answers(name: &str) -> Vec<Answer> {
    let numbers = |text: &str| -> Vec<f64> {
        text.split_whitespace().map(|number| number.parse().expect("the table holds numbers")).collect()
    };
    let of_line = |line: &str| {
        let (given, wanted) = line.strip_prefix(name)?.strip_prefix(' ')?.split_once('=')?;
        Some(Answer { given: numbers(given), wanted: numbers(wanted) })
    };
    let found: Vec<Answer> = TABLE.lines().filter_map(of_line).collect();
    assert!(!found.is_empty(), "no answers are called `{name}`");
    found
}
