//! `gs2e study`: measures error against run time.

use super::meter::ThisProcess;
use super::subject::{StudySubject, SubjectArgs};
use super::{go_unless, lab_problem};
use crate::cli::output::{self, OutputFile};
use crate::cli::words::{Word, one_of};
use crate::cli::{CommonArgs, Console, ExitKind, VerbError, machine, on_interrupt};
use clap::builder::PossibleValuesParser;
use gs2e_files as files;
use gs2e_lab::work_precision::lab::{NamedRules, StudyLab, StudyMachine, StudyPlan};
use gs2e_lab::work_precision::pick::ErrorMeasure;
use gs2e_lab::work_precision::recommend::RecommendedSetting;
use gs2e_lab::work_precision::window::FineWindow;
use gs2e_lab::work_precision::{StudyResult, chart, report};
use gs2e_render::{LayerOrder, RenderRules};
use gs2e_sensor::SensorSettings;
use gs2e_sensor::noise::HotPixelNoise;
use gs2e_sensor::voltmeter::{BetweenFrames, DriftGain, SamplerKind, VoltmeterModel};
use gs2e_trajectory::sampled::SampledPath;
use std::fs;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `study` without a subcommand.
#[derive(Debug, clap::Args)]
pub(super) struct WorkPrecision {
    #[command(flatten)]
    subject: SubjectArgs,
    /// Begin of the window, seconds of the trajectory [default: in its middle]
    #[arg(long, value_name = "S")]
    start: Option<f64>,
    /// Length of the window, seconds [default: 0.1, or the whole trajectory]
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Frames per second
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "150,300,600,1200,2400,4800")]
    rates: Vec<u32>,
    /// Frames per second of the reference, an even multiple of each rate
    #[arg(long, value_name = "HZ", default_value_t = 9600)]
    finest: u32,
    /// Brightness between frames
    #[arg(long, value_parser = one_of(&BETWEEN), value_name = "LIST", value_delimiter = ',')]
    #[arg(default_value = "linear,catmull,hermite")]
    between: Vec<BetweenFrames>,
    /// Spacing of frames
    #[arg(long, value_parser = PossibleValuesParser::new(STEPS), value_name = "LIST", value_delimiter = ',')]
    #[arg(default_value = "uniform,flow")]
    steps: Vec<String>,
    /// Rule sets; the others are compared with the first
    #[arg(long, value_parser = one_of(&RULE_SETS), value_name = "LIST", value_delimiter = ',')]
    #[arg(default_value = "official,soft")]
    rules: Vec<NamedRules>,
    /// Give all sensors the same noise, instead of none
    #[arg(long)]
    noise: bool,
    /// Skip the comparison of pictures with the float64 renderer
    #[arg(long)]
    no_pictures: bool,
    /// Folder for table, pictures and summary [default: study/SCENE]
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
}

const BETWEEN: [Word<BetweenFrames>; 3] = [
    ("linear", "", BetweenFrames::Linear),
    ("catmull", "", BetweenFrames::Catmull),
    ("hermite", "", BetweenFrames::Hermite),
];

const STEPS: [&str; 2] = ["uniform", "flow"];

/// Rule sets and orders of layers.
const RULE_SETS: [Word<NamedRules>; 5] = [
    ("official", "", NamedRules { name: "official", rules: RenderRules::Official, order: LayerOrder::Depth }),
    ("exact", "", NamedRules { name: "exact", rules: RenderRules::Exact, order: LayerOrder::Depth }),
    ("gsplat", "", NamedRules { name: "gsplat", rules: RenderRules::Gsplat, order: LayerOrder::Depth }),
    ("soft", "", NamedRules { name: "soft", rules: RenderRules::Soft, order: LayerOrder::Depth }),
    (
        "blended",
        "`soft` with `order: blended`",
        NamedRules { name: "blended", rules: RenderRules::Soft, order: LayerOrder::Blended },
    ),
];

/// A study as one JSON object.
#[derive(serde::Serialize)]
struct StudyRecord<'a> {
    #[serde(flatten)]
    study: &'a StudyResult,
    recommended: Option<RecommendedSetting>,
}

/// Default length of the window, s.
const DEFAULT_S: f64 = 0.1;

impl WorkPrecision {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.screen()?;
        let subject = self.subject.open(common)?;
        let to = self.to.clone().unwrap_or_else(|| PathBuf::from("study").join(&subject.scene));
        let window = self.window(&subject)?;
        let whole = subject.motion.seconds().last().copied().unwrap_or(0.0);
        refuse_others(&to)?;
        // A folder that cannot be created is reported before the measurements, which take long.
        fs::create_dir_all(&to).map_err(|e| output::unwritable_file(&to, e))?;
        let cancelled = on_interrupt()?;
        let (name, linear_only) = (subject.name(), subject.sensor.law != SamplerKind::Exact);
        let lab = StudyLab {
            gaussians: subject.gaussians,
            camera: subject.camera,
            window: &window,
            sensor: frame_independent(&subject.sensor, self.noise),
            recipe_sensor: subject.sensor,
            seed: subject.seed,
            style: subject.style,
            backend: subject.backend,
            meter: &ThisProcess,
            go_on: &|| go_unless(&cancelled),
            say: &|line| console.note(line),
        };
        let machine =
            StudyMachine { cores: machine::available_cores(), processor: machine::processor_name() };
        let study = lab.study(&self.plan(), name, machine).map_err(lab_problem)?;
        write_study(&study, &to)?;
        let recommended = RecommendedSetting::from_study(&study, linear_only);
        if console.json {
            console.result(&StudyRecord { study: &study, recommended });
            return Ok(ExitKind::Done);
        }
        console.print(&report::conclusion_words(&study));
        console.print(&format!("table, plots and text: {}", to.display()));
        if let Some(RecommendedSetting { recipe, because }) = recommended {
            console.print("For the recipe:");
            console.print_lines(&recipe);
            console.print(&format!("because {because}"));
            console.print(&format!(
                "another rate changes the speed of a path with `frames` or `factor`; `duration: {whole:.6} s` in their place \
                 keeps it"
            ));
        }
        Ok(ExitKind::Done)
    }

    fn plan(&self) -> StudyPlan {
        StudyPlan {
            rules: self.rules.clone(),
            rates: self.rates.clone(),
            between: self.between.clone(),
            uniform: self.steps.iter().any(|name| name == "uniform"),
            by_flow: self.steps.iter().any(|name| name == "flow"),
            noise: self.noise,
            pictures: !self.no_pictures,
        }
    }

    fn screen(&self) -> Result<(), VerbError> {
        let refuse = |what: String| Err(VerbError::usage("rates", what));
        if self.finest > 1_000_000 {
            return refuse(format!("--finest {}, wanted at most 1000000", self.finest));
        }
        // The middle of each step must be a fine frame, so a step has an even number of intervals.
        let even = |rate: u32| rate > 0 && self.finest.is_multiple_of(rate.saturating_mul(2));
        if let Some(rate) = self.rates.iter().find(|rate| !even(**rate)) {
            return refuse(format!("--rates {rate}: --finest {} is not an even multiple of it", self.finest));
        }
        if self.rates.is_empty() || !self.rates.is_sorted_by(|a, b| a < b) {
            return refuse(format!("--rates {:?}, wanted increasing numbers", self.rates));
        }
        let positive = |value: Option<f64>| value.is_none_or(|v| v.is_finite() && v >= 0.0);
        if !positive(self.start) || !positive(self.seconds) {
            return Err(VerbError::usage("window", "--start and --seconds must be at least 0"));
        }
        Ok(())
    }

    fn window(&self, subject: &StudySubject) -> Result<FineWindow, VerbError> {
        let refuse = |what: String| VerbError::usage("window", what);
        let poses = &subject.motion.trajectory.world_from_camera;
        if poses.len() < 2 {
            return Err(refuse("the trajectory has a single pose: nothing moves".to_owned()));
        }
        let path = SampledPath::through_poses(poses, subject.motion.seconds())
            .map_err(|e| VerbError::failed("step-failed", format!("failed to follow the path: {e}")))?;
        let whole = path.seconds();
        let seconds = self.seconds.unwrap_or(DEFAULT_S.min(whole - self.start.unwrap_or(0.0)));
        let finest = f64::from(self.finest);
        // The tolerance keeps a window whose length is a multiple of the interval but for rounding.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate")]
        let pairs = (seconds * finest / 2.0 + 1e-6).floor() as usize;
        let intervals = 2 * pairs;
        let start = self.start.unwrap_or(((whole - seconds) / 2.0).max(0.0));
        // Stamps are whole microseconds, so the end may exceed the path by a fraction of one.
        if start + intervals as f64 / finest > whole + 1e-6 {
            let what =
                format!("{seconds} s from {start} s extend beyond the end of the trajectory at {whole} s");
            return Err(refuse(what));
        }
        // The rates rise, so the first has the longest steps.
        let coarsest = (self.finest / self.rates[0]) as usize;
        if intervals < 2 * coarsest {
            let what =
                format!("{seconds} s have fewer than two steps at {} frames per second", self.rates[0]);
            return Err(refuse(what).help("use a longer window, or higher --rates"));
        }
        Ok(FineWindow { path, start, intervals, finest: self.finest })
    }
}

/// The sensor with the law whose events do not depend on frames, and without hot pixels, mismatch
/// and the cap, which are not part of the signal; without the noise of the law too unless `noise` is set.
fn frame_independent(sensor: &VoltmeterModel, noise: bool) -> VoltmeterModel {
    // `k3` and `k6` are the noise terms of the law.
    let [k1, k2, _, k4, k5, _] = sensor.k;
    VoltmeterModel {
        k: if noise { sensor.k } else { [k1, k2, 0.0, k4, k5, 0.0] },
        law: SamplerKind::Exact,
        gain: DriftGain::Log,
        threshold_spread: 0.0,
        settings: SensorSettings {
            max_events_per_pixel_frame: u32::MAX,
            allow_cap: false,
            hot_pixels: HotPixelNoise::default(),
            ..sensor.settings
        },
        ..sensor.clone()
    }
}

/// Name of the summary.
const SUMMARY: &str = "summary.md";

/// Refuses a folder with files that no study wrote: some of them could have the names of the study's own.
fn refuse_others(to: &std::path::Path) -> Result<(), VerbError> {
    let is_empty = || fs::read_dir(to).map_or(true, |mut entries| entries.next().is_none());
    let summary = files::read_text(&to.join(SUMMARY), files::MAX_TEXT);
    if is_empty() || summary.is_ok_and(|text| text.starts_with(report::SUMMARY_HEAD)) {
        return Ok(());
    }
    let what = format!("{} holds files, and not those of a study", to.display());
    Err(VerbError::usage("foreign-folder", what)
        .help("name a new folder, or that of an earlier study, with --to"))
}

/// Writes all files of the study into a folder.
fn write_study(study: &StudyResult, to: &std::path::Path) -> Result<(), VerbError> {
    let table = |out: &mut dyn Write| report::write_csv(study, out);
    let json = |out: &mut dyn Write| Ok(serde_json::to_writer_pretty(out, study)?);
    let words = report::study_words(study);
    let words = |out: &mut dyn Write| out.write_all(words.as_bytes());
    let chart = |measure: &ErrorMeasure| {
        let svg = chart::chart_svg(study, *measure)?;
        let fill = move |out: &mut dyn Write| out.write_all(svg.as_bytes());
        Some((to.join(format!("{}.svg", measure.name())), fill))
    };
    let charted: Vec<_> = ErrorMeasure::ALL.iter().filter_map(chart).collect();
    let [csv_at, json_at, words_at] =
        ["work_precision.csv", "work_precision.json", SUMMARY].map(|name| to.join(name));
    let mut outputs = vec![
        OutputFile { path: &csv_at, fill: &table },
        OutputFile { path: &json_at, fill: &json },
        OutputFile { path: &words_at, fill: &words },
    ];
    outputs.extend(charted.iter().map(|(path, fill)| OutputFile { path, fill }));
    output::write_outputs(&outputs)
}
