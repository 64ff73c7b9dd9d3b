//! `gs2e gc --shared-store`: deletes files without a recent use from a folder that several machines share.

use crate::cli::{Console, ExitKind, UserMessage, VerbError};
use gs2e_files::is_there;
use gs2e_store::{SharedSweep, SharedSweepSummary, is_bucket, sweep_shared};
use serde_json::json;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Shortest age. No job of a cluster is so short that its files can go earlier.
const LEAST_AGE: Duration = Duration::from_secs(3600);
/// Difference of clocks above which the user hears of it, s.
const TOLD_DIFFERENCE: u64 = 300;

pub(super) fn run(
    shared: &Path,
    older_than: Duration,
    dry_run: bool,
    console: &Console,
) -> Result<ExitKind, VerbError> {
    if is_bucket(shared) {
        let what = format!("{} is not a folder", shared.display());
        let help =
            "in a bucket, a lifecycle rule deletes old objects; a step whose objects are gone is made again";
        return Err(VerbError::usage("not-shared", what).help(help));
    }
    if !is_there(&shared.join("VERSION")) {
        let what = format!("there is no shared store in {}", shared.display());
        return Err(VerbError::usage("no-shared-store", what));
    }
    if older_than < LEAST_AGE {
        let seconds = older_than.as_secs();
        let what = format!("--older-than is {seconds} s, wanted 1h or more, and more than the longest job");
        return Err(VerbError::usage("usage", what));
    }
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let now_ns = i64::try_from(now.as_nanos()).unwrap_or(i64::MAX);
    let swept = sweep_shared(shared, SharedSweep { older_than, now_ns, dry_run })?;
    report(&swept, dry_run, console);
    Ok(ExitKind::Done)
}

fn report(swept: &SharedSweepSummary, dry_run: bool, console: &Console) {
    let SharedSweepSummary { records, blobs, kept_records, restored, deleted, refused, .. } = *swept;
    let [mb, deleted_mb] = [swept.bytes, swept.deleted_bytes].map(|bytes| bytes as f64 * 1e-6);
    let [moved, removed] = if dry_run { ["would move", "would delete"] } else { ["moved", "deleted"] };
    console.note(&format!("{moved} {records} records and {blobs} blobs, {mb:.1} MB, to the trash"));
    console.note(&format!(
        "{removed} {deleted} files of the trash, of old plans and of killed processes, {deleted_mb:.1} MB"
    ));
    if restored > 0 {
        console.note(&format!("{restored} files were used meanwhile, and are back"));
    }
    if refused > 0 {
        console.note(&format!("{refused} old folders of other users stay: only they may delete them"));
    }
    console.note(&format!("kept {kept_records} records"));
    if swept.clock_difference >= TOLD_DIFFERENCE {
        let seconds = swept.clock_difference;
        let what =
            format!("the clocks of machines differ by {seconds} s; files stay two hours longer for that");
        console.report_to_people(&UserMessage::warning("clock-skew", what));
    }
    let mut record = json!(swept);
    record["dry_run"] = json!(dry_run);
    console.result(&record);
}
