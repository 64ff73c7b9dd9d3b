//! Speed laws along a path: lists, frame rates, integrals, and speed in pixels.

use super::{LAW, hertz, law, named, orbit, refined, still, timing};
use glam::{DQuat, DVec3};
use gs2e_num::se3::{Se3, Twist};
use gs2e_testing::absent::is_thorough;
use gs2e_trajectory::flow::FlowMeter;
use gs2e_trajectory::path::{CameraPath, PathInputs};
use gs2e_trajectory::refine::{RefinePath, refine_views};
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::sample::{PoseSchedule, SummationRule};
use gs2e_trajectory::speed::function::SpeedExpression;
use gs2e_trajectory::speed::list::SpeedLevels;
use gs2e_trajectory::speed::{FlowSpeed, SpeedChoice, SpeedMeaning};
use gs2e_trajectory::travel::PoseCount;
use gs2e_trajectory::{NamedPose, PoseTiming, TrajectoryBuild, TrajectoryError, TrajectoryWarning};
use proptest::prelude::*;

fn list(multipliers: &[f64], blend: f64, meaning: SpeedMeaning) -> SpeedChoice {
    SpeedChoice::List(SpeedLevels::new(multipliers.to_vec(), blend, meaning).unwrap())
}

/// Five views on a straight line, 4 units long, looking across it.
fn line() -> Vec<(String, Se3)> {
    named((0..5u32).map(|k| still(DQuat::IDENTITY, DVec3::X * f64::from(k))))
}

fn frames(count: u64) -> RefinePath {
    RefinePath { window: 0, count: PoseCount::Frames(count), ..RefinePath::default() }
}

fn travelled(params: &RefinePath, timing: PoseTiming<'_>) -> Result<TrajectoryBuild, TrajectoryError> {
    let views = line();
    let views: Vec<NamedPose<'_>> =
        views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose }).collect();
    refine_views(&views, params, timing)
}

#[test]
fn levels_are_reached_and_blended() {
    let speed = list(&[1.0, 0.5, 2.0], 0.1, SpeedMeaning::Speed);
    let made = travelled(&frames(301), timing(&speed)).unwrap();
    let speeds = &made.report.linear_unit_s;
    // 300 steps of 1/2400 s over 4 units. The left sum of a law of mean 7/6 differs from its
    // integral by under 1 %.
    let unit = 4.0 * 2400.0 / made.report.u.iter().sum::<f64>();
    for (j, level) in [(40, 1.0), (150, 0.5), (250, 2.0)] {
        assert!((speeds[j] / unit - level).abs() < 1e-9, "{j}: {}", speeds[j] / unit);
    }
    // At the boundaries the blend is at half its way.
    for (j, middle) in [(100, 0.75), (200, 1.25)] {
        assert!((speeds[j] / unit - middle).abs() < 1e-9, "{j}: {}", speeds[j] / unit);
    }
    assert_eq!(made.warnings, []);
}

#[test]
fn a_list_of_one_level_is_a_constant_speed() {
    let poses = |level: f64| {
        let speed = list(&[level], 0.1, SpeedMeaning::Speed);
        travelled(&frames(50), timing(&speed)).unwrap().trajectory
    };
    assert_eq!(poses(1.0), poses(1e-6));
    let constant = travelled(&frames(50), timing(&law("1"))).unwrap().trajectory;
    assert_eq!(poses(3.0), constant);
}

#[test]
fn wild_and_unblended_lists_are_reported() {
    let wild = list(&[1.0, 0.2, 5.0, 0.01, 3.0], 0.1, SpeedMeaning::Speed);
    let warnings = travelled(&frames(100), timing(&wild)).unwrap().warnings;
    assert!(
        matches!(warnings[..], [TrajectoryWarning::SpeedRange { ratio, .. }] if (ratio - 500.0).abs() < 1e-9),
        "{warnings:?}"
    );
    let steps = list(&[1.0, 2.0], 0.0, SpeedMeaning::Speed);
    let warnings = travelled(&frames(100), timing(&steps)).unwrap().warnings;
    assert!(
        matches!(&warnings[..], [TrajectoryWarning::Rough { because }] if because == "its levels are not blended")
    );
}

#[test]
fn frame_rates_keep_the_speed_and_change_the_stamps() {
    let speed = list(&[1.0, 4.0], 0.1, SpeedMeaning::FrameRate);
    let made = travelled(&frames(101), timing(&speed)).unwrap();
    let speeds = &made.report.linear_unit_s;
    assert!(speeds.iter().all(|v| (v / speeds[0] - 1.0).abs() < 1e-9), "{speeds:?}");
    // About 50 steps of 1/2400 s, then of a quarter of that, with each stamp rounded by itself.
    let stamps = &made.trajectory.stamps_us;
    let step = |j: usize| stamps[j + 1] - stamps[j];
    assert!((416..=417).contains(&step(10)) && (104..=105).contains(&step(90)), "{stamps:?}");
    let exact: f64 = made.report.u.iter().map(|v| 1e6 / (2400.0 * v)).sum();
    let last = *stamps.last().unwrap();
    assert!((last as f64 - exact).abs() <= 0.5, "{last} {exact}");
    // The path is covered in proportion to time: a distance of 4 units.
    let [first, .., end] = &made.trajectory.world_from_camera[..] else { panic!("there are 101 poses") };
    assert!(((end.translation - first.translation).length() - 4.0).abs() < 1e-12);
    assert_eq!((made.report.meaning, made.report.law), (SpeedMeaning::FrameRate, SummationRule::Sum));
}

#[test]
fn frames_less_than_a_microsecond_apart_are_refused() {
    let speed = list(&[1.0, 1e6], 0.1, SpeedMeaning::FrameRate);
    let refused = travelled(&frames(101), timing(&speed)).unwrap_err();
    assert!(matches!(refused, TrajectoryError::Stamps { step: 40..60, .. }), "{refused:?}");
}

#[test]
fn the_integral_of_the_published_law_is_its_closed_form() {
    let speed = law(LAW);
    let count = 150;
    let shares = |law| PoseSchedule::new(&speed, count, law).unwrap().shares;
    let integral = shares(SummationRule::Integral);
    let distance = |t: f64| 1.1 * t + 0.25 * (1.0 - t.cos());
    for (j, share) in integral.iter().enumerate() {
        let t = j as f64 / (count - 1) as f64;
        assert!((share - distance(t) / distance(1.0)).abs() < 1e-14, "{j}");
    }
    // The paper's left sum lags by at most 8.0e-3 of a step.
    let lag =
        shares(SummationRule::Sum).iter().zip(&integral).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let of_a_step = lag * (count - 1) as f64;
    assert!((7.5e-3..8.1e-3).contains(&of_a_step), "{of_a_step}");
}

#[test]
fn the_integral_of_a_list_is_exact() {
    let speed = list(&[1e-6, 1e6, 1.0, 3.0], 0.5, SpeedMeaning::Speed);
    let shares = PoseSchedule::new(&speed, 5, SummationRule::Integral).unwrap().shares;
    // Segment ends are in the middle of windows: a whole level, plus or minus 13/96 of the jump
    // over half a window.
    let mean = (1e-6 + 1e6 + 1.0 + 3.0) / 4.0;
    let up_to_first = (1e-6 + 0.5 * (1e6 - 1e-6) * (13.0 / 96.0)) / 4.0;
    assert!((shares[1] - up_to_first / mean).abs() < 1e-15, "{shares:?}");
    assert!(shares[4].to_bits() == 1.0f64.to_bits() && shares.is_sorted());
}

#[test]
fn shares_end_at_one_and_never_fall() {
    for (text, count) in [(LAW, 150), ("1", 3), ("exp(9*t)", 100_000), ("1e300", 777), ("exp(-600*t)", 1000)]
    {
        for summation in [SummationRule::Sum, SummationRule::Integral] {
            let shares = PoseSchedule::new(&law(text), count, summation).unwrap().shares;
            assert!(shares.is_sorted() && shares.len() == count, "{text}");
            assert_eq!((shares[0].to_bits(), shares[count - 1].to_bits()), (0, 1.0f64.to_bits()), "{text}");
        }
    }
}

/// A picture that moves by `1 + x` px for each unit of camera motion along x, and for no other
/// motion.
struct Ramp {
    asked: usize,
}

impl FlowMeter for Ramp {
    fn median_px(&mut self, world_from_camera: &Se3, twist: &Twist) -> Result<Option<f64>, String> {
        self.asked += 1;
        Ok(Some((1.0 + world_from_camera.translation.x) * twist.linear.x))
    }
}

fn flow(px_s: f64, shape: &str) -> SpeedChoice {
    SpeedChoice::Flow(FlowSpeed { px_s, shape: SpeedExpression::parse(shape).unwrap() })
}

fn by_flow(
    params: RefinePath,
    speed: &SpeedChoice,
    meter: Option<&mut dyn FlowMeter>,
) -> Result<TrajectoryBuild, TrajectoryError> {
    let views = line();
    let views: Vec<NamedPose<'_>> =
        views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose }).collect();
    CameraPath::Refine(params).make(
        PathInputs { views: &views, base: None, scene: None },
        timing(speed),
        meter,
    )
}

#[test]
fn a_speed_in_pixels_is_kept() {
    let params = RefinePath { window: 0, count: PoseCount::Flow, ..RefinePath::default() };
    let mut meter = Ramp { asked: 0 };
    let made = by_flow(params.clone(), &flow(240.0, "1"), Some(&mut meter)).unwrap();
    // From x = 0 to 4 the picture moves by 4 + 16/2 px: 50 ms at 240 px/s, which is 120 steps.
    let asked = made.report.flow.unwrap();
    assert!((asked.px - 12.0).abs() < 1e-6 && meter.asked < 100, "{asked:?}");
    assert_eq!(made.trajectory.world_from_camera.len(), 121);
    for (j, pose) in made.trajectory.world_from_camera.iter().enumerate() {
        // x + x^2/2 = 12 j / 120
        let exact = (1.0 + 2.0 * 12.0 * j as f64 / 120.0).sqrt() - 1.0;
        // The spline of a logarithm over 64 parts of a ramp of 1 to 5: h^4/384 of a fourth
        // derivative of up to 6 * 4^4.
        assert!((pose.translation.x - exact).abs() < 1e-6, "{j}: {} {exact}", pose.translation.x);
    }
    // With a shape the flow follows it: twice as fast at the end, step by step.
    let made = by_flow(params, &flow(240.0, "1 + t"), Some(&mut meter)).unwrap();
    let x = |j: usize| made.trajectory.world_from_camera[j].translation.x;
    let px = |j: usize| (x(j + 1) - x(j)) * (1.0 + f64::midpoint(x(j), x(j + 1)));
    assert!((px(119) / px(0) - (1.0 + 119.0 / 120.0)).abs() < 1e-4, "{} {}", px(0), px(119));
}

#[test]
fn an_impossible_speed_in_pixels_is_refused() {
    struct Blind;
    impl FlowMeter for Blind {
        fn median_px(&mut self, _: &Se3, _: &Twist) -> Result<Option<f64>, String> {
            Ok(None)
        }
    }
    let speed = flow(240.0, "1");
    let params = RefinePath { window: 0, count: PoseCount::Flow, ..RefinePath::default() };
    let t = |params: &RefinePath, speed: &SpeedChoice, meter: Option<&mut dyn FlowMeter>, words: &str| {
        let refused = by_flow(params.clone(), speed, meter).unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
    };
    t(&params, &speed, None, "there is no scene");
    t(&params, &speed, Some(&mut Blind), "no pixel has a depth");
    t(&params, &law("1"), Some(&mut Ramp { asked: 0 }), "a speed in px/s");
    t(&frames(20), &speed, Some(&mut Ramp { asked: 0 }), "none of factor, frames and duration");
    let literal = RefinePath { literal: true, ..params.clone() };
    t(&literal, &speed, Some(&mut Ramp { asked: 0 }), "does not divide chords");
    t(&params, &flow(1e-9, "1"), Some(&mut Ramp { asked: 0 }), "poses, wanted at most");
}

/// Two million, or ten million with slow tests.
#[test]
fn millions_of_poses_are_made() {
    let count = if is_thorough() { 10_000_000 } else { 2_000_000 };
    let params = RefinePath { count: PoseCount::Frames(count), ..RefinePath::default() };
    let made = refined(&orbit(30, 0.005, 0.5, 1), &params, LAW);
    let poses = &made.trajectory.world_from_camera;
    assert_eq!((poses.len() as u64, made.trajectory.stamps_us.len() as u64), (count, count));
    assert_eq!(*made.trajectory.stamps_us.last().unwrap(), hertz("2400").stamp_us(count - 1));
    let follow = made.report.mixed_ratio.unwrap();
    // Places near 1 are rounded at 1.1e-16 of the path, which is 1e-9 of a step, at both of its
    // ends.
    assert!(follow.min > 1.0 - 1e-8 && follow.max < 1.0 + 1e-8, "{follow:?}");
    let few = refined(&orbit(30, 0.005, 0.5, 1), &RefinePath { window: 2, ..frames(2) }, LAW)
        .trajectory
        .world_from_camera;
    assert_eq!((poses[0], poses[poses.len() - 1]), (few[0], few[1]));
}

fn any_list() -> impl Strategy<Value = SpeedChoice> {
    let level = prop_oneof![3 => -1.0..1.0f64, 1 => Just(-6.0), 1 => Just(6.0), 1 => -300.0..300.0f64];
    let levels = prop::collection::vec(level.prop_map(|e| 10f64.powf(e)), 1..8);
    let blend = prop_oneof![Just(0.0), Just(0.5), 0.0..=0.5f64];
    let meaning = prop_oneof![Just(SpeedMeaning::Speed), Just(SpeedMeaning::FrameRate)];
    (levels, blend, meaning).prop_map(|(levels, blend, meaning)| list(&levels, blend, meaning))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(512) })]
    #[test]
    fn no_list_makes_a_nan(speed in any_list(), count in 1..80u64, integral in any::<bool>()) {
        let law = if integral { SummationRule::Integral } else { SummationRule::Sum };
        match travelled(&frames(count), PoseTiming { law, ..timing(&speed) }) {
            Ok(made) => {
                let text = serde_json::to_string(&made.report).unwrap();
                // JSON writes a number that is not finite as null, which must not occur in a
                // report.
                let read: SpeedReport = serde_json::from_str(&text).unwrap();
                prop_assert_eq!(&read, &made.report);
                prop_assert!(made.trajectory.world_from_camera.iter().all(Se3::is_finite));
                prop_assert!(made.trajectory.stamps_us.is_sorted_by(|a, b| a < b));
            }
            Err(refused) => prop_assert!(!refused.to_string().contains("NaN"), "{refused}"),
        }
    }
}
