//! `gs2e audit`: reads every byte of a release tree, offline.

mod parts;
mod rebuild;

use super::verdicts::{report_count, report_findings};
use super::{CommonArgs, Console, ExitKind, UserMessage, VerbError, check};
use gs2e_audit::recheck::recheck_tree;
use gs2e_audit::{self as audit, AuditFault, AuditOptions};
use gs2e_check::Verdict;
use gs2e_export::{IncludedExporter, SilentProgress};
use gs2e_recipe::TakedownList;
use gs2e_release::signature::PublisherKey;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Arguments of `audit`.
#[derive(Debug, clap::Args)]
pub(super) struct AuditArgs {
    /// Folder of the release
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Takedown list; fail if a scene on it is present
    #[arg(long, value_name = "FILE")]
    takedown: Option<PathBuf>,
    /// Verify the signature with this public key of minisign: a file, or its second line
    #[arg(long, value_name = "KEY")]
    public_key: Option<String>,
    /// Also check the data as `gs2e check --tree` does, and rebuild every scene from the recipes
    #[arg(long)]
    full: bool,
    #[command(flatten)]
    parts: parts::PartArgs,
    #[command(flatten)]
    rebuild: rebuild::RebuildArgs,
}

impl AuditArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let dir = self.dir.display();
        if !self.dir.is_dir() {
            return Err(VerbError::usage("input-missing", format!("{dir} is not a folder")));
        }
        let takedown =
            self.takedown.as_ref().map(|file| TakedownList::read(std::slice::from_ref(file))).transpose()?;
        let key = self.public_key.as_deref().map(PublisherKey::read).transpose();
        let key = key.map_err(|e| VerbError::usage("public-key", e.to_string()))?;
        if self.parts.write(&self.dir, console)? {
            return Ok(ExitKind::Done);
        }
        let exporter = IncludedExporter { progress: &SilentProgress };
        let options = AuditOptions { takedown: takedown.as_ref(), exporter: Some(&exporter), composed: None };
        let audited = audit::audit_with(&self.dir, options, self.parts.read()?)
            .map_err(|e| self.parts.refused(&self.dir, &e))?;
        let mut report = audited
            .map_err(|e| VerbError::failed("input-unreadable", format!("{dir} cannot be audited: {e}")))?;
        if let Some(key) = &key {
            report.verify(&self.dir, key);
        }
        // Damaged files are reported by the audit; their data say nothing.
        let faulty = if self.full && report.faults.is_empty() {
            let findings = recheck_tree(&self.dir, &[]).map_err(|error| check::of_tree(&error))?.joined;
            report_findings(&findings, console);
            report_count(&findings, [0; 2], console);
            findings.iter().filter(|finding| finding.verdict == Verdict::Fail).count()
        } else {
            0
        };
        if let Some(rebuilt) = self.rebuild.run(&self.dir, self.full, common, console)? {
            console.note(&format!("rebuilt: {}", rebuilt.scenes.join(", ")));
            report.faults.extend(rebuilt.faults);
            report.rebuilt_scenes = rebuilt.scenes.len();
        }
        for fault in &report.faults {
            console.result(&to_json(fault));
            console.report_to_people(&fault_message(fault));
        }
        let (files, mb) = (report.files, report.bytes as f64 * 1e-6);
        let count = report.faults.len();
        let faults = if count == 1 { "fault" } else { "faults" };
        console.note(&format!("{count} {faults} in {files} files, {mb:.1} MB"));
        let (proved, unproved) = (report.proved(), report.unproved());
        // After faults, the long list would hide them.
        if count == 0 || common.verbose {
            console.note(&format!("this audit covers: {}", report.covers.join("; ")));
            proved.iter().chain(&unproved).for_each(|sentence| console.note(sentence));
        }
        console.result(&json!({
            "faults": count, "files": files, "bytes": report.bytes, "covers": report.covers,
            "proved": proved, "unproved": unproved, "written_by": report.written_by,
            "signed_by": report.signed_by, "verified": report.verified,
        }));
        Ok(if count + faulty == 0 { ExitKind::Done } else { ExitKind::Fault })
    }
}

fn fault_message(fault: &AuditFault) -> UserMessage {
    let place = fault.file.as_ref().or(fault.scene.as_ref()).map_or("the release", String::as_str);
    UserMessage::error(fault.code.name(), format!("{place}: {}", fault.message)).help(fault.help())
}

/// The fields of every message, and the file and scene of the fault.
fn to_json(fault: &AuditFault) -> Value {
    let mut value = fault_message(fault).to_json();
    let own = [("path", &fault.file), ("file", &fault.file), ("scene", &fault.scene)];
    own.into_iter().for_each(|(name, text)| value[name] = json!(text));
    value["message"] = json!(fault.message);
    value
}
