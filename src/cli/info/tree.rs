//! Properties of the folders that this program writes: releases and stores.

use super::PathFacts;
use crate::cli::VerbError;
use gs2e_num::units::format_amount;
use gs2e_release::summary::ReleaseSummary;
use gs2e_store::gc::GcSweep;
use gs2e_store::{FORMAT, Store, StoreAccess};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::Path;

pub(super) fn release_facts(place: &Path) -> Result<PathFacts, VerbError> {
    let failed = |e| VerbError::failed("input-unreadable", format!("failed to read the release: {e}"));
    let found = ReleaseSummary::read(place).map_err(failed)?;
    let sums = if found.checksums { "SHA256SUMS" } else { "none: SHA256SUMS is missing" };
    let rows = vec![
        ("name", format!("{} {}", found.name, found.version)),
        ("written by", found.tool.clone()),
        ("licence", found.licence.clone()),
        ("scenes", found.scenes.to_string()),
        ("trajectories", found.trajectories.to_string()),
        ("events", found.events.to_string()),
        ("size", format!("{} in {} files", format_amount(found.bytes, "B"), found.files)),
        ("checksums", sums.to_owned()),
    ];
    Ok(PathFacts { kind: "release", title: "a release", rows, recipe: Vec::new(), value: json!(found) })
}

pub(super) fn store_facts(place: &Path) -> Result<PathFacts, VerbError> {
    let store = Store::open(place, StoreAccess::Read, &mut |_| {})?;
    // A collection that keeps nothing, and is not carried out, counts everything.
    let all = store.sweep(&BTreeSet::new(), GcSweep { until_ns: i64::MAX, dry_run: true })?;
    let releases = store.roots()?.len();
    let rows = vec![
        ("format", FORMAT.to_string()),
        ("records", format!("{}, one per step and version of its inputs", all.records)),
        ("files", all.blobs.to_string()),
        ("size", format_amount(all.bytes, "B")),
        ("releases", releases.to_string()),
    ];
    let value = json!({
        "format": FORMAT, "records": all.records, "files": all.blobs, "bytes": all.bytes, "releases": releases,
    });
    Ok(PathFacts { kind: "store", title: "a store", rows, recipe: Vec::new(), value })
}
