//! One meaning has many spellings, and numbers have exactly their written value.

use super::{recipe, said, snapshot, sound};
use gs2e_num::units::Ratio;
use gs2e_recipe::{OutputKind, ReconstructMethod, SceneSource, UpstreamOrigin};
use gs2e_render::RenderRules;
use gs2e_sensor::esim::{EsimModel, IntensityScale};
use gs2e_sensor::front_end::{ChannelDecode, FrontEnd, GreyRange, LuminanceWeights};
use gs2e_sensor::latency::PixelLatency;
use gs2e_sensor::noise::{
    FloorPoint, HotPixelNoise, NoiseFloor, RedrawRule, ReferenceRule, RefractoryPeriod, ThresholdMismatch,
};
use gs2e_sensor::readout::{ArbiterOrder, ReadoutBus};
use gs2e_sensor::v2e::{FilterSteps, LeakNoise, V2eModel};
use gs2e_sensor::voltmeter::{SamplerKind, VoltmeterModel, VoltmeterPreset};
use gs2e_sensor::{SensorChoice, SensorSet, SensorSettings, v2e};
use gs2e_source::DiskCapture;
use gs2e_source::kind::CaptureKind;
use gs2e_trajectory::path::CameraPath;
use gs2e_trajectory::refine::{RefinePath, TranslationScale};
use gs2e_trajectory::travel::PoseCount;

fn voltmeter(recipe: gs2e_recipe::Recipe) -> VoltmeterModel {
    match recipe.sensors {
        SensorSet::One(SensorChoice::Voltmeter(voltmeter)) => voltmeter,
        other => panic!("{other:?}"),
    }
}

/// The path of the first trajectory.
fn refined(recipe: &gs2e_recipe::Recipe) -> &RefinePath {
    match &recipe.trajectories[0].path {
        CameraPath::Refine(refine) => refine,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_bundled_recipes_have_their_stated_meaning() {
    let bundled = gs2e_recipe::read_all(&[gs2e_testing::repository::root().join("recipes")]);
    let recipes = bundled.unwrap_or_else(|faults| panic!("{}", faults.render_text()));
    for recipe in &recipes {
        let name = recipe.scene.replace('/', "-");
        snapshot(&format!("merged-{name}"), &serde_json::to_string_pretty(&recipe.meta.merged).unwrap());
    }
    let scenes: Vec<&str> = recipes.iter().map(|r| r.scene.as_str()).collect();
    assert_eq!(scenes, ["procedural/paper-scale", "procedural/still-life"]);
}

#[test]
fn spelling_changes_nothing() {
    let plain = "version: 1\nscene: a/b\nseed: 7\nsource:\n  procedural:\n    kind: still-life\n    arc: 20\n\
                 trajectories:\n  - name: base\n    refine:\n      window: 2\n      factor: 1.1\n    speed:\n      \
                 function: 1 + t\nsampling:\n  rate: 2400\nsensor:\n  voltmeter:\n    preset: dvs346\n    threshold:\n      on: 0.5\n\
                 outputs:\n  - events\n  - sharp\nlicence:\n  expression: CC0-1.0\n  holder: Example Lab\n";
    let wanted = said(recipe(plain).unwrap());
    let t = |yaml: &str| {
        let found = recipe(yaml).unwrap_or_else(|faults| panic!("{yaml}\n{}", faults.render_text()));
        assert_eq!(said(found), wanted, "{yaml}");
    };
    t(&plain.replace('\n', "\r\n"));
    t(&format!("\u{feff}---\n# a comment\n{plain}...\n"));
    t(&plain.replace("rate: 2400", "rate: 24e2  # frames").replace("seed: 7", "seed: 7.0"));
    t(&plain.replace("on: 0.5", "on: +.50").replace("arc: 20", "arc: 2.0e1"));
    // As PyYAML, which reads YAML 1.1, writes it back.
    t(&plain.replace("on: 0.5", "true: 0.5"));
    t(&plain.replace("factor: 1.1", "factor: 11/10").replace("scene: a/b", "scene: 'a/b'"));
    t(&plain
        .replace("factor: 1.1", "factor: \"1.10\"")
        .replace("function: 1 + t", "function: |-\n        1 + t"));
    t(&plain.replace("- events\n  - sharp", "- sharp\n  - events"));
    t(
        "licence: { holder: \"Example Lab\", expression: 'CC0-1.0' }\nsensor: { voltmeter: { preset: dvs346-paper, threshold: { on: 5e-1 } } }\n\
       outputs: [sharp, events]\nsampling: { rate: 2400.000 }\nseed: 0x7\ntrajectories: [{ speed: { function: \"1 + t\" }, \
       refine: { factor: 1.1, window: 2.0 }, name: base }]\nsource: { procedural: { arc: 20 } }\nscene: a/b\nversion: 1.0\n",
    );
    t(
        "{\"version\": 1, \"scene\": \"a/b\", \"seed\": 7, \"source\": {\"procedural\": {}}, \"trajectories\": [{\"name\": \
       \"base\", \"refine\": {\"factor\": \"11/10\"}, \"speed\": {\"function\": \"1 + t\"}}], \"sensor\": {\"voltmeter\": \
       {\"preset\": \"dvs346\", \"threshold\": {\"on\": 0.5}}}, \"licence\": {\"expression\": \"CC0-1.0\", \"holder\": \"Example Lab\"}}",
    );
}

#[test]
fn absent_keys_follow_the_paper_with_a_measured_sensor() {
    let recipe = sound("");
    assert_eq!(recipe.seed, 0);
    assert_eq!(recipe.rate.0, Ratio::new(2400, 1).unwrap());
    assert_eq!(recipe.outputs, [OutputKind::Events, OutputKind::Sharp].into());
    let (refine, speed) = (refined(&recipe), &recipe.trajectories[0].speed);
    assert_eq!((refine.window, refine.count), (2, PoseCount::Factor(Ratio::new(5, 1).unwrap())));
    // A.1: the speed at both ends of the sequence.
    let law = speed.as_law();
    assert!((law.speed(0.0) - 1.1).abs() < 1e-15, "{}", law.speed(0.0));
    assert!((law.speed(1.0) - 1.310_367_746_201_974).abs() < 1e-15, "{}", law.speed(1.0));
    assert_eq!(voltmeter(recipe), VoltmeterPreset::Davis346.model());
}

#[test]
fn ratios_are_exactly_the_written_values() {
    // A sensor with little noise, of which a frame interval of 10 s may have many events.
    let quiet = "sensor: { esim: {} }";
    let rate = |text: &str| sound(&format!("sampling: {{ rate: {text} }}\n{quiet}")).rate.0;
    let t = |text: &str, n, d| assert_eq!(rate(text), Ratio::new(n, d).unwrap(), "{text}");
    t("2400", 2400, 1);
    t("23.976", 2997, 125);
    t("30000/1001", 30_000, 1001);
    t("'30000/1001'", 30_000, 1001);
    t("59.94", 2997, 50);
    // As floats both would be 0.1.
    t("0.1", 1, 10);
    t("0.10000000000000001", 10_000_000_000_000_001, 100_000_000_000_000_000);
}

#[test]
fn units_are_converted_and_presets_are_numbers() {
    let t = |yaml: &str, wanted: [f64; 6]| {
        let found = voltmeter(sound(&format!("sensor: {{ voltmeter: {{ {yaml} }} }}"))).k;
        for (found, wanted) in found.into_iter().zip(wanted) {
            assert!((found - wanted).abs() <= 1e-6 * wanted, "{yaml}: {found:e}, wanted {wanted:e}");
        }
    };
    // The table of docs/design/numerics-sensor.md, "Units and presets", in official units.
    let dvs240 = [4.42411, 23.0, 2e-4, 1e-7, 5e-8, 1e-5];
    let gs2e_si = [0.5, 0.255, 1.596_872e-3, 1e-8, 3.921_569e-10, 1e-8];
    t("preset: dvs240", dvs240);
    t("k: [4.42411, 23, 2e-4, 1e-7, 5e-8, 1e-5], units: { time: us, brightness: 255 }", dvs240);
    t("preset: gs2e-si", gs2e_si);
    t("k: [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5], units: { time: s, brightness: 1 }", gs2e_si);
}

#[test]
fn a_value_may_be_named_and_used_again() {
    let found = voltmeter(sound(
        "sensor: { voltmeter: { preset: dvs240, threshold: { on: &theta 0.7, off: *theta } } }",
    ));
    assert_eq!(
        (found.threshold_on.to_bits(), found.threshold_off.to_bits()),
        (0.7_f64.to_bits(), 0.7_f64.to_bits())
    );
}

#[test]
fn names_that_look_like_numbers_are_names() {
    // Instances of MVImgNet have names such as these.
    for name in ["11/16009258", "12/0e12", "13/1.10"] {
        let yaml =
            "version: 1\nscene: NAME\nsource: { procedural: {} }\ntrajectories: [{ name: 007, refine: {} }]";
        let recipe = recipe(&yaml.replace("NAME", name)).unwrap();
        assert_eq!((recipe.scene.as_str(), recipe.trajectories[0].name.as_str()), (name, "007"));
    }
}

#[test]
fn paths_start_at_the_file_that_names_them() {
    let root = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let file = root.path().join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    };
    write(
        "defaults.yaml",
        "reconstruct: { given: { path: scenes/a.ply } }\ntrajectories: [{ name: base, refine: {} }]\n",
    );
    write("sub/a.yaml", "version: 1\nscene: a\nsource: { colmap: { path: ../capture } }\n");
    write("sub/b.yaml", "version: 1\nscene: b\nsource: { nerfstudio: { path: /abs/transforms.json } }\n");
    let recipes = gs2e_recipe::read_all(&[root.path().to_owned()]).unwrap();
    let whole =
        |kind, path| SceneSource::Captured(DiskCapture::all_views(kind, path), UpstreamOrigin::default());
    assert_eq!(recipes[0].source, whole(CaptureKind::Colmap, root.path().join("sub/../capture")));
    assert_eq!(recipes[1].source, whole(CaptureKind::Nerfstudio, "/abs/transforms.json".into()));
    assert_eq!(recipes[0].reconstruct, Some(ReconstructMethod::Given(root.path().join("scenes/a.ply"))));
    // The path is kept as written, so that a release is the same in every folder.
    assert_eq!(recipes[0].meta.merged["source"]["colmap"]["path"], "../capture");
    assert_eq!(recipes[0].meta.merged["reconstruct"]["given"]["path"], "scenes/a.ply");
    let named = recipes[0].meta.named_at.reconstruct.as_ref().unwrap();
    assert!(named.file.ends_with("/defaults.yaml"), "{named}");
    assert_eq!((named.line, named.column), (1, 14));
}

#[test]
fn the_merged_form_is_a_recipe_that_means_the_same() {
    let everything = "seed: 18446744073709551615\ncamera: { width: 640, height: 360, fx: 500, fy: 500.5, cx: 320, cy: 180 }\n\
        sampling: { rate: 30000/1001 }\nrender: { rules: exact, antialiased: true, background: [0.1, 0.2, 0.3] }\n\
        sensor: { voltmeter: { k: [0.5, 1e-3, 0.1, 0.01, 0.1, 1e-5], units: { time: s, brightness: 1 }, gain: midpoint, \
        threshold: { on: 0.3, off: 0.4 }, max_events_per_pixel_frame: 5 } }\noutputs: [sharp]\nsharp: { every: 3 }\n\
        checks: { waive: [{ check: sampling, because: a test }] }\n\
        licence: { expression: MIT OR LicenseRef-Own, holder: Example Lab }\n";
    for more in ["", everything] {
        let first = sound(more);
        let again = recipe(&serde_json::to_string_pretty(&first.meta.merged).unwrap())
            .unwrap_or_else(|faults| panic!("{}", faults.render_text()));
        assert_eq!(said(again), said(first));
    }
}

/// Checks that a sensor's recipe has this meaning, and its canonical form too.
fn check_sensor(yaml: &str, wanted: SensorChoice) {
    let found = sound(&format!("sensor: {yaml}"));
    assert_eq!(found.sensors, SensorSet::One(wanted), "{yaml}");
    let again = recipe(&found.meta.merged.to_string()).unwrap_or_else(|f| panic!("{}", f.render_text()));
    assert_eq!(said(again), said(found), "{yaml}");
}

#[test]
fn front_ends_are_read() {
    let t = check_sensor;
    let seen = FrontEnd {
        luminance: LuminanceWeights::from_weights([0.2, 0.7, 0.1]).unwrap(),
        decode: ChannelDecode::Srgb,
        exposure: 2.5,
        range: GreyRange { min: 1.0, max: Some(200.0) },
        lux: None,
    };
    let words = "front_end: { luminance: { weights: [0.2, 0.7, 0.1] }, decode: srgb, exposure: 2.5, \
                 range: { min: 1, max: 200 } }";
    t(
        &format!("{{ voltmeter: {{ preset: dvs346-paper, {words} }} }}"),
        SensorChoice::Voltmeter(VoltmeterModel {
            settings: SensorSettings { front_end: seen, ..SensorSettings::default() },
            ..VoltmeterModel::new(VoltmeterPreset::Dvs346.k())
        }),
    );
    t(
        &format!("{{ esim: {{ {words} }} }}"),
        SensorChoice::Esim(EsimModel {
            settings: SensorSettings { front_end: seen, ..SensorSettings::default() },
            ..EsimModel::default()
        }),
    );
    let rec709 = FrontEnd { luminance: LuminanceWeights::Rec709, ..FrontEnd::default() };
    for luminance in ["rec709", "{ weights: [0.2126, 0.7152, 0.0722] }"] {
        t(
            &format!("{{ v2e: {{ front_end: {{ luminance: {luminance} }} }} }}"),
            SensorChoice::V2e(V2eModel {
                settings: SensorSettings {
                    front_end: rec709,
                    ..V2eModel::from(v2e::V2ePreset::Clean).settings
                },
                ..V2eModel::from(v2e::V2ePreset::Clean)
            }),
        );
    }
}

#[test]
fn presets_in_lux_follow_the_light_of_white() {
    let t = check_sensor;
    t("{ voltmeter: { preset: dvs346-paper } }", VoltmeterPreset::Dvs346.model().into());
    t("{ voltmeter: { preset: evk4 } }", VoltmeterPreset::Evk4.model().into());
    t(
        "{ voltmeter: { preset: davis346, front_end: { lux: 10 }, threshold: { spread: 0 }, floor: [] } }",
        SensorChoice::Voltmeter(VoltmeterModel {
            threshold_spread: 0.0,
            floor: NoiseFloor::default(),
            ..VoltmeterPreset::Davis346.model_at(10.0)
        }),
    );
    t(
        "{ voltmeter: { preset: dvs346, floor: [{ lux: 2, on: 0.5 }], refractory: { period_us: 5 } } }",
        SensorChoice::Voltmeter(VoltmeterModel {
            floor: NoiseFloor(vec![FloorPoint { lux: 2.0, on: 0.5, off: 0.0 }]),
            settings: SensorSettings {
                refractory: RefractoryPeriod { period_us: 5.0, reference: ReferenceRule::Passing },
                front_end: FrontEnd { lux: Some(250.0), ..FrontEnd::default() },
                ..VoltmeterPreset::Dvs346.model().settings
            },
            ..VoltmeterPreset::Dvs346.model()
        }),
    );
}

#[test]
fn all_sensors_are_read() {
    let t = check_sensor;
    let dvs346 = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
    let hot_pixels = HotPixelNoise { share: 0.001, rate: 20.0, ..HotPixelNoise::default() };
    let official = VoltmeterModel { law: SamplerKind::Official, ..dvs346 };
    t("{ voltmeter: { preset: dvs346-paper, law: official } }", SensorChoice::Voltmeter(official.clone()));
    t(
        "{ voltmeter: { preset: dvs346-paper, law: official, threshold: { spread: 0.1 }, hot_pixels: { share: 1e-3, rate: 20 }, allow_cap: true, \
         labels: true } }",
        SensorChoice::Voltmeter(VoltmeterModel {
            threshold_spread: 0.1,
            settings: SensorSettings { hot_pixels, allow_cap: true, labels: true, ..official.settings },
            ..official
        }),
    );
    t("{ esim: {} }", SensorChoice::Esim(EsimModel::default()));
    t(
        "{ esim: { threshold: { on: 0.3, spread: 0.02 }, mismatch: per-frame, intensity: linear, eps: 0.01, \
         refractory: { period_us: 100, reference: at-end }, hot_pixels: { share: 0.001, rate: 20 }, \
         max_events_per_pixel_frame: 7, allow_cap: true, labels: true, \
         latency: { us: 100, jitter_us: 10, tau_us: 40 }, readout: { rate_mev_s: 12, arbiter: columns, queue: 9 } } }",
        SensorChoice::Esim(EsimModel {
            threshold: ThresholdMismatch { on: 0.3, off: 0.2, spread: 0.02 },
            mismatch: RedrawRule::PerFrame,
            intensity: IntensityScale::Linear,
            eps: 0.01,
            settings: SensorSettings {
                refractory: RefractoryPeriod { period_us: 100.0, reference: ReferenceRule::AtEnd },
                hot_pixels,
                max_events_per_pixel_frame: 7,
                allow_cap: true,
                front_end: FrontEnd { lux: Some(250.0), ..FrontEnd::default() },
                labels: true,
                latency: Some(PixelLatency { us: 100.0, jitter_us: 10.0, tau_us: 40.0, max_us: 1e4 }),
                readout: Some(ReadoutBus {
                    rate_mev_s: 12.0,
                    arbiter: ArbiterOrder::Columns,
                    queue: Some(9),
                }),
            },
        }),
    );
    t("{ v2e: {} }", SensorChoice::V2e(V2eModel::from(v2e::V2ePreset::Clean)));
    let noisy = V2eModel::from(v2e::V2ePreset::Noisy);
    let refractory = RefractoryPeriod { period_us: 10.0, ..noisy.settings.refractory };
    t("{ v2e: { preset: noisy, labels: true } }", SensorChoice::V2e(noisy.clone()).with_labels());
    t("{ v2e: { preset: noisy, labels: false } }", SensorChoice::V2e(noisy.clone()));
    t(
        "{ v2e: { preset: noisy, cutoff: 100, filter: euler, leak: { rate: 0.5 }, refractory: { period_us: 10 } } }",
        SensorChoice::V2e(V2eModel {
            cutoff: 100.0,
            filter: FilterSteps::Euler,
            leak: LeakNoise { rate: 0.5, ..noisy.leak },
            settings: SensorSettings { refractory, ..noisy.settings },
            ..noisy
        }),
    );
}

#[test]
fn all_rules_of_rendering_are_read() {
    for (word, wanted) in [
        ("official", RenderRules::Official),
        ("exact", RenderRules::Exact),
        ("gsplat", RenderRules::Gsplat),
        ("soft", RenderRules::Soft),
    ] {
        let found = sound(&format!("render: {{ rules: {word} }}"));
        assert_eq!((found.render.rules, &found.meta.merged["render"]["rules"]), (wanted, &word.into()));
        let again = recipe(&found.meta.merged.to_string()).unwrap_or_else(|f| panic!("{}", f.render_text()));
        assert_eq!(said(again), said(found), "{word}");
    }
    assert_eq!(sound("").render.rules, RenderRules::Official);
}

#[test]
fn all_ways_of_refining_are_read() {
    let refine = |text: &str| {
        let yaml = "version: 1\nscene: a\nsource: { procedural: {} }\ntrajectories: [{ name: b, refine: { REFINE } }]";
        let recipe = recipe(&yaml.replace("REFINE", text)).unwrap_or_else(|f| panic!("{}", f.render_text()));
        let text = serde_json::to_string(&recipe.meta.merged).unwrap();
        assert_eq!(said(super::recipe(&text).unwrap()), said(recipe.clone()), "{text}");
        refined(&recipe).clone()
    };
    assert_eq!(refine("frames: 150").count, PoseCount::Frames(150));
    assert_eq!(refine("duration: 0.0625").count, PoseCount::Duration(Ratio::new(1, 16).unwrap()));
    assert_eq!(refine("metric: { scale: none }").scale, TranslationScale::None);
    assert_eq!(refine("metric: { scale: 2.5 }").scale, TranslationScale::Fixed(2.5));
    let other = refine(
        "window: 0, order: nearest, rotation: slerp-midpoint, ends: pinned, gaps: refuse, literal: true",
    );
    let usual = refine("");
    assert!(other.window != usual.window && other.order != usual.order && other.rotation != usual.rotation);
    assert!(other.ends != usual.ends && other.gaps != usual.gaps && other.literal != usual.literal);
}

#[test]
fn the_papers_preset_is_what_the_paper_does() {
    let long = "version: 1\nscene: a\nsource: { procedural: {} }\ntrajectories: [{ name: base, refine: { window: 2, factor: 5 }, \
                speed: { function: \"0.25*sin(t) + 1.1\" } }]\nsampling: { rate: 2400, between: linear }\nrender: { rules: official }\n\
                sensor: { voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } } }\noutputs: [events, sharp]\n";
    let short = "version: 1\nscene: a\nsource: { procedural: {} }\ntrajectories: [{ name: base, refine: {} }]\npreset: paper\n";
    assert_eq!(said(recipe(short).unwrap()), said(recipe(long).unwrap()));
    let other = short.replace("paper", "papers");
    assert!(recipe(&other).unwrap_err().render_text().contains("preset"), "another name is refused");
    // The recipe's own keys override the preset.
    let own = recipe(&format!("{short}sampling: {{ rate: 1200 }}\n")).unwrap();
    assert_eq!(own.rate.0, Ratio::new(1200, 1).unwrap());
    // Without trajectories the preset brings the paper's two.
    let bare = recipe("version: 1\nscene: a\nsource: { procedural: {} }\npreset: paper\n").unwrap();
    assert_eq!(bare.trajectories.len(), 1 + 3);
}

#[test]
fn a_preset_stands_above_the_defaults_of_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("defaults.yaml", "seed: 5\nsampling: { tolerance: 0.1 }\noutputs: [depth]\n");
    write("a.yaml", "version: 1\nscene: a\nsource: { procedural: {} }\npreset: paper\n");
    write(
        "b.yaml",
        "version: 1\nscene: b\nsource: { procedural: {} }\ntrajectories: [{ name: base, refine: {} }]\n",
    );
    let recipes = gs2e_recipe::read_all(&[folder.path().to_owned()]).unwrap();
    let merged = |i: usize| &recipes[i].meta.merged;
    assert_eq!(merged(0)["sampling"]["tolerance"], serde_json::Value::Null);
    assert_eq!(
        (&merged(0)["outputs"], &merged(0)["seed"]),
        (&serde_json::json!(["events", "sharp"]), &5.into())
    );
    assert_eq!(merged(1)["sampling"]["tolerance"], serde_json::json!(0.1));
}

#[test]
fn durations_may_name_their_unit() {
    let t = |text: &str| {
        let yaml = format!(
            "version: 1\nscene: a\nsource: {{ procedural: {{}} }}\ntrajectories: [{{ name: base, refine: {{ duration: {text} }} }}]\n"
        );
        recipe(&yaml).map(|recipe| refined(&recipe).count)
    };
    let wanted = PoseCount::Duration(Ratio::new(2, 1).unwrap());
    for text in ["2", "2 s", "2s", "2000 ms", "2000ms"] {
        assert_eq!(t(text).unwrap(), wanted, "{text}");
    }
    for text in ["2 m", "s", "2 s s", "-1 s", "0 s"] {
        assert!(t(text).is_err(), "{text}");
    }
}
