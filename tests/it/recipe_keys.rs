//! Keys that say the same as others in the unit of a person: contrasts, pictures per second, angles of
//! view. And speeds along which an accelerometer would show what no real one does.

use crate::support::workspace::{TINY, Workspace};

/// The keys of the steps that a run of a recipe would make, as far as they are known.
fn keys(place: &Workspace, recipe: &str) -> Vec<String> {
    place.write("r.yaml", recipe);
    let rows: serde_json::Value = serde_json::from_str(&place.ok("plan --json r.yaml").stdout).unwrap();
    rows.as_array().unwrap().iter().map(|row| format!("{} {}", row["step"], row["key"])).collect()
}

/// The message that refuses a recipe.
fn refusal(recipe: &str) -> String {
    let place = Workspace::new();
    place.write("r.yaml", recipe);
    let ended = place.gs2e("plan r.yaml");
    assert_eq!(ended.code, 2, "{recipe}\n{}{}", ended.stdout, ended.stderr);
    ended.stderr
}

fn with(from: &str, to: &str) -> String {
    let recipe = TINY.replace(from, to);
    assert_ne!(recipe, TINY, "{from}");
    recipe
}

const VOLTMETER: &str = "voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }";

#[test]
fn a_contrast_is_the_equal_threshold() {
    let place = Workspace::new();
    place.write("r.yaml", with(VOLTMETER, "esim: { threshold: { on: 0.25, off: 0.3 } }"));
    assert!(place.build("r.yaml").len() >= 5);
    for same in ["contrast: [0.25, 0.3]", "contrast: { on: 0.25, off: 0.3 }"] {
        place.write("r.yaml", with(VOLTMETER, &format!("esim: {{ {same} }}")));
        assert_eq!(place.build("r.yaml"), [""; 0], "{same}");
    }
    // `k1` of the constants published for the DVS346 is 5.26534: a volt is a contrast of 0.18992.
    for model in
        ["voltmeter: { preset: dvs346, contrast: 0.2 }", "v2e: { contrast: 0.2 }", "esim: { contrast: 0.2 }"]
    {
        place.write("r.yaml", with(VOLTMETER, model));
        let said = place.ok("build r.yaml").stderr;
        assert!(said.contains("contrast ON 0.2000, OFF 0.2000"), "{model}: {said}");
    }
}

#[test]
fn a_contrast_stands_above_the_threshold_of_the_defaults() {
    let place = Workspace::new();
    place.write("r/defaults.yaml", "sensor:\n  esim: { threshold: { on: 1.0, off: 1.0 } }\n");
    place.write("r/a.yaml", with(VOLTMETER, "esim: { contrast: 0.2 }"));
    assert!(place.ok("build r").stderr.contains("contrast ON 0.2000, OFF 0.2000"));
}

#[test]
fn contrasts_that_cannot_be_meant_are_refused() {
    for (sensor, words) in [
        ("esim: { contrast: 0.2, threshold: { on: 0.2 } }", "exclude each other"),
        ("esim: { contrast: [0.2] }", "contrast"),
        ("esim: { contrast: 0 }", "is 0, wanted a number from 0.0001 to 20"),
        ("esim: { contrast: { on: { uniform: [0.1, 0.3] } } }", "write the law under threshold"),
        ("esim: { threshold: 0.2 }", "help: write keys in braces, such as { on: … }"),
    ] {
        let said = refusal(&with(VOLTMETER, sensor));
        assert!(said.contains(words), "{sensor}: {said}");
    }
}

/// A threshold of 0.2 of `evk4` is in its own unit: a contrast of 0.03.
#[test]
fn a_contrast_that_no_camera_has_is_a_warning_of_the_plan() {
    let place = Workspace::new();
    for (sensor, warned) in [
        ("voltmeter: { preset: evk4, threshold: { on: 0.2, off: 0.2 } }", true),
        ("voltmeter: { preset: davis346, threshold: { on: 500, off: 500 } }", true),
        ("voltmeter: { preset: evk4 }", false),
        ("voltmeter: { preset: davis346, contrast: 0.06 }", false),
        ("esim: { contrast: 1.9 }", false),
    ] {
        place.write("r.yaml", with(VOLTMETER, sensor));
        let said = place.ok("plan r.yaml").stderr;
        assert_eq!(said.contains("one event needs a contrast of"), warned, "{sensor}: {said}");
    }
}

#[test]
fn pictures_per_second_are_the_equal_number_of_poses() {
    let place = Workspace::new();
    let t = |counted: &str, per_second: &str| {
        let [a, b] = [counted, per_second].map(|keys_of| {
            keys(
                &place,
                &format!(
                    "{}{keys_of}\n",
                    TINY.replace("[events, sharp]", "[events, sharp, depth, flow, blur]")
                ),
            )
        });
        assert_eq!(a, b, "{counted} | {per_second}");
    };
    t("sharp: { every: 8 }", "sharp: { fps: 300 }");
    // 2400 / 301 is nearer to 8 than to 7.
    t("depth: { every: 8 }", "depth: { fps: 301 }");
    t("flow: { every: 3 }", "flow: { fps: 800 }");
    t("blur: { frames: 3 }", "blur: { fps: 800 }");
    // 4 poses are no exposure with a frame in its middle.
    t("blur: { frames: 5 }", "blur: { fps: 600 }");
    for (section, words) in [
        ("sharp: { every: 8, fps: 30 }", "exclude each other"),
        ("blur: { frames: 3, fps: 30 }", "exclude each other"),
        ("sharp: { fps: 4800 }", "above the 2400 poses per second"),
    ] {
        let said = refusal(&format!("{}{section}\n", with("[events, sharp]", "[events, sharp, blur]")));
        assert!(said.contains(words), "{section}: {said}");
    }
}

#[test]
fn an_angle_of_view_is_the_equal_focal_length() {
    let place = Workspace::new();
    let [angle, length] = ["fov: 90", "fx: 32"].map(|key| {
        keys(
            &place,
            &with(
                "camera: { width: 64, height: 48 }",
                &format!("camera: {{ width: 64, height: 48, {key} }}"),
            ),
        )
    });
    assert!(angle == length || angle.iter().any(|key| key.contains("null")), "{angle:?} {length:?}");
    let both =
        with("camera: { width: 64, height: 48 }", "camera: { width: 64, height: 48, fov: 60, fx: 50 }");
    assert!(refusal(&both).contains("exclude each other"));
}

#[test]
fn inertial_data_needs_a_smooth_speed() {
    let along = |path: &str, speed: &str| {
        let recipe = TINY.replace("refine: { window: 2, factor: 2, curve: cubic }", path);
        let recipe = recipe.replace("speed: { function: \"0.25*sin(t) + 1.1\" }", &format!("speed: {speed}"));
        format!("{}scale: {{ metres_per_unit: 0.4 }}\n", recipe.replace("[events, sharp]", "[sharp, imu]"))
    };
    for (path, speed, because, instead) in [
        (
            "refine: { window: 2 }",
            "{ flow: { px_s: 400 } }",
            "`flow` follows a measurement",
            "function: \"1\"",
        ),
        (
            "refine: { frames: 12 }",
            "{ list: { multipliers: [1, 2], blend: 0 } }",
            "not blended",
            "blend: 0.1",
        ),
        ("refine: { frames: 12 }", "{ function: \"1 + abs(t - 0.5)\" }", "it uses abs", "without corners"),
        (
            "refine: { frames: 12, curve: slerp-lerp }",
            "{ function: \"1\" }",
            "`curve: slerp-lerp` has corners",
            "curve: cubic",
        ),
    ] {
        let said = refusal(&along(path, speed));
        assert!(said.contains("the output imu needs a smooth speed") && said.contains(because), "{said}");
        assert!(said.contains(instead), "{said}");
    }
    let place = Workspace::new();
    for speed in ["{ list: { multipliers: [1, 2] } }", "{ function: \"1 + t\" }"] {
        place.write("r.yaml", along("refine: { frames: 12 }", speed));
        place.ok("plan r.yaml");
    }
}

#[test]
fn the_help_for_a_missing_up_is_that_of_the_orbit() {
    let recipe = "version: 1\nscene: a\nsource: none\noutputs: [imu]\ncamera: { width: 8, height: 8 }\n\
        scale: { metres_per_unit: 1 }\ntrajectories:\n  - name: b\n    orbit: { centre: [0, 0, 0], from: [0, 0, -4], up: [0, -1, 0], frames: 9 }\n";
    let said = refusal(recipe);
    assert!(said.contains("write imu: { up: [0, -1, 0] }"), "{said}");
}

#[test]
fn what_yaml_readers_disagree_on_is_refused() {
    for (from, to, words) in [
        ("seed: 7", "seed: 0123", "help: write 123, or 0o123 for an octal number"),
        ("factor: 2", "frames: -50", "wanted a whole number of at least 0"),
        ("[events, sharp]", "events", "help: write it in brackets: [events]"),
        ("rate: 2400", "rate: 1000 Hz", "help: write the number without its unit: 1000"),
        ("off: 1.0 }", "off: 1.0 }, labels: True", "help: write true"),
        ("off: 1.0 }", "off: 1.0 }, labels: no", "help: write false"),
    ] {
        let said = refusal(&with(from, to));
        assert!(said.contains(words), "{to}: {said}");
    }
}

#[test]
fn a_tolerance_for_a_sensor_without_names_the_rate_to_write() {
    let recipe = with(VOLTMETER, "v2e: {}").replace("rate: 2400, between: linear", "tolerance: 0.1");
    assert!(refusal(&recipe).contains("sampling: { rate: 2400 }"));
}

#[test]
fn files_beside_the_recipes_are_named_by_what_they_are() {
    for name in ["defaults.yml", "Defaults.yaml", "release.YML"] {
        let place = Workspace::new();
        place.write("r/a.yaml", TINY);
        place.write(&format!("r/{name}"), "seed: 3\n");
        let said = place.gs2e("plan r").stderr;
        let wanted = format!("wanted {}.yaml", name.split('.').next().unwrap().to_lowercase());
        assert!(said.contains("a file with this name is ignored") && said.contains(&wanted), "{said}");
    }
}
