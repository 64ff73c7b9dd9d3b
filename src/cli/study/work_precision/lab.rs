//! The laboratory of a study: a window of a path, its frames by each rule set, and their costs.

use super::{RuleSet, SteppingArg, WorkPrecision};
use crate::camera::Camera;
use crate::cli::console::Console;
use crate::cli::machine;
use crate::cli::problem::VerbError;
use crate::cli::study::cost::{CostSampling, Measured, kept_at, measure_views, process_time};
use crate::cli::study::subject::StudySubject;
use crate::cli::study::{end_problem, go_unless, interrupted_problem, not_rendered};
use crate::frames::rendered::RenderedFrames;
use crate::render::backend::Backend;
use crate::render::flow::PixelFlowMeter;
use crate::render::{CameraVelocity, CameraView, ChannelSet, RenderRules, RenderStyle};
use crate::sampling::path::SampledPath;
use crate::scene::Gaussians;
use crate::seed::Seed;
use crate::sensor::voltmeter::{BetweenFrames, VoltmeterModel};
use crate::study::work_precision::grid::FrameGrid;
use crate::study::work_precision::pass::{PassSetup, feed_settings};
use crate::study::work_precision::{
    OfRules, PicturePrecision, RuleCosts, SettingRow, StudyResult, finest_law as law_of, image_differences,
    judge_pass,
};
use crate::trajectory::Trajectory;
use crate::units::{Hertz, Ratio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

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

/// A part of a path, and its finest frames.
pub(super) struct FineWindow {
    pub(super) path: SampledPath,
    pub(super) start: f64,
    pub(super) intervals: usize,
    pub(super) finest: u32,
}

impl FineWindow {
    fn stamp_us(&self, frame: usize) -> i64 {
        let rate = Hertz(Ratio::new(self.finest.into(), 1).expect("it is a multiple of a rate above 0"));
        rate.stamp_us(frame as u64)
    }

    fn seconds(&self) -> f64 {
        self.stamp_us(self.intervals) as f64 * 1e-6
    }

    /// The view at a fine frame. Its time is the rounded stamp, so that poses and events have the
    /// same time.
    fn view(&self, camera: Camera, frame: usize) -> CameraView {
        let at = self.start + self.stamp_us(frame) as f64 * 1e-6;
        // A rounded stamp may lie beyond the end of the path.
        let (pose, velocity) = self.path.at(at.min(self.path.seconds()));
        CameraView { velocity, ..CameraView::at_rest(camera, pose) }
    }

    /// Up to `count` views, evenly spread.
    fn views(&self, camera: Camera, count: usize) -> Vec<CameraView> {
        let count = count.min(self.intervals);
        (0..count).map(|k| self.view(camera, (2 * k + 1) * self.intervals / (2 * count))).collect()
    }
}

/// The equipment of a study.
pub(super) struct StudyLab<'a> {
    pub(super) subject: &'a StudySubject,
    pub(super) window: &'a FineWindow,
    /// The sensor of the recipe.
    pub(super) own: VoltmeterModel,
    /// The sensor that is fed with frames.
    pub(super) sensor: VoltmeterModel,
    pub(super) seed: Seed,
    pub(super) style: RenderStyle,
    pub(super) backend: Backend,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) console: &'a Console,
}

impl StudyLab<'_> {
    pub(super) fn study(&self, asked: &WorkPrecision, scene: String) -> Result<StudyResult, VerbError> {
        let grids = self.grids(asked)?;
        let mut study = StudyResult {
            scene,
            size: self.subject.camera.size,
            cores: machine::available_cores(),
            processor: machine::processor_name(),
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
            let (backend, style) = self.of(*rules);
            self.console.say(&format!("{}: measuring the cost of frames", rules.name()));
            let kinds: &[_] = if asked.no_pictures { &[VALUE, RATED] } else { &[VALUE, RATED, RGB] };
            let kinds = self.kinds(kinds, &backend, style)?;
            costs.push(RuleCosts { value: kinds[0].0, rated: kinds[1].0 });
            if !asked.no_pictures {
                study.pictures.extend(self.pictures(*rules, (&backend, style), kinds)?);
            }
        }
        for (rules, costs) in asked.rules.iter().zip(costs) {
            let (backend, style) = self.of(*rules);
            let (of, rows) = self.pass(*rules, (&backend, style), (&grids, &asked.between()), costs)?;
            study.rules.push(of);
            study.rows.extend(rows);
        }
        Ok(study)
    }

    /// The back end and the style of a rule set.
    fn of(&self, rules: RuleSet) -> (Backend, RenderStyle) {
        let style = rules.style(self.style);
        // Soft rules are rendered on the CPU, in both orders of layers. Only the blended order
        // requires it.
        let on_cpu = self.backend.takes_gpu() && style.rules == RenderRules::Soft;
        (if on_cpu { Backend::Cpu } else { self.backend.clone() }, style)
    }

    fn grids(&self, asked: &WorkPrecision) -> Result<Vec<FrameGrid>, VerbError> {
        let FineWindow { intervals, finest, .. } = *self.window;
        let uniform: Vec<FrameGrid> =
            asked.rates.iter().map(|rate| FrameGrid::uniform_steps(*rate, finest, intervals)).collect();
        let mut grids = Vec::new();
        if asked.steps.contains(&SteppingArg::Flow) {
            self.console.say("measuring the optical flow");
            let flows = self.flows(asked.rules[0])?;
            grids.extend(uniform.iter().map(|uniform| FrameGrid::flow_steps(&flows, uniform)));
        }
        // Uniform grids come first in the table.
        if asked.steps.contains(&SteppingArg::Uniform) {
            grids.splice(0..0, uniform);
        }
        Ok(grids)
    }

    /// Motion of the picture in each fine interval, px: the faster of the two measured places
    /// around it.
    fn flows(&self, rules: RuleSet) -> Result<Vec<f64>, VerbError> {
        let FineWindow { intervals, finest, .. } = *self.window;
        let (backend, style) = self.of(rules);
        let gaussians = self.subject.gaussians.clone();
        let renderer = backend.renderer(gaussians, style).map_err(|e| not_rendered(&e))?;
        let mut meter = PixelFlowMeter::new(renderer, self.subject.camera);
        let every = intervals.div_ceil(FLOWS);
        let mut measured = Vec::new();
        for place in 0..=intervals.div_ceil(every) {
            let view = self.window.view(self.subject.camera, (place * every).min(intervals));
            let speed = meter.speed_px(&view.world_from_camera, view.velocity, FLOW_PERCENT);
            // A picture without depth does not move.
            measured.push(speed.map_err(|e| not_rendered(&e))?.unwrap_or(0.0));
            self.go_on()?;
        }
        let faster = |j: usize| measured[j / every].max(measured[j / every + 1]);
        Ok((0..intervals).map(|j| faster(j) / f64::from(finest)).collect())
    }

    fn go_on(&self) -> Result<(), VerbError> {
        if go_unless(&self.cancelled).is_break() { Err(interrupted_problem()) } else { Ok(()) }
    }

    /// Measures the costs of these kinds of frames.
    fn kinds(
        &self,
        kinds: &[ChannelSet],
        backend: &Backend,
        style: RenderStyle,
    ) -> Result<Vec<Measured>, VerbError> {
        let views = self.window.views(self.subject.camera, SAMPLE);
        let sampling = CostSampling { kinds, keep: PICTURES, rounds: ROUNDS };
        self.measured((backend, style), &self.subject.gaussians, &views, &sampling)
    }

    fn measured(
        &self,
        (backend, style): (&Backend, RenderStyle),
        scene: &Arc<Gaussians>,
        views: &[CameraView],
        sampling: &CostSampling<'_>,
    ) -> Result<Vec<Measured>, VerbError> {
        let mut renderer = backend.renderer(scene.clone(), style).map_err(|e| not_rendered(&e))?;
        let poses: Vec<_> = views.iter().map(|view| view.world_from_camera).collect();
        // The same promise as in a build, which renders known poses only.
        renderer.keep_to(&self.subject.camera, &poses);
        measure_views(&mut *renderer, views, sampling, &|| go_unless(&self.cancelled))
    }

    /// The differences from f64 of several ways to render, these kinds among them.
    fn pictures(
        &self,
        rules: RuleSet,
        (backend, style): (&Backend, RenderStyle),
        kinds: Vec<Measured>,
    ) -> Result<Vec<PicturePrecision>, VerbError> {
        let whole = &self.subject.gaussians;
        let views = self.window.views(self.subject.camera, SAMPLE);
        let few: Vec<CameraView> = kept_at(views.len(), PICTURES).map(|at| views[at]).collect();
        let once = CostSampling { kinds: &[VALUE], keep: PICTURES, rounds: 0 };
        let exactly = self.measured((&Backend::Reference, style), whole, &few, &once)?;
        let names = ["luminance", "luminance and its rate", "rgb"].map(str::to_owned);
        let mut rendered: Vec<(String, Measured)> = names.into_iter().zip(kinds).collect();
        for degree in (0..whole.sh_degree).rev() {
            let scene = Arc::new(whole.with_degree(degree));
            let sampling = CostSampling { rounds: ROUNDS, ..once };
            let found = self.measured((backend, style), &scene, &views, &sampling)?;
            rendered.extend(found.into_iter().map(|found| (format!("luminance, SH degree {degree}"), found)));
        }
        let reference = exactly[0].1.clone();
        rendered.extend(exactly.into_iter().map(|found| ("luminance in f64".to_owned(), found)));
        let picture = |(what, (cost, images)): (String, Measured)| {
            let (psnr_db, worst_grey) = image_differences(&images, &reference);
            PicturePrecision { rules: rules.name().to_owned(), what, cost, psnr_db, worst_grey }
        };
        Ok(rendered.into_iter().map(picture).collect())
    }

    /// Makes the one pass over the fine frames of a rule set.
    fn pass(
        &self,
        rules: RuleSet,
        (backend, style): (&Backend, RenderStyle),
        (grids, between): (&[FrameGrid], &[BetweenFrames]),
        costs: RuleCosts,
    ) -> Result<(OfRules, Vec<SettingRow>), VerbError> {
        let Self { subject, window, .. } = self;
        let frames = window.intervals + 1;
        let settings = grids.len() * between.len();
        self.console.say(&format!("{}: {frames} frames for {settings} settings", rules.name()));
        let views: Vec<CameraView> = (0..frames).map(|j| window.view(subject.camera, j)).collect();
        let trajectory = Trajectory {
            world_from_camera: views.iter().map(|view| view.world_from_camera).collect(),
            stamps_us: (0..frames).map(|j| window.stamp_us(j)).collect(),
        };
        let velocities: Vec<CameraVelocity> = views.iter().map(|view| view.velocity).collect();
        let renderer = backend.renderer(subject.gaussians.clone(), style).map_err(|e| not_rendered(&e))?;
        let mut fine = RenderedFrames::new(renderer, subject.camera, trajectory).with_rates(velocities);
        let setup = PassSetup { sensor: &self.sensor, seed: self.seed, grids, between };
        let passed = feed_settings(&setup, &mut fine, &process_time, &mut |_| go_unless(&self.cancelled))
            .map_err(end_problem)?;
        let rows = judge_pass(&passed, grids, rules.name(), &costs);
        let (law, finest_s) = law_of(&rows);
        let of = OfRules {
            rules: rules.name().to_owned(),
            class: backend.class(),
            reference: passed.reference.len(),
            law,
            finest_s,
            jitter: passed.jitter(&self.own, window.seconds()),
            costs,
        };
        Ok((of, rows))
    }
}
