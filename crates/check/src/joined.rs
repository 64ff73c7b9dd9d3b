//! The findings of a build and those on the files of its release, as one list.
//!
//! A build knows what no release has: the brightness that the sensor saw, the counts of the simulation, the
//! fitted curve of the path. The files of a release show what no build reads: its pictures, in order. A
//! release is judged by both, so each statement has the worse of the two verdicts.

use super::{Finding, NAMES, Verdict};

/// Passes over the files of a release. What `checks.json` states of them was found in the same files, which
/// may have changed since.
const OF_FILES: [&str; 5] = ["event_times", "photometric", "depth_consistency", "flow_projection", "records"];

/// Joins the findings of a build with those on the files of the release, in the order of reports.
///
/// A statement that both judged has the worse verdict, and that of the build if they are equal. A second
/// join with the same files changes nothing.
#[must_use]
pub fn join_findings(built: Vec<Finding>, files: Vec<Finding>) -> Vec<Finding> {
    let is_judged_again = |f: &Finding| {
        let same = |other: &Finding| other.check == f.check && other.subject.place == f.subject.place;
        // A build compares disparity with the depth of the simulation, which is not in the files.
        let is_of_build = f.subject.statement == "disparity";
        OF_FILES.contains(&f.check.as_str()) && !is_of_build && files.iter().any(same)
    };
    let mut joined: Vec<Finding> = built.into_iter().filter(|f| !is_judged_again(f)).collect();
    for finding in files {
        let same = |other: &&mut Finding| other.check == finding.check && other.subject == finding.subject;
        match joined.iter_mut().find(same) {
            Some(known) if is_worse(&finding, known) => *known = finding,
            Some(_) => {}
            None => joined.push(finding),
        }
    }
    let spoken: Vec<(String, String)> =
        joined.iter().filter(|f| !is_silent(f)).map(|f| (f.check.clone(), f.subject.place.clone())).collect();
    joined.retain(|f| {
        !is_silent(f) || spoken.iter().all(|(check, place)| (check, place) != (&f.check, &f.subject.place))
    });
    // Stable: statements of one check keep their order.
    joined.sort_by_key(|f| NAMES.iter().position(|name| *name == f.check));
    joined
}

/// Returns true for a check without any statement about its subject.
fn is_silent(finding: &Finding) -> bool {
    finding.verdict == Verdict::NotRun && finding.subject.statement.is_empty()
}

fn is_worse(files: &Finding, built: &Finding) -> bool {
    let severity = |finding: &Finding| match finding.verdict {
        Verdict::NotRun => 0,
        Verdict::Pass => 1,
        Verdict::Warn => 2,
        Verdict::Waived => 3,
        Verdict::Fail => 4,
    };
    severity(files) > severity(built)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subject::Judgement;

    fn finding(check: &str, statement: &str, verdict: Verdict, because: &str) -> Finding {
        Judgement::without_value(verdict, "1", because.to_owned()).finding("s/t", check, statement)
    }

    fn said(findings: &[Finding]) -> Vec<String> {
        let one =
            |f: &Finding| format!("{}#{} {} {}", f.check, f.subject.statement, f.verdict.name(), f.because);
        findings.iter().map(one).collect()
    }

    #[test]
    fn the_worse_verdict_counts() {
        use Verdict::{Fail, NotRun, Pass, Warn};
        let built = vec![
            finding("event_frame", "sign", Pass, "built"),
            finding("affine", "", Warn, "built"),
            finding("speed", "", NotRun, "built"),
            finding("sampling", "", NotRun, "built"),
        ];
        let files = vec![
            finding("speed", "", Pass, "files"),
            finding("event_frame", "sign", Fail, "files"),
            finding("affine", "", NotRun, "files"),
            finding("sampling", "", NotRun, "files"),
        ];
        let wanted = [
            "event_frame#sign fail files",
            "sampling# not-run built",
            "affine# warn built",
            "speed# pass files",
        ];
        let once = join_findings(built, files.clone());
        assert_eq!(said(&once), wanted);
        assert_eq!(said(&join_findings(once, files)), wanted, "a second join changes nothing");
    }

    #[test]
    fn a_check_that_says_something_has_no_statement_that_it_was_not_run() {
        use Verdict::{NotRun, Pass};
        let built = vec![
            finding("photometric", "", NotRun, "built"),
            finding("flow_projection", "", NotRun, "built"),
        ];
        let files = vec![
            finding("photometric", "order", NotRun, "files"),
            finding("photometric", "shift", Pass, "files"),
            finding("flow_projection", "", NotRun, "files"),
        ];
        let wanted = [
            "photometric#order not-run files",
            "photometric#shift pass files",
            "flow_projection# not-run files",
        ];
        assert_eq!(said(&join_findings(built, files)), wanted);
    }
}
