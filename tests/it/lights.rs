//! Light that changes: the events of a flickering still scene are those of the law's closed form, pictures
//! and exposures are multiplied in linear light, and the setting is part of keys, messages and releases.

use crate::rolling::picture;
use crate::support::steps::{keys, recipe, steps};
use crate::support::workspace::Workspace;
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_event::{Event, Polarity};
use gs2e_image::{Image, Size, srgb};
use gs2e_num::seed::Seed;
use gs2e_render::backend::Backend;
use gs2e_render::lights::{Flicker, LevelMoment, SceneLights, Waveform};
use gs2e_render::{
    AntialiasMode, ChannelSet, LayerOrder, RenderChoice, RenderRules, RenderedImages, Renderer,
};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene::camera::view::CameraView;
use gs2e_sensor::esim::EsimModel;
use gs2e_sensor::front_end::{ChannelDecode, FrontEnd};
use gs2e_sensor::noise::ThresholdMismatch;
use gs2e_sensor::{SensorModel, SensorSettings, simulate_one};
use gs2e_trajectory::Trajectory;
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::sync::Arc;

/// Frames per second, and seconds: ten periods of 100 Hz.
const RATE: u32 = 10_000;
const PERIODS: u32 = 10;
const SIZE: Size = Size { width: 40, height: 30 };

/// A still camera before a still life: the colours that it sees, and the events of a sensor in this light.
fn still_events(lights: &SceneLights, model: &dyn SensorModel) -> (Image<[f32; 3]>, Vec<Event>) {
    let life = StillLife { gaussians: 400, views: 6, arc: 6.0, seed: 1, fountain: None };
    let scene = Arc::new(procedural::still_life(&life));
    let view = procedural::still_capture(&life).views[0].clone();
    let (camera, pose) = (view.camera.resized(SIZE), view.world_from_camera);
    let choice = RenderChoice {
        rules: RenderRules::Soft,
        order: LayerOrder::Depth,
        antialiased: AntialiasMode::Off,
        background: [0.2, 0.5, 0.0],
        near: None,
    };
    let renderer =
        || -> Box<dyn Renderer> { Backend::Cpu.renderer(scene.clone(), choice.resolve(None)).unwrap() };
    let mut rendered = RenderedImages::default();
    let want = ChannelSet { rgb: true, ..ChannelSet::default() };
    renderer().render(&CameraView::at_rest(camera, pose), want, &mut rendered).unwrap();
    let count = RATE / 100 * PERIODS + 1;
    let stamps_us = (0..count).map(|j| i64::from(j) * 1_000_000 / i64::from(RATE)).collect();
    let trajectory = Trajectory { world_from_camera: vec![pose; count as usize], stamps_us };
    let mut frames = RenderedFrames::new(renderer(), camera, trajectory).lit_by(Some(lights.clone()));
    let mut events: Vec<Event> = Vec::new();
    simulate_one(&mut frames, model, Seed(3), &mut events, &mut |_| ControlFlow::Continue(())).unwrap();
    (rendered.rgb.unwrap(), events)
}

/// The ideal sensor of `ln(eps + L)` with a threshold `c` and light `f` times the scene's: references are the
/// grid `V(0) + k c`. In each period after the first, as many ON events as OFF events step through the grid
/// points between the darkest and the brightest moment.
fn check_closed_form(waveform: Waveform, depth: f64, decode: ChannelDecode) {
    let flicker = Flicker { hz: 100.0, depth, waveform, phase: 0.0 };
    // A first frame that is a little brighter, so that no reference is at an extreme of the flicker.
    let level = [(0.0, 0.1), (1e-3, 0.0)].map(|(t, stops)| LevelMoment { t, stops }).to_vec();
    let lights = SceneLights { flicker: Some(flicker), level };
    let front_end = FrontEnd { decode, ..FrontEnd::default() };
    let threshold = ThresholdMismatch { on: 0.05, off: 0.05, ..EsimModel::default().threshold };
    let settings = SensorSettings { front_end, ..SensorSettings::default() };
    let model = EsimModel { threshold, settings, ..EsimModel::default() };
    let (rgb, events) = still_events(&lights, &model);
    // Extremes and the start of each form, with a mean of 1.
    let [dark, bright, start] = match waveform {
        Waveform::Sine => [1.0 - depth, 1.0 + depth, 1.0],
        Waveform::Square => [1.0 - depth, 1.0 + depth, 1.0 + depth],
        Waveform::Rectified => [1.0 - depth, 1.0 + depth * (std::f64::consts::FRAC_PI_2 - 1.0), 1.0 - depth],
    };
    let mut counts = vec![[0_u32; 2]; SIZE.pixels()];
    let first = start * libm::exp2(0.1);
    // Whole periods between moments at which no form is at the start or at an extreme.
    let counted_us = 12_700..12_700 + 10_000 * i64::from(PERIODS - 2);
    for event in &events {
        if counted_us.contains(&event.t.floor_micros()) {
            let pixel = usize::from(event.y) * SIZE.width as usize + usize::from(event.x);
            counts[pixel][usize::from(event.polarity == Polarity::On)] += 1;
        }
    }
    let (mut compared, mut most) = (0, 0);
    for (pixel, colour) in rgb.pixels().iter().enumerate() {
        let level = |factor: f64| {
            let lit = colour.map(|v| srgb::encode(factor * srgb::decode(f64::from(v))));
            let seen = match decode {
                ChannelDecode::None => lit,
                ChannelDecode::Srgb => lit.map(srgb::decode),
            };
            libm::log(0.001 + 0.299 * seen[0] + 0.587 * seen[1] + 0.114 * seen[2])
        };
        let steps = [dark, bright].map(|factor| (level(factor) - level(first)) / 0.05);
        // A grid point that the extreme touches within rounding may or may not be crossed.
        if steps.iter().any(|step| (step - step.round()).abs() < 2e-3) {
            continue;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "small numbers of events"
        )]
        let wanted = (steps[1].floor() - steps[0].ceil()) as u32;
        compared += 1;
        most = most.max(wanted);
        let (wanted, found) = ((PERIODS - 2) * wanted, counts[pixel]);
        assert_eq!(found, [wanted; 2], "{waveform:?} {decode:?}, pixel {pixel}");
    }
    assert!(compared > 1000 && most > 5, "{compared} {most}");
}

#[test]
fn a_flickering_still_scene_has_the_events_of_the_closed_form() {
    for waveform in [Waveform::Sine, Waveform::Rectified, Waveform::Square] {
        check_closed_form(waveform, 0.5, ChannelDecode::Srgb);
        check_closed_form(waveform, 0.5, ChannelDecode::None);
    }
    // Dark once in a period: the logarithm ends at ln(eps).
    check_closed_form(Waveform::Sine, 1.0, ChannelDecode::Srgb);
}

fn lit(lights: Value) -> Value {
    let mut value = recipe("tiny");
    value["outputs"] = json!(["events", "sharp", "blur", "depth"]);
    value["trajectories"][0]["refine"] = json!({ "duration": 0.05 });
    value["blur"] = json!({ "frames": 5, "subframes": "literal" });
    if !lights.is_null() {
        value["lights"] = lights;
    }
    value
}

fn flicker() -> Value {
    json!({ "flicker": { "hz": 100, "depth": 0.6, "waveform": "rectified", "phase": 0.25 } })
}

#[test]
fn pictures_of_a_release_are_in_the_light_of_their_moment() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", lit(Value::Null).to_string());
    place.ok("release --to plain");
    place.write("recipes/tiny.yaml", lit(flicker()).to_string());
    place.ok("release --to lit");
    place.ok("audit lit");
    // Frames at different light agree by their poses and depths, and events agree with the frames.
    place.ok("check --tree lit");
    let stamps = std::fs::read_to_string(place.path("lit/tiny/base/timestamps_us.txt")).unwrap();
    let stamps: Vec<f64> = stamps.lines().map(|line| line.parse().unwrap()).collect();
    // The form of the mains, written independently: the size of a sine, with a mean of 1.
    let factor = |us: f64| {
        let sine = libm::sin(std::f64::consts::PI * (us * 1e-4 + 0.25)).abs();
        1.0 + 0.6 * (sine * std::f64::consts::FRAC_PI_2 - 1.0)
    };
    for pose in [0, 7, 30] {
        let name = |tree: &str| format!("{tree}/tiny/base/sharp/{pose:06}.png");
        let (plain, shown) = (picture(&place, &name("plain")), picture(&place, &name("lit")));
        // A channel at white may have been above it.
        let below_white =
            plain.as_flattened().iter().zip(shown.as_flattened()).filter(|(plain, _)| **plain < 255);
        for (plain, shown) in below_white {
            let light = srgb::decode(f64::from(*plain) / 255.0) * factor(stamps[pose]);
            // Both are rounded to bytes. In the dark, half a byte before is up to 3 after.
            let off = 255.0 * srgb::encode(light).min(1.0) - f64::from(*shown);
            assert!(off.abs() <= if *plain > 40 { 1.5 } else { 4.0 }, "{pose}: {plain} {shown} {off}");
        }
    }
    // A blurred frame is the mean light of its sharp frames.
    let blurred = picture(&place, "lit/tiny/base/blur/000008.png");
    let frames: Vec<Vec<[u8; 3]>> =
        (6..=10).map(|pose| picture(&place, &format!("lit/tiny/base/sharp/{pose:06}.png"))).collect();
    for (pixel, blurred) in blurred.as_flattened().iter().enumerate() {
        let lights = frames.iter().map(|frame| srgb::decode(f64::from(frame.as_flattened()[pixel]) / 255.0));
        let mean = 255.0 * srgb::encode(lights.sum::<f64>() / 5.0);
        assert!((mean - f64::from(*blurred)).abs() <= 1.1, "{pixel}: {mean} {blurred}");
    }
    let same = |name: &str| {
        let bytes = |tree: &str| std::fs::read(place.path(&format!("{tree}/tiny/base/{name}"))).unwrap();
        bytes("plain") == bytes("lit")
    };
    assert!(same("depth/000000.npy") && same("poses.txt") && !same("events.h5"));
    let card = std::fs::read_to_string(place.path("lit/README.md")).unwrap();
    assert!(card.contains("flicker of 100 Hz (rectified, depth 0.6)"), "{card}");
    let report = std::fs::read_to_string(place.path("lit/report.html")).unwrap();
    assert!(report.contains("flicker of 100 Hz (rectified, depth 0.6)"));
    place.ok("export lit --to mcap --out recording");
    let export = std::fs::read_to_string(place.path("recording/export.json")).unwrap();
    assert!(export.contains("the light of the scene changes with time"), "{export}");
}

#[test]
fn a_changed_light_makes_what_it_lights_again() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", lit(Value::Null).to_string());
    place.ok("build");
    let before = keys(&place, "recipes");
    place.write("recipes/tiny.yaml", lit(flicker()).to_string());
    let stale = |place: &Workspace| -> Vec<String> {
        let all = steps(place, "recipes").into_iter().filter(|(_, step)| step.action != "keep");
        all.map(|(name, _)| name).collect()
    };
    assert_eq!(stale(&place), ["tiny/base/blur", "tiny/base/checks", "tiny/base/events", "tiny/base/sharp"]);
    let why = place.ok("why tiny/base/sharp").stdout;
    assert!(why.contains("lights.flicker.hz"), "{why}");
    place.ok("build");
    place.write("recipes/tiny.yaml", lit(Value::Null).to_string());
    assert_eq!(keys(&place, "recipes"), before);
}

/// Frames placed for a tolerance follow a flicker that no motion shows.
#[test]
fn a_tolerance_sees_the_light() {
    let place = Workspace::new();
    let mut value = lit(flicker());
    value["outputs"] = json!(["events"]);
    value["sensor"] = json!({ "voltmeter": { "preset": "evk4", "front_end": { "decode": "srgb" } } });
    value["sampling"] = json!({ "tolerance": 0.1 });
    value["lights"]["flicker"]["hz"] = json!(400);
    let mut frames = Vec::new();
    for lights in [value["lights"].clone(), Value::Null] {
        value["lights"] = lights;
        if value["lights"].is_null() {
            value.as_object_mut().unwrap().remove("lights");
        }
        place.write("recipes/tiny.yaml", value.to_string());
        place.ok("release --replace --to out");
        let scene = std::fs::read_to_string(place.path("out/tiny/scene.json")).unwrap();
        let scene: Value = serde_json::from_str(&scene).unwrap();
        let chosen = &scene["trajectories"][0]["sampling"]["tolerance"];
        assert!(chosen["achieved"].as_f64().unwrap() <= 0.1, "{chosen}");
        frames.push(chosen["frames"].as_u64().unwrap());
    }
    // Twenty periods of 2.5 ms, with several frames each.
    assert!(frames[0] > frames[1] + 100, "{frames:?}");
}

#[test]
fn a_flicker_near_the_frame_rate_is_warned_of() {
    let place = Workspace::new();
    let mut value = lit(json!({ "flicker": { "hz": 200, "depth": 0.1 } }));
    value["outputs"] = json!(["events"]);
    place.write("recipes/tiny.yaml", value.to_string());
    let said = place.ok("build").stderr;
    assert!(said.contains("12 frames in a period of the flicker"), "{said}");
}

#[test]
fn lights_that_make_no_sense_are_refused_by_name() {
    let place = Workspace::new();
    let refused = |lights: Value, sampling: Value, because: &str| {
        let mut value = lit(lights);
        if !sampling.is_null() {
            value["sampling"] = sampling;
        }
        place.write("tiny.yaml", value.to_string());
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{because}: {}", ended.stderr);
        assert!(ended.stderr.contains(because), "{because}: {}", ended.stderr);
    };
    let with = |flicker: Value| json!({ "flicker": flicker });
    refused(json!({}), Value::Null, "has neither `flicker` nor `level`");
    refused(with(json!({ "hz": 100 })), Value::Null, "depth");
    refused(with(json!({ "depth": 0.5 })), Value::Null, "hz");
    refused(with(json!({ "hz": 100, "depth": 1.5 })), Value::Null, "wanted a number above 0 and at most 1");
    refused(with(json!({ "hz": 0, "depth": 0.5 })), Value::Null, "wanted a number from 0.001 to 100000");
    refused(with(json!({ "hz": 100, "depth": 0.5, "waveform": "saw" })), Value::Null, "rectified");
    refused(with(json!({ "hz": 1000, "depth": 0.5 })), Value::Null, "fewer than 4 in a period");
    let square = with(json!({ "hz": 100, "depth": 0.5, "waveform": "square" }));
    refused(square.clone(), json!({ "between": "catmull" }), "overshoots at the jumps");
    refused(square, json!({ "tolerance": 0.05 }), "exclude each other");
    let level = json!({ "level": [{ "t": 0.5, "stops": 0 }, { "t": 0.5, "stops": 1 }] });
    refused(level, Value::Null, "wanted above 0.5");
    refused(json!({ "level": [{ "t": 0.5 }] }), Value::Null, "stops");
}
