//! Sensors whose front ends differ, over one rendering.

use crate::support::workspace::{TINY, Workspace, tiny_with};
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_image::{Size, srgb};
use gs2e_render::backend::Backend;
use gs2e_render::{AntialiasMode, ChannelSet, LayerOrder, RenderChoice, RenderRules, RenderedImages};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene::camera::view::CameraView;
use gs2e_sensor::frames::FrameSequence as _;
use gs2e_sensor::front_end::{ChannelDecode, FrontEnd, FrontEndFrames, LuminanceWeights};
use gs2e_trajectory::Trajectory;
use std::fs;
use std::sync::Arc;

const SENSOR: &str = "sensor:\n  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }\n";

const LIGHT: &str =
    "voltmeter: { preset: dvs346-paper, front_end: { luminance: rec709, decode: srgb, exposure: 1.5 } }";
const BRIGHT: &str =
    "voltmeter: { preset: dvs346-paper, front_end: { exposure: 2, range: { min: 10, max: 400 } } }";

#[test]
fn several_sensors_see_the_same_as_each_alone() {
    let place = Workspace::new();
    place.write(
        "tiny.yaml",
        tiny_with(&format!(
            "sensors:\n  usual: {{ voltmeter: {{ preset: dvs346-paper }} }}\n  light: {{ {LIGHT} }}\n  bright: {{ {BRIGHT} }}\n"
        )),
    );
    let message = place.ok("release -v --to several tiny.yaml").stderr;
    let brightness = "brightness: 0.2126 R + 0.7152 G + 0.0722 B, in linear light, times 1.5";
    assert!(message.contains(brightness), "{message}");
    place.ok("audit several");
    let events = |path: &str| fs::read(place.path(path)).unwrap();
    let several =
        ["usual", "light", "bright"].map(|name| events(&format!("several/tiny/base/events/{name}.h5")));
    assert!(several[0] != several[1] && several[0] != several[2] && several[1] != several[2]);
    for (sensor, several) in
        [SENSOR, &format!("sensor: {{ {LIGHT} }}\n"), &format!("sensor: {{ {BRIGHT} }}\n")]
            .into_iter()
            .zip(several)
    {
        place.write("tiny.yaml", tiny_with(sensor));
        place.ok("release --replace --to one tiny.yaml");
        assert!(events("one/tiny/base/events.h5") == several, "{sensor}");
    }
}

/// The check `event_frame` compares events with the brightness that their own sensor saw; another
/// sensor's brightness would not match.
#[test]
fn each_sensor_is_checked_by_its_own_brightness() {
    let place = Workspace::new();
    place.write(
        "tiny.yaml",
        tiny_with(&format!(
            "sensors:\n  usual: {{ voltmeter: {{ preset: dvs346-paper }} }}\n  light: {{ {LIGHT} }}\n"
        )),
    );
    place.ok("release --to out tiny.yaml");
    let checks = place.json("out/tiny/base/checks.json");
    let judged = |name: &str| -> Vec<(String, f64)> {
        let of = checks.as_array().unwrap().iter().filter(|f| f["check"] == "event_frame");
        let of = of.filter(|f| f["subject"].as_str().unwrap().starts_with(&format!("tiny/base/{name}")));
        of.map(|f| (f["verdict"].as_str().unwrap().to_owned(), f["measured"].as_f64().unwrap_or(0.0)))
            .collect()
    };
    for name in ["usual", "light"] {
        let found = judged(name);
        let count = |wanted: &str| found.iter().filter(|(verdict, _)| verdict == wanted).count();
        assert!(count("pass") >= 2 && count("pass") + count("not-run") == found.len(), "{name}: {found:?}");
    }
}

#[test]
fn a_release_states_the_brightness_of_each_sensor() {
    let place = Workspace::new();
    let said = |sensors: &str| {
        place.write("tiny.yaml", tiny_with(sensors));
        place.ok("release --replace --to out tiny.yaml");
        place.ok("audit out");
        let scene = place.json("out/tiny/scene.json");
        let card = fs::read_to_string(place.path("out/README.md")).unwrap();
        // The canonical recipe describes the same sensors.
        place.write("again.yaml", scene["recipe"].to_string());
        assert!(place.stale("again.yaml").is_empty());
        (scene["conventions"]["brightness"].as_str().unwrap().to_owned(), scene, card)
    };
    let (brightness, _, card) = said(SENSOR);
    assert_eq!(brightness, "srgb-encoded");
    assert!(!card.contains("another brightness"));
    let (brightness, _, card) = said(&format!("sensor: {{ {BRIGHT} }}\n"));
    assert_eq!(brightness, "srgb-encoded", "it is not decoded");
    let row = "| tiny | | 0.299 R + 0.587 G + 0.114 B, display-encoded, times 2, clamped to 10 to 400 |";
    assert!(card.contains(row), "{card}");
    let (brightness, scene, _) = said(&format!("sensor: {{ {LIGHT} }}\n"));
    assert_eq!(brightness, "linear");
    let front_end = &scene["trajectories"][0]["sensor"]["front_end"];
    assert_eq!((&front_end["decode"], &front_end["exposure"]), (&"srgb".into(), &1.5.into()));
    let (brightness, _, card) = said(&format!(
        "sensors:\n  usual: {{ voltmeter: {{ preset: dvs346-paper }} }}\n  light: {{ {LIGHT} }}\n"
    ));
    assert_eq!(brightness, "per-sensor");
    assert!(card.contains("| tiny | light | 0.2126 R") && !card.contains("| tiny | usual | 0."), "{card}");
}

#[test]
fn writing_out_a_default_changes_no_key() {
    let place = Workspace::with_tiny();
    place.ok("build tiny.yaml");
    for front_end in [
        "{}",
        "{ luminance: rec601, decode: none, exposure: 1, range: { min: 0 } }",
        "{ luminance: { weights: [0.299, 0.587, 0.114] } }",
    ] {
        place.write(
            "tiny.yaml",
            TINY.replace("preset: dvs346,", &format!("preset: dvs346, front_end: {front_end},")),
        );
        assert!(place.stale("tiny.yaml").is_empty(), "{front_end}");
    }
    place.write("tiny.yaml", TINY.replace("preset: dvs346,", "preset: dvs346, front_end: { exposure: 2 },"));
    assert_eq!(place.stale("tiny.yaml"), ["tiny/base/events", "tiny/base/checks"]);
}

/// Combinations that hermite supports are built. The refused ones are among the broken recipes.
#[test]
fn cubics_see_through_front_ends() {
    let place = Workspace::new();
    for (between, sensor) in [("hermite", BRIGHT), ("catmull", LIGHT)] {
        let text = tiny_with(&format!("sensor: {{ {sensor} }}\n"));
        place.write("tiny.yaml", text.replace("between: linear", &format!("between: {between}")));
        let message = place.ok("build tiny.yaml --json").stdout;
        assert!(message.contains("tiny/base/events"), "{message}");
    }
}

/// Rendered frames behind a front end, encoded again, are the renderer's own colours.
#[test]
fn rendered_colours_are_decoded() {
    let life = StillLife { gaussians: 400, views: 6, arc: 6.0, seed: 1, fountain: None };
    let scene = Arc::new(procedural::still_life(&life));
    let seen_from = procedural::still_capture(&life).views[0].clone();
    let (camera, pose) =
        (seen_from.camera.resized(Size { width: 40, height: 30 }), seen_from.world_from_camera);
    let choice = RenderChoice {
        rules: RenderRules::Official,
        order: LayerOrder::Depth,
        antialiased: AntialiasMode::Off,
        background: [0.2, 0.5, 0.8],
        near: None,
    };
    let renderer = || Backend::Cpu.renderer(scene.clone(), choice.resolve(None)).unwrap();
    let mut rendered = RenderedImages::default();
    let want = ChannelSet { rgb: true, ..ChannelSet::default() };
    renderer().render(&CameraView::at_rest(camera, pose), want, &mut rendered).unwrap();
    let rgb = rendered.rgb.unwrap();
    for (channel, weights) in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].into_iter().enumerate() {
        let trajectory = Trajectory { world_from_camera: vec![pose], stamps_us: vec![0] };
        let mut frames = RenderedFrames::new(renderer(), camera, trajectory);
        let luminance = LuminanceWeights::from_weights(weights).unwrap();
        let mut seen = FrontEndFrames::new(
            &mut frames,
            FrontEnd { luminance, decode: ChannelDecode::Srgb, ..FrontEnd::default() },
        );
        let frame = seen.next().unwrap().unwrap();
        assert!(seen.next().unwrap().is_none());
        for (light, rgb) in frame.luminance.pixels().iter().zip(rgb.pixels()) {
            let found = srgb::encode(f64::from(*light) / 255.0);
            // The light is rounded to 24 bits twice, and the steeper end of the curve multiplies
            // the error by 13.
            let off = (found - f64::from(rgb[channel])).abs();
            assert!(off <= 13.0 * 2.0 * f64::from(f32::EPSILON), "{found}, rendered {}", rgb[channel]);
        }
    }
}
