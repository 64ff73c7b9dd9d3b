//! What a study measures with: a window of a path, its frames by each rule set, and what they cost.

use super::{RuleSet, Stepping, WorkPrecision};
use crate::camera::Camera;
use crate::cli::console::Console;
use crate::cli::machine;
use crate::cli::problem::Problem;
use crate::cli::study::cost::{Measured, Sampling, kept_at, measure_views, process_time};
use crate::cli::study::subject::Subject;
use crate::cli::study::{end_problem, go_unless, interrupted_problem, not_rendered};
use crate::frames::rendered::RenderedFrames;
use crate::render::backend::Backend;
use crate::render::flow::Meter;
use crate::render::{Channels, Rules, Style, Velocity, View};
use crate::sampling::path::Path;
use crate::scene::Gaussians;
use crate::seed::Seed;
use crate::sensor::voltmeter::{Between, Voltmeter};
use crate::study::work_precision::grid::Grid;
use crate::study::work_precision::pass::{Setup, feed_settings};
use crate::study::work_precision::{
    Costs, OfRules, Picture, Row, Study, finest_law as law_of, image_differences, judge_pass,
};
use crate::trajectory::Trajectory;
use crate::units::{Hertz, Ratio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Frames whose cost is measured, of each kind.
const SAMPLE: usize = 12;
/// Of these, pictures that are held against f64.
const PICTURES: usize = 3;
/// Times that these frames are rendered again.
const ROUNDS: usize = 3;
/// Places at which the flow is measured, at most, and the share of pixels in percent that move no faster.
const FLOWS: usize = 240;
const FLOW_PERCENT: usize = 99;

const VALUE: Channels = Channels { luminance: true, ..Channels::NONE };
const RATED: Channels = Channels { luminance_rate: true, ..VALUE };
const RGB: Channels = Channels { rgb: true, luminance: false, ..VALUE };

/// A part of a path, and the finest frames of it.
pub(super) struct Window {
    pub(super) path: Path,
    pub(super) start: f64,
    pub(super) intervals: usize,
    pub(super) finest: u32,
}

impl Window {
    fn stamp_us(&self, frame: usize) -> i64 {
        let rate = Hertz(Ratio::new(self.finest.into(), 1).expect("it is a multiple of a rate above 0"));
        rate.stamp_us(frame as u64)
    }

    fn seconds(&self) -> f64 {
        self.stamp_us(self.intervals) as f64 * 1e-6
    }

    /// At a fine frame's stamp, which is rounded: poses and events have the same time.
    fn view(&self, camera: Camera, frame: usize) -> View {
        let at = self.start + self.stamp_us(frame) as f64 * 1e-6;
        let (pose, velocity) = self.path.at(at.min(self.path.seconds()));
        View { velocity, ..View::at_rest(camera, pose) }
    }

    /// Some, evenly spread.
    fn views(&self, camera: Camera, count: usize) -> Vec<View> {
        let count = count.min(self.intervals);
        (0..count).map(|k| self.view(camera, (2 * k + 1) * self.intervals / (2 * count))).collect()
    }
}

/// Everything that is measured with.
pub(super) struct Lab<'a> {
    pub(super) subject: &'a Subject,
    pub(super) window: &'a Window,
    /// As the recipe has it.
    pub(super) own: Voltmeter,
    /// What is fed.
    pub(super) sensor: Voltmeter,
    pub(super) seed: Seed,
    pub(super) style: Style,
    pub(super) backend: Backend,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) console: &'a Console,
}

impl Lab<'_> {
    pub(super) fn study(&self, asked: &WorkPrecision, scene: String) -> Result<Study, Problem> {
        let grids = self.grids(asked)?;
        let mut study = Study {
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
        // All of these before the first pass, whose events would stay in the memory that is measured.
        let mut costs = Vec::new();
        for rules in &asked.rules {
            let (backend, style) = self.of(*rules);
            self.console.say(&format!("{}: measuring what frames cost", rules.name()));
            let kinds: &[_] = if asked.no_pictures { &[VALUE, RATED] } else { &[VALUE, RATED, RGB] };
            let kinds = self.kinds(kinds, &backend, style)?;
            costs.push(Costs { value: kinds[0].0, rated: kinds[1].0 });
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

    /// What renders a rule set, and how.
    fn of(&self, rules: RuleSet) -> (Backend, Style) {
        let style = rules.style(self.style);
        // No GPU renders soft edges yet.
        let on_cpu = self.backend.takes_gpu() && style.rules == Rules::Soft;
        (if on_cpu { Backend::Cpu } else { self.backend.clone() }, style)
    }

    fn grids(&self, asked: &WorkPrecision) -> Result<Vec<Grid>, Problem> {
        let Window { intervals, finest, .. } = *self.window;
        let uniform: Vec<Grid> =
            asked.rates.iter().map(|rate| Grid::uniform_steps(*rate, finest, intervals)).collect();
        let mut grids = Vec::new();
        if asked.steps.contains(&Stepping::Flow) {
            self.console.say("measuring how fast the picture moves");
            let flows = self.flows(asked.rules[0])?;
            grids.extend(uniform.iter().map(|uniform| Grid::flow_steps(&flows, uniform)));
        }
        if asked.steps.contains(&Stepping::Uniform) {
            grids.splice(0..0, uniform);
        }
        Ok(grids)
    }

    /// How far the picture moves in each fine interval, px: the faster of the two measured places about it.
    fn flows(&self, rules: RuleSet) -> Result<Vec<f64>, Problem> {
        let Window { intervals, finest, .. } = *self.window;
        let (backend, style) = self.of(rules);
        let gaussians = self.subject.gaussians.clone();
        let renderer = backend.renderer(gaussians, style).map_err(|e| not_rendered(&e))?;
        let mut meter = Meter::new(renderer, self.subject.camera);
        let every = intervals.div_ceil(FLOWS);
        let mut measured = Vec::new();
        for place in 0..=intervals.div_ceil(every) {
            let view = self.window.view(self.subject.camera, (place * every).min(intervals));
            let speed = meter.speed_px(&view.world_from_camera, view.velocity, FLOW_PERCENT);
            measured.push(speed.map_err(|e| not_rendered(&e))?.unwrap_or(0.0));
            self.go_on()?;
        }
        let faster = |j: usize| measured[j / every].max(measured[j / every + 1]);
        Ok((0..intervals).map(|j| faster(j) / f64::from(finest)).collect())
    }

    fn go_on(&self) -> Result<(), Problem> {
        if go_unless(&self.cancelled).is_break() { Err(interrupted_problem()) } else { Ok(()) }
    }

    /// Costs of these kinds of frames.
    fn kinds(&self, kinds: &[Channels], backend: &Backend, style: Style) -> Result<Vec<Measured>, Problem> {
        let views = self.window.views(self.subject.camera, SAMPLE);
        let sampling = Sampling { kinds, keep: PICTURES, rounds: ROUNDS };
        self.measured((backend, style), &self.subject.gaussians, &views, &sampling)
    }

    fn measured(
        &self,
        (backend, style): (&Backend, Style),
        scene: &Arc<Gaussians>,
        views: &[View],
        sampling: &Sampling<'_>,
    ) -> Result<Vec<Measured>, Problem> {
        let mut renderer = backend.renderer(scene.clone(), style).map_err(|e| not_rendered(&e))?;
        let poses: Vec<_> = views.iter().map(|view| view.world_from_camera).collect();
        renderer.keep_to(&self.subject.camera, &poses);
        measure_views(&mut *renderer, views, sampling, &|| go_unless(&self.cancelled))
    }

    /// How ways of rendering, these kinds among them, differ from f64.
    fn pictures(
        &self,
        rules: RuleSet,
        (backend, style): (&Backend, Style),
        kinds: Vec<Measured>,
    ) -> Result<Vec<Picture>, Problem> {
        let whole = &self.subject.gaussians;
        let views = self.window.views(self.subject.camera, SAMPLE);
        let few: Vec<View> = kept_at(views.len(), PICTURES).map(|at| views[at]).collect();
        let once = Sampling { kinds: &[VALUE], keep: PICTURES, rounds: 0 };
        let exactly = self.measured((&Backend::Reference, style), whole, &few, &once)?;
        let names = ["luminance", "luminance and its rate", "rgb"].map(str::to_owned);
        let mut rendered: Vec<(String, Measured)> = names.into_iter().zip(kinds).collect();
        for degree in (0..whole.sh_degree).rev() {
            let scene = Arc::new(whole.with_degree(degree));
            let sampling = Sampling { rounds: ROUNDS, ..once };
            let found = self.measured((backend, style), &scene, &views, &sampling)?;
            rendered.extend(found.into_iter().map(|found| (format!("luminance, SH degree {degree}"), found)));
        }
        let reference = exactly[0].1.clone();
        rendered.extend(exactly.into_iter().map(|found| ("luminance in f64".to_owned(), found)));
        let picture = |(what, (cost, images)): (String, Measured)| {
            let (psnr_db, worst_grey) = image_differences(&images, &reference);
            Picture { rules: rules.name().to_owned(), what, cost, psnr_db, worst_grey }
        };
        Ok(rendered.into_iter().map(picture).collect())
    }

    /// The one pass over the fine frames of a rule set.
    fn pass(
        &self,
        rules: RuleSet,
        (backend, style): (&Backend, Style),
        (grids, between): (&[Grid], &[Between]),
        costs: Costs,
    ) -> Result<(OfRules, Vec<Row>), Problem> {
        let Self { subject, window, .. } = self;
        let frames = window.intervals + 1;
        let settings = grids.len() * between.len();
        self.console.say(&format!("{}: {frames} frames for {settings} settings", rules.name()));
        let views: Vec<View> = (0..frames).map(|j| window.view(subject.camera, j)).collect();
        let trajectory = Trajectory {
            world_from_camera: views.iter().map(|view| view.world_from_camera).collect(),
            stamps_us: (0..frames).map(|j| window.stamp_us(j)).collect(),
        };
        let velocities: Vec<Velocity> = views.iter().map(|view| view.velocity).collect();
        let renderer = backend.renderer(subject.gaussians.clone(), style).map_err(|e| not_rendered(&e))?;
        let mut fine = RenderedFrames::new(renderer, subject.camera, trajectory).with_rates(velocities);
        let setup = Setup { sensor: &self.sensor, seed: self.seed, grids, between };
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
