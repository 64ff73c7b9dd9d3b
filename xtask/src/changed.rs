//! The tests that can tell whether what differs from `main` is sound.

use crate::command::{Outcome, program, root};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs;

/// Arguments of `cargo test` for each call, or `None` if nothing differs from `main`.
pub(crate) fn calls() -> Outcome<Option<Vec<Vec<String>>>> {
    let files = changed_files()?;
    if files.is_empty() {
        return Ok(None);
    }
    Ok(Some(calls_for(&files, &crates_needed()?)))
}

/// Paths of the files that differ from `main`, with those that git does not know yet.
fn changed_files() -> Outcome<Vec<String>> {
    let git = |args: &[&str]| -> Outcome<String> {
        let output = program(OsStr::new("git"), args).capture()?;
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let texts =
        [git(&["diff", "--name-only", "main"])?, git(&["ls-files", "--others", "--exclude-standard"])?];
    Ok(texts.iter().flat_map(|text| text.lines()).map(str::to_owned).collect())
}

/// The crates of the workspace that each crate of `crates/` names, for its tests too.
fn crates_needed() -> Outcome<BTreeMap<String, BTreeSet<String>>> {
    let folder = root().join("crates");
    let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut needed = BTreeMap::new();
    for entry in entries {
        let path = entry.map_err(|e| format!("{}: {e}", folder.display()))?.path();
        let manifest = path.join("Cargo.toml");
        let text = fs::read_to_string(&manifest).map_err(|e| format!("{}: {e}", manifest.display()))?;
        let names = text.lines().filter_map(|line| line.strip_prefix("gs2e-")?.split(['.', ' ']).next());
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        needed.insert(name, names.map(str::to_owned).collect());
    }
    Ok(needed)
}

/// The calls that the files ask for. Tests and pages ask for themselves, and tests of a crate for all of its
/// tests; a crate asks for the tests of what depends on it; any other file for everything.
fn calls_for(files: &[String], needed: &BTreeMap<String, BTreeSet<String>>) -> Vec<Vec<String>> {
    let mut crates: BTreeSet<&str> = BTreeSet::new();
    let mut features: BTreeSet<String> = BTreeSet::new();
    let mut tests: BTreeSet<&str> = BTreeSet::new();
    let mut program = false;
    for file in files {
        match file.split('/').collect::<Vec<_>>()[..] {
            ["crates", _, "results", ..] => features.extend(["docs::", "tidy::"].map(str::to_owned)),
            ["crates", name, "tests", ..] if needed.contains_key(name) => {
                tests.insert(name);
            }
            ["crates", name, ..] if needed.contains_key(name) => {
                crates.insert(name);
            }
            ["src", ..] => program = true,
            ["tests", "it", feature, ..] if !["main.rs", "support.rs", "support"].contains(&feature) => {
                features.insert(format!("{}::", feature.trim_end_matches(".rs")));
            }
            ["docs", ..] => features.extend(["docs::", "tidy::"].map(str::to_owned)),
            [page] if page.ends_with(".md") => features.extend(["docs::", "tidy::"].map(str::to_owned)),
            _ => return vec![vec!["--workspace".to_owned()]],
        }
    }
    program |= !crates.is_empty();
    while let Some((name, _)) = needed.iter().find(|(name, below)| {
        !crates.contains(name.as_str()) && below.iter().any(|b| crates.contains(b.as_str()))
    }) {
        crates.insert(name);
    }
    let mut calls = Vec::new();
    tests.extend(crates);
    if !tests.is_empty() {
        let packages = tests.iter().flat_map(|name| ["--package".to_owned(), format!("gs2e-{name}")]);
        calls.push(packages.chain(["--tests".to_owned()]).collect());
    }
    let whole = ["--package", "gs2e"].map(str::to_owned);
    if program {
        calls.push(whole.to_vec());
    } else if !features.is_empty() {
        let only = ["--test", "it", "--"].map(str::to_owned);
        calls.push(whole.into_iter().chain(only).chain(features).collect());
    }
    calls
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crate_asks_for_what_depends_on_it() {
        let needs = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<BTreeSet<_>>();
        let needed = BTreeMap::from([
            ("num".to_owned(), needs(&[])),
            ("sensor".to_owned(), needs(&["num"])),
            ("scene".to_owned(), needs(&[])),
        ]);
        let t = |files: &[&str], wanted: &[&str]| {
            let files: Vec<String> = files.iter().map(|file| (*file).to_owned()).collect();
            let calls: Vec<String> = calls_for(&files, &needed).iter().map(|call| call.join(" ")).collect();
            assert_eq!(calls, wanted, "{files:?}");
        };
        t(
            &["crates/num/src/seed.rs"],
            &["--package gs2e-num --package gs2e-sensor --tests", "--package gs2e"],
        );
        t(&["crates/scene/Cargo.toml"], &["--package gs2e-scene --tests", "--package gs2e"]);
        t(&["crates/scene/tests/scene_files.rs"], &["--package gs2e-scene --tests"]);
        t(&["crates/lab/results/tolerance.md"], &["--package gs2e --test it -- docs:: tidy::"]);
        t(&["src/cli.rs"], &["--package gs2e"]);
        t(&["tests/it/why.rs", "tests/it/docs/cli_page.rs"], &["--package gs2e --test it -- docs:: why::"]);
        t(&["README.md"], &["--package gs2e --test it -- docs:: tidy::"]);
        t(&["Cargo.lock", "src/cli.rs"], &["--workspace"]);
        t(&["tests/it/support.rs"], &["--workspace"]);
    }
}
