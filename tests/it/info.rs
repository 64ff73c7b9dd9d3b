//! `gs2e info`, through the binary: scenes, captures, event files, releases and stores.

use crate::sources::datasets::{Generator, VIEWS};
use crate::support::workspace::{TINY, Workspace};
use glam::DVec3;
use gs2e_image::{Size, png};
use serde_json::{Value, json};
use std::fs;
use std::io::{Cursor, Write as _};

/// A floor of 20 by 20 points at y = 0, a pillar of 40 on it up to y = 3.9, and three strays.
fn planted() -> Vec<[f64; 3]> {
    let cell = |i: u32| f64::from(i) - 9.5;
    let floor = (0..400).map(|i| [cell(i % 20), 0.0, cell(i / 20)]);
    let pillar = (0..40).map(|i| [0.25, 0.1 * f64::from(i), 0.125]);
    floor.chain(pillar).chain([[1e4; 3]; 3]).collect()
}

/// A `.ply` of opaque round Gaussians, and of 500 invisible ones far away.
fn ply(points: &[[f64; 3]], double: bool) -> Vec<u8> {
    let rest = "f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let (number, count) = (if double { "double" } else { "float" }, points.len() + 500);
    let mut file = format!("ply\nformat ascii 1.0\nelement vertex {count}\n").into_bytes();
    for name in ["x", "y", "z"] {
        writeln!(file, "property {number} {name}").unwrap();
    }
    for name in rest.split(' ') {
        writeln!(file, "property float {name}").unwrap();
    }
    file.extend(b"end_header\n");
    for [x, y, z] in points {
        writeln!(file, "{x} {y} {z} 1 0.5 0 4 -1 -1 -1 1 0 0 0").unwrap();
    }
    for i in 0..500 {
        writeln!(file, "{i} -70000 0 1 0.5 0 -90 -1 -1 -1 1 0 0 0").unwrap();
    }
    file
}

fn info_of(place: &Workspace, args: &str) -> Value {
    serde_json::from_str(&place.ok(&format!("info --json {args}")).stdout).unwrap()
}

fn vector(value: &Value) -> DVec3 {
    serde_json::from_value(value.clone()).unwrap()
}

fn close(found: DVec3, wanted: [f64; 3]) {
    assert!((found - DVec3::from_array(wanted)).length() < 1e-6, "{found} {wanted:?}");
}

#[test]
fn a_scene_is_where_its_opacity_is() {
    let place = Workspace::new();
    place.write("scene.ply", ply(&planted(), false));
    let found = info_of(&place, "scene.ply");
    assert_eq!((&found["kind"], &found["path"]), (&json!("scene"), &json!("scene.ply")));
    assert_eq!((&found["format"], &found["position_bits"]), (&json!(".ply"), &json!(32)));
    assert_eq!((&found["gaussians"], &found["sh_degree"]), (&json!(943), &json!(0)));
    // 443 visible points: 2.5 % of them are 11, and 97.5 % are 431.9. Outside in, x and z have 20
    // floor points at either end. Of y, 401 are 0, and the 432nd is 31 steps up the pillar.
    let survey = &found["survey"];
    close(vector(&survey["low"]), [-9.5, 0.0, -9.5]);
    close(vector(&survey["high"]), [9.5, 3.1, 9.5]);
    // The 222nd: after 200 floor points comes the pillar.
    close(vector(&survey["centre"]), [0.25, 0.0, 0.125]);
    let radius = survey["radius"].as_f64().unwrap();
    let within = |radius: f64| {
        let inside =
            |p: &&[f64; 3]| (DVec3::from_array(**p) - DVec3::new(0.25, 0.0, 0.125)).length() <= radius;
        planted().iter().filter(inside).count()
    };
    // 95 % of 443 are 420.85.
    assert!(within(radius * 1.000_001) >= 421 && within(radius * 0.999_999) <= 420, "{radius}");
    assert_eq!(survey["up"]["rule"], "layer");
    assert!(vector(&survey["up"]["direction"]).dot(DVec3::Y) > 0.99);

    let shown = place.ok("info scene.ply").stdout;
    for wanted in
        ["scene.ply: a scene\n", "  Gaussians    943\n", "positions of 32 bits", "a guess", "degree 0"]
    {
        assert!(shown.contains(wanted), "{wanted}: {shown}");
    }
}

#[test]
fn each_scene_format_is_named() {
    let place = Workspace::new();
    place.write("wide.ply", ply(&planted(), true));
    let wide = info_of(&place, "wide.ply");
    assert_eq!((&wide["format"], &wide["position_bits"]), (&json!(".ply"), &json!(64)));
    for (name, format) in [("a.spz", ".spz"), ("a.splat", ".splat")] {
        place.ok(&format!("convert --lossy wide.ply {name}"));
        let found = info_of(&place, name);
        assert_eq!((&found["format"], &found["gaussians"]), (&json!(format), &json!(943)));
        // A byte of opacity is at least 1/512, so the 500 faint Gaussians weigh as one together, and
        // move the end on the pillar by one point, which is 0.1.
        assert!((vector(&found["survey"]["high"]) - vector(&wide["survey"]["high"])).length() < 0.11);
    }
}

/// The recipe at the end of what people see.
fn printed_recipe(place: &Workspace) -> String {
    let shown = place.ok("info scene.ply").stdout;
    let (_, recipe) = shown.split_once("# A first recipe").unwrap();
    assert!(info_of(place, "scene.ply")["recipe"].as_str().unwrap().ends_with(recipe));
    format!("#{recipe}")
}

#[test]
fn the_suggested_recipe_is_a_recipe_and_shows_the_scene() {
    let place = Workspace::new();
    place.write("scene.ply", ply(&planted(), false));
    place.write("first.yaml", printed_recipe(&place));
    let steps = place.plan("first.yaml");
    assert!(steps.iter().any(|(step, _)| step == "my-scene/orbit/events"), "{steps:?}");

    // The view from the start of the orbit, by OpenCV's axes.
    let orbit = &info_of(&place, "scene.ply")["orbit"];
    let [centre, from, up] = ["centre", "from", "up"].map(|key| vector(&orbit[key]));
    let forward = (centre - from).normalize();
    let right = forward.cross(up).normalize();
    let rows = [right, forward.cross(right), forward];
    let camera = json!({
        "W": 64, "H": 48, "fx": 55.4, "fy": 55.4, "cx": 32, "cy": 24,
        "R": rows.map(|row| row.to_array()), "t": rows.map(|row| -row.dot(from)),
    });
    place.write("view.json", camera.to_string());
    place.ok("render --backend cpu --scene scene.ply --view view.json --out seen.png");
    let seen = png::read_rgb(Cursor::new(fs::read(place.path("seen.png")).unwrap())).unwrap();
    assert_eq!(seen.size(), Size { width: 64, height: 48 });
    let lit = |x: usize, y: usize| seen.pixels()[64 * y + x][0] > 10;
    // The ball of 95 % touches the upper and the lower edge, so the floor is in the middle of the
    // image, and nothing but the corner points of the floor is near its edges.
    let columns = (0..64).filter(|x| (0..48).any(|y| lit(*x, y))).count();
    let rows = (0..48).filter(|y| (0..64).any(|x| lit(x, *y))).count();
    assert!(columns >= 32 && rows >= 12, "{columns} columns and {rows} rows are lit");
}

/// The path of the scene is right from where the recipe is.
#[test]
fn a_first_recipe_in_another_folder_finds_its_scene() {
    let place = Workspace::new();
    place.write("scenes/plant.ply", ply(&planted(), false));
    place.write("recipes/defaults.yaml", "outputs: [events]\n");
    place.ok("info scenes/plant.ply --recipe recipes/plant.yaml");
    place.ok("plan recipes");
    let again = place.gs2e("info scenes/plant.ply --recipe recipes/plant.yaml");
    assert!(again.code == 2 && again.stderr.contains("recipes/plant.yaml"), "{}", again.stderr);
    place.write("e.txt", "# t x y p in us; sensor 8x4\n1000 1 2 1\n");
    let ended = place.gs2e("info e.txt --recipe recipes/e.yaml");
    assert!(ended.code == 2 && !place.path("recipes/e.yaml").exists(), "{}", ended.stderr);
}

/// An orbit that says nothing is laid about the scene as `info` suggests it.
#[test]
fn an_orbit_without_values_is_the_suggested_one() {
    let place = Workspace::new();
    place.write("scene.ply", ply(&planted(), false));
    let recipe = |orbit: &str, scene: &str| {
        format!(
            "version: 1\nscene: my-scene\nsource: none\n{scene}camera: {{ width: 64, height: 48, fx: 55.4 }}\n\
             trajectories:\n  - {{ name: orbit, orbit: {{ {orbit}frames: 4 }} }}\noutputs: []\n"
        )
    };
    let given = "reconstruct: { given: { path: scene.ply } }\n";
    let first_pose = |orbit: &str| {
        place.write("own.yaml", recipe(orbit, given));
        let built = place.ok("build --json own.yaml").stdout;
        let step = built.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let step = step.into_iter().find(|step| step["step"] == "my-scene/orbit/trajectory").unwrap();
        let outputs = step["outputs"].as_array().unwrap();
        let poses = outputs.iter().find(|output| output["role"] == "poses.txt").unwrap();
        let text = fs::read_to_string(place.path(poses["path"].as_str().unwrap())).unwrap();
        let numbers: Vec<f64> = text
            .lines()
            .find(|line| !line.starts_with('#'))
            .unwrap()
            .split(' ')
            .map(|word| word.parse().unwrap())
            .collect();
        DVec3::new(numbers[1], numbers[2], numbers[3])
    };
    let found = info_of(&place, "scene.ply");
    let [centre, from] = ["centre", "from"].map(|key| vector(&found["orbit"][key]));
    // `info` rounds to four digits of the radius.
    let tolerance = 1e-3 * (from - centre).length();
    assert!((first_pose("") - from).length() < tolerance);
    // A centre that is given moves the start with it.
    let moved = first_pose("centre: [100.25, 0, 0.125], ");
    assert!((moved - from - DVec3::X * 100.0).length() < tolerance, "{moved}");
    // Without a scene there is nothing to take the values from.
    place.write("own.yaml", recipe("", ""));
    let refused = place.gs2e("plan own.yaml");
    assert_eq!(refused.code, 2);
    assert!(refused.stderr.contains("missing field \"trajectories[0].orbit.centre\""), "{}", refused.stderr);
}

#[test]
fn a_capture_is_counted_and_measured() {
    let place = Workspace::new();
    // Six views of the origin, 4 units away and 0.2 radians apart.
    let frame = |i: u32| {
        let (sin, cos) = (0.2 * f64::from(i)).sin_cos();
        let rows = [
            [cos, 0.0, sin, 4.0 * sin],
            [0.0, 1.0, 0.0, 0.0],
            [-sin, 0.0, cos, 4.0 * cos],
            [0.0, 0.0, 0.0, 1.0],
        ];
        json!({ "file_path": format!("images/{i:03}.png"), "transform_matrix": rows })
    };
    let frames: Vec<Value> = (0..6).map(frame).collect();
    let file =
        json!({ "w": 64, "h": 48, "fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "frames": frames });
    place.write("transforms.json", file.to_string());
    let found = info_of(&place, "transforms.json");
    assert_eq!(
        (&found["kind"], &found["capture"], &found["views"]),
        (&json!("capture"), &json!("nerfstudio"), &json!(6))
    );
    assert_eq!(found["photos_missing"].as_array().unwrap().len(), 6);
    let camera = &found["cameras"][0];
    assert_eq!((&camera["width"], &camera["fx"], &camera["views"]), (&json!(64), &json!(60.0), &json!(6)));
    // Views at 4 units from the origin, all towards it, in equal steps.
    let scale = found["evenness"]["scale"].as_f64().unwrap();
    assert!((scale - 4.0).abs() < 1e-9 && found["evenness"]["focused"] == true, "{scale}");
    let step = found["evenness"]["longest_step"]["times_median"].as_f64().unwrap();
    assert!((step - 1.0).abs() < 1e-9 && found["evenness"]["gaps"] == 0, "{step}");
    // The folder is the same capture.
    assert_eq!(info_of(&place, ".")["views"], 6);
    let shown = place.ok("info transforms.json").stdout;
    for wanted in ["a capture\n", "6 missing", "64x48", "4 units, the median distance"] {
        assert!(shown.contains(wanted), "{wanted}: {shown}");
    }
}

/// A folder with the captures of two programs, as datasets are often delivered.
#[test]
fn each_capture_of_a_folder_is_shown_with_its_key() {
    let place = Workspace::new();
    Generator::new().instance(&place.path("fox"), None);
    let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]];
    let frame = json!({ "file_path": "images/000.jpg", "transform_matrix": pose });
    let file = json!({ "w": 64, "h": 48, "fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "frames": [frame] });
    place.write("fox/transforms.json", file.to_string());
    let shown = place.ok("info fox").stdout;
    for (kind, views) in [("colmap", VIEWS), ("nerfstudio", 1)] {
        let key = format!("  in a recipe  source: {{ {kind}: {{ path: … }} }}\n  views        {views}\n");
        assert!(shown.contains(&key), "{kind}: {shown}");
    }
    let found = info_of(&place, "fox");
    let captures: Vec<_> = found["captures"].as_array().unwrap().iter().map(|c| &c["capture"]).collect();
    assert_eq!(
        (&found["kind"], captures),
        (&json!("captures"), vec![&json!("colmap"), &json!("nerfstudio")])
    );
}

#[test]
fn events_are_counted() {
    let place = Workspace::new();
    // Two seconds from the first to the last of five events; one is out of order.
    let lines =
        "# t x y p in us; sensor 8x4\n1000 1 2 1\n1000 3 2 0\n5000 1 2 1\n4000 7 3 1\n2001000 0 0 0\n";
    place.write("few.txt", lines);
    let found = info_of(&place, "few.txt");
    let wanted = json!({
        "kind": "events", "path": "few.txt", "format": "txt", "width": 8, "height": 4, "events": 5, "on": 3,
        "on_share": 0.6, "first_us": 1000, "last_us": 2_001_000, "rate_ev_s": 2.5, "labelled": false,
        "signal": null, "sorted": false, "backward": 1, "untimed": 0, "law": null,
    });
    assert_eq!(found, wanted);
    let shown = place.ok("info few.txt").stdout;
    for wanted in ["60.00 %", "2.5 ev/s", "not sorted: 1 events", "1000 to 2001000 us"] {
        assert!(shown.contains(wanted), "{wanted}: {shown}");
    }
    // A .csv does not state the sensor.
    place.write("few.csv", "t,x,y,p\n0,1,2,1\n");
    assert_eq!(place.gs2e("info few.csv").code, 1);
    assert_eq!(info_of(&place, "--size 8x4 few.csv")["events"], 1);
    place.ok("convert --size 8x4 few.csv few.h5");
    let stored = info_of(&place, "few.h5");
    assert_eq!((&stored["sorted"], &stored["rate_ev_s"]), (&json!(true), &Value::Null));
}

#[test]
fn releases_and_stores_are_counted() {
    let place = Workspace::released(TINY, "");
    let found = info_of(&place, "tree");
    let manifest: Value = place.json("tree/manifest.json");
    let scene: Value = place.json("tree/tiny/scene.json");
    assert_eq!((&found["kind"], &found["name"]), (&json!("release"), &manifest["name"]));
    assert_eq!((&found["scenes"], &found["trajectories"]), (&json!(1), &json!(1)));
    assert_eq!(found["events"], scene["trajectories"][0]["statistics"]["events"]);
    assert_eq!(found["checksums"], true);
    let shown = place.ok("info tree").stdout;
    assert!(shown.contains("tree: a release\n") && shown.contains("SHA256SUMS"), "{shown}");

    let store = info_of(&place, ".gs2e");
    // Of each step, and of the verdicts on the files of the release.
    let records = place.plan("tiny.yaml").len() + 1;
    assert_eq!(
        (&store["kind"], &store["records"], &store["releases"]),
        (&json!("store"), &json!(records), &json!(1))
    );
    assert!(store["bytes"].as_u64().unwrap() > 0 && place.ok("info .gs2e").stdout.contains("a store"));

    // Events of the release, with the law of their simulation.
    let events = info_of(&place, "tree/tiny/base/events.h5");
    assert_eq!(events["events"], scene["trajectories"][0]["statistics"]["events"]);
    assert!(events["law"]["c_on"].is_number() && events["sorted"] == true, "{events}");

    fs::write(place.path("tree/manifest.json"), "{}").unwrap();
    assert_eq!(place.gs2e("info tree").code, 1);
}

#[test]
fn other_paths_are_refused() {
    let place = Workspace::new();
    let refused = |path: &str, exit: i32, code: &str| {
        let ended = place.gs2e(&format!("info --json {path}"));
        let object: Value = serde_json::from_str(&ended.stdout).unwrap();
        assert_eq!((ended.code, &object["code"]), (exit, &json!(code)), "{path}: {}", ended.stderr);
    };
    place.write("notes.bin", "nothing that is known");
    place.write("broken.ply", "ply\nformat ascii 1.0\n");
    place.write("broken.h5", "no HDF5");
    place.write("odd.json", "{}");
    place.write("empty/nothing.bin", "");
    refused("gone", 2, "input-missing");
    refused("gone.h5", 2, "input-missing");
    refused("empty", 2, "input-missing");
    refused("notes.bin", 1, "input-unreadable");
    refused("broken.ply", 1, "input-unreadable");
    refused("broken.h5", 1, "input-unreadable");
    refused("odd.json", 1, "input-unreadable");
    refused("/dev/null", 1, "input-unreadable");
    assert_eq!(place.gs2e("info").code, 2);
}
