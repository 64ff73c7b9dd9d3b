//! Steps that one pass of the renderer serves together: their products are those of single steps.

use crate::support::steps::{keys, products, recipe, steps};
use crate::support::workspace::Workspace;
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// Blurred frames whose pictures lie between the poses too: the image moves by some pixels per pose.
const DENSE: &str = "{ \"frames\": 3, \"subframes\": \"auto\" }";

/// A recipe with these outputs and other settings.
fn with(outputs: &[&str], settings: &[(&str, Value)]) -> Value {
    let mut value = recipe("tiny");
    value["outputs"] = json!(outputs);
    for (name, setting) in settings {
        value[*name] = setting.clone();
    }
    value
}

/// The names of the steps of a build that were made together with others, as their records say.
fn together(place: &Workspace) -> BTreeSet<String> {
    let shared = |(name, key): (String, String)| {
        // A step that failed has no record.
        let record = std::fs::read(place.path(&format!(".gs2e/ac/{}/{key}.json", &key[..2]))).ok()?;
        let record: Value = serde_json::from_slice(&record).unwrap();
        let provenance = &record["provenance"];
        let alone = provenance.get("alone_seconds")?.as_f64().unwrap();
        // Alone, a step has no less work than its share.
        assert!(alone >= provenance["seconds"].as_f64().unwrap() - 1e-9, "{name}: {provenance}");
        Some(name.trim_start_matches("tiny/base/").to_owned())
    };
    keys(place, "tiny.yaml").into_iter().filter_map(shared).collect()
}

/// Builds a recipe, and then every step again by itself, which compares the bytes.
fn check(value: &Value, options: &str, wanted: &[&str]) {
    let place = Workspace::new();
    place.write("tiny.yaml", value.to_string());
    place.ok(&format!("build -q {options} tiny.yaml"));
    let again = place.ok(&format!("build --json --recheck 1 {options} tiny.yaml")).stdout;
    let made = again.lines().filter(|line| line.contains("\"state\":\"made\"")).count();
    if options.is_empty() {
        assert_eq!(
            together(&place),
            wanted.iter().map(|name| (*name).to_owned()).collect::<BTreeSet<String>>(),
            "{value}"
        );
        assert_eq!(made, steps(&place, "tiny.yaml").len(), "each step is compared");
    }
    assert!(made > wanted.len(), "{again}");
}

#[test]
fn every_set_of_outputs_has_the_bytes_of_single_steps() {
    let all = ["events", "sharp", "blur", "depth", "flow"];
    for set in 0..1_u32 << all.len() {
        let outputs: Vec<&str> = (0..5).filter(|k| set >> k & 1 == 1).map(|k| all[k]).collect();
        if outputs.len() < 2 {
            continue;
        }
        let blur = if set % 2 == 0 { json!({ "frames": 3 }) } else { serde_json::from_str(DENSE).unwrap() };
        check(&with(&outputs, &[("blur", blur)]), "", &outputs);
    }
}

#[test]
fn spacings_sensors_and_rules_do_not_matter() {
    let all = ["events", "sharp", "blur", "depth", "flow"];
    let blur = |subframes| ("blur", json!({ "frames": 3, "subframes": subframes }));
    let spaced = [
        ("sharp", json!({ "every": 3 })),
        ("depth", json!({ "every": 4 })),
        ("flow", json!({ "every": 5 })),
        blur("auto"),
    ];
    check(&with(&all, &spaced), "", &all);
    // Rates, soft layers, a background, and the flow of a moving camera.
    let soft = json!({ "rules": "soft", "antialiased": true, "background": [0.2, 0.1, 0.4] });
    let hermite = ("sampling", json!({ "rate": 2400, "between": "hermite" }));
    check(&with(&all, &[("render", soft), hermite, blur("literal")]), "", &all);
    // Two sensors, one of them behind colours.
    let mut two = with(&all, &[blur("auto")]);
    let sensors = json!({
        "plain": { "voltmeter": { "preset": "dvs346" } },
        "red": { "voltmeter": { "preset": "dvs346", "front_end": { "luminance": { "weights": [1, 0, 0] } } } },
    });
    two.as_object_mut().unwrap().remove("sensor");
    two["sensors"] = sensors;
    check(&two, "", &all);
    check(&with(&all, &[blur("auto")]), "--no-omit", &all);
}

/// The image moves by pixels between two poses, so that blurred frames are dense.
#[test]
fn dense_exposures_share_their_poses() {
    let mut value =
        with(&["events", "sharp", "blur", "flow"], &[("blur", serde_json::from_str(DENSE).unwrap())]);
    value["source"]["procedural"]["arc"] = json!(80);
    check(&value, "", &["blur", "events", "flow", "sharp"]);
    let place = Workspace::new();
    place.write("tiny.yaml", value.to_string());
    place.ok("build -q tiny.yaml");
    let path = &steps(&place, "tiny.yaml")["tiny/base/blur"].outputs["exposures.json"];
    let exposures: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    assert!(exposures[0]["subframes"].as_u64() > Some(1), "{exposures}");
}

/// With a tolerance, the frames of the events are not at the poses.
#[test]
fn events_with_a_tolerance_are_made_alone() {
    let mut value = with(&["events", "sharp", "depth"], &[]);
    value["sampling"] = json!({ "tolerance": 0.2 });
    check(&value, "", &["depth", "sharp"]);
}

#[test]
fn a_step_that_is_stale_alone_is_made_alone() {
    let place = Workspace::new();
    let mut value = with(&["sharp"], &[]);
    place.write("tiny.yaml", value.to_string());
    place.ok("build -q tiny.yaml");
    // The others join one another, and the step that is up to date is not made again.
    value["outputs"] = json!(["events", "sharp", "depth"]);
    place.write("tiny.yaml", value.to_string());
    let made: BTreeSet<String> = place.build("tiny.yaml").into_iter().collect();
    let wanted = ["tiny/base/checks", "tiny/base/depth", "tiny/base/events"];
    assert!(wanted.iter().all(|step| made.contains(*step)) && !made.contains("tiny/base/sharp"), "{made:?}");
    assert_eq!(together(&place), BTreeSet::from(["depth", "events"].map(str::to_owned)));
    // One stale step has a pass of its own.
    value["depth"] = json!({ "every": 2 });
    place.write("tiny.yaml", value.to_string());
    assert_eq!(place.build("tiny.yaml"), ["tiny/base/depth"]);
    assert_eq!(together(&place), BTreeSet::from(["events".to_owned()]));
}

#[test]
fn a_step_that_fails_leaves_the_others() {
    let place = Workspace::new();
    let value = with(&["events", "sharp", "blur"], &[("blur", json!({ "frames": 99 }))]);
    place.write("tiny.yaml", value.to_string());
    let ended = place.gs2e("build --keep-going tiny.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("an exposure of 99 frames needs 101"), "{}", ended.stderr);
    let plan = place.plan("tiny.yaml");
    let kept = |step: &str| plan.iter().any(|(name, action)| name == step && action == "keep");
    assert!(kept("tiny/base/events") && kept("tiny/base/sharp"), "{plan:?}");
    assert!(!kept("tiny/base/blur"), "{plan:?}");
    assert_eq!(together(&place), BTreeSet::from(["events", "sharp"].map(str::to_owned)));
}

/// Returns true if a depth image lies in a folder of this one, while others change it.
fn has_picture(folder: &std::path::Path) -> bool {
    let files = walkdir::WalkDir::new(folder).into_iter().flatten();
    files.into_iter().any(|file| file.path().extension().is_some_and(|extension| extension == "npy"))
}

#[test]
fn a_pass_that_is_interrupted_records_nothing_of_its_steps() {
    let outputs = ["events", "sharp", "depth"];
    for signal in [rustix::process::Signal::INT, rustix::process::Signal::KILL] {
        let place = Workspace::new();
        let mut value = with(&outputs, &[]);
        value["trajectories"][0]["refine"]["factor"] = json!(20);
        value["camera"] = json!({ "width": 96, "height": 64 });
        place.write("tiny.yaml", value.to_string());
        let mut child = place.spawn("build -q tiny.yaml");
        while !has_picture(&place.path(".gs2e/gs2e-tmp")) {
            assert!(child.try_wait().unwrap().is_none(), "it ended before its pass");
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        let pid = rustix::process::Pid::from_raw(child.id().try_into().unwrap()).unwrap();
        rustix::process::kill_process(pid, signal).unwrap();
        child.wait().unwrap();
        let stale = place.stale("tiny.yaml");
        for output in outputs {
            assert!(stale.contains(&format!("tiny/base/{output}")), "{output} is not recorded: {stale:?}");
        }
        place.ok("build -q tiny.yaml");
        let clean = Workspace::new();
        clean.write("tiny.yaml", value.to_string());
        clean.ok("build -q tiny.yaml");
        assert_eq!(products(&place, "tiny.yaml"), products(&clean, "tiny.yaml"));
    }
}
