use super::files::{SAMPLES_HEAD, is_canonical, write_sample};
use super::*;
use glam::DQuat;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::units::Ratio;

fn model(rate: u64, axes: AxisModel) -> ImuModel {
    ImuModel {
        rate: Hertz(Ratio::new(rate, 1).unwrap()),
        gyroscope: axes,
        accelerometer: axes,
        gravity: GRAVITY,
        up: None,
        metres_per_unit: 0.5,
    }
}

/// A path of poses at 1000 Hz.
fn path(pose: impl Fn(f64) -> Se3, milliseconds: u32) -> SampledPath {
    let times: Vec<f64> = (0..=milliseconds).map(|j| f64::from(j) * 1e-3).collect();
    let poses: Vec<Se3> = times.iter().map(|t| pose(*t)).collect();
    SampledPath::with_end_rates(&poses, times).unwrap()
}

#[test]
fn a_still_body_shows_gravity_and_no_rate() {
    let tilt = exp_vector(DVec3::new(0.3, -0.4, 0.2));
    let still = path(|_| Se3 { rotation: tilt, translation: DVec3::new(1.0, 2.0, 3.0) }, 100);
    let model = model(200, AxisModel::IDEAL);
    let samples: Vec<ImuSample> =
        ImuSampler::new(&model, &still, DVec3::new(0.0, 0.0, 3.0), Seed(1)).collect();
    assert_eq!(samples.len(), 21);
    for sample in samples {
        let wanted = tilt.conjugate() * DVec3::new(0.0, 0.0, GRAVITY);
        assert!((sample.accelerometer - wanted).length() < 1e-12, "{sample:?}");
        assert!(sample.gyroscope.length() < 1e-12, "{sample:?}");
        assert_eq!(sample.state.world_from_body.translation, DVec3::new(0.5, 1.0, 1.5));
    }
}

#[test]
fn a_body_on_a_circle_shows_its_turn_and_its_centripetal_force() {
    // A radius of 4 units, which are 2 m, at 3 rad/s about z; the body keeps its axes to the circle.
    let (radius, rate) = (4.0, 3.0);
    let circle = path(
        |t| {
            let turn = DQuat::from_rotation_z(rate * t);
            Se3 { rotation: turn, translation: turn * DVec3::new(radius, 0.0, 0.0) }
        },
        500,
    );
    let model = model(400, AxisModel::IDEAL);
    for sample in ImuSampler::new(&model, &circle, DVec3::Z, Seed(1)).skip(4).take(190) {
        // The spline through poses 1 ms apart misses a second derivative by h^2/12 of the fourth, 3^4 * 2 m,
        // and by terms of higher order, which are below a thousandth of that.
        let bound = 1.001 * 1e-6 / 12.0 * 162.0;
        let wanted = DVec3::new(-rate * rate * 2.0, 0.0, GRAVITY);
        assert!((sample.accelerometer - wanted).length() < bound, "{sample:?}");
        assert!((sample.gyroscope - DVec3::new(0.0, 0.0, rate)).length() < 1e-9, "{sample:?}");
        assert!((sample.state.velocity.length() - 6.0).abs() < 1e-8, "{sample:?}");
    }
}

#[test]
fn what_exceeds_the_range_is_bounded_and_counted() {
    let spin = path(|t| Se3 { rotation: DQuat::from_rotation_x(5.0 * t), translation: DVec3::ZERO }, 100);
    let model = model(100, AxisModel { range: Some(4.0), ..AxisModel::IDEAL });
    let mut sampler = ImuSampler::new(&model, &spin, DVec3::X, Seed(1));
    let samples: Vec<ImuSample> = (&mut sampler).collect();
    assert_eq!(sampler.saturated, samples.len() as u64);
    assert!(samples.iter().all(|s| s.gyroscope.x.max(s.accelerometer.x) <= 4.0 && s.gyroscope.x > 3.999));
}

#[test]
fn errors_are_a_function_of_seed_and_index() {
    let axes = AxisModel { noise: 0.1, walk: 0.2, bias: 0.3, range: None };
    let draw = |seed: u64| {
        let mut errors = AxisErrors::new(axes, 100.0, 0, Seed(seed));
        (0..5).map(|_| errors.show(DVec3::ZERO).0).collect::<Vec<_>>()
    };
    assert_eq!(draw(1), draw(1));
    assert_ne!(draw(1), draw(2));
    // A part that is off leaves the draws of the others as they are.
    let mut still = AxisErrors::new(AxisModel { walk: 0.0, ..axes }, 100.0, 0, Seed(1));
    assert_eq!(still.show(DVec3::ZERO).0, draw(1)[0]);
    // The gyroscope and the accelerometer share the seed, and no draw.
    let mut other = AxisErrors::new(axes, 100.0, 3, Seed(1));
    assert_ne!(other.show(DVec3::ZERO).0, draw(1)[0]);
}

#[test]
fn files_are_read_as_they_are_written_and_no_others() {
    let sample = ImuSample {
        t_ns: 5,
        gyroscope: DVec3::new(0.1, -2e-7, 3.0),
        accelerometer: DVec3::new(1e22, 0.0, -0.0),
        state: ImuState {
            world_from_body: Se3::IDENTITY,
            velocity: DVec3::ZERO,
            gyroscope_bias: DVec3::ZERO,
            accelerometer_bias: DVec3::ZERO,
        },
    };
    let mut file = format!("{SAMPLES_HEAD}\n").into_bytes();
    write_sample(&sample, &mut file).unwrap();
    assert!(is_canonical(&file).unwrap());
    let refused = |lines: &str, because: &str| {
        let error = is_canonical(format!("{SAMPLES_HEAD}\n{lines}").as_bytes()).unwrap_err();
        assert!(error.contains(because), "{error}");
    };
    refused("0,1,2,3,4,5,6\n0,1,2,3,4,5,6\n", "line 3: its stamp is not above the one before");
    refused("0,1,2,3,4,5,NaN\n", "line 2: a value is not a finite number");
    refused("0,1,2,3,4,5\n", "line 2: it has another number of columns");
    refused("0.5,1,2,3,4,5,6\n", "line 2: its stamp is no whole number");
    assert!(is_canonical(b"t,x\n").is_err());
    // Line ends, numbers and a missing end that this program does not write.
    let sample = String::from_utf8(file).unwrap();
    let other =
        [sample.replace('\n', "\r\n"), sample.replacen(",3,", ",3.0,", 1), sample.trim_end().to_owned()];
    for text in other {
        assert_ne!(text, sample);
        assert!(!is_canonical(text.as_bytes()).unwrap(), "{text}");
    }
}

mod against_poses {
    use super::super::consistency::{InertialLines, compare_inertial};
    use super::super::files::{STATES_HEAD, read_lines, write_state};
    use super::*;
    use crate::Trajectory;

    /// A walk with turns about all axes, at 240 poses per second.
    fn walk(t: f64) -> Se3 {
        let turn = DVec3::new(0.4 * libm::sin(5.0 * t), 0.9 * t, 0.3 * libm::cos(7.0 * t));
        let place = DVec3::new(libm::sin(3.0 * t), 0.5 * libm::cos(4.0 * t), t);
        Se3 { rotation: exp_vector(turn), translation: place }
    }

    /// Samples, states and poses of a second of the walk, as the files have them.
    fn written(rate: u64, axes: AxisModel) -> (ImuModel, [InertialLines; 2], Trajectory) {
        written_along(walk, 240, rate, axes)
    }

    fn written_along(
        walk: impl Fn(f64) -> Se3,
        poses_hz: u32,
        rate: u64,
        axes: AxisModel,
    ) -> (ImuModel, [InertialLines; 2], Trajectory) {
        let seconds: Vec<f64> = (0..=poses_hz).map(|j| f64::from(j) / f64::from(poses_hz)).collect();
        let poses: Vec<Se3> = seconds.iter().map(|t| walk(*t)).collect();
        #[expect(clippy::cast_possible_truncation, reason = "a second")]
        let stamps_us = seconds.iter().map(|t| (t * 1e6).round() as i64).collect();
        let path = SampledPath::with_end_rates(&poses, seconds).unwrap();
        let model = model(rate, axes);
        let [mut samples, mut states] =
            [SAMPLES_HEAD, STATES_HEAD].map(|head| format!("{head}\n").into_bytes());
        for sample in ImuSampler::new(&model, &path, DVec3::Y, Seed(3)) {
            write_sample(&sample, &mut samples).unwrap();
            write_state(&sample, &mut states).unwrap();
        }
        let lines = [read_lines(&samples, SAMPLES_HEAD).unwrap(), read_lines(&states, STATES_HEAD).unwrap()];
        (model, lines, Trajectory { world_from_camera: poses, stamps_us })
    }

    const NOISY: AxisModel = AxisModel { noise: 2e-3, walk: 1e-3, bias: 0.02, range: None };

    /// The comparisons that exceed what is allowed.
    fn faults(model: &ImuModel, [samples, states]: &[InertialLines; 2], poses: &Trajectory) -> Vec<String> {
        let gravity = DVec3::new(0.0, -model.gravity, 0.0);
        let found = match compare_inertial(model, samples, states, gravity, poses) {
            Ok(found) => found,
            Err(because) => return vec![because],
        };
        assert!(found.bounded.is_empty(), "{found:?}");
        found.differences.iter().filter(|found| !found.is_allowed()).map(ToString::to_string).collect()
    }

    #[test]
    fn sound_data_agree_at_any_rate_with_and_without_noise() {
        for rate in [50, 200, 1000, 4000] {
            for axes in [AxisModel::IDEAL, NOISY, AxisModel { range: Some(9.81), ..NOISY }] {
                let (model, lines, poses) = written(rate, axes);
                assert_eq!(faults(&model, &lines, &poses), [""; 0], "{rate} {axes:?}");
            }
        }
    }

    /// The first two intervals may have the same mean rate, and yet turn at a changing one.
    #[test]
    fn a_peak_of_the_rate_near_an_end_is_allowed() {
        for step in 0..40 {
            let peak = 1e-4 * f64::from(step);
            let turn = |t: f64| {
                let angle = 0.01 * libm::sin(200.0 * (t - peak));
                Se3 { rotation: DQuat::from_rotation_x(angle), translation: DVec3::X * t }
            };
            for turn in [&turn as &dyn Fn(f64) -> Se3, &|t| turn(1.0 - t)] {
                let (model, lines, poses) = written_along(turn, 2400, 1000, AxisModel::IDEAL);
                assert_eq!(faults(&model, &lines, &poses), [""; 0], "{step}");
            }
        }
    }

    /// Each planted fault is found, and named by the file that has it.
    #[test]
    fn planted_faults_are_found() {
        let finds =
            |name: &str,
             word: &str,
             plant: &dyn Fn(&mut ImuModel, &mut [InertialLines; 2], &mut Trajectory)| {
                let (mut model, mut lines, mut poses) = written(1000, NOISY);
                plant(&mut model, &mut lines, &mut poses);
                let found = faults(&model, &lines, &poses);
                assert!(found.iter().any(|fault| fault.contains(word)), "{name}: {found:?}");
            };
        let each = |lines: &mut InertialLines, change: &dyn Fn(&mut Vec<f64>)| {
            lines.iter_mut().for_each(|(_, values)| change(values));
        };
        finds("swapped axes", "the gyroscope", &|_, [samples, _], _| each(samples, &|v| v.swap(0, 1)));
        finds("another sign", "the gyroscope", &|_, [samples, _], _| each(samples, &|v| v[2] = -v[2]));
        finds("degrees", "the gyroscope", &|_, [samples, _], _| each(samples, &|v| v[1] = v[1].to_degrees()));
        finds("another scale", "the accelerometer", &|_, [samples, _], _| each(samples, &|v| v[4] *= 1.02));
        finds("no gravity", "the accelerometer", &|_, [samples, _], _| each(samples, &|v| v[4] -= GRAVITY));
        finds("a delay of 10 ms", "the gyroscope", &|_, [samples, _], _| {
            let values: Vec<Vec<f64>> = samples.iter().map(|(_, v)| v.clone()).collect();
            samples.iter_mut().skip(10).zip(values).for_each(|((_, v), late)| *v = late);
        });
        finds("noise of twice the density", "the gyroscope", &|model, _, _| model.gyroscope.noise /= 2.0);
        finds("noise of half the density", "the stated density", &|model, _, _| {
            model.accelerometer.noise *= 2.0
        });
        finds("poses of another scale", "the positions", &|_, _, poses| {
            poses.world_from_camera.iter_mut().for_each(|pose| pose.translation *= 1.001);
        });
        finds("poses of another clock", "the rotations", &|_, _, poses| {
            poses.stamps_us.iter_mut().for_each(|t| *t += 500);
        });
        finds("stamps of another rate", "sample 1 is at", &|model, _, _| {
            model.rate = Hertz(Ratio::new(999, 1).unwrap());
        });
        finds("the last tenth missing", "the samples end before", &|_, lines, _| {
            lines.iter_mut().for_each(|lines| lines.truncate(900));
        });
        finds("one displaced pose", "the positions", &|_, _, poses| {
            poses.world_from_camera[100].translation.x += 1e-3;
        });
    }

    #[test]
    fn files_that_cannot_be_compared_are_named() {
        let (model, [samples, mut states], poses) = written(50, NOISY);
        states.pop();
        let found = compare_inertial(&model, &samples, &states, DVec3::Y, &poses);
        assert_eq!(found.unwrap_err(), "the states have other stamps than the samples");
    }

    /// A sensor whose range holds all of the walk's rates and forces.
    const WIDE: AxisModel = AxisModel { range: Some(30.0), ..NOISY };

    #[test]
    fn samples_at_and_beyond_the_bound_are_found() {
        let finds = |name: &str, word: &str, change: &dyn Fn(&mut Vec<f64>)| {
            let (model, mut lines, poses) = written(1000, WIDE);
            lines[0].iter_mut().for_each(|(_, values)| change(values));
            let gravity = DVec3::new(0.0, -model.gravity, 0.0);
            let found = compare_inertial(&model, &lines[0], &lines[1], gravity, &poses).unwrap();
            let faults = found.differences.iter().filter(|found| !found.is_allowed());
            let faults: Vec<String> = faults.map(ToString::to_string).collect();
            assert!(faults.iter().any(|fault| fault.contains(word)), "{name}: {faults:?}");
        };
        finds("degrees beyond", "the largest value of the gyroscope", &|v| v[1] = v[1].to_degrees());
        finds("degrees, bounded", "the gyroscope shows its bound", &|v| {
            v[..3].iter_mut().for_each(|v| *v = v.to_degrees().clamp(-30.0, 30.0));
        });
        finds("saturated", "the gyroscope shows its bound", &|v| v[..3].copy_from_slice(&[30.0, 0.0, 0.0]));
        finds("far beyond", "the largest value of the accelerometer", &|v| {
            v[3..].copy_from_slice(&[1e6, 0.0, 0.0]);
        });
    }

    /// A spin at 5 rad/s with a range of 4: each sample is bounded, and its states say so.
    #[test]
    fn a_sensor_that_is_always_at_its_bound_is_not_compared() {
        let seconds: Vec<f64> = (0..=100).map(|j| f64::from(j) * 1e-3).collect();
        let pose = |t: f64| Se3 { rotation: DQuat::from_rotation_x(5.0 * t), translation: DVec3::ZERO };
        let poses: Vec<Se3> = seconds.iter().map(|t| pose(*t)).collect();
        let stamps_us = (0..=100).map(|j| j * 1000).collect();
        let path = SampledPath::with_end_rates(&poses, seconds).unwrap();
        let model = ImuModel {
            accelerometer: AxisModel::IDEAL,
            ..model(500, AxisModel { range: Some(4.0), ..AxisModel::IDEAL })
        };
        let samples: Vec<ImuSample> = ImuSampler::new(&model, &path, DVec3::Y, Seed(3)).collect();
        let lines = |write: &dyn Fn(&ImuSample, &mut Vec<u8>), head: &str| {
            let mut file = format!("{head}\n").into_bytes();
            samples.iter().for_each(|sample| write(sample, &mut file));
            read_lines(&file, head).unwrap()
        };
        let shown = lines(&|sample, out| write_sample(sample, out).unwrap(), SAMPLES_HEAD);
        let states = lines(&|sample, out| write_state(sample, out).unwrap(), STATES_HEAD);
        let gravity = DVec3::new(0.0, -model.gravity, 0.0);
        let poses = Trajectory { world_from_camera: poses, stamps_us };
        let found = compare_inertial(&model, &shown, &states, gravity, &poses).unwrap();
        assert!(
            found.differences.iter().all(super::super::consistency::InertialDifference::is_allowed),
            "{found:?}"
        );
        assert_eq!(found.bounded, ["gyroscope"]);
    }
}

#[test]
fn a_description_of_another_sensor_is_named_by_its_keys() {
    use super::files::{sensor_differences, sensor_text};
    let (model, gravity) = (model(1000, AxisModel { noise: 2e-3, ..AxisModel::IDEAL }), DVec3::NEG_Y);
    let text = sensor_text(&model, gravity);
    let differences = |text: &str| sensor_differences(text.as_bytes(), &model, gravity).unwrap();
    assert_eq!(differences(&text), [""; 0]);
    // The form of the file is the concern of others.
    assert_eq!(differences(&text.replace("1.0, 0.0", "1, 0")), [""; 0]);
    let t = |from: &str, to: &str, key: &str| {
        let found = differences(&text.replacen(from, to, 1));
        assert!(found.len() == 1 && found[0].starts_with(&format!("its {key} is ")), "{found:?}");
    };
    t("data: [1.0", "data: [-1.0", "data");
    t(
        "accelerometer_noise_density: 0.002",
        "accelerometer_noise_density: 0.2",
        "accelerometer_noise_density",
    );
    t("rate_hz: 1000", "rate_hz: 200", "rate_hz");
    t("metres_per_unit: 0.5", "metres_per_unit: 1", "metres_per_unit");
    t("sensor_type: imu", "sensor_type: !!python/object/apply:os.system", "sensor_type");
    t("cols: 4\n", "", "cols");
}
