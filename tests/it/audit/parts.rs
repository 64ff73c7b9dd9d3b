//! An audit in parts: its files, and one verdict.

use super::{BASE, parts_of};
use crate::release::small::{copy, gs2e, said};
use gs2e_audit::{AuditOptions, AuditPart, PartsError, audit_release, audit_with};
use std::fs;

#[test]
fn a_verdict_needs_all_parts_of_one_release() {
    let folder = copy();
    let dir = folder.path();
    let parts = parts_of(dir, 3);
    let (files, bytes) = parts.iter().map(AuditPart::size).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    let whole = audit_release(dir).unwrap();
    assert_eq!((files, bytes), (whole.files, whole.bytes));
    let refused = |parts: Vec<AuditPart>| audit_with(dir, AuditOptions::default(), Some(parts)).unwrap_err();
    assert_eq!(refused(Vec::new()), PartsError::Empty);
    assert_eq!(refused(vec![parts[0].clone(), parts[2].clone()]), PartsError::Missing { number: 2, of: 3 });
    let because = |because, number| PartsError::Unlike { number, because };
    assert_eq!(refused(vec![parts[0].clone(), parts[0].clone()]), because("there twice", 1));
    let others = [parts[0].clone(), parts_of(dir, 2).remove(1)].to_vec();
    assert_eq!(refused(others), because("of another number of parts than the others", 2));
    // A file that comes later is read for the verdict.
    fs::write(dir.join("small/more.txt"), "").unwrap();
    let faults = audit_with(dir, AuditOptions::default(), Some(parts.clone())).unwrap().unwrap().faults;
    assert_eq!(faults[0].code.name(), "unlisted", "{faults:?}");
    fs::write(dir.join("SHA256SUMS"), "").unwrap();
    assert_eq!(refused(parts), because("of another release, or of an earlier state of this one", 1));
}

#[test]
fn parts_are_files_and_the_verdict_has_the_exit_code() {
    let folder = copy();
    let dir = folder.path().to_str().unwrap();
    let parts = tempfile::tempdir().unwrap();
    let to = parts.path().to_str().unwrap();
    let run = |options: &[&str], code: i32| {
        let ended = gs2e(parts.path(), &[&["audit", dir, "--parts", to], options].concat());
        assert_eq!(ended.status.code(), Some(code), "{options:?}: {}", said(&ended));
        said(&ended)
    };
    assert!(run(&[], 2).contains("there is no part of an audit"));
    run(&["--shard", "1/2"], 0);
    let missing = run(&[], 2);
    assert!(
        missing.contains("part 2 of 2 is missing") && missing.contains("--shard 2/2 --parts"),
        "{missing}"
    );
    run(&["--shard", "2/2"], 0);
    assert!(run(&[], 0).contains("0 faults in "));
    // A part says what was true when it was written.
    fs::write(folder.path().join(BASE).join("speed.json"), "{}").unwrap();
    run(&["--shard", "1/2"], 0);
    run(&["--shard", "2/2"], 0);
    assert!(run(&[], 3).contains("speed.json: its SHA-256 is "));
}

#[test]
fn any_number_of_parts_is_counted_without_a_list() {
    let folder = copy();
    let parts = vec![AuditPart::audit(folder.path(), 1, u32::MAX).unwrap()];
    let missing = PartsError::Missing { number: 2, of: u32::MAX };
    assert_eq!(audit_with(folder.path(), AuditOptions::default(), Some(parts)).unwrap_err(), missing);
}
