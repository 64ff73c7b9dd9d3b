//! `gs2e study`: error against run time.

use super::cost::{Measured, Sampling, kept_at, measure, spent};
use super::subject::{self, Subject};
use super::{ended, interrupted, not_rendered, unless};
use crate::camera::Camera;
use crate::cli::console::Console;
use crate::cli::output::{self, Output};
use crate::cli::problem::{Exit, Problem};
use crate::cli::{Common, Targets, machine, on_interrupt};
use crate::frames::rendered::RenderedFrames;
use crate::render::backend::Backend;
use crate::render::flow::Meter;
use crate::render::{Channels, Layering, Rules, Style, Velocity, View};
use crate::sampling::path::Path;
use crate::scene::Gaussians;
use crate::seed::{Purpose, Seed};
use crate::sensor::noise::HotPixels;
use crate::sensor::voltmeter::{Between, Gain, Law, Voltmeter};
use crate::study::work_precision::grid::Grid;
use crate::study::work_precision::pass::{Setup, pass};
use crate::study::work_precision::pick::Measure;
use crate::study::work_precision::{
    Costs, OfRules, Picture, Row, Study, chart, differences, judge, law as law_of, report,
};
use crate::trajectory::Trajectory;
use crate::units::{Hertz, Ratio};
use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Arguments of `study` itself.
#[derive(Debug, clap::Args)]
pub(super) struct WorkPrecision {
    /// The recipe; its scene is built
    #[arg(value_name = "RECIPE", default_value = Targets::DEFAULT)]
    recipe: PathBuf,
    /// Which trajectory [default: the first]
    #[arg(long, value_name = "NAME")]
    trajectory: Option<String>,
    /// Where the window begins, seconds of the trajectory [default: about its middle]
    #[arg(long, value_name = "S")]
    start: Option<f64>,
    /// How long the window is [default: 0.1, or the whole trajectory]
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Frames a second
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "150,300,600,1200,2400,4800")]
    rates: Vec<u32>,
    /// Frames a second of the reference, an even multiple of each rate
    #[arg(long, value_name = "HZ", default_value_t = 9600)]
    finest: u32,
    /// Brightness between frames
    #[arg(
        long,
        value_enum,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "linear,catmull,hermite"
    )]
    between: Vec<Interpolation>,
    /// Times of frames
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', default_value = "uniform,flow")]
    steps: Vec<Stepping>,
    /// Rule sets; the first is the one that the others are held against
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', default_value = "official,soft")]
    rules: Vec<RuleSet>,
    /// Let the sensors have their noise, the same in all
    #[arg(long)]
    noise: bool,
    /// Leave out the pictures against f64
    #[arg(long)]
    no_pictures: bool,
    /// Where table, pictures and words go [default: study/SCENE]
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Interpolation {
    Linear,
    Catmull,
    Hermite,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Stepping {
    Uniform,
    Flow,
}

/// Rules and order of layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum RuleSet {
    Official,
    Exact,
    Gsplat,
    Soft,
    /// `soft` with `order: blended`
    Blended,
}

impl RuleSet {
    fn name(self) -> &'static str {
        match self {
            Self::Official => "official",
            Self::Exact => "exact",
            Self::Gsplat => "gsplat",
            Self::Soft => "soft",
            Self::Blended => "blended",
        }
    }

    fn style(self, style: Style) -> Style {
        let (rules, order) = match self {
            Self::Official => (Rules::Official, Layering::Depth),
            Self::Exact => (Rules::Exact, Layering::Depth),
            Self::Gsplat => (Rules::Gsplat, Layering::Depth),
            Self::Soft => (Rules::Soft, Layering::Depth),
            Self::Blended => (Rules::Soft, Layering::Blended),
        };
        Style { rules, order, ..style }
    }
}

/// Length of the window where nobody says, s.
const USUAL_S: f64 = 0.1;
/// Frames whose cost is measured, of each kind.
const SAMPLE: usize = 12;
/// Of these, pictures that are held against f64.
const PICTURES: usize = 3;
/// Times that these frames are rendered again.
const ROUNDS: usize = 3;
/// Places at which the flow is measured, at most, and the share of pixels in percent that move no faster.
const FLOWS: usize = 240;
const FLOW_PERCENT: usize = 99;

const VALUE: Channels = Channels {
    luminance: true,
    rgb: false,
    alpha: false,
    depth: false,
    flow: false,
    luminance_rate: false,
    doubtful: false,
};
const RATED: Channels = Channels { luminance_rate: true, ..VALUE };
const RGB: Channels = Channels { rgb: true, luminance: false, ..VALUE };

impl WorkPrecision {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        self.screen()?;
        let recipe = subject::recipe(&self.recipe)?;
        let name = subject::trajectory(&recipe, self.trajectory.as_deref())?;
        let sensor = subject::sensor(&recipe)?;
        common.limit_cores();
        let backend = common.backend()?;
        let to = self.to.clone().unwrap_or_else(|| PathBuf::from("study").join(&recipe.scene));
        let seed = Seed::derive(recipe.seed, &recipe.scene, &name, Purpose::Sensor);
        let scene = format!("{}/{name}", recipe.scene);
        let render = recipe.render;
        let subject = Subject::open(recipe, &name, common)?;
        let style = render.resolve(subject.gaussians.antialiased);
        let window = self.window(&subject)?;
        fs::create_dir_all(&to).map_err(|e| output::unwritable(&to, e))?;
        let lab = Lab {
            subject: &subject,
            window: &window,
            own: sensor.clone(),
            sensor: if self.noise { law(&sensor) } else { quiet(&law(&sensor)) },
            seed,
            style,
            backend,
            cancelled: on_interrupt()?,
            console,
        };
        let study = lab.study(&self, scene)?;
        write(&study, &to)?;
        if console.json {
            console.large_result(&study);
        } else {
            console.print(&report::paragraph(&study));
            console.print(&format!("table, pictures and words: {}", to.display()));
        }
        Ok(Exit::Done)
    }

    fn screen(&self) -> Result<(), Problem> {
        let refuse = |what: String| Err(Problem::usage("rates", what));
        if self.finest > 1_000_000 {
            return refuse(format!("--finest {}, wanted at most 1000000", self.finest));
        }
        let even = |rate: u32| rate > 0 && self.finest.is_multiple_of(rate.saturating_mul(2));
        if let Some(rate) = self.rates.iter().find(|rate| !even(**rate)) {
            return refuse(format!("--rates {rate}: --finest {} is no even multiple of it", self.finest));
        }
        if self.rates.is_empty() || !self.rates.is_sorted_by(|a, b| a < b) {
            return refuse(format!("--rates {:?}, wanted rising numbers", self.rates));
        }
        let positive = |value: Option<f64>| value.is_none_or(|v| v.is_finite() && v >= 0.0);
        if !positive(self.start) || !positive(self.seconds) {
            return Err(Problem::usage("window", "--start and --seconds are numbers from 0".to_owned()));
        }
        Ok(())
    }

    fn window(&self, subject: &Subject) -> Result<Window, Problem> {
        let refuse = |what: String| Problem::usage("window", what);
        let poses = &subject.motion.trajectory.world_from_camera;
        if poses.len() < 2 {
            return Err(refuse("the trajectory has a single pose: nothing moves".to_owned()));
        }
        let path = Path::through(poses, subject.motion.seconds())
            .map_err(|e| Problem::failed("step-failed", format!("failed to follow the path: {e}")))?;
        let whole = path.seconds();
        let seconds = self.seconds.unwrap_or(USUAL_S.min(whole - self.start.unwrap_or(0.0)));
        let finest = f64::from(self.finest);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate")]
        let pairs = (seconds * finest / 2.0 + 1e-6).floor() as usize;
        let intervals = 2 * pairs;
        let start = self.start.unwrap_or(((whole - seconds) / 2.0).max(0.0));
        // Stamps are whole microseconds.
        if start + intervals as f64 / finest > whole + 1e-6 {
            let what =
                format!("{seconds} s from {start} s on reach beyond the trajectory's end at {whole} s");
            return Err(refuse(what));
        }
        let coarsest = (self.finest / self.rates[0]) as usize;
        if intervals < 2 * coarsest {
            let what = format!("{seconds} s hold fewer than two steps at {} frames a second", self.rates[0]);
            return Err(refuse(what).help("a longer window, or higher --rates"));
        }
        Ok(Window { path, start, intervals, finest: self.finest })
    }

    fn between(&self) -> Vec<Between> {
        let of = |between: &Interpolation| match between {
            Interpolation::Linear => Between::Linear,
            Interpolation::Catmull => Between::Catmull,
            Interpolation::Hermite => Between::Hermite,
        };
        self.between.iter().map(of).collect()
    }
}

/// The sensor by the law whose events do not depend on frames, without what is not of the signal.
fn law(sensor: &Voltmeter) -> Voltmeter {
    Voltmeter {
        law: Law::Exact,
        gain: Gain::Log,
        max_events_per_pixel_frame: u32::MAX,
        allow_cap: false,
        threshold_spread: 0.0,
        hot_pixels: HotPixels::default(),
        ..sensor.clone()
    }
}

fn quiet(sensor: &Voltmeter) -> Voltmeter {
    let [k1, k2, _, k4, k5, _] = sensor.k;
    Voltmeter { k: [k1, k2, 0.0, k4, k5, 0.0], ..sensor.clone() }
}

/// A part of a path, and the finest frames of it.
struct Window {
    path: Path,
    start: f64,
    intervals: usize,
    finest: u32,
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
        View { velocity, ..View::still(camera, pose) }
    }

    /// Some, evenly spread.
    fn views(&self, camera: Camera, count: usize) -> Vec<View> {
        let count = count.min(self.intervals);
        (0..count).map(|k| self.view(camera, (2 * k + 1) * self.intervals / (2 * count))).collect()
    }
}

/// Everything that is measured with.
struct Lab<'a> {
    subject: &'a Subject,
    window: &'a Window,
    /// As the recipe has it.
    own: Voltmeter,
    /// What is fed.
    sensor: Voltmeter,
    seed: Seed,
    style: Style,
    backend: Backend,
    cancelled: Arc<AtomicBool>,
    console: &'a Console,
}

impl Lab<'_> {
    fn study(&self, asked: &WorkPrecision, scene: String) -> Result<Study, Problem> {
        let grids = self.grids(asked)?;
        let mut study = Study {
            scene,
            size: self.subject.camera.size,
            cores: machine::cores(),
            processor: machine::processor(),
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
            asked.rates.iter().map(|rate| Grid::uniform(*rate, finest, intervals)).collect();
        let mut grids = Vec::new();
        if asked.steps.contains(&Stepping::Flow) {
            self.console.say("measuring how fast the picture moves");
            let flows = self.flows(asked.rules[0])?;
            grids.extend(uniform.iter().map(|uniform| Grid::flow(&flows, uniform)));
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
        if unless(&self.cancelled).is_break() { Err(interrupted()) } else { Ok(()) }
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
        measure(&mut *renderer, views, sampling, &|| unless(&self.cancelled))
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
            let (psnr_db, worst_grey) = differences(&images, &reference);
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
        let passed = pass(&setup, &mut fine, &spent, &mut |_| unless(&self.cancelled)).map_err(ended)?;
        let rows = judge(&passed, grids, rules.name(), &costs);
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

/// Puts everything into a folder.
fn write(study: &Study, to: &std::path::Path) -> Result<(), Problem> {
    let table = |out: &mut dyn Write| report::csv(study, out);
    let json = |out: &mut dyn Write| Ok(serde_json::to_writer_pretty(out, study)?);
    let words = report::words(study);
    let words = |out: &mut dyn Write| out.write_all(words.as_bytes());
    let charts: Vec<(PathBuf, String)> = Measure::ALL
        .iter()
        .filter_map(|measure| {
            Some((to.join(format!("{}.svg", measure.name())), chart::svg(study, *measure)?))
        })
        .collect();
    type Fill<'a> = Box<dyn Fn(&mut dyn Write) -> std::io::Result<()> + 'a>;
    let charted: Vec<(&PathBuf, Fill<'_>)> = charts
        .iter()
        .map(|(path, svg)| (path, Box::new(|out: &mut dyn Write| out.write_all(svg.as_bytes())) as Fill<'_>))
        .collect();
    let [csv_at, json_at, words_at] =
        ["work_precision.csv", "work_precision.json", "summary.md"].map(|name| to.join(name));
    let mut outputs = vec![
        Output { path: &csv_at, fill: &table },
        Output { path: &json_at, fill: &json },
        Output { path: &words_at, fill: &words },
    ];
    outputs.extend(charted.iter().map(|(path, fill)| Output { path, fill }));
    output::write(&outputs)
}
