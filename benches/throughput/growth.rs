//! Growth of the cost of events: core-seconds of rendering and simulating for 1 to 16 times the
//! frames, the pixels and the Gaussians.
//!
//! Times are sums over all cores, from the Gaussians in memory to the last event, which is counted
//! and dropped. Rounds are interleaved, as in the other parts. The fit uses the fastest run of each
//! size.

use crate::laws::GrowthLaws;
use glam::DQuat;
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_event::{Event, EventSink};
use gs2e_image::{Image, Size};
use gs2e_num::se3::Se3;
use gs2e_num::seed::Seed;
use gs2e_num::units::{Hertz, Timestamp};
use gs2e_render::cpu::{CpuRenderer, PassKind};
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_sensor::SensorModel as _;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::sync::Arc;

/// The part's name on the command line.
pub(crate) const PART: &str = "growth";

/// Sizes relative to the smallest.
const FACTORS: [u32; 5] = [1, 2, 4, 8, 16];
/// Sides of the pictures. Their squares grow about as [`FACTORS`].
const WIDTHS: [u32; 5] = [160, 226, 320, 452, 640];

const FRAMES: u32 = 48;
const GAUSSIANS: u32 = 20_000;
const SIZE: Size = Size { width: 640, height: 360 };
const RATE: f64 = 2400.0;
/// Angular speed of the camera about the scene, rad/s.
const TURN: f64 = 0.5;

/// The only axis whose sizes are frames.
const FRAME_AXIS: &str = "frames";

/// Parts of the time: before the first frame, in each pass of the renderer, and in the sensor.
const STAGES: [&str; 7] = ["start", "project", "sort", "bin", "raster", "resolve", "sensor"];
const SENSOR: usize = 6;

/// The cost of one size.
struct Point {
    size: f64,
    work: Work,
    /// Runs, sorted by their total.
    runs: Vec<Run>,
}

/// Frames to render and simulate.
struct Work {
    scene: Arc<Gaussians>,
    camera: Camera,
    poses: Vec<Se3>,
}

/// One run: core-seconds by stage, number of events, and number of blended pairs.
struct Run {
    core_s: [f64; STAGES.len()],
    events: usize,
    blended: u64,
}

impl Run {
    fn total(&self) -> f64 {
        self.core_s.iter().sum()
    }
}

/// An axis along which one size grows.
pub(crate) struct Axis {
    name: &'static str,
    what: String,
    points: Vec<Point>,
}

/// Measures the three axes, or those whose description holds every text of `only`, with `runs` runs
/// each after one run to warm up.
pub(crate) fn measure(only: &[String], runs: usize) -> Vec<Axis> {
    let mut axes = vec![frames(), pixels(), gaussians()];
    axes.retain(|axis| only.iter().all(|text| axis.what.contains(text)));
    for round in 0..=runs {
        for point in axes.iter_mut().flat_map(|axis| &mut axis.points) {
            let run = point.work.run();
            if round > 0 {
                point.runs.push(run);
            }
        }
    }
    for point in axes.iter_mut().flat_map(|axis| &mut axis.points) {
        point.runs.sort_by(|a, b| a.total().total_cmp(&b.total()));
    }
    axes
}

fn frames() -> Axis {
    let small = Size { width: 320, height: 180 };
    let scene = scene(GAUSSIANS);
    let point = |factor| point(f64::from(factor * FRAMES / 2), &scene, small, factor * FRAMES / 2);
    let what = format!("along one path at {RATE} frames/s, {small}, {GAUSSIANS} Gaussians");
    Axis { name: FRAME_AXIS, what, points: FACTORS.map(point).into() }
}

fn pixels() -> Axis {
    let scene = scene(GAUSSIANS);
    let point = |width| {
        let size = Size { width, height: (width * SIZE.height + SIZE.width / 2) / SIZE.width };
        point(size.pixels() as f64, &scene, size, FRAMES)
    };
    let what = format!("of one field of view, {FRAMES} frames, {GAUSSIANS} Gaussians");
    Axis { name: "pixels", what, points: WIDTHS.map(point).into() }
}

fn gaussians() -> Axis {
    let point = |factor| {
        let count = factor * GAUSSIANS;
        point(f64::from(count), &scene(count), SIZE, FRAMES / 2)
    };
    let what = format!("of one picture, smaller the more there are, {} frames, {SIZE}", FRAMES / 2);
    Axis { name: "Gaussians", what, points: FACTORS.map(point).into() }
}

fn life(gaussians: u32) -> StillLife {
    StillLife { gaussians, ..StillLife::default() }
}

fn scene(gaussians: u32) -> Arc<Gaussians> {
    Arc::new(procedural::still_life(&life(gaussians)))
}

fn point(size: f64, scene: &Arc<Gaussians>, picture: Size, frames: u32) -> Point {
    let life = life(GAUSSIANS);
    let photo = &procedural::still_capture(&life).views[life.views as usize / 2];
    let Se3 { rotation, translation } = photo.world_from_camera;
    let pose = |frame: u32| {
        let turn = DQuat::from_rotation_y(TURN * f64::from(frame) / RATE);
        Se3 { rotation: turn * rotation, translation: turn * translation }
    };
    let camera = photo.camera.resized(picture);
    let work = Work { scene: scene.clone(), camera, poses: (0..frames).map(pose).collect() };
    Point { size, work, runs: Vec::new() }
}

/// Processor time of all cores of this process, s.
pub(crate) fn spent() -> f64 {
    let at = clock_gettime(ClockId::ProcessCPUTime);
    at.tv_sec as f64 + at.tv_nsec as f64 * 1e-9
}

impl Work {
    /// Makes events as the step of a build does, but without writing a file.
    fn run(&self) -> Run {
        const STYLE: RenderStyle = RenderStyle {
            rules: RenderRules::Official,
            order: LayerOrder::Depth,
            antialiased: false,
            background: [0.0; 3],
        };
        let want = ChannelSet { luminance: true, ..ChannelSet::default() };
        let mut run = Run { core_s: [0.0; STAGES.len()], events: 0, blended: 0 };
        let mut last = spent();
        let core_s = &mut run.core_s;
        let mut done = |stage: usize| {
            let now = spent();
            core_s[stage] += now - last;
            last = now;
        };
        let mut renderer = CpuRenderer::new(self.scene.clone(), STYLE).expect("the scene can be rendered");
        renderer.keep_to(&self.camera, &self.poses);
        let sensor = VoltmeterModel::new(VoltmeterPreset::Dvs346.k());
        let mut pixels = sensor.start(self.camera.size, [0, 0], Seed(1)).expect("the preset is valid");
        let mut events = EventCounter(0);
        done(0);
        let mut rendered = RenderedImages::default();
        for (index, pose) in self.poses.iter().enumerate() {
            let view = CameraView::at_rest(self.camera, *pose);
            let mut passed = |pass: PassKind| done(1 + pass as usize);
            let work = renderer.render_in_passes(&view, want, &mut rendered, &mut passed);
            run.blended += work.expect("it can be rendered").blended;
            let frame = frame(index, rendered.luminance.take().expect("it was asked for"));
            pixels.advance(&frame, &mut events).expect("the rate is far below the cap");
            done(SENSOR);
        }
        pixels.finish(&mut events).expect("the rate is far below the cap");
        done(SENSOR);
        run.events = events.0;
        run
    }
}

/// A frame on the sensor's grey scale.
fn frame(index: usize, mut luminance: Image<f32>) -> DenseFrame {
    luminance.pixels_mut().iter_mut().for_each(|v| *v *= 255.0);
    let rate = Hertz("2400".parse().expect("it is a ratio"));
    DenseFrame { index, t: Timestamp::from_micros(rate.stamp_us(index as u64)), luminance, rate: None }
}

/// Counts events and drops them.
struct EventCounter(usize);

impl EventSink for EventCounter {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.0 += events.len();
        Ok(())
    }
}

impl Point {
    fn best(&self) -> &Run {
        &self.runs[0]
    }

    fn median(&self) -> f64 {
        let n = self.runs.len();
        f64::midpoint(self.runs[(n - 1) / 2].total(), self.runs[n / 2].total())
    }

    /// Mean number of Gaussians that a pixel of a frame blends.
    fn blended(&self) -> f64 {
        let pixels = self.work.camera.size.pixels() * self.work.poses.len();
        self.best().blended as f64 / pixels as f64
    }
}

impl Axis {
    fn growth(&self, of: impl Fn(&Run) -> f64) -> Option<GrowthLaws> {
        let points: Vec<(f64, f64)> = self.points.iter().map(|p| (p.size, of(p.best()))).collect();
        GrowthLaws::fit_points(&points)
    }

    /// A Markdown table: one row per size, then the exponents.
    pub(crate) fn table(&self) -> String {
        let mut lines = vec![
            format!("**{}** {}:\n", self.name, self.what),
            format!(
                "| {} | core-s | median | {} | events | blended per pixel |",
                self.name,
                STAGES.join(" | ")
            ),
            format!("|{}", "---|".repeat(STAGES.len() + 5)),
        ];
        for point in &self.points {
            let parts = point.best().core_s.map(|s| format!("{s:.4}")).join(" | ");
            let (best, median) = (point.best().total(), point.median());
            let (events, blended) = (point.best().events, point.blended());
            lines.push(format!(
                "| {} | {best:.3} | {median:.3} | {parts} | {events} | {blended:.1} |",
                point.size
            ));
        }
        let exponent =
            |growth: Option<GrowthLaws>| growth.map_or_else(String::new, |g| format!("{:.2}", g.exponent));
        let parts: Vec<String> =
            (0..STAGES.len()).map(|at| exponent(self.growth(|run| run.core_s[at]))).collect();
        if let Some(all) = self.growth(Run::total) {
            let (exponent, error) = (all.exponent, all.standard_error);
            lines.push(format!("| exponent | {exponent:.3} +- {error:.3} | | {} | | |\n", parts.join(" | ")));
            lines.push(self.split(&all));
        }
        lines.join("\n")
    }

    /// The cost that is paid once, and the cost that grows.
    fn split(&self, growth: &GrowthLaws) -> String {
        // A line through noisy runs may begin below 0: then nothing is fixed.
        let [first, last] =
            [0, self.points.len() - 1].map(|at| 100.0 * growth.fixed_share(self.points[at].size).max(0.0));
        let frames = self.points[0].work.poses.len();
        let each = match self.name {
            FRAME_AXIS => format!("{:.3} core-ms a frame", 1e3 * growth.marginal),
            name => format!(
                "{:.2} core-ns by frame for each of the {name}",
                1e9 * growth.marginal / frames as f64
            ),
        };
        format!(
            "As a line: {:.4} core-s, and {each}; off by {:.1} % at most. What does not grow is {first:.1} % of the smallest \
             and {last:.1} % of the largest.\n",
            growth.fixed,
            100.0 * growth.worst,
        )
    }

    /// The figures as JSON.
    pub(crate) fn json(&self) -> Value {
        let point = |point: &Point| {
            let parts: serde_json::Map<String, Value> = STAGES
                .iter()
                .zip(point.best().core_s)
                .map(|(name, s)| ((*name).to_owned(), json!(s)))
                .collect();
            json!({
                "size": point.size,
                "core_s": { "best": point.best().total(), "median": point.median() },
                "parts_core_s": parts,
                "events": point.best().events,
                "blended_a_pixel": point.blended(),
            })
        };
        json!({
            "axis": self.name,
            "workload": self.what,
            "points": self.points.iter().map(point).collect::<Vec<_>>(),
            "growth": self.growth(Run::total),
        })
    }
}
