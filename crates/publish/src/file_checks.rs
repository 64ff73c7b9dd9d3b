//! The passes of `gs2e check --tree` over the files of a scene before they are written.
//!
//! Their verdicts are stored under the digests of the files, so a release that repeats a scene does not
//! judge it again.

use super::made_once::{FileInputs, digest_of_files};
use super::{ReleaseError, failed};
use gs2e_audit::recheck::{FileVerdicts, RecheckError, judge_unwritten};
use gs2e_build::artifact::write_json;
use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_release::TOOL;
use gs2e_release::composed::ReleaseTree;
use gs2e_store::description::describe_value;
use gs2e_store::{Key, Store};
use std::sync::atomic::{AtomicBool, Ordering};

/// Name of the stage in the records.
const STAGE: &str = "file-checks";
/// Raised when a pass over the files of a release changes its verdicts.
const REVISION: u32 = 5;
/// Name of the output.
const VERDICTS: &str = "verdicts.json";

/// Judges the files of a scene, or takes the stored verdicts on the same files.
pub(super) fn judge_files(
    id: &str,
    files: &ReleaseTree,
    store: &Store,
    cancel: &AtomicBool,
) -> Result<(Key, FileVerdicts), ReleaseError> {
    let made_of = FileInputs {
        stage: STAGE,
        revision: REVISION,
        parameters: describe_value(&TOOL),
        files: digest_of_files(files),
    };
    let (key, outputs) = made_of.outputs(store, |folder| {
        let verdicts = judge_unwritten(files, id, cancel).map_err(|e| stopped(e, cancel))?;
        let path = folder.join(VERDICTS);
        write_json(&path, &verdicts).map_err(failed(&path))
    })?;
    let path = outputs.first().map(|output| store.path_of(&output.digest)).unwrap_or_default();
    let bytes = files::read_with(&path, LinkRule::Refuse, files::MAX_DOCUMENT).map_err(failed(&path))?;
    let verdicts = serde_json::from_slice(&bytes).map_err(std::io::Error::from).map_err(failed(&path))?;
    Ok((key, verdicts))
}

fn stopped(error: RecheckError, cancel: &AtomicBool) -> ReleaseError {
    // A pass that is stopped returns some error of its reader, so only the flag tells the reason.
    if cancel.load(Ordering::Relaxed) { ReleaseError::Interrupted } else { ReleaseError::Recheck(error) }
}
