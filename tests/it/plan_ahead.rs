//! What `gs2e plan` says before anything is built: sizes, and recipes that can hardly be meant.

use crate::support::workspace::{TINY, Workspace, tree};

/// The numbers before these words in the line about the release.
fn stated(said: &str, words: &str) -> f64 {
    let line = said.lines().find(|line| line.starts_with("a release: ")).unwrap_or_else(|| panic!("{said}"));
    let before = line.split_once(words).unwrap_or_else(|| panic!("{words}: {line}")).0;
    before.rsplit(' ').next().unwrap().parse().unwrap()
}

/// The bytes that are stated, from a number with a prefix.
fn stated_bytes(said: &str) -> f64 {
    let unit = |unit: &str, scale: f64| {
        said.contains(&format!("{unit}, of which")).then_some((unit.to_owned(), scale))
    };
    let (unit, scale) = unit(" kB", 1e3).or_else(|| unit(" MB", 1e6)).or_else(|| unit(" GB", 1e9)).unwrap();
    stated(said, &format!("{unit}, of which")) * scale
}

/// Two scenes, one of which has a speed that only a measurement turns into a number of poses.
#[test]
fn a_plan_states_the_size_of_its_release() {
    let pictures =
        "outputs: [events, sharp, depth, flow]\nsharp: { fps: 120 }\ndepth: { fps: 60 }\nflow: { fps: 60 }\n";
    let camera = "camera: { width: 160, height: 120 }";
    let sensor = "sensor: { esim: { contrast: 0.3 } }";
    let source = "source: { procedural: { kind: still-life, gaussians: 1000, views: 8, arc: 24, seed: 1 } }";
    for (name, path, speed) in [
        ("counted", "refine: { window: 2, duration: 0.5 }", "{ function: \"1 + t\" }"),
        ("measured", "refine: { window: 2 }", "{ flow: { px_s: 40 } }"),
    ] {
        let place = Workspace::new();
        place.write(
            "r.yaml",
            format!(
                "version: 1\nscene: {name}\n{source}\n{camera}\ntrajectories:\n  - name: base\n    {path}\n    speed: {speed}\n\
                 sampling: {{ rate: 240 }}\n{sensor}\n{pictures}licence: {{ expression: CC0-1.0, holder: Example Lab }}\n"
            ),
        );
        let said = place.ok("plan r.yaml").stderr;
        let [poses, files, bytes] = [stated(&said, " poses"), stated(&said, " files"), stated_bytes(&said)];
        place.ok("release --to out r.yaml");
        let made = tree(&place.path("out"));
        let found =
            std::fs::read_to_string(place.path(&format!("out/{name}/base/timestamps_us.txt"))).unwrap();
        let sizes: usize = made.values().map(Vec::len).sum();
        let t = |what: &str, stated: f64, found: f64| {
            // Within a fifth.
            assert!((stated / found - 1.0).abs() < 0.2, "{name}: {what}: {stated}, found {found}\n{said}");
        };
        t("poses", poses, found.lines().count() as f64);
        t("files", files, made.len() as f64);
        t("bytes", bytes, sizes as f64);
    }
}

#[test]
fn a_length_that_nothing_tells_is_named() {
    let place = Workspace::new();
    let recipe = TINY.replace(
        "source: { procedural: { kind: still-life, gaussians: 500, views: 6, arc: 6, seed: 1 } }",
        "source: { photos: { path: photos } }\nreconstruct: { builtin: {} }",
    );
    let recipe = recipe.replace("refine: { window: 2, factor: 2, curve: cubic }", "refine: { window: 2 }");
    place.write("r.yaml", recipe.replace("{ function: \"0.25*sin(t) + 1.1\" }", "{ flow: { px_s: 400 } }"));
    std::fs::create_dir(place.path("photos")).unwrap();
    let picture = gs2e_image::Image::filled(gs2e_image::Size { width: 16, height: 16 }, [9_u8, 9, 9]);
    for name in ["a.png", "b.png", "c.png"] {
        let mut file = std::fs::File::create(place.path(&format!("photos/{name}"))).unwrap();
        gs2e_image::png::write_image(&picture, &mut file).unwrap();
    }
    let said = place.ok("plan r.yaml").stderr;
    assert!(
        said.contains("not counted: tiny/base, whose length is known once its poses are built"),
        "{said}"
    );
}

#[test]
fn recipes_that_can_hardly_be_meant_are_warned_of_or_refused() {
    let path = "refine: { window: 2, factor: 2, curve: cubic }";
    let camera = "camera: { width: 64, height: 48 }";
    for (from, to, code, words) in [
        (path, "refine: { frames: 20000000 }", 0, "the release takes about"),
        (
            "outputs: [events, sharp]",
            "outputs: [events, sharp]\ndepth: { every: 2 }",
            0,
            "outputs does not name depth",
        ),
        (camera, "camera: { width: 64, height: 48, fx: 0.8 }", 0, "the camera sees 177.1 degrees across"),
        (
            "outputs: [events, sharp]",
            "outputs: [events, sharp, blur]\nblur: { frames: 99 }",
            2,
            "need 101 poses",
        ),
    ] {
        let recipe = TINY.replace(from, to);
        let recipe = if to.starts_with("outputs: [events, sharp, blur]") {
            recipe.replace("factor: 2", "frames: 100")
        } else {
            recipe
        };
        let place = Workspace::new();
        place.write("r.yaml", &recipe);
        let ended = place.gs2e("plan r.yaml");
        assert_eq!(ended.code, code, "{to}: {}", ended.stderr);
        assert!(ended.stderr.contains(words) && ended.stderr.contains("help: "), "{to}: {}", ended.stderr);
    }
    let place = Workspace::with_tiny();
    let said = place.ok("plan tiny.yaml").stderr;
    assert!(!said.contains("warning"), "{said}");
}

#[test]
fn a_scene_file_that_is_none_is_refused_by_the_plan() {
    let place = Workspace::new();
    let recipe = "version: 1\nscene: a\nsource: none\nreconstruct: { given: { path: FILE } }\ncamera: { width: 64, height: 48 }\n\
        trajectories:\n  - name: b\n    orbit: { centre: [0, 0, 0], from: [0, 0, -4], up: [0, -1, 0], frames: 9 }\n";
    place.write("r.yaml", recipe.replace("FILE", "r.yaml"));
    for command in ["plan r.yaml", "build r.yaml"] {
        let ended = place.gs2e(command);
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        assert!(ended.stderr.contains("is no scene") && ended.stderr.contains(".splat"), "{}", ended.stderr);
    }
}

#[test]
fn a_plan_names_every_changed_key_of_the_recipe() {
    let place = Workspace::with_tiny();
    place.build("tiny.yaml");
    let edited =
        TINY.replace("on: 1.0, off: 1.0", "on: 1.5, off: 1.25").replace("sin(t) + 1.1", "sin(t) + 1.2");
    place.write("tiny.yaml", edited);
    let said = place.ok("plan tiny.yaml").stdout;
    let line = |step: &str| {
        said.lines().find(|line| line.contains(step)).unwrap_or_else(|| panic!("{said}")).to_owned()
    };
    let motion = line("tiny/base/trajectory");
    assert!(motion.contains("trajectories.base.speed.function") && !motion.contains("binary"), "{motion}");
    place.write("tiny.yaml", TINY.replace("on: 1.0, off: 1.0", "on: 1.5, off: 1.25"));
    let said = place.ok("plan tiny.yaml").stdout;
    let events = said.lines().find(|line| line.contains("base/events")).unwrap();
    for key in ["sensor.voltmeter.threshold.on: 1.0 -> 1.5", "sensor.voltmeter.threshold.off: 1.0 -> 1.25"] {
        assert!(events.contains(key), "{events}");
    }
    assert!(
        said.lines().any(|line| line.starts_with("may run") && line.contains("depends on base/events")),
        "{said}"
    );
    let why = place.ok("why tiny/base/events --recipes tiny.yaml").stdout;
    assert!(why.contains("changed since the last run: sensor.voltmeter.threshold.off"), "{why}");
    assert!(!why.contains("changed since the last run: params."), "{why}");
}
