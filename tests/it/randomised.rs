//! Sensors with numbers that are drawn for each trajectory.

use crate::support::workspace::{Workspace, same_tree, tiny_with};
use gs2e_recipe::{Recipe, read_all};
use serde_json::json;
use std::collections::BTreeMap;
use std::fs;

fn load(yaml: &str) -> Result<Recipe, String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recipe.yaml");
    fs::write(&file, yaml).unwrap();
    let mut read = read_all(std::slice::from_ref(&file)).map_err(|faults| faults.to_string())?;
    Ok(read.remove(0))
}

/// A recipe with these trajectories and sensors.
fn recipe(trajectories: &[&str], sensors: &str) -> Result<Recipe, String> {
    let named: Vec<String> =
        trajectories.iter().map(|name| format!("{{ name: {name}, refine: {{}} }}")).collect();
    load(&format!(
        "version: 1\nscene: test\nsource: {{ procedural: {{}} }}\ntrajectories: [{}]\n{sensors}\n",
        named.join(", ")
    ))
}

/// The drawn numbers of a trajectory, by sensor and path.
fn drawn(recipe: &Recipe, trajectory: &str) -> BTreeMap<String, f64> {
    let asked = recipe.trajectories.iter().find(|asked| asked.name == trajectory).unwrap();
    let all = &asked.drawn.as_ref().unwrap().numbers;
    let of = |(sensor, numbers): (&String, &BTreeMap<String, f64>)| {
        let sensor = sensor.clone();
        numbers.iter().map(|(path, x)| (format!("{sensor}:{path}"), *x)).collect::<Vec<_>>()
    };
    all.iter().flat_map(of).collect()
}

const RANGES: &str = "sensors:
  noisy:
    v2e:
      preset: noisy
      threshold: { on: { normal: [0.2, 0.03], within: [0.1, 0.3] } }
      shot: { uniform: [1, 10] }
  clean: { twin_of: noisy }
";

#[test]
fn another_trajectory_sensor_or_number_moves_no_draw() {
    let one = recipe(&["a"], RANGES).unwrap();
    let base = drawn(&one, "a");
    assert_eq!(base.len(), 2);
    let more = RANGES.replace("shot:", "cutoff: { log_uniform: [20, 200] }\n      shot:")
        + "  other: { esim: { threshold: { on: { uniform: [0.1, 0.4] } } } }\n";
    let many = recipe(&["z", "a", "b"], &more).unwrap();
    let again = drawn(&many, "a");
    assert_eq!(again.len(), 4);
    assert!(base.iter().all(|(path, x)| again[path].to_bits() == x.to_bits()), "{base:?} {again:?}");
    let bits = |name: &str, path: &str| drawn(&many, name)[path].to_bits();
    for path in again.keys() {
        let [a, b, z] = ["a", "b", "z"].map(|name| bits(name, path));
        assert!(a != b && b != z && a != z, "{path}");
    }
}

#[test]
fn a_twin_has_the_numbers_of_its_sensor() {
    let one = recipe(&["a"], RANGES).unwrap();
    let sensors: BTreeMap<_, _> = one.sensors_of("a").iter().collect();
    let [noisy, clean] = ["noisy", "clean"].map(|name| sensors[&Some(name)]);
    assert_eq!(*clean, noisy.without_noise());
    let contrast = noisy.as_model().contrast().0;
    assert!((contrast - drawn(&one, "a")["noisy:v2e.threshold.on"]).abs() < 1e-12);
    assert_eq!(one.sensors_of("a").twins(), [("clean", "noisy")]);
}

#[test]
fn presets_are_ranges_that_other_keys_override() {
    let read = |sensor: &str| drawn(&recipe(&["a"], &format!("sensor: {sensor}")).unwrap(), "a");
    let v2e = read("{ v2e: { preset: randomised, threshold: { off: 0.3 }, shot: { uniform: [40, 41] } } }");
    assert!(!v2e.contains_key(":v2e.threshold.off") && v2e.contains_key(":v2e.refractory.period_us"));
    assert!((40.0..=41.0).contains(&v2e[":v2e.shot"]));
    let esim = read("{ esim: { preset: randomised } }");
    assert_eq!(esim.keys().filter(|path| path.starts_with(":esim.hot_pixels.")).count(), 2);
    let faults = recipe(&["a"], "sensor: { esim: { preset: dvs346 } }").unwrap_err();
    assert!(faults.contains("unknown preset \"dvs346\""), "{faults}");
    // A law replaces another law of the defaults, and a number replaces a law.
    let folder = tempfile::tempdir().unwrap();
    let defaults = "sensor: { v2e: { shot: { uniform: [1, 2] }, cutoff: { uniform: [20, 30] } } }\n";
    fs::write(folder.path().join("defaults.yaml"), defaults).unwrap();
    let own = "sensor: { v2e: { shot: { normal: [5, 1], within: [4, 6] }, cutoff: 50 } }\n";
    fs::write(
        folder.path().join("a.yaml"),
        format!(
            "version: 1\nscene: a\nsource: {{ procedural: {{}} }}\ntrajectories: [{{ name: a, refine: {{}} }}]\n{own}"
        ),
    )
    .unwrap();
    let merged = read_all(&[folder.path().to_owned()]).unwrap().remove(0);
    let found = drawn(&merged, "a");
    assert!(found.len() == 1 && (4.0..=6.0).contains(&found[":v2e.shot"]), "{found:?}");
}

/// The full form is a recipe with the same draws.
#[test]
fn the_full_form_keeps_the_laws() {
    let k = "sensor: { voltmeter: { k: [{ uniform: [5, 5.5] }, 20, 0.0001, 1.0e-7, 5.0e-9, 0.00001], \
             units: { time: us, brightness: 255 }, front_end: { exposure: { uniform: [0.5, 1.5] } } } }";
    for sensors in [RANGES, k] {
        let own = recipe(&["a", "b"], sensors).unwrap();
        let full = &own.meta.merged;
        let again = load(&full.to_string()).unwrap();
        assert_eq!((&again.meta.merged, drawn(&again, "b")), (full, drawn(&own, "b")));
    }
    let full = recipe(&["a"], RANGES).unwrap().meta.merged;
    assert_eq!(full["sensors"]["noisy"]["v2e"]["shot"], json!({ "uniform": [1.0, 10.0] }));
    assert_eq!(
        full["sensors"]["noisy"]["v2e"]["threshold"]["on"],
        json!({ "normal": [0.2, 0.03], "within": [0.1, 0.3] })
    );
}

#[test]
fn faulty_ranges_are_refused_with_place_and_range() {
    let t = |esim: &str, wanted: &[&str]| {
        let faults = recipe(&["a"], &format!("sensor: {{ esim: {{ {esim} }} }}")).unwrap_err();
        assert!(faults.contains("recipe.yaml:5:"), "{esim}: {faults}");
        for part in wanted {
            assert!(faults.contains(part), "{esim}: {faults}");
        }
        assert_eq!(faults.matches("recipe.yaml:5:").count(), 1, "{esim}: {faults}");
    };
    let on = "\"sensor.esim.threshold.on\"";
    t("threshold: { on: { uniform: [0.4, 0.2] } }", &[on, "range 0.4 to 0.2"]);
    t("threshold: { on: { uniform: [] } }", &["wanted a list of two numbers"]);
    t("threshold: { on: { uniform: } }", &["wanted a list of two numbers"]);
    t("threshold: { on: { uniform: [0.1, .inf] } }", &["wanted a list of two numbers"]);
    t("threshold: { on: { normal: [0.2, 0.1] } }", &[on, "normal without within"]);
    t("threshold: { on: { within: [0.2, 0.3] } }", &[on, "wanted one law"]);
    t("threshold: { on: { uniform: [0.1, 0.2], log_uniform: [0.1, 0.2] } }", &[on, "wanted one law"]);
    t("threshold: { on: { log_uniform: [0, 0.2] } }", &[on, "above 0"]);
    let limits = "wanted a number from 0.000001 to 1000000";
    t("threshold: { on: { uniform: [-0.1, 0.2] } }", &[on, "is -0.1", limits, "the lower end"]);
    t("threshold: { on: { normal: [0.2, 0.1], within: [0, 1] } }", &[on, "is 0,", limits, "the lower end"]);
    t("threshold: { on: { uniform: [0.1, 1e7] } }", &[on, limits, "the upper end"]);
    t("threshold: { on: { uniform: [-2, -1] } }", &[on, "is -2", "the lower end"]);
    t("hot_pixels: { share: { uniform: [0, 2] }, rate: 1 }", &["is 2", "from 0 to 1", "the upper end"]);
    t("max_events_per_pixel_frame: { uniform: [1, 5.5] }", &["wanted a whole number"]);
}

#[test]
fn draws_are_in_the_release_and_in_the_key() {
    let place = Workspace::new();
    let write = |high: &str| {
        let ranges = format!("sensor: {{ v2e: {{ threshold: {{ on: {{ uniform: [0.1, {high}] }} }} }} }}\n");
        place.write("tiny.yaml", tiny_with(&ranges));
    };
    write("0.3");
    place.ok("release --to tree tiny.yaml");
    place.ok("audit tree");
    let scene = place.json("tree/tiny/scene.json");
    let part = &scene["trajectories"][0];
    let found = part["drawn"]["v2e.threshold.on"].as_f64().unwrap();
    assert!((0.1..=0.3).contains(&found) && part["sensor"]["threshold"]["on"] == found, "{part}");
    // Another range is another draw, and `why` names it.
    write("0.4");
    let why = place.ok("why tiny/base/events --recipes tiny.yaml").stdout;
    assert!(why.contains("sensor.v2e.threshold.on.uniform[1]: 0.3 -> 0.4"), "{why}");
}

/// The same bytes with one and with two threads. A second trajectory leaves the first as it is.
#[test]
fn threads_and_other_trajectories_change_no_byte() {
    let sensors = "sensor: { v2e: { preset: randomised, max_events_per_pixel_frame: 100000 } }\n";
    let [one, two, more] = [Workspace::new(), Workspace::new(), Workspace::new()];
    one.write("tiny.yaml", tiny_with(sensors));
    two.write("tiny.yaml", tiny_with(sensors));
    one.ok("release -j 1 --to out tiny.yaml");
    two.ok("release -j 2 --to out tiny.yaml");
    same_tree(&one.path("out"), &two.path("out"));
    let other = "trajectories:\n  - { name: another, refine: { window: 3 } }\n";
    more.write("tiny.yaml", tiny_with(sensors).replace("trajectories:\n", other));
    more.ok("release -j 2 --to out tiny.yaml");
    let events = |place: &Workspace| fs::read(place.path("out/tiny/base/events.h5")).unwrap();
    assert!(events(&one) == events(&more));
    let drawn = |place: &Workspace, name: &str| {
        let scene = place.json("out/tiny/scene.json");
        let of_it = scene["trajectories"].as_array().unwrap().iter().find(|t| t["name"] == name).unwrap();
        of_it["drawn"].clone()
    };
    assert_eq!(drawn(&one, "base"), drawn(&more, "base"));
    assert_ne!(drawn(&more, "another"), drawn(&more, "base"));
}

#[test]
fn a_camera_of_a_rig_draws_the_numbers_of_its_own_sensor() {
    let rig = "sensor: { esim: { threshold: { on: { uniform: [0.1, 0.4] } } } }
rig:
  cameras:
    - { name: left }
    - { name: right, sensor: { v2e: { preset: randomised, shot: 3 } } }
    - { name: third, sensor: { esim: { threshold: { on: 0.3 } } } }
    - { name: fourth, sensor: { v2e: { shot: { uniform: [1, 10] } } } }
outputs: [events]";
    let one = recipe(&["a", "b"], rig).unwrap();
    let [left, right, fourth] = ["a/left", "a/right", "a/fourth"].map(|name| drawn(&one, name));
    assert_eq!(left.keys().collect::<Vec<_>>(), [":esim.threshold.on"]);
    assert!(right.len() > 3 && right.keys().all(|path| path.starts_with(":v2e.")), "{right:?}");
    assert!(!right.contains_key(":v2e.shot"), "a key overrides the range of the preset");
    assert_eq!(fourth.keys().collect::<Vec<_>>(), [":v2e.shot"]);
    assert!(one.trajectories.iter().find(|own| own.name == "a/third").unwrap().drawn.is_none());
    assert_ne!(drawn(&one, "b/right"), right);
    let model = |name: &str| one.sensors_of(name).iter().next().unwrap().1.as_model().written();
    assert_eq!(model("a/right")["threshold"]["on"], json!(right[":v2e.threshold.on"]));
    assert_eq!(model("a/third")["threshold"]["on"], json!(0.3));

    // The full form has the laws, and is the same recipe.
    let cameras = &one.meta.merged["rig"]["cameras"];
    assert_eq!(cameras[3]["sensor"]["v2e"]["shot"], json!({ "uniform": [1.0, 10.0] }));
    let again = load(&serde_json::to_string(&one.meta.merged).unwrap()).unwrap();
    assert_eq!(again.trajectories, one.trajectories);

    let refused = recipe(&["a"], &rig.replace("[1, 10]", "[-1, 10]")).unwrap_err();
    assert!(refused.contains("lower end of its range"), "{refused}");
}
