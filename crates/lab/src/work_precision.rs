//! Work and precision: the event error of each setting and its cost, for one scene on one machine.
//!
//! ```text
//! path ─ fine frames ─┬─ reference: hermite, every frame
//!   (per rule set)    └─ grid: uniform or flow steps
//!                         └─ linear, catmull, hermite ─┬─ voltage: RMS at middles
//!                                                      └─ events: matched, timed
//! ```
//! Each rule set is rendered once at the finest rate. Every setting uses a part of these frames
//! ([`grid`]) and is compared with the finest setting of the same rules. All sensors share one
//! seed, so noise, if it is on, follows the same path. The cost of a frame is measured separately,
//! by rendering a sample of frames ([`FrameCost`]); the cost of a sensor is measured during the
//! simulation.

mod brief;
pub mod chart;
pub mod cost;
pub mod errors;
pub mod grid;
pub mod lab;
mod pass;
pub mod pick;
pub mod recommend;
pub mod report;
mod voltage;
pub mod window;

use errors::StreamErrors;
use grid::StepRule;
use gs2e_image::{Image, Size};
use gs2e_sampling::jitter::IntervalNoise;
use gs2e_sampling::law::ErrorLaw;
use gs2e_sensor::voltmeter::BetweenFrames;
use pass::PassResult;
use pick::{ErrorMeasure, MethodComparison};
use serde::Serialize;
use std::ops::{Add, AddAssign, Mul, Sub};

/// Frame rate of the reference setting, if it is among the requested ones: the rate of the
/// published datasets.
pub(crate) const BASE_RATE: u32 = 2400;

/// Time spent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct TimeSpent {
    /// Summed over all cores, s.
    pub core_s: f64,
    /// Wall-clock time, s.
    pub wall_s: f64,
}

impl Add for TimeSpent {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { core_s: self.core_s + o.core_s, wall_s: self.wall_s + o.wall_s }
    }
}

impl AddAssign for TimeSpent {
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl Sub for TimeSpent {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + o * -1.0
    }
}

impl Mul<f64> for TimeSpent {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self { core_s: self.core_s * by, wall_s: self.wall_s * by }
    }
}

/// The cost of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrameCost {
    /// Mean over the sample.
    pub frame: TimeSpent,
    /// (Gaussian, pixel) pairs blended, mean.
    pub pairs: f64,
    /// Peak memory of the program while the sample was rendered, with scene and renderer, MB;
    /// `None` if the system does not report it.
    pub peak_mb: Option<f64>,
    /// Number of frames of the sample.
    pub sample: usize,
}

/// The cost of frames under a rule set, without and with the rate of the luminance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RuleCosts {
    /// Luminance alone.
    pub value: FrameCost,
    /// Luminance and its rate.
    pub rated: FrameCost,
}

impl RuleCosts {
    fn of(&self, between: BetweenFrames) -> &FrameCost {
        match between {
            BetweenFrames::Linear | BetweenFrames::Catmull => &self.value,
            BetweenFrames::Hermite => &self.rated,
        }
    }
}

/// A setting: its error and its cost.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SettingRow {
    /// Name of the rule set.
    pub rules: String,
    /// Interpolation between frames.
    pub between: BetweenFrames,
    /// Choice of frame times.
    pub steps: StepRule,
    /// Frames per second. For flow steps, the rate of the uniform grid with the same number of
    /// frames.
    pub rate: u32,
    /// Number of frames.
    pub frames: usize,
    /// RMS error of k1 V at the middles of intervals, thresholds.
    pub rms_th: f64,
    /// Errors of the events.
    pub errors: StreamErrors,
    /// Time of the renderer.
    pub render: TimeSpent,
    /// Time of the sensor.
    pub sensor: TimeSpent,
    /// Number of blended pairs.
    pub pairs: f64,
    /// See [`FrameCost::peak_mb`].
    pub peak_mb: Option<f64>,
}

impl SettingRow {
    /// Time of renderer and sensor together, s.
    #[must_use]
    pub fn core_s(&self) -> f64 {
        self.render.core_s + self.sensor.core_s
    }

    /// Rules, interpolation and steps. The rows of one curve differ in the rate only.
    #[must_use]
    pub fn method(&self) -> String {
        let flow = if self.steps == StepRule::Flow { ", flow steps" } else { "" };
        format!("{} {}{flow}", self.rules, self.between.name())
    }
}

/// The results for one rule set as a whole.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OfRules {
    /// Name of the rule set.
    pub rules: String,
    /// Numerical class of the renderer.
    pub class: String,
    /// Number of events of the reference.
    pub reference: usize,
    /// The error law of `hermite` at the three finest uniform rates, with the step in s and the
    /// error as in [`SettingRow::rms_th`].
    pub law: Option<ErrorLaw>,
    /// The finest of these steps, s.
    pub finest_s: Option<f64>,
    /// Jitter of the sensor.
    pub jitter: Option<IntervalNoise>,
    /// Cost of frames.
    pub costs: RuleCosts,
}

/// A way of rendering a picture, compared with the picture in f64.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PicturePrecision {
    /// Name of the rule set.
    pub rules: String,
    /// The channel.
    pub what: String,
    /// The cost of a frame.
    pub cost: FrameCost,
    /// PSNR of luminance with grey 255 as the peak, dB; `None` for equal images.
    pub psnr_db: Option<f64>,
    /// Largest difference, grey.
    pub worst_grey: f64,
}

/// PSNR (`None` for equal images) and the largest difference of luminance on the scale 0..1.
///
/// # Panics
/// The images differ in number or size.
#[must_use]
pub(crate) fn image_differences(found: &[Image<f32>], reference: &[Image<f32>]) -> (Option<f64>, f64) {
    assert_eq!(found.len(), reference.len(), "one reference an image");
    let (mut squares, mut count, mut worst) = (0.0, 0usize, 0.0f64);
    for (a, b) in found.iter().zip(reference) {
        assert_eq!(a.size(), b.size(), "they show the same");
        for (a, b) in a.pixels().iter().zip(b.pixels()) {
            let apart = (f64::from(*a) - f64::from(*b)).abs();
            squares += apart * apart;
            worst = worst.max(apart);
        }
        count += a.pixels().len();
    }
    // The peak is 1, on the scale 0..1.
    let psnr = (squares > 0.0).then(|| -10.0 * libm::log10(squares / count as f64));
    (psnr, 255.0 * worst)
}

/// The results of a study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudyResult {
    /// Scene and trajectory.
    pub scene: String,
    /// Size of the frames.
    pub size: Size,
    /// Number of cores that the program may use.
    pub cores: usize,
    /// The machine's name of its processor, if known.
    pub processor: Option<String>,
    /// Duration of the window, s.
    pub seconds: f64,
    /// Frame rate of the references.
    pub finest: u32,
    /// True if the sensors had noise.
    pub noise: bool,
    /// Results per rule set; the first is the reference.
    pub rules: Vec<OfRules>,
    /// Settings.
    pub rows: Vec<SettingRow>,
    /// Ways of rendering.
    pub pictures: Vec<PicturePrecision>,
}

/// The rows of a pass, and the results for its rule set.
#[must_use]
pub(crate) fn judge_pass(
    passed: &PassResult,
    grids: &[grid::FrameGrid],
    rules: &str,
    costs: &RuleCosts,
) -> Vec<SettingRow> {
    let row = |fed: &pass::SettingRun| {
        let grid = &grids[fed.grid];
        let (frames, cost) = (grid.places.len(), costs.of(fed.between));
        SettingRow {
            rules: rules.to_owned(),
            between: fed.between,
            steps: grid.steps,
            rate: grid.rate,
            frames,
            rms_th: fed.rms_th,
            errors: StreamErrors::compare_streams(&fed.events, &passed.reference),
            render: cost.frame * frames as f64,
            sensor: fed.spent,
            pairs: cost.pairs * frames as f64,
            peak_mb: cost.peak_mb,
        }
    };
    passed.fed.iter().map(row).collect()
}

/// Steps and errors of the three finest uniform rates of `hermite`, or of the best requested
/// interpolation.
fn finest_steps(rows: &[SettingRow]) -> Vec<(f64, f64)> {
    let of = |between: BetweenFrames| {
        let uniform = rows.iter().filter(move |row| row.steps == StepRule::Uniform && row.between == between);
        let mut points: Vec<(f64, f64)> =
            uniform.map(|row| (1.0 / f64::from(row.rate), row.rms_th)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.truncate(3);
        points
    };
    let best = [BetweenFrames::Hermite, BetweenFrames::Catmull, BetweenFrames::Linear].map(of);
    best.into_iter().find(|points| !points.is_empty()).unwrap_or_default()
}

/// The error law of `hermite` at the three finest uniform rates, and the finest step, s.
#[must_use]
pub(crate) fn finest_law(rows: &[SettingRow]) -> (Option<ErrorLaw>, Option<f64>) {
    let points = finest_steps(rows);
    (ErrorLaw::fit_points(&points), points.first().map(|(step, _)| *step))
}

impl OfRules {
    /// Error that jumps of the renderer leave at the finest rate, thresholds. No interpolation gets
    /// below it there.
    #[must_use]
    pub(crate) fn left_by_jumps(&self) -> Option<f64> {
        let (law, step) = self.law.zip(self.finest_s)?;
        // The part `J h` of the squared error, which no interpolation removes.
        Some((law.jumps * step).sqrt())
    }
}

impl StudyResult {
    /// Description of the machine.
    #[must_use]
    pub fn machine(&self) -> String {
        let cores = if self.cores == 1 { "1 core".to_owned() } else { format!("{} cores", self.cores) };
        self.processor.as_ref().map_or_else(|| cores.clone(), |name| format!("{name}, {cores}"))
    }

    /// The reference setting: the first rule set with even steps, linear if it was requested, at
    /// `BASE_RATE` or else at the finest rate.
    #[must_use]
    pub fn base(&self) -> Option<&SettingRow> {
        let rules = &self.rules.first()?.rules;
        let first = self.rows.iter().filter(|row| row.rules == *rules && row.steps == StepRule::Uniform);
        // Tuples compare from the left: interpolation first, then the rate.
        first.max_by_key(|row| (row.between == BetweenFrames::Linear, row.rate == BASE_RATE, row.rate))
    }

    /// The cost of each method at the error of [`Self::base`], for every measure.
    #[must_use]
    pub fn picks(&self) -> Vec<MethodComparison> {
        let Some(base) = self.base() else { return Vec::new() };
        ErrorMeasure::ALL
            .iter()
            .filter_map(|measure| MethodComparison::at_error(*measure, base, &self.rows))
            .collect()
    }

    /// The cheapest setting of another rule set that is nearer to its limit than the first rule set
    /// gets at these rates, and the lowest error of the first.
    #[must_use]
    pub(crate) fn below_the_first(&self) -> Option<(f64, Option<&SettingRow>)> {
        let first = self.rules.first()?;
        let own = self.rows.iter().filter(|row| row.rules == first.rules).map(|row| row.rms_th);
        let lowest = own.fold(f64::INFINITY, f64::min);
        let others = self.rows.iter().filter(|row| row.rules != first.rules && row.rms_th < lowest);
        Some((lowest, others.min_by(|a, b| a.core_s().total_cmp(&b.core_s()))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_those_of_the_definition() {
        let size = Size { width: 2, height: 2 };
        let a = Image::from_vec(size, vec![0.0, 0.5, 1.0, 0.25]);
        let b = Image::from_vec(size, vec![0.0, 0.5, 0.8, 0.25]);
        // 0.2^2 / 4 is 0.01: 20 dB.
        let (psnr, worst) = image_differences(std::slice::from_ref(&b), std::slice::from_ref(&a));
        assert!((psnr.unwrap() - 20.0).abs() < 1e-5 && (worst - 51.0).abs() < 1e-5);
        assert_eq!(image_differences(std::slice::from_ref(&a), std::slice::from_ref(&a)), (None, 0.0));
    }
}
