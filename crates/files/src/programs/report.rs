//! Report of a supervisor on the end of its program: one line of text.

use std::fmt;
use std::str::FromStr;

/// End of a supervised program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgramReport {
    /// It ended with this exit code.
    Code(i32),
    /// This signal ended it.
    Signal(i32),
    /// It was not started: the system's error number.
    NotStarted(i32),
}

impl fmt::Display for ProgramReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Code(code) => writeln!(f, "code {code}"),
            Self::Signal(signal) => writeln!(f, "signal {signal}"),
            Self::NotStarted(error) => writeln!(f, "not-started {error}"),
        }
    }
}

/// The text is not a report. It is incomplete, for example, if the supervisor was killed while it
/// wrote.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("it ended without a report")]
pub struct NoReport;

impl FromStr for ProgramReport {
    type Err = NoReport;

    fn from_str(text: &str) -> Result<Self, NoReport> {
        // A line without its end may be cut: `code 1` could be the start of `code 137`.
        let (kind, number) = text.strip_suffix('\n').and_then(|line| line.split_once(' ')).ok_or(NoReport)?;
        let number = number.parse().map_err(|_| NoReport)?;
        match kind {
            "code" => Ok(Self::Code(number)),
            "signal" => Ok(Self::Signal(number)),
            "not-started" => Ok(Self::NotStarted(number)),
            _ => Err(NoReport),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_report_is_read_and_no_part_of_one() {
        for report in [ProgramReport::Code(13), ProgramReport::Signal(9), ProgramReport::NotStarted(2)] {
            let text = report.to_string();
            assert_eq!(text.parse(), Ok(report));
            for cut in 0..text.len() {
                assert_eq!(text[..cut].parse::<ProgramReport>(), Err(NoReport), "{:?}", &text[..cut]);
            }
        }
    }
}
