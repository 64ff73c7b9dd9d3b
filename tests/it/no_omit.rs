//! `--no-omit`: work that is otherwise left out is done, and neither an event nor a frame changes.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

use crate::support::given::{GIVEN, transforms};
use crate::support::workspace::{TINY, Workspace, tree};
use gs2e_release::ReleaseManifest;
use gs2e_release::left_out::OmissionRow;
use gs2e_scene::blobs::{ColourBlob, blob_crowd, blob_scene};
use gs2e_scene::{Gaussians, ply, sh};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;

/// A scene with all kinds of omitted work: Gaussians behind and outside the views, an opaque wall
/// of 250 layers, and harmonics of degree 2 that are zero.
fn wasteful() -> Gaussians {
    const DEGREE: u8 = 2;
    // The cameras are 4 units from the origin along z and look back at it.
    let before = |blob: &ColourBlob| ColourBlob {
        position: [blob.position[0], blob.position[1], 4.0 - blob.position[2]],
        ..*blob
    };
    let layer = |k: u8| ColourBlob {
        position: [0.0, 0.0, -3.0 - 0.005 * f32::from(k)],
        deviations: [40.0, 40.0, 0.01],
        opacity: 0.95,
        colour: [0.1 + 0.002 * f64::from(k), 0.5, 0.3],
        ..ColourBlob::default()
    };
    let blobs: Vec<ColourBlob> = blob_crowd(400, 6).iter().map(before).chain((0..250).map(layer)).collect();
    let mut scene = blob_scene(&blobs);
    let zeros = vec![[0.0; 3]; sh::function_count(DEGREE) - 1];
    scene.sh = scene.sh.iter().flat_map(|first| std::iter::once(*first).chain(zeros.clone())).collect();
    scene.sh_degree = DEGREE;
    scene
}

/// A recipe over that scene, with this interpolation between frames and this `render` line.
fn place(between: &str, render: &str) -> Workspace {
    let place = Workspace::new();
    let recipe = GIVEN.replace("between: linear", &format!("between: {between}"));
    // The cameras hardly move, so the sensor's thresholds are low.
    let recipe = recipe.replace("threshold: { on: 1.0, off: 1.0 }", "threshold: { on: 0.02, off: 0.02 }");
    place.write("recipe.yaml", recipe + render);
    let mut file = Vec::new();
    ply::write_ply(&wasteful(), &mut file).unwrap();
    place.write("scene.ply", file);
    place.write("transforms.json", transforms(1.0));
    place
}

/// The steps that a build made, as reported to programs.
fn build(place: &Workspace, options: &str) -> BTreeMap<String, Value> {
    let found = place.ok(&format!("build --json {options} recipe.yaml")).stdout;
    let steps = found.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    steps
        .filter(|step| step["state"] == "made")
        .map(|step| (step["step"].as_str().unwrap().trim_start_matches("given/").to_owned(), step))
        .collect()
}

/// The contents of a step's files, by role.
fn files(place: &Workspace, step: &Value) -> BTreeMap<String, Vec<u8>> {
    let text = |file: &Value, field: &str| file[field].as_str().unwrap().to_owned();
    let outputs = step["outputs"].as_array().unwrap();
    outputs
        .iter()
        .map(|file| (text(file, "role"), fs::read(place.path(&text(file, "path"))).unwrap()))
        .collect()
}

fn rows(step: &Value) -> Vec<OmissionRow> {
    serde_json::from_value(step["left_out"].clone()).unwrap()
}

fn whats(rows: &[OmissionRow]) -> Vec<&str> {
    rows.iter().filter(|row| row.proof == "identical bytes").map(|row| row.what.as_str()).collect()
}

const BY_RENDERER: [&str; 3] = [
    "Gaussians that no pose sees",
    "harmonics that are zero in the whole scene",
    "splat-tile pairs hidden behind opaque tiles",
];

/// Compares the counts of two builds.
fn check_counts(omitted: &Value, whole: &Value) {
    let count = |work: &Value, name: &str| work[name].as_u64().unwrap();
    for name in ["unseen", "zero_harmonics", "hidden"] {
        assert!(count(omitted, name) > 0, "{name}: {omitted}");
        assert_eq!(count(whole, name), 0, "{name}");
    }
    for name in ["gaussians", "tile_pairs", "blended", "stopped", "affine_doubtful", "affine_invalid"] {
        assert_eq!(omitted[name], whole[name], "{name}");
    }
    let not_drawn = |work: &Value| {
        ["unseen", "behind", "degenerate", "outside"].iter().map(|name| count(work, name)).sum::<u64>()
    };
    assert_eq!(not_drawn(omitted), not_drawn(whole));
}

/// Builds both ways in one store, and compares.
fn check(place: &Workspace) {
    let (omitted, whole) = (build(place, ""), build(place, "--no-omit"));
    assert_eq!(omitted.len(), 8, "all steps are made");
    assert_eq!(
        whole.keys().map(String::as_str).collect::<Vec<_>>(),
        ["base/checks", "base/events", "base/sharp"],
        "what does not render is not made again"
    );
    let [a, b] = [&omitted, &whole].map(|built| files(place, &built["base/events"]));
    assert_eq!(a["events.h5"], b["events.h5"]);
    assert_eq!(a["brightness.npy"], b["brightness.npy"]);
    let simulation = |files: &BTreeMap<String, Vec<u8>>| {
        serde_json::from_slice::<Value>(&files["simulation.json"]).unwrap()
    };
    let [mut a, mut b] = [simulation(&a), simulation(&b)];
    assert!(a["streams"][0]["account"]["events"].as_u64() > Some(100), "the scene is a test: {a}");
    check_counts(&a["work"].take(), &b["work"].take());
    assert_eq!(b.as_object_mut().unwrap().remove("omit"), Some("nothing".into()));
    assert_eq!(a, b);

    let [mut a, mut b] = [&omitted, &whole].map(|built| files(place, &built["base/sharp"]));
    let work = |files: &mut BTreeMap<String, Vec<u8>>| {
        serde_json::from_slice::<Value>(&files.remove("work.json").unwrap()).unwrap()
    };
    check_counts(&work(&mut a), &work(&mut b));
    assert!(a == b && a.len() == 12, "sharp frames");

    let [events, sharp] = ["base/events", "base/sharp"].map(|step| rows(&omitted[step]));
    assert_eq!(whats(&sharp), BY_RENDERER);
    assert_eq!(whats(&events), [&BY_RENDERER[..], &["colours that no sensor sees"]].concat());
    assert!(["base/events", "base/sharp"].iter().all(|step| whats(&rows(&whole[*step])).is_empty()));
    assert_eq!(build(place, "").len() + build(place, "--no-omit").len(), 0, "both are up to date");
}

#[test]
fn events_and_frames_are_the_same_bytes() {
    check(&place("linear", ""));
}

#[test]
fn rates_and_soft_layers_are_the_same_bytes_too() {
    check(&place("hermite", "render: { rules: soft, antialiased: true, background: [0.2, 0.1, 0.4] }\n"));
}

/// A release states the omissions in its manifest and in a section of its report; everything else
/// in it is the same.
#[test]
fn releases_differ_only_in_their_omissions() {
    let place = place("linear", "");
    let message = place.ok("release -v --to omitted recipe.yaml").stderr;
    assert!(
        message.contains("work skipped for given/base (output is byte-identical unless noted)\n"),
        "{message}"
    );
    place.ok("release --no-omit --to whole recipe.yaml");
    let [mut omitted, mut whole] = ["omitted", "whole"].map(|name| tree(&place.path(name)));
    let manifest = |files: &mut BTreeMap<String, Vec<u8>>| {
        files.remove("SHA256SUMS").unwrap();
        files.remove("B3SUMS").unwrap();
        let manifest: ReleaseManifest =
            serde_json::from_slice(&files.remove("manifest.json").unwrap()).unwrap();
        manifest.scenes.into_iter().next().unwrap()
    };
    let [a, b] = [manifest(&mut omitted), manifest(&mut whole)];
    for files in [&mut omitted, &mut whole] {
        let report = String::from_utf8(files.remove("report.html").unwrap()).unwrap();
        let (before, rest) = report.split_once("<section id=\"skipped\">").unwrap();
        let (_, after) = rest.split_once("</section>").unwrap();
        files.insert("report.html".into(), format!("{before}{after}").into_bytes());
    }
    assert!(omitted == whole && omitted.len() > 20);
    assert_eq!(whats(&b.omitted["base"]), [""; 0]);
    let rows = &a.omitted["base"];
    let work = a.left_out["base"];
    let events: Vec<&OmissionRow> = rows.iter().filter(|row| row.step == "events").collect();
    let counted = |what: &str| events.iter().find(|row| row.what == what).map(|row| (row.how_much, row.of));
    assert_eq!(counted(BY_RENDERER[0]), Some((work.unseen, Some(work.gaussians))));
    assert_eq!(counted(BY_RENDERER[2]), Some((work.hidden, Some(work.tile_pairs))));
    // All harmonics but the first of nine.
    let drawn = work.zero_harmonics / 8;
    assert_eq!(counted(BY_RENDERER[1]), Some((8 * drawn, Some(9 * drawn))));
    assert_eq!(counted("colours that no sensor sees"), Some((12, Some(12))));
}

/// The time saved is reported as an estimate if a path is long enough for an unnoticeable
/// measurement. It is written to no file.
#[test]
fn saved_time_is_reported_for_long_paths_and_written_to_no_file() {
    let place = Workspace::new();
    let long =
        TINY.replace("factor: 2", "factor: 250").replace("outputs: [events, sharp]", "outputs: [events]");
    place.write("long.yaml", long.replace("scene: tiny", "scene: long"));
    place.write("tiny.yaml", TINY);
    let ended = place.ok("build -v --json long.yaml tiny.yaml");
    let steps: Vec<Value> = ended.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let step = |name: &str| steps.iter().find(|step| step["step"] == name).unwrap();
    let saving = &step("long/base/events")["saving"];
    assert!(saving["seconds"].is_f64(), "{saving}");
    assert_eq!((&saving["sampled"], &saving["frames"]), (&json!(3), &json!(1500)));
    assert_eq!(step("tiny/base/events")["saving"], Value::Null);
    assert_eq!(step("tiny/base/checks").get("left_out"), None, "it renders nothing");
    let message = ended.stderr.matches("(an estimate from 3 of 1500 frames)").count();
    assert_eq!(message, 1, "{}", ended.stderr);
    let again = place.ok("build --recheck 100% long.yaml").stderr;
    assert!(again.contains("5 steps rerun, each with the recorded bytes"), "{again}");
}
