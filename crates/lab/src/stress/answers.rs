//! Answers that were computed in advance with 120 digits.

/// Written by `answers.py`.
const TABLE: &str = include_str!("answers.txt");

/// One point of a table of answers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct KnownAnswer {
    /// Input of the program.
    pub given: Vec<f64>,
    /// Correct output.
    pub wanted: Vec<f64>,
}

/// Returns the answers of this name.
///
/// # Panics
/// The table has no answer of this name. The table is part of the program.
#[must_use]
pub(crate) fn find_answers(name: &str) -> Vec<KnownAnswer> {
    let numbers = |text: &str| -> Vec<f64> {
        text.split_whitespace().map(|number| number.parse().expect("the table holds numbers")).collect()
    };
    let of_line = |line: &str| {
        // The space ends the name, which may be the beginning of another one.
        let (given, wanted) = line.strip_prefix(name)?.strip_prefix(' ')?.split_once('=')?;
        Some(KnownAnswer { given: numbers(given), wanted: numbers(wanted) })
    };
    let found: Vec<KnownAnswer> = TABLE.lines().filter_map(of_line).collect();
    assert!(!found.is_empty(), "no answers are called `{name}`");
    found
}
