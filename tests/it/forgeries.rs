//! Forged releases, each with all digests rewritten: forgeries that the audit finds, forgeries that
//! only a rebuilt scene shows, and forgeries that cannot be found.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod data;
mod exported;
mod held_out;
mod products;
mod rich;
mod rows;

use crate::release::forger::{read, reseal, reseal_sums};
use crate::release::small::{copy, release};
use crate::release::unfindable::{DATA, VALUES, is_data, is_unfindable};
use gs2e_audit::{AuditFault, audit_release, rebuilt};
use std::collections::BTreeMap;
use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// The means by which a forgery is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum FindingMeans {
    /// The audit, with a fault of this code.
    Audit(&'static str),
    /// A comparison with the scene made again from its recipe; the tree alone does not show it.
    Rebuild,
    /// It cannot be found, for this reason.
    Never(&'static str),
}

/// A forged change of a release.
struct Forgery {
    name: &'static str,
    forge: Box<dyn Fn(&Path) + Send + Sync>,
    /// True if the manifest is rewritten too; false if only the sums are.
    whole: bool,
    found: FindingMeans,
}

/// The faults of an audit, and the differences from a release that was made from the recipes.
fn judge(forgery: &Forgery) -> (Vec<AuditFault>, Vec<AuditFault>) {
    let folder = copy();
    (forgery.forge)(folder.path());
    if forgery.found == FindingMeans::Rebuild {
        assert_eq!(unlisted(folder.path()), [""; 0], "{}: docs/publish.md does not list it", forgery.name);
    }
    if forgery.whole {
        reseal(folder.path());
    } else {
        reseal_sums(folder.path());
    }
    let audited = audit_release(folder.path()).unwrap().faults;
    let mut compared = Vec::new();
    if audited.is_empty() {
        compared = rebuilt::compare_scenes(folder.path(), release(), "small/one").unwrap();
        compared.extend(rebuilt::compare_tops(folder.path(), release()).unwrap());
    }
    (audited, compared)
}

/// Files that differ from the release in more than the values that the audit cannot know. The
/// loader of another version is not compared.
fn unlisted(folder: &Path) -> Vec<String> {
    let (old, new) = (read(release()), read(folder));
    let other_version = old["manifest.json"] != new["manifest.json"] && new["gs2e.py"] != old["gs2e.py"];
    let is_known = |path: &str, bytes: &[u8]| {
        let before = &old[path];
        before == bytes
            || is_data(path)
            || is_unfindable(path, before, bytes)
            || path == "gs2e.py" && other_version
    };
    new.into_iter().filter(|(path, bytes)| !is_known(path, bytes)).map(|(path, _)| path).collect()
}

/// Describes how a forgery is misjudged; `None` if it is judged right.
fn misjudged(forgery: &Forgery) -> Option<String> {
    // A forgery that cannot be made is reported, and the others are still judged.
    let judged = catch_unwind(AssertUnwindSafe(|| judge(forgery)));
    let Ok((audited, compared)) = judged else { return Some(format!("{}: a panic", forgery.name)) };
    let held = match forgery.found {
        FindingMeans::Audit(code) => audited.iter().any(|fault| fault.code.name() == code),
        FindingMeans::Rebuild => audited.is_empty() && !compared.is_empty(),
        FindingMeans::Never(_) => audited.is_empty() && compared.is_empty(),
    };
    (!held).then(|| {
        let seen =
            |faults: &[AuditFault]| faults.iter().take(4).map(|f| format!("\n    {f}")).collect::<String>();
        format!(
            "{}: wanted {:?}\n  audit:{}\n  rebuild:{}",
            forgery.name,
            forgery.found,
            seen(&audited),
            seen(&compared)
        )
    })
}

#[test]
fn every_forgery_is_found_as_the_table_states() {
    let rows = rows::all();
    assert!(rows.len() >= 82, "{}", rows.len());
    let part = rows.len().div_ceil(4);
    let missed: Vec<String> = std::thread::scope(|scope| {
        let hands: Vec<_> = rows
            .chunks(part)
            .map(|rows| scope.spawn(|| rows.iter().filter_map(misjudged).collect::<Vec<_>>()))
            .collect();
        hands.into_iter().flat_map(|hand| hand.join().unwrap()).collect()
    });
    assert!(missed.is_empty(), "{} of {} forgeries:\n{}", missed.len(), rows.len(), missed.join("\n"));
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for row in &rows {
        let by = match row.found {
            FindingMeans::Audit(_) => "by the audit",
            FindingMeans::Rebuild => "by --rebuild alone",
            FindingMeans::Never(_) => "by nothing",
        };
        *counts.entry(by).or_default() += 1;
    }
    let _ = writeln!(std::io::stderr(), "{} forgeries, found {counts:?}", rows.len());
}

#[test]
fn the_page_lists_the_values_that_an_audit_cannot_know() {
    let page = include_str!("../../docs/publish.md");
    let values = VALUES.iter().flat_map(|(_, pointers)| *pointers).map(|pointer| {
        pointer.rsplit_once("*/").map_or_else(|| pointer.trim_start_matches('/'), |(_, below)| below)
    });
    // Values of a part that is listed as a whole are listed by their last name.
    let named = |value: &str| {
        let last = value.rsplit('/').next().unwrap_or(value);
        page.contains(&format!("`{value}`")) || page.contains(&format!("`{last}`"))
    };
    let missing: Vec<&str> = values.chain(DATA).filter(|value| !named(value)).collect();
    assert_eq!(missing, [""; 0]);
}

#[test]
fn a_release_of_another_version_is_judged_by_common_rules() {
    let folder = copy();
    rows::of_version(folder.path(), "0.0.9");
    reseal(folder.path());
    let report = audit_release(folder.path()).unwrap();
    assert_eq!((report.faults.as_slice(), report.written_by.as_deref()), (&[][..], Some("gs2e 0.0.9")));
    assert!(report.proved().concat().contains("written by gs2e 0.0.9"), "{:?}", report.proved());
    std::fs::write(folder.path().join("setup.py"), "").unwrap();
    reseal(folder.path());
    let codes: Vec<&str> =
        audit_release(folder.path()).unwrap().faults.iter().map(|f| f.code.name()).collect();
    assert_eq!(codes, ["stray"]);
}
