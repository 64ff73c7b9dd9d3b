//! `gs2e study thresholds`: a sweep of the contrast threshold.

use super::subject::{StudySubject, SubjectArgs};
use super::{end_problem, go_unless, not_rendered};
use crate::cli::words::parse_numbers;
use crate::cli::{CommonArgs, Console, ExitKind, VerbError, on_interrupt, output};
use gs2e_event::picture::picture_grid;
use gs2e_image::png;
use gs2e_lab::thresholds::{SweepResult, ThresholdRow, ThresholdSweep, sweep_thresholds};
use gs2e_render::backend::Backend;
use gs2e_render::{LayerOrder, RenderError, RenderRules, RenderStyle};
use gs2e_sampling::rendered::RenderedFrames;
use gs2e_sensor::front_end::FrontEndFrames;
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_trajectory::Trajectory;
use serde_json::json;
use std::io::{self, Write};
use std::ops::Range;
use std::path::PathBuf;

/// Arguments of `study thresholds`.
#[derive(Debug, clap::Args)]
pub(super) struct ThresholdsArgs {
    #[command(flatten)]
    subject: SubjectArgs,
    /// Thresholds of ON and OFF events, in rising order
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "0.25,0.5,0.75,1,1.25,1.5")]
    thresholds: Vec<f64>,
    /// Begin and end of the part to render, milliseconds of the trajectory [default: 100 ms around
    /// its middle]
    #[arg(long, value_name = "T0,T1", value_parser = parse_span)]
    span: Option<[f64; 2]>,
    /// File for the table
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// File for the picture, a .png: 1 ms of events at each threshold
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

fn parse_span(text: &str) -> Result<[f64; 2], String> {
    let span = parse_numbers(text).filter(|[begin, end]| 0.0 <= *begin && begin < end);
    span.ok_or_else(|| format!("`{text}` is not T0,T1: two times in milliseconds, T0 before T1"))
}

/// Default length of the rendered part, ms.
const DEFAULT_MS: f64 = 100.0;
/// Length of the pictures, us.
const PICTURE_US: i64 = 1000;
/// Number of pictures per row, and the pixels between them.
const COLUMNS: usize = 3;
const GAP: u32 = 4;

impl ThresholdsArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.screen(console)?;
        let built = self.subject.open(common)?;
        let range = self.range(&built.motion.trajectory)?;
        let trajectory = window_of(&built.motion.trajectory, range.clone());
        let middle = trajectory.stamps_us.last().map_or(0, |last| last / 2);
        let sweep = ThresholdSweep {
            sensor: built.sensor.clone(),
            thresholds: self.thresholds.clone(),
            seed: built.seed,
            within_ns: interval_ns(&trajectory),
            window_us: middle - PICTURE_US / 2..middle + PICTURE_US / 2,
        };
        let found = built.sweep(&sweep, &trajectory, range)?;
        self.write(&sweep, &found)?;
        self.report(&built.name(), &found, console);
        Ok(ExitKind::Done)
    }

    fn screen(&self, console: &Console) -> Result<(), VerbError> {
        let outputs = self.csv.iter().chain(&self.picture).map(PathBuf::as_path);
        output::screen_outputs(outputs, [self.subject.recipe.as_path()], console.json)?;
        let rising = self.thresholds.windows(2).all(|pair| pair[0] < pair[1]);
        let in_range = self.thresholds.iter().all(|t| (1e-6..=1e6).contains(t));
        if !rising || !in_range {
            let found = &self.thresholds;
            let what = format!("--thresholds {found:?}, wanted increasing numbers from 1e-6 to 1e6");
            return Err(VerbError::usage("thresholds", what));
        }
        Ok(())
    }

    /// The range of poses in the requested time.
    fn range(&self, whole: &Trajectory) -> Result<Range<usize>, VerbError> {
        let end_us = whole.stamps_us.last().copied().unwrap_or(0);
        let middle_ms = end_us as f64 * 0.5e-3;
        let default = [middle_ms - DEFAULT_MS / 2.0, middle_ms + DEFAULT_MS / 2.0];
        let [begin, end] = self.span.unwrap_or(default);
        let place = |ms: f64| whole.stamps_us.partition_point(|t| (*t as f64) < ms * 1e3);
        // One pose beyond the end, so that the last interval covers it.
        let range: Range<usize> = place(begin)..(place(end) + 1).min(whole.stamps_us.len());
        if range.len() < 3 {
            let what = format!("{} poses are from {begin} to {end} ms, wanted at least 3", range.len());
            return Err(VerbError::usage("span", what).help(format!("the trajectory ends at {end_us} us")));
        }
        Ok(range)
    }

    fn write(&self, sweep: &ThresholdSweep, found: &SweepResult) -> Result<(), VerbError> {
        let table = |out: &mut dyn Write| write_csv(found, out);
        let picture = |out: &mut dyn Write| {
            let captioned = found.pictures.iter().zip(&sweep.thresholds);
            let captioned: Vec<_> = captioned.map(|(image, t)| (image.clone(), t.to_string())).collect();
            png::write_image(&picture_grid(&captioned, COLUMNS, GAP), out)
        };
        output::write_given(&[(self.csv.as_deref(), &table), (self.picture.as_deref(), &picture)])
    }

    fn report(&self, scene: &str, found: &SweepResult, console: &Console) {
        let (row, because) = found.recommended();
        let recommended = row.map(|row| row.threshold);
        if console.json {
            return console.result(&json!({
                "scene": scene, "frames": found.frames, "seconds": found.seconds, "rows": found.rows,
                "recommended": recommended, "because": because, "recipe": found.recipe_fragment(),
            }));
        }
        let SweepResult { frames, seconds, .. } = found;
        console.print(&format!("{scene}: {frames} frames, {:.1} ms, rendered with two rules", 1e3 * seconds));
        console.print("threshold  contrast     events  ev/px/s   ON  smooth  near a jump  other");
        for row in &found.rows {
            let ThresholdRow { threshold, contrast, events, rate_ev_px_s, .. } = row;
            let [on, smooth, near_jump, other] = [row.on, row.smooth, row.near_jump, row.other]
                .map(|part| 100.0 * part as f64 / (*events).max(1) as f64);
            console.print(&format!(
                "{threshold:9}  {contrast:8.4}  {events:9}  {rate_ev_px_s:7.3}  {on:2.0} %  {smooth:4.1} %      \
                 {near_jump:5.1} %  {other:3.1} %"
            ));
        }
        console.print_lines(
            "smooth: the smooth rendering makes the same event; near a jump: the renderer jumped since the pixel's\n\
             previous event; other: late or early after a jump, or under a slow difference of the renderings",
        );
        let recommended = recommended.map_or_else(|| "none".to_owned(), |threshold| threshold.to_string());
        console.print(&format!("recommended: {recommended}: {because}"));
        console.print("For the recipe:");
        console.print_lines(&found.recipe_fragment());
    }
}

/// A part of a trajectory, with its first stamp at 0.
fn window_of(whole: &Trajectory, range: Range<usize>) -> Trajectory {
    let first = whole.stamps_us[range.start];
    Trajectory {
        world_from_camera: whole.world_from_camera[range.clone()].to_vec(),
        stamps_us: whole.stamps_us[range].iter().map(|t| t - first).collect(),
    }
}

fn write_csv(found: &SweepResult, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "threshold,contrast,events,on,rate_ev_px_s,smooth_stream,smooth,near_jump,other")?;
    for row in &found.rows {
        let ThresholdRow { threshold, contrast, events, on, rate_ev_px_s, .. } = row;
        let ThresholdRow { smooth_stream, smooth, near_jump, other, .. } = row;
        writeln!(
            out,
            "{threshold},{contrast},{events},{on},{rate_ev_px_s},{smooth_stream},{smooth},{near_jump},{other}"
        )?;
    }
    Ok(())
}

/// The longest interval between two frames, ns.
fn interval_ns(trajectory: &Trajectory) -> i64 {
    let intervals = trajectory.stamps_us.windows(2).map(|pair| pair[1] - pair[0]);
    1000 * intervals.max().unwrap_or(0)
}

impl StudySubject {
    /// Renders a part of the trajectory by two rule sets, and sweeps the thresholds. `range` is its poses
    /// among those of the whole trajectory.
    fn sweep(
        &self,
        asked: &ThresholdSweep,
        trajectory: &Trajectory,
        range: Range<usize>,
    ) -> Result<SweepResult, VerbError> {
        let Self { backend, style, .. } = self;
        let cancel = on_interrupt()?;
        let mut tap = |_: usize| go_unless(&cancel);
        // The picture as a continuous function of the view. No GPU renders a blended order.
        let smooth = RenderStyle { rules: RenderRules::Soft, order: LayerOrder::Blended, ..*style };
        let velocities = self.motion.velocities();
        let frames = |backend: &Backend, style| {
            let renderer = backend.renderer(self.gaussians.clone(), style)?;
            let frames = RenderedFrames::new(renderer, self.camera, trajectory.clone());
            Ok::<_, RenderError>(match asked.sensor.between {
                BetweenFrames::Hermite => frames.with_rates(velocities[range.clone()].to_vec()),
                BetweenFrames::Linear | BetweenFrames::Catmull => frames,
            })
        };
        let mut released = frames(backend, *style).map_err(|e| not_rendered(&e))?;
        let smooth_by = if backend.takes_gpu() { &Backend::Cpu } else { backend };
        let mut smooth = frames(smooth_by, smooth).map_err(|e| not_rendered(&e))?;
        let front_end = asked.sensor.settings.front_end;
        let mut released = FrontEndFrames::new(&mut released, front_end);
        let mut smooth = FrontEndFrames::new(&mut smooth, front_end);
        sweep_thresholds(asked, &mut released, &mut smooth, &mut tap).map_err(end_problem)
    }
}
