//! The laboratory of a study: a window of a path, its frames by each rule set, and their costs.

use super::cost::{CostSampling, KindCost, ProcessMeter, Taps, kept_at, measure_views};
use super::grid::FrameGrid;
use super::pass::{PassSetup, feed_settings};
use super::window::FineWindow;
use super::{
    OfRules, PicturePrecision, RuleCosts, SettingRow, StudyResult, finest_law as law_of, image_differences,
    judge_pass,
};
use gs2e_num::seed::Seed;
use gs2e_render::backend::Backend;
use gs2e_render::flow::PixelFlowMeter;
use gs2e_render::{ChannelSet, LayerOrder, RenderError, RenderRules, RenderStyle, Renderer};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_sensor::SimulateError;
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel};
use gs2e_trajectory::Trajectory;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Number of frames of each kind whose cost is measured.
const SAMPLE: usize = 12;
/// Number of these frames whose pictures are compared with f64.
const PICTURES: usize = 3;
/// Number of times that these frames are rendered again.
const ROUNDS: usize = 3;
/// Maximum number of places at which the flow is measured, and the percentage of pixels that move
/// no faster.
const FLOWS: usize = 240;
const FLOW_PERCENT: usize = 99;

const VALUE: ChannelSet = ChannelSet { luminance: true, ..ChannelSet::NONE };
const RATED: ChannelSet = ChannelSet { luminance_rate: true, ..VALUE };
const RGB: ChannelSet = ChannelSet { rgb: true, luminance: false, ..VALUE };

/// A rule set and an order of layers, under one name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedRules {
    /// Name in the tables.
    pub name: &'static str,
    /// The rules.
    pub rules: RenderRules,
    /// The order of layers.
    pub order: LayerOrder,
}

/// The settings that a study compares.
#[derive(Debug)]
pub struct StudyPlan {
    /// Rule sets; the others are compared with the first.
    pub rules: Vec<NamedRules>,
    /// Frames per second, in increasing order.
    pub rates: Vec<u32>,
    /// Interpolations between frames.
    pub between: Vec<BetweenFrames>,
    /// True if frames are spaced evenly.
    pub uniform: bool,
    /// True if frames are spaced by the optical flow.
    pub by_flow: bool,
    /// True if the sensors have their noise.
    pub noise: bool,
    /// True if pictures are compared with the float64 renderer.
    pub pictures: bool,
}

/// The machine that a study runs on.
#[derive(Debug)]
pub struct StudyMachine {
    /// Number of cores that the program may use.
    pub cores: usize,
    /// The machine's name of its processor, if known.
    pub processor: Option<String>,
}

/// The reason why a study ended early.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// The user stopped it.
    #[error("interrupted")]
    Interrupted,
    /// A frame cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A sensor cannot go on.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
}

/// The equipment of a study.
#[expect(missing_debug_implementations, reason = "it holds closures")]
pub struct StudyLab<'a> {
    /// The scene.
    pub gaussians: Arc<Gaussians>,
    /// The camera.
    pub camera: Camera,
    /// The window.
    pub window: &'a FineWindow,
    /// The sensor of the recipe.
    pub recipe_sensor: VoltmeterModel,
    /// The sensor that is fed with frames.
    pub sensor: VoltmeterModel,
    /// Seed of the noise.
    pub seed: Seed,
    /// The style of the recipe, whose rules and order the study replaces.
    pub style: RenderStyle,
    /// The back end.
    pub backend: Backend,
    /// Readings of the process.
    pub meter: &'a dyn ProcessMeter,
    /// Breaks when the user stops the study.
    pub go_on: &'a dyn Fn() -> ControlFlow<()>,
    /// Takes a line on what is measured next.
    pub say: &'a dyn Fn(&str),
}

/// The back end and the style of a rule set.
struct RuleRenderer {
    name: &'static str,
    backend: Backend,
    style: RenderStyle,
}

impl RuleRenderer {
    fn renderer(&self, scene: &Arc<Gaussians>) -> Result<Box<dyn Renderer>, RenderError> {
        self.backend.renderer(scene.clone(), self.style)
    }
}

impl StudyLab<'_> {
    /// Measures the costs and the errors of all settings.
    ///
    /// # Errors
    /// A frame cannot be rendered, a sensor cannot go on, or the user stopped the study.
    pub fn study(
        &self,
        asked: &StudyPlan,
        scene: String,
        machine: StudyMachine,
    ) -> Result<StudyResult, LabError> {
        let grids = self.grids(asked)?;
        let mut study = StudyResult {
            scene,
            size: self.camera.size,
            cores: machine.cores,
            processor: machine.processor,
            seconds: self.window.seconds(),
            finest: self.window.finest,
            noise: asked.noise,
            rules: Vec::new(),
            rows: Vec::new(),
            pictures: Vec::new(),
        };
        // All costs are measured before the first pass, because the events of a pass would count as
        // memory of the frames.
        let mut costs = Vec::new();
        for rules in &asked.rules {
            let by = self.of(*rules);
            (self.say)(&format!("{}: measuring the cost of frames", rules.name));
            let kinds: &[_] = if asked.pictures { &[VALUE, RATED, RGB] } else { &[VALUE, RATED] };
            let kinds = self.kinds(kinds, &by)?;
            costs.push(RuleCosts { value: kinds[0].0, rated: kinds[1].0 });
            if asked.pictures {
                study.pictures.extend(self.pictures(&by, kinds)?);
            }
        }
        for (rules, costs) in asked.rules.iter().zip(costs) {
            let (of, rows) = self.pass(&self.of(*rules), &grids, &asked.between, costs)?;
            study.rules.push(of);
            study.rows.extend(rows);
        }
        Ok(study)
    }

    /// The back end and the style of a rule set.
    fn of(&self, rules: NamedRules) -> RuleRenderer {
        let style = RenderStyle { rules: rules.rules, order: rules.order, ..self.style };
        // Soft rules are rendered on the CPU, in both orders of layers. Only the blended order
        // requires it.
        let on_cpu = self.backend.takes_gpu() && style.rules == RenderRules::Soft;
        let backend = if on_cpu { Backend::Cpu } else { self.backend.clone() };
        RuleRenderer { name: rules.name, backend, style }
    }

    fn grids(&self, asked: &StudyPlan) -> Result<Vec<FrameGrid>, LabError> {
        let FineWindow { intervals, finest, .. } = *self.window;
        let uniform: Vec<FrameGrid> =
            asked.rates.iter().map(|rate| FrameGrid::uniform_steps(*rate, finest, intervals)).collect();
        let mut grids = Vec::new();
        if asked.by_flow {
            (self.say)("measuring the optical flow");
            let flows = self.flows(asked.rules[0])?;
            grids.extend(uniform.iter().map(|uniform| FrameGrid::flow_steps(&flows, uniform)));
        }
        // Uniform grids come first in the table.
        if asked.uniform {
            grids.splice(0..0, uniform);
        }
        Ok(grids)
    }

    /// Motion of the picture in each fine interval, px: the faster of the two measured places
    /// around it.
    fn flows(&self, rules: NamedRules) -> Result<Vec<f64>, LabError> {
        let FineWindow { intervals, finest, .. } = *self.window;
        let renderer = self.of(rules).renderer(&self.gaussians)?;
        let mut meter = PixelFlowMeter::new(renderer, self.camera);
        let every = intervals.div_ceil(FLOWS);
        let mut measured = Vec::new();
        for place in 0..=intervals.div_ceil(every) {
            let view = self.window.view(self.camera, (place * every).min(intervals));
            let speed = meter.speed_px(&view.world_from_camera, view.velocity, FLOW_PERCENT);
            // A picture without depth does not move.
            measured.push(speed?.unwrap_or(0.0));
            self.go_on()?;
        }
        let faster = |j: usize| measured[j / every].max(measured[j / every + 1]);
        Ok((0..intervals).map(|j| faster(j) / f64::from(finest)).collect())
    }

    fn go_on(&self) -> Result<(), LabError> {
        if (self.go_on)().is_break() { Err(LabError::Interrupted) } else { Ok(()) }
    }

    /// Measures the costs of these kinds of frames.
    fn kinds(&self, kinds: &[ChannelSet], by: &RuleRenderer) -> Result<Vec<KindCost>, LabError> {
        let views = self.window.views(self.camera, SAMPLE);
        let sampling = CostSampling { kinds, keep: PICTURES, rounds: ROUNDS };
        self.measured(by, &self.gaussians, &views, &sampling)
    }

    fn measured(
        &self,
        by: &RuleRenderer,
        scene: &Arc<Gaussians>,
        views: &[CameraView],
        sampling: &CostSampling<'_>,
    ) -> Result<Vec<KindCost>, LabError> {
        let mut renderer = by.renderer(scene)?;
        let poses: Vec<_> = views.iter().map(|view| view.world_from_camera).collect();
        // The same promise as in a build, which renders known poses only.
        renderer.keep_to(&self.camera, &poses);
        measure_views(&mut *renderer, views, sampling, Taps { meter: self.meter, go_on: self.go_on })
    }

    /// The differences from f64 of several ways to render, these kinds among them.
    fn pictures(&self, by: &RuleRenderer, kinds: Vec<KindCost>) -> Result<Vec<PicturePrecision>, LabError> {
        let whole = &self.gaussians;
        let views = self.window.views(self.camera, SAMPLE);
        let few: Vec<CameraView> = kept_at(views.len(), PICTURES).map(|at| views[at]).collect();
        let once = CostSampling { kinds: &[VALUE], keep: PICTURES, rounds: 0 };
        let exact = RuleRenderer { backend: Backend::Reference, ..*by };
        let exactly = self.measured(&exact, whole, &few, &once)?;
        let names = ["luminance", "luminance and its rate", "rgb"].map(str::to_owned);
        let mut rendered: Vec<(String, KindCost)> = names.into_iter().zip(kinds).collect();
        for degree in (0..whole.sh_degree).rev() {
            let scene = Arc::new(whole.with_degree(degree));
            let sampling = CostSampling { rounds: ROUNDS, ..once };
            let found = self.measured(by, &scene, &views, &sampling)?;
            rendered.extend(found.into_iter().map(|found| (format!("luminance, SH degree {degree}"), found)));
        }
        let reference = exactly[0].1.clone();
        rendered.extend(exactly.into_iter().map(|found| ("luminance in f64".to_owned(), found)));
        let picture = |(what, (cost, images)): (String, KindCost)| {
            let (psnr_db, worst_grey) = image_differences(&images, &reference);
            PicturePrecision { rules: by.name.to_owned(), what, cost, psnr_db, worst_grey }
        };
        Ok(rendered.into_iter().map(picture).collect())
    }

    /// Makes the one pass over the fine frames of a rule set.
    fn pass(
        &self,
        by: &RuleRenderer,
        grids: &[FrameGrid],
        between: &[BetweenFrames],
        costs: RuleCosts,
    ) -> Result<(OfRules, Vec<SettingRow>), LabError> {
        let Self { window, camera, .. } = self;
        let frames = window.intervals + 1;
        let settings = grids.len() * between.len();
        (self.say)(&format!("{}: {frames} frames for {settings} settings", by.name));
        let views: Vec<CameraView> = (0..frames).map(|j| window.view(*camera, j)).collect();
        let trajectory = Trajectory {
            world_from_camera: views.iter().map(|view| view.world_from_camera).collect(),
            stamps_us: (0..frames).map(|j| window.stamp_us(j)).collect(),
        };
        let velocities: Vec<CameraVelocity> = views.iter().map(|view| view.velocity).collect();
        let renderer = by.renderer(&self.gaussians)?;
        let mut fine = RenderedFrames::new(renderer, *camera, trajectory).with_rates(velocities);
        let setup = PassSetup { sensor: &self.sensor, seed: self.seed, grids, between };
        let clock = || self.meter.time();
        let passed = feed_settings(&setup, &mut fine, &clock, &mut |_| (self.go_on)())?;
        let rows = judge_pass(&passed, grids, by.name, &costs);
        let (law, finest_s) = law_of(&rows);
        let of = OfRules {
            rules: by.name.to_owned(),
            class: by.backend.class(),
            reference: passed.reference.len(),
            law,
            finest_s,
            jitter: passed.jitter(&self.recipe_sensor, window.seconds()),
            costs,
        };
        Ok((of, rows))
    }
}
