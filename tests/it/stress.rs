//! `gs2e stress`: every row is within its limit. `crates/lab/tests/stress/naive.rs` shows that naive
//! implementations exceed it.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]
#![expect(clippy::print_stdout, reason = "the table")]

use crate::support::workspace::{RunOutcome, Workspace};
use crate::support::{gpu, shared};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// The rows of a run, printed as a table.
fn rows(ended: &RunOutcome) -> Vec<Value> {
    let rows: Vec<Value> =
        ended.stdout.lines().map(|line| serde_json::from_str(line).expect("a record a line")).collect();
    for row in &rows {
        let word = |name: &str| row[name].as_str().unwrap_or_default().to_owned();
        let figure = |name: &str| row[name].as_f64().map_or_else(String::new, |v| format!("{v:.1e}"));
        println!(
            "{:8} {:42} {:8} of {:8} {:10} {:.2} s {}",
            word("verdict"),
            word("id"),
            figure("error"),
            figure("limit"),
            word("unit"),
            row["seconds"].as_f64().unwrap_or(0.0),
            word("at")
        );
    }
    rows
}

fn run(args: &str) -> RunOutcome {
    let place = Workspace::new();
    let output = place.command_with_gpu(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    RunOutcome {
        code: output.status.code().unwrap(),
        stdout: text(output.stdout),
        stderr: text(output.stderr),
    }
}

/// Runs an area in a process of its own, so that the tests of several areas run in parallel.
fn all_within(area: &str, at_least: usize) {
    let ended = run(&format!("stress --json --area {area}"));
    let rows = rows(&ended);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(rows.len() >= at_least && rows.iter().all(|row| row["area"] == area && row["verdict"] == "pass"));
    assert!(rows.iter().all(|row| row["points"].as_u64() > Some(0) && row["seconds"].as_f64() >= Some(0.0)));
    let ids: BTreeSet<&str> = rows.iter().filter_map(|row| row["id"].as_str()).collect();
    assert_eq!(ids.len(), rows.len(), "each row has a name of its own");
}

#[test]
fn the_sensor_is_within_its_limits() {
    all_within("sensor", 20);
}

#[test]
fn trajectories_are_within_their_limits() {
    all_within("trajectory", 9);
}

#[test]
fn the_clock_is_within_its_limits() {
    all_within("clock", 8);
}

/// On the CPU, on the reference with the limits of 64 bits, and on a GPU, which may be in software;
/// with a captured scene if there is one.
#[test]
fn the_renderers_are_within_their_limits() {
    let own = shared::path("data/scenes/playbot_lod3.ply").map(std::fs::canonicalize);
    let own =
        own.and_then(Result::ok).map_or_else(String::new, |path| format!(" --scene {}", path.display()));
    let ended = run(&format!("stress --json --area splat{own}"));
    let rows = rows(&ended);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let mut verdicts: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for row in &rows {
        verdicts
            .entry(row["backend"].as_str().unwrap())
            .or_default()
            .insert(row["verdict"].as_str().unwrap());
    }
    let by_gpu = if gpu::device().is_some() { "pass" } else { "not-run" };
    let wanted = [("cpu", "pass"), ("reference", "pass"), ("gpu", by_gpu)];
    assert_eq!(verdicts, wanted.map(|(backend, verdict)| (backend, [verdict].into())).into());
    // The limits of 64 bits do not apply to 32 bits.
    let limit =
        |id: &str| rows.iter().find(|row| row["id"] == id).and_then(|row| row["limit"].as_f64()).unwrap();
    for case in ["needles-from-afar", "needles-undilated", "luminance-path"] {
        assert!(limit(&format!("splat/{case}@reference")) < 1e-12, "{case}");
        assert!(limit(&format!("splat/{case}@cpu")) > 1e-7, "{case}");
    }
    assert_eq!(rows.iter().any(|row| row["case"] == "own-picture"), !own.is_empty());
}

#[test]
fn a_missing_gpu_is_reported_and_has_no_results() {
    let place = Workspace::new();
    let found = place.ok("stress counted splat/near-plane splat/ties@gpu");
    let lines: Vec<&str> = found.stdout.lines().collect();
    assert_eq!(lines.len(), 7, "{}", found.stdout);
    let begins = |word: &str| lines.iter().filter(|line| line.starts_with(word)).count();
    assert_eq!((begins("ok"), begins("not run  splat/")), (4, 3), "{}", found.stdout);
    assert!(found.stderr.contains("4 ok, 0 miss their limit, 3 not run"), "{}", found.stderr);
    let found = place.gs2e("stress --backend gpu near-plane");
    assert_eq!((found.code, found.stdout.as_str()), (2, ""), "{}", found.stderr);
}

#[test]
fn selected_cases_run_and_unknown_ones_are_refused() {
    let place = Workspace::new();
    let message = place.ok("stress --area sensor --area clock polarity absolute-stamps --markdown t.md");
    assert_eq!(message.stdout.lines().count(), 2, "{}", message.stdout);
    let page = std::fs::read_to_string(place.path("t.md")).unwrap();
    assert!(
        page.contains("\n## sensor\n")
            && page.contains("\n| absolute-stamps |")
            && !page.contains("## splat")
    );
    let message = place.ok("stress --backend reference near-plane --quiet");
    assert_eq!((message.stdout.as_str(), message.stderr.as_str()), ("", ""));
    for (args, wanted) in [
        ("stress --area colour", "sensor, trajectory, splat, clock"),
        ("stress polarities", "no case has the name `polarities`"),
        ("stress near-plane --scene nowhere.ply", "nowhere.ply does not exist"),
        ("stress polarity --markdown nowhere/t.md", "a folder that does not exist"),
    ] {
        let message = place.gs2e(args);
        assert_eq!(message.code, 2, "{args}: {}", message.stderr);
        assert!(message.stderr.contains(wanted), "{args}: {}", message.stderr);
    }
}
