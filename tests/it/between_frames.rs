//! Brightness between rendered frames: rates along a path, and the savings by cubics.

use crate::support::workspace::{TINY, Workspace};
use glam::DVec3;
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_event::Event;
use gs2e_image::{Image, Size};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::seed::Seed;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{LayerOrder, RenderRules, RenderStyle};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraVelocity;
use gs2e_sensor::frames::FrameSequence as _;
use gs2e_sensor::simulate_one;
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel, VoltmeterPreset};
use gs2e_source::Capture;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::twist::pose_twists;
use serde_json::Value;
use std::fs;
use std::ops::ControlFlow;
use std::sync::Arc;

const SIZE: Size = Size { width: 96, height: 72 };
/// Duration of the path, s.
const LENGTH: f64 = 0.08;
/// A style in which the picture is a continuous function of the view.
const SMOOTH: RenderStyle = RenderStyle {
    rules: RenderRules::Soft,
    order: LayerOrder::Blended,
    antialiased: false,
    background: [0.2; 3],
};

struct World {
    scene: Arc<Gaussians>,
    capture: Capture,
}

impl World {
    fn new() -> Self {
        let life = StillLife { gaussians: 300, views: 6, arc: 40.0, seed: 1, fountain: None };
        Self { scene: Arc::new(procedural::still_life(&life)), capture: procedural::still_capture(&life) }
    }

    /// Half of an orbit's step there and back, turning all the time.
    fn pose(&self, t: f64) -> Se3 {
        let [from, to] = [&self.capture.views[0], &self.capture.views[1]].map(|view| view.world_from_camera);
        let way = 0.5 * libm::sin(30.0 * t);
        let turn = exp_vector(DVec3::new(0.01 * libm::cos(40.0 * t), 0.02 * libm::sin(25.0 * t), 0.01 * t));
        Se3 { rotation: from.rotation * turn, translation: from.translation.lerp(to.translation, way) }
    }

    fn frames(&self, steps: u32) -> RenderedFrames {
        let seconds: Vec<f64> = (0..=steps).map(|j| LENGTH * f64::from(j) / f64::from(steps)).collect();
        let poses: Vec<Se3> = seconds.iter().map(|t| self.pose(*t)).collect();
        let own = |(pose, twist): (&Se3, gs2e_num::se3::Twist)| CameraVelocity {
            linear: pose.rotation.conjugate() * twist.linear,
            angular: twist.angular,
        };
        let velocities = poses.iter().zip(pose_twists(&poses, &seconds)).map(own).collect();
        // Whole microseconds at every number of steps used here.
        let stamps_us = (0..=i64::from(steps)).map(|j| 80_000 * j / i64::from(steps)).collect();
        let trajectory = Trajectory { world_from_camera: poses, stamps_us };
        let renderer = Box::new(CpuRenderer::new(self.scene.clone(), SMOOTH).unwrap());
        let camera = self.capture.views[0].camera.resized(SIZE);
        RenderedFrames::new(renderer, camera, trajectory).with_rates(velocities)
    }

    /// Each pixel's events in order of time, ns, without noise.
    fn events(&self, steps: u32, between: BetweenFrames) -> Vec<Vec<i64>> {
        let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
        let sensor = VoltmeterModel { between, ..VoltmeterModel::new([k1, k2, 0.0, 0.0, 0.0, 0.0]) };
        let mut all: Vec<Event> = Vec::new();
        let mut go_on = |_: &_| ControlFlow::Continue(());
        simulate_one(&mut self.frames(steps), &sensor, Seed(1), &mut all, &mut go_on).unwrap();
        let mut pixels = vec![Vec::new(); SIZE.pixels()];
        for event in all {
            pixels[usize::from(event.y) * SIZE.width as usize + usize::from(event.x)].push(event.t.0);
        }
        pixels.iter_mut().for_each(|times: &mut Vec<i64>| times.sort_unstable());
        pixels
    }
}

/// Compares the rate of each frame with the difference of its neighbours, a thousandth of the path
/// apart.
#[test]
fn frames_along_a_path_carry_the_rate_of_their_change() {
    let world = World::new();
    let steps = 1000;
    let step = LENGTH / f64::from(steps);
    let mut frames = world.frames(steps);
    let mut last: Vec<(Image<f32>, Image<f32>)> = Vec::new();
    let (mut errors, mut most) = (Vec::new(), 0.0f64);
    while let Some(frame) = frames.next().unwrap() {
        last.push((frame.luminance, frame.rate.unwrap()));
        if last.len() < 3 {
            continue;
        }
        if frame.index % 100 == 50 {
            for i in 0..SIZE.pixels() {
                let [before, after] =
                    [&last[0], &last[2]].map(|(luminance, _)| f64::from(luminance.pixels()[i]));
                let (wanted, found) = ((after - before) / (2.0 * step), f64::from(last[1].1.pixels()[i]));
                most = most.max(wanted.abs());
                errors.push((wanted - found).abs());
            }
        }
        last.remove(0);
    }
    errors.sort_by(f64::total_cmp);
    let [median, high] = [50, 99].map(|percent| errors[errors.len() * percent / 100] / most);
    println!("rates to {most:.0} grey/s; off by {median:.1e} of it at the median, {high:.1e} at 99 %");
    // Differences of f32 frames: 255 * 6e-8 / (2 * 80 us) is 0.1 grey/s.
    assert!(most > 300.0 && median < 1e-3 && high < 1e-2);
}

/// Compares events of 100 frames with those of 1600: times at the pixels that have equal numbers of
/// them.
#[test]
fn cubics_meet_fine_frames_with_fewer() {
    let world = World::new();
    let truth = world.events(1600, BetweenFrames::Linear);
    let all: usize = truth.iter().map(Vec::len).sum();
    let away = |between: BetweenFrames| {
        let found = world.events(100, between);
        let miscounted: usize = found.iter().zip(&truth).map(|(a, b)| a.len().abs_diff(b.len())).sum();
        let same = found.iter().zip(&truth).filter(|(a, b)| a.len() == b.len());
        let mut apart: Vec<i64> =
            same.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).abs())).collect();
        apart.sort_unstable();
        let (count, median) = (miscounted as f64 / all as f64, apart[apart.len() / 2] as f64 * 1e-3);
        println!("{between:?}: counts off by {count:.5}, times by {median:.2} us of {all} events");
        (count, median)
    };
    let [linear, catmull, hermite] =
        [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite].map(away);
    assert!(all > 2000);
    assert!(catmull.1 < 0.5 * linear.1 && hermite.1 < 0.1 * linear.1);
    assert!(hermite.0 <= linear.0);
}

#[test]
fn a_recipe_chooses_the_brightness_between_frames() {
    let place = Workspace::new();
    let mut streams = Vec::new();
    for between in ["linear", "catmull", "hermite"] {
        place.write("tiny.yaml", TINY.replace("between: linear", &format!("between: {between}")));
        place.ok("release --to tree tiny.yaml");
        place.ok("audit tree");
        let scene: Value = place.json("tree/tiny/scene.json");
        assert_eq!(scene["trajectories"][0]["sampling"]["between"], between);
        assert_eq!(scene["recipe"]["sampling"]["between"], between);
        streams.push(fs::read(place.path("tree/tiny/base/events.h5")).unwrap());
    }
    assert!(streams[0] != streams[1] && streams[1] != streams[2] && streams[0] != streams[2]);
    let card = fs::read_to_string(place.path("tree/README.md")).unwrap();
    assert!(card.contains("cubic (Hermite, with rendered rates of change)"));
}
