//! `gs2e audit`: reads every byte of a release tree, offline.

use super::console::Console;
use super::problem::{Exit, Problem};
use crate::release::audit;
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `audit`.
#[derive(Debug, clap::Args)]
pub(super) struct Audit {
    /// Folder of the release
    #[arg(value_name = "DIR")]
    dir: PathBuf,
}

impl Audit {
    pub(super) fn run(self, console: &Console) -> Result<Exit, Problem> {
        let dir = self.dir.display();
        if !self.dir.is_dir() {
            return Err(Problem::usage("input-missing", format!("{dir} is no folder")));
        }
        let report = audit::audit(&self.dir)
            .map_err(|e| Problem::failed("input-unreadable", format!("{dir} cannot be read: {e}")))?;
        for fault in &report.faults {
            if console.json {
                console.result(&serde_json::to_value(fault).expect("a fault is plain data"));
            } else {
                console.print(&fault.to_string());
            }
        }
        let (files, mb) = (report.files, report.bytes as f64 * 1e-6);
        let count = report.faults.len();
        console.say(&format!("{count} faults in {files} files, {mb:.1} MB"));
        console.say(&format!("this audit covers: {}", report.covers.join("; ")));
        if console.json {
            console.result(
                &json!({ "faults": count, "files": files, "bytes": report.bytes, "covers": report.covers }),
            );
        }
        Ok(if count == 0 { Exit::Done } else { Exit::Fault })
    }
}
