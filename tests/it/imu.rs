//! Inertial data: a strap-down integrator of this test returns the path, noise has its densities, and the
//! files are part of a release.

use crate::support::steps::{recipe, steps};
use crate::support::workspace::Workspace;
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::seed::Seed;
use gs2e_num::units::{Hertz, Ratio};
use gs2e_trajectory::imu::{AxisErrors, AxisModel, GRAVITY, ImuModel, ImuSample, ImuSampler};
use gs2e_trajectory::sampled::SampledPath;
use serde_json::{Value, json};

/// Position, velocity and rotation.
#[derive(Debug, Clone, Copy)]
struct State {
    p: DVec3,
    v: DVec3,
    q: DQuat,
}

/// A measurement: body rate and specific force.
type Measured = (DVec3, DVec3);

impl State {
    fn rate(self, (w, a): Measured, gravity: DVec3) -> Self {
        let turn = self.q * DQuat::from_xyzw(0.5 * w.x, 0.5 * w.y, 0.5 * w.z, 0.0);
        Self { p: self.v, v: self.q * a + gravity, q: turn }
    }

    fn plus(self, h: f64, rate: Self) -> Self {
        Self { p: self.p + h * rate.p, v: self.v + h * rate.v, q: self.q + rate.q * h }
    }

    /// A step of the classical fourth order over three measurements: at its start, middle and end.
    fn step(self, h: f64, [start, middle, end]: [Measured; 3], gravity: DVec3) -> Self {
        let k1 = self.rate(start, gravity);
        let k2 = self.plus(h / 2.0, k1).rate(middle, gravity);
        let k3 = self.plus(h / 2.0, k2).rate(middle, gravity);
        let k4 = self.plus(h, k3).rate(end, gravity);
        let sum = [(k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)];
        let next = sum.into_iter().fold(self, |state, (k, weight)| state.plus(weight * h / 6.0, k));
        Self { q: next.q.normalize(), ..next }
    }
}

/// Distance and angle from the truth after integration from the first sample to the last.
fn missed(samples: &[(f64, Measured)], first: State, last: &State, gravity: DVec3) -> (f64, f64) {
    let mut state = first;
    for three in samples.windows(3).step_by(2) {
        let h = three[2].0 - three[0].0;
        state = state.step(h, [three[0].1, three[1].1, three[2].1], gravity);
    }
    let turn = state.q.conjugate() * last.q;
    ((state.p - last.p).length(), 2.0 * DVec3::new(turn.x, turn.y, turn.z).length())
}

fn truth(sample: &ImuSample) -> State {
    let Se3 { rotation, translation } = sample.state.world_from_body;
    State { p: translation, v: sample.state.velocity, q: rotation }
}

/// A body that swings and turns about changing axes.
fn tumbling(t: f64) -> Se3 {
    let turn = DQuat::from_rotation_z(2.0 * t) * DQuat::from_rotation_x(0.8 * libm::sin(3.0 * t));
    Se3 {
        rotation: turn,
        translation: DVec3::new(libm::sin(2.0 * t), libm::cos(5.0 * t), 0.3 * libm::sin(4.0 * t)),
    }
}

#[test]
fn the_integrated_path_is_met_with_the_fourth_power_of_the_step() {
    let times: Vec<f64> = (0..=19_200).map(|j| f64::from(j) / 9600.0).collect();
    let poses: Vec<Se3> = times.iter().map(|t| tumbling(*t)).collect();
    let path = SampledPath::with_end_rates(&poses, times).unwrap();
    let errors = [25, 50, 100].map(|rate| {
        let model = ImuModel {
            rate: Hertz(Ratio::new(rate, 1).unwrap()),
            gyroscope: AxisModel::IDEAL,
            accelerometer: AxisModel::IDEAL,
            gravity: GRAVITY,
            up: None,
            metres_per_unit: 2.0,
        };
        let mut sampler = ImuSampler::new(&model, &path, DVec3::new(0.2, -0.1, 1.0), Seed(1));
        let gravity = sampler.gravity();
        let samples: Vec<ImuSample> = (&mut sampler).collect();
        let measured: Vec<(f64, Measured)> =
            samples.iter().map(|s| (s.t_ns as f64 * 1e-9, (s.gyroscope, s.accelerometer))).collect();
        missed(&measured, truth(&samples[0]), &truth(samples.last().unwrap()), gravity)
    });
    for (coarse, fine) in errors.iter().zip(&errors[1..]) {
        let orders = [coarse.0 / fine.0, coarse.1 / fine.1].map(libm::log2);
        assert!(orders.iter().all(|order| (3.5..4.7).contains(order)), "{orders:?} {errors:?}");
    }
    // The fifth derivative of the position, 2 m times 5^5, over a step of 20 ms and 2 s of path.
    assert!(errors[2].0 < 2.0 * 3125.0 * 0.02f64.powi(4) * 2.0 / 120.0, "{errors:?}");
}

/// Allan deviation of samples at spans of `n` samples of `dt` seconds, without overlap.
fn allan(samples: &[f64], n: usize) -> f64 {
    let means: Vec<f64> = samples.chunks_exact(n).map(|chunk| chunk.iter().sum::<f64>() / n as f64).collect();
    let squares: f64 = means.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    (squares / (2.0 * (means.len() - 1) as f64)).sqrt()
}

#[test]
fn ten_million_samples_have_the_densities_of_the_model() {
    let (rate, count) = (1000.0, 10_000_000 / 3);
    let (noise, walk) = (2.0e-3, 3.0e-2);
    let errors = |axes| {
        let mut errors = AxisErrors::new(axes, rate, 0, Seed(5));
        let mut axes = [Vec::new(), Vec::new(), Vec::new()];
        for _ in 0..count {
            let value = errors.show(DVec3::ZERO).0.to_array();
            axes.iter_mut().zip(value).for_each(|(axis, value)| axis.push(value));
        }
        axes
    };
    let mean = |deviations: Vec<f64>| {
        (deviations.iter().map(|d| d * d).sum::<f64>() / deviations.len() as f64).sqrt()
    };
    // White noise: the deviation at a span of tau seconds is N / sqrt(tau). With 3.3e6 samples and spans of
    // 10, the variance is known to 0.2 %.
    let white = errors(AxisModel { noise, ..AxisModel::IDEAL });
    let found = mean(white.iter().map(|axis| allan(axis, 10)).collect()) * (10.0 / rate).sqrt();
    assert!((found / noise - 1.0).abs() < 0.03, "{found}");
    // A random walk: the deviation is K sqrt(tau / 3).
    let walking = errors(AxisModel { walk, ..AxisModel::IDEAL });
    let found = mean(walking.iter().map(|axis| allan(axis, 200)).collect()) / (200.0 / rate / 3.0).sqrt();
    assert!((found / walk - 1.0).abs() < 0.03, "{found}");
}

#[test]
fn biases_at_the_start_have_their_deviation() {
    let axes = AxisModel { bias: 0.5, ..AxisModel::IDEAL };
    let squares: f64 =
        (0..4000).map(|seed| AxisErrors::new(axes, 1000.0, 3, Seed(seed)).bias.length_squared()).sum();
    // 12,000 draws: the deviation is known to 0.65 %, and this allows four times that.
    assert!(((squares / 12_000.0).sqrt() / 0.5 - 1.0).abs() < 0.026, "{squares}");
}

fn with_imu(outputs: &[&str], imu: Value) -> Value {
    let mut value = recipe("tiny");
    value["outputs"] = json!(outputs);
    value["imu"] = imu;
    value["scale"] = json!({ "metres_per_unit": 0.5 });
    value
}

/// The columns of a file, without its first line.
fn columns(place: &Workspace, name: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(place.path(name)).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|v| v.parse().unwrap()).collect()).collect()
}

fn vector(row: &[f64]) -> DVec3 {
    DVec3::new(row[0], row[1], row[2])
}

#[test]
fn a_release_has_inertial_data_that_integrate_to_its_path() {
    let place = Workspace::new();
    let ideal = json!({ "preset": "ideal", "rate": 2000, "up": [0, -1, 0] });
    let mut value = with_imu(&["imu"], ideal);
    // 1,201 poses through six views.
    value["trajectories"][0]["refine"] = json!({ "duration": 0.5 });
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("release --to out");
    place.ok("audit out");
    let (samples, states) =
        (columns(&place, "out/tiny/base/imu/imu.csv"), columns(&place, "out/tiny/base/imu/state.csv"));
    assert_eq!(samples.len(), states.len());
    let measured: Vec<(f64, Measured)> =
        samples.iter().map(|row| (row[0] * 1e-9, (vector(&row[1..4]), vector(&row[4..7])))).collect();
    let state = |row: &[f64]| State {
        p: vector(&row[1..4]),
        v: vector(&row[8..11]),
        q: DQuat::from_xyzw(row[5], row[6], row[7], row[4]),
    };
    // An even number of intervals, for steps over two.
    let last = (samples.len() - 1) / 2 * 2;
    let sensor = std::fs::read_to_string(place.path("out/tiny/base/imu/sensor.yaml")).unwrap();
    assert!(sensor.contains("rate_hz: 2000\n") && sensor.contains("gravity: [-0, 9.80665, -0]"), "{sensor}");
    let gravity = DVec3::new(0.0, GRAVITY, 0.0);
    let found = missed(&measured[..=last], state(&states[0]), &state(&states[last]), gravity);
    // Steps of 1 ms. Only the six views, where the third derivative jumps, leave more than rounding.
    assert!(found.0 < 1e-7 && found.1 < 1e-7, "{found:?}");
    // The first state is the first pose of the release, in metres.
    let poses = std::fs::read_to_string(place.path("out/tiny/base/poses.txt")).unwrap();
    let first: Vec<f64> =
        poses.lines().next().unwrap().split_whitespace().map(|v| v.parse().unwrap()).collect();
    assert!((vector(&first[1..4]) * 0.5 - vector(&states[0][1..4])).length() < 1e-12);
    let card = std::fs::read_to_string(place.path("out/README.md")).unwrap();
    assert!(card.contains("imu/imu.csv") && card.contains("scene.imu()"), "{card}");
}

#[test]
fn events_are_the_same_with_and_without_inertial_data() {
    let place = Workspace::new();
    let events = |outputs: &[&str]| {
        place.write("tiny.yaml", with_imu(outputs, json!({})).to_string());
        place.ok("release --to out tiny.yaml");
        std::fs::read(place.path("out/tiny/base/events.h5")).unwrap()
    };
    assert_eq!(events(&["events", "imu"]), events(&["events"]));
}

#[test]
fn a_changed_sensor_makes_its_data_and_their_checks_alone() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", with_imu(&["events", "imu"], json!({})).to_string());
    place.ok("build");
    place
        .write("recipes/tiny.yaml", with_imu(&["events", "imu"], json!({ "preset": "mpu6500" })).to_string());
    let stale: Vec<String> = steps(&place, "recipes")
        .into_iter()
        .filter(|(_, step)| step.action != "keep")
        .map(|(name, _)| name)
        .collect();
    assert_eq!(stale, ["tiny/base/checks", "tiny/base/imu"]);
    let why = place.ok("why tiny/base/imu").stdout;
    assert!(why.contains("gyroscope.noise"), "{why}");
}

#[test]
fn inertial_data_need_no_scene_and_altered_ones_are_found() {
    let place = Workspace::new();
    let mut value = with_imu(&["imu"], json!({ "up": [0, 0, 1] }));
    value["source"] = json!("none");
    value["camera"] = json!({ "width": 48, "height": 32, "fx": 40 });
    value["trajectories"] = json!([{
        "name": "base",
        "keyframes": {
            "poses": [
                { "position": [0, 0, -4], "look_at": [0, 0, 0], "up": [0, 1, 0] },
                { "position": [1, 0, -4], "look_at": [0, 0, 0], "up": [0, 1, 0] },
                { "position": [1, 1, -4], "look_at": [0, 0, 0], "up": [0, 1, 0] },
            ],
            "duration": 0.1,
        },
    }]);
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("release --to out");
    place.ok("audit out");
    let path = place.path("out/tiny/base/imu/imu.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    std::fs::write(&path, text.replacen("\n1000000,", "\n0,", 1)).unwrap();
    let ended = place.gs2e("audit out");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
}

#[test]
fn recipes_without_what_they_need_are_refused_by_name() {
    let place = Workspace::new();
    let refused = |value: Value, because: &str| {
        place.write("tiny.yaml", value.to_string());
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        assert!(ended.stderr.contains(because), "{because}: {}", ended.stderr);
    };
    let mut value = with_imu(&["imu"], json!({}));
    value.as_object_mut().unwrap().remove("scale");
    refused(value, "the output imu needs scale");
    refused(with_imu(&["imu"], json!({ "rate": 200_000 })), "wanted a number from 1 to 100000");
    refused(with_imu(&["imu"], json!({ "up": [0, 0, 0] })), "is no direction");
    refused(with_imu(&["imu"], json!({ "preset": "mpu" })), "mpu6500");
    let mut value = with_imu(&["imu"], json!({}));
    value["scale"] = json!({ "metres_per_unit": 0 });
    refused(value, "wanted a number above 0");
    let mut value = with_imu(&["imu"], json!({}));
    value["source"] = json!("none");
    value["camera"] = json!({ "width": 48, "height": 32, "fx": 40 });
    let poses = json!([{ "position": [0, 0, -4], "look_at": [0, 0, 0], "up": [0, 1, 0] }, { "position": [1, 0, -4], "look_at": [0, 0, 0], "up": [0, 1, 0] }]);
    value["trajectories"] = json!([{ "name": "base", "keyframes": { "poses": poses, "duration": 0.1 } }]);
    refused(value, "the output imu needs imu.up");
}
