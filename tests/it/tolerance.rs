//! `sampling: { tolerance }`: frames only where the sensor needs them.

use crate::support::workspace::Workspace;
use glam::DVec3;
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::seed::Seed;
use gs2e_render::backend::Backend;
use gs2e_render::sample::TileSample;
use gs2e_render::{LayerOrder, RenderRules, RenderStyle, Renderer};
use gs2e_sampling::choose::ChoiceQuestion;
use gs2e_sampling::flow::PathFlow;
use gs2e_sampling::measure::{PathViewer, SensorScale};
use gs2e_sampling::scout::ScoutRenderer;
use gs2e_sampling::{ErrorTolerance, PilotMethod};
use gs2e_scene::camera::Camera;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel, VoltmeterPreset};
use gs2e_trajectory::sampled::SampledPath;
use std::fs;
use std::sync::Arc;

/// The sensor of the recipe. Its figures are pinned.
const SENSOR: &str = "sensor: { voltmeter: { preset: dvs346-paper } }\n";

/// A recipe with this sampling, over 0.1 s with a fast passage in the middle.
fn recipe(sampling: &str) -> String {
    format!(
        "version: 1\nscene: tiny\nseed: 7\n\
         source: {{ procedural: {{ kind: still-life, gaussians: 500, views: 6, arc: 12, seed: 1 }} }}\n\
         camera: {{ width: 64, height: 48 }}\ntrajectories:\n  - name: base\n    \
         refine: {{ window: 2, duration: 0.1, curve: cubic }}\n    \
         speed: {{ function: \"1 + 2*exp(-100*(t - 0.5)^2)\" }}\nsampling: {sampling}\n\
         {SENSOR}"
    )
}

#[test]
fn a_recipe_may_ask_for_an_error_in_place_of_a_rate() {
    let place = Workspace::new();
    place.write("tolerant.yaml", recipe("{ rate: 2400, tolerance: 0.03 }"));
    place.write("plain.yaml", recipe("{ rate: 2400, law: integral }"));
    place.ok("release --to tolerant tolerant.yaml");
    place.ok("release --to plain plain.yaml");
    place.ok("audit tolerant");
    let [tolerant, plain] = ["tolerant", "plain"].map(|tree| place.json(&format!("{tree}/tiny/scene.json")));
    let [part, other] = [&tolerant, &plain].map(|scene| &scene["trajectories"][0]);

    // Poses, stamps and pictures are those of the rate.
    for file in ["poses.txt", "timestamps_us.txt"] {
        let [a, b] =
            ["tolerant", "plain"].map(|tree| fs::read(place.path(&format!("{tree}/tiny/base/{file}"))));
        assert_eq!(a.unwrap(), b.unwrap(), "{file}");
    }
    assert_eq!(part["statistics"]["linear_unit_s"], other["statistics"]["linear_unit_s"]);

    // The chosen, predicted and measured figures.
    let listed = &part["sampling"]["tolerance"];
    let number = |name: &str| listed[name].as_f64().unwrap_or_else(|| panic!("{name}: {listed}"));
    assert!((number("tolerance") - 0.03).abs() < 1e-12);
    assert!(number("predicted") <= 0.8 * 0.03 + 1e-9 && number("bound_95") <= 0.03, "{listed}");
    assert!(number("achieved") > 0.003 && number("achieved") <= number("bound_95"), "{listed}");
    let poses = part["poses"].as_f64().unwrap();
    assert!(number("frames") < poses, "{listed}, {poses} poses");
    assert_eq!(part["sampling"]["between"], listed["between"]);
    assert_eq!(part["render_rules"]["rules"], "soft");
    assert_eq!(other["sampling"], serde_json::json!({ "rate": "2400/1", "between": "linear" }));

    // There are nearly as many events as from the many frames of the other recipe.
    let [found, wanted] = [part, other].map(|part| part["statistics"]["events"].as_f64().unwrap());
    assert!((found / wanted - 1.0).abs() < 0.05, "{found} {wanted}");
}

#[test]
fn threads_and_another_store_change_nothing() {
    let bytes = |threads: &str| {
        let place = Workspace::new();
        place.write("tolerant.yaml", recipe("{ tolerance: 0.05 }"));
        let status =
            place.command("release --to tree tolerant.yaml").env("RAYON_NUM_THREADS", threads).output();
        assert!(status.unwrap().status.success());
        ["scene.json", "base/events.h5"]
            .map(|file| fs::read(place.path(&format!("tree/tiny/{file}"))).unwrap())
    };
    assert_eq!(bytes("1"), bytes("3"));
}

#[test]
fn an_unreachable_tolerance_is_refused_with_a_reachable_one() {
    let place = Workspace::new();
    place.write("tolerant.yaml", recipe("{ tolerance: 0.0001 }"));
    let ended = place.gs2e("release --to tree tolerant.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let listed: String = ended.stderr.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(listed.contains("the tolerance of 0.0001 thresholds cannot be met here"), "{listed}");
    assert!(listed.contains("can be met; render: { rules: soft, order: blended } has fewer"), "{listed}");
    assert!(!place.path("tree").exists());
}

/// A tolerance below the sensor's own noise is built, with a warning.
#[test]
fn a_tolerance_below_the_jitter_is_warned_of() {
    let place = Workspace::new();
    let noisy = "sensor: { voltmeter: { k: [5.265, 20, 0.02, 0, 0, 0.002], units: { time: us, brightness: 255 } } }\n";
    place.write("tolerant.yaml", recipe("{ tolerance: 0.03 }").replace(SENSOR, noisy));
    let listed: String =
        place.ok("build tolerant.yaml").stderr.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(listed.contains("sampling.tolerance 0.03 is below the sensor's own jitter"), "{listed}");
}

const SIZE: Size = Size { width: 80, height: 60 };

/// An arc of 0.4 rad about the still life within 0.2 s, faster in the middle.
fn path() -> SampledPath {
    let seconds: Vec<f64> = (0..=480).map(|j| f64::from(j) / 2400.0).collect();
    let pose = |t: &f64| {
        let share = t / 0.2;
        let angle = 0.4 * (share - 0.6 * libm::sin(std::f64::consts::TAU * share) / std::f64::consts::TAU);
        let rotation = exp_vector(DVec3::new(0.0, -angle, 0.0));
        Se3 { rotation, translation: rotation * DVec3::new(0.0, -0.4, -3.0) }
    };
    SampledPath::through_poses(&seconds.iter().map(pose).collect::<Vec<_>>(), seconds).unwrap()
}

fn renderer(rules: RenderRules) -> Box<dyn Renderer> {
    let scene = procedural::still_life(&StillLife { gaussians: 1500, ..StillLife::default() });
    let style = RenderStyle { rules, order: LayerOrder::Depth, antialiased: false, background: [0.0; 3] };
    Backend::Cpu.renderer(Arc::new(scene), style).unwrap()
}

/// Time, `V` of all pixels, and its slopes.
type Levels = (f64, Vec<f64>, Vec<f64>);

fn levels(frame: &DenseFrame, k2: f64) -> Levels {
    let l = frame.luminance.pixels();
    let v = l.iter().map(|l| (f64::from(*l) + k2).ln()).collect();
    let rate = frame.rate.as_ref().unwrap().pixels();
    let slope = rate.iter().zip(l).map(|(rate, l)| f64::from(*rate) / (f64::from(*l) + k2)).collect();
    (frame.t.0 as f64 * 1e-9, v, slope)
}

/// In the middle of two even neighbours: the mean; the polynomial of the third order through four;
/// the mean and an eighth of the difference of the slopes. Elsewhere the polynomials of the same
/// data in Newton's form.
fn middle(between: BetweenFrames, four: [&Levels; 4], i: usize, t: f64) -> f64 {
    let [a, b, c, d] = four.map(|(t, v, _)| (*t, v[i]));
    let h = c.0 - b.0;
    let x = (t - b.0) / h;
    let rise = c.1 - b.1;
    let slopes = match between {
        BetweenFrames::Linear => [rise, rise],
        BetweenFrames::Hermite => [four[1].2[i] * h, four[2].2[i] * h],
        // The derivative at the middle one of three points of the parabola through them.
        BetweenFrames::Catmull => [[a, b, c], [b, c, d]].map(|[p, q, r]| {
            let [left, right] = [(q.1 - p.1) / (q.0 - p.0), (r.1 - q.1) / (r.0 - q.0)];
            let second = (right - left) / (r.0 - p.0);
            (left + second * (q.0 - p.0)) * h
        }),
    };
    // Newton's form through (0, b, slope) and (1, c, slope), each taken twice.
    b.1 + slopes[0] * x
        + (rise - slopes[0]) * x * x
        + (slopes[0] + slopes[1] - 2.0 * rise) * x * x * (x - 1.0)
}

/// The error on all intervals of the chosen frames, computed independently, agrees with the error
/// on the few held-out ones, at all pixels or at a sample of them.
#[test]
fn the_error_of_all_intervals_is_within_the_tolerance() {
    let (path, sensor) = (path(), VoltmeterModel::new(VoltmeterPreset::Dvs346.k()));
    let small = Camera { size: SIZE, fx: 75.0, fy: 75.0, cx: 40.0, cy: 30.0, lens: None };
    // 20 x 15 tiles: one of four is in a sample.
    let large = small.resized(Size { width: 320, height: 240 });
    let all = [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite];
    for (rules, rms, between, camera) in [
        (RenderRules::Soft, 0.05, &all[..], small),
        (RenderRules::Soft, 0.04, &all[2..], small),
        (RenderRules::Official, 0.06, &all[..1], small),
        (RenderRules::Soft, 0.1, &all[2..], large),
    ] {
        let flow = PathFlow::measure_path(&path, 480, 200_000, camera, &mut *renderer(rules)).unwrap();
        let front_ends = [FrontEnd::default()];
        let mut scout = ScoutRenderer::new(renderer(rules), camera, &path, &front_ends, &|| true);
        let question = ChoiceQuestion {
            tolerance: ErrorTolerance { rms, between: None, pilot: PilotMethod::default() },
            flow: &flow,
            size: camera.size,
            intervals: 480,
            scales: &[SensorScale::for_sensor(&sensor, 0)],
            between,
            seed: Seed(3),
            advice: "",
        };
        let (chosen, moments) = question.answer(&mut scout).unwrap();

        let [k1, k2, ..] = sensor.k;
        let middles = moments.windows(2).map(|pair| i64::midpoint(pair[0], pair[1]));
        let mut asked: Vec<i64> = moments.iter().copied().chain(middles).collect();
        asked.sort_unstable();
        let whole = Arc::new(TileSample::whole(camera.size));
        let asked: Vec<_> = asked.into_iter().map(|moment| (moment, whole.clone())).collect();
        let mut seen = Vec::new();
        scout.show(&asked, true, &mut |frames| seen.push(levels(&frames[0], k2))).unwrap();
        let (mut sum, mut count) = (0.0, 0);
        // Only intervals with a neighbour on both sides.
        for j in (2..seen.len() - 4).step_by(2) {
            let four = [&seen[j - 2], &seen[j], &seen[j + 2], &seen[j + 4]];
            let (t, truth, _) = &seen[j + 1];
            for (i, truth) in truth.iter().enumerate() {
                let error = k1 * (middle(chosen.between, four, i, *t) - truth);
                sum += error * error;
                count += 1;
            }
        }
        let found = (sum / f64::from(count)).sqrt();
        assert!((chosen.pilot_share < 0.3) == (camera.size != SIZE), "{chosen:?}");
        println!("{rules:?} {rms}: {found:.4} of all, {:.4} held out, {chosen:?}", chosen.achieved);
        assert!(found <= rms, "{found} of all intervals, asked for {rms}: {chosen:?}");
        // Twelve intervals of a hundred estimate the root of the mean square to a fifth or better; a
        // sample of 75 tiles adds less than that.
        assert!((found / chosen.achieved - 1.0).abs() < 0.4, "{found}: {chosen:?}");
    }
}

/// The measured flow of a known motion: a camera that turns about its own centre in front of a
/// scene.
#[test]
fn the_flow_of_a_known_motion_is_found() {
    let camera = Camera { size: SIZE, fx: 75.0, fy: 75.0, cx: 40.0, cy: 30.0, lens: None };
    // It turns at 0.5 rad/s, and three times as fast in the second half. Depth does not matter.
    let seconds: Vec<f64> = (0..=200).map(|j| f64::from(j) / 1000.0).collect();
    let angle = |t: f64| if t < 0.1 { 0.5 * t } else { 0.05 + 1.5 * (t - 0.1) };
    let from = DVec3::new(0.0, -0.4, -3.0);
    let pose = |t: &f64| Se3 { rotation: exp_vector(DVec3::new(0.0, angle(*t), 0.0)), translation: from };
    let path = SampledPath::through_poses(&seconds.iter().map(pose).collect::<Vec<_>>(), seconds).unwrap();
    let flow =
        PathFlow::measure_path(&path, 200, 200_000, camera, &mut *renderer(RenderRules::Soft)).unwrap();
    // At the left and right edges the flow is f (1 + (40/75)^2), which 99 % of the pixels do not
    // exceed, except for a column.
    for (from, to, rate) in [(10_000, 80_000, 0.5), (120_000, 190_000, 1.5)] {
        let px_s = 75.0 * (1.0 + (40.0_f64 / 75.0).powi(2)) * rate;
        let length = flow.length_about(f64::from(from + to) / 2.0, 1.0);
        let found = 1e6 / length;
        assert!((found / px_s - 1.0).abs() < 0.06, "{found} {px_s}");
    }
}
