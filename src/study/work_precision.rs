//! Work and precision: which error of the events each setting has, and what it costs, for one scene on one machine.
//!
//! ```text
//! path ─ fine frames ─┬─ reference: hermite, every frame
//!   (per rule set)    └─ grid: uniform or flow steps ─ between: linear, catmull, hermite ─┬─ voltage: RMS at middles
//!                                                                                         └─ events: matched, timed
//! ```
//! Each rule set is rendered once, at the finest rate; every setting takes a part of these frames ([`grid`]) and is held
//! against the finest of its own rules. All sensors share one seed, so that the noise, where it is on, is the same path.
//! What a frame costs is measured beside this, by rendering a sample of frames for nothing else ([`Cost`]); what a sensor
//! costs, while it is fed.

mod brief;
pub mod chart;
pub mod errors;
pub mod grid;
pub mod pass;
pub mod pick;
pub mod report;
mod voltage;

use crate::image::{Image, Size};
use crate::sampling::jitter::Jitter;
use crate::sampling::law::Law;
use crate::sensor::voltmeter::Between;
use errors::Errors;
use grid::Steps;
use pass::Passed;
use pick::{Measure, Pick};
use serde::Serialize;
use std::ops::{Add, AddAssign, Mul, Sub};

/// Frames a second of the setting that the others are held against, where it is among those asked for: the rate of the
/// published datasets.
pub const BASE_RATE: u32 = 2400;

/// Time that something took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spent {
    /// Of all cores together, s.
    pub core_s: f64,
    /// On the wall, s.
    pub wall_s: f64,
}

impl Add for Spent {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self { core_s: self.core_s + o.core_s, wall_s: self.wall_s + o.wall_s }
    }
}

impl AddAssign for Spent {
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

impl Sub for Spent {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + o * -1.0
    }
}

impl Mul<f64> for Spent {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self { core_s: self.core_s * by, wall_s: self.wall_s * by }
    }
}

/// What one frame of a kind costs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// Mean over the sample.
    pub frame: Spent,
    /// (Gaussian, pixel) pairs blended, mean.
    pub pairs: f64,
    /// Memory of the program at its peak while the sample was rendered, scene and renderer included, MB; `None` where the
    /// system does not say.
    pub peak_mb: Option<f64>,
    /// Frames of the sample.
    pub sample: usize,
}

/// What frames cost under a rule set, without and with the rate of luminance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Costs {
    /// Luminance alone.
    pub value: Cost,
    /// Luminance and its rate.
    pub rated: Cost,
}

impl Costs {
    fn of(&self, between: Between) -> &Cost {
        match between {
            Between::Linear | Between::Catmull => &self.value,
            Between::Hermite => &self.rated,
        }
    }
}

/// A setting: its error and its cost.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the rule set.
    pub rules: String,
    /// Brightness between frames.
    pub between: Between,
    /// How times were chosen.
    pub steps: Steps,
    /// Frames a second; of flow steps, of the uniform grid with as many frames.
    pub rate: u32,
    /// Frames.
    pub frames: usize,
    /// RMS of k1 V at interval middles, thresholds.
    pub rms_th: f64,
    /// Of the events.
    pub errors: Errors,
    /// By the renderer.
    pub render: Spent,
    /// By the sensor.
    pub sensor: Spent,
    /// Pairs blended.
    pub pairs: f64,
    /// See [`Cost::peak_mb`].
    pub peak_mb: Option<f64>,
}

impl Row {
    /// Of renderer and sensor together, s.
    #[must_use]
    pub fn core_s(&self) -> f64 {
        self.render.core_s + self.sensor.core_s
    }

    /// Rules, interpolation and steps: a curve is what only the rate tells apart.
    #[must_use]
    pub fn method(&self) -> String {
        let flow = if self.steps == Steps::Flow { ", flow steps" } else { "" };
        format!("{} {}{flow}", self.rules, self.between.name())
    }
}

/// What was found of one rule set as a whole.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OfRules {
    /// Its name.
    pub rules: String,
    /// Numerical class of what rendered.
    pub class: String,
    /// Events of the reference.
    pub reference: usize,
    /// The law of `hermite` at the three finest uniform rates, step in s, error as [`Row::rms_th`].
    pub law: Option<Law>,
    /// Step of the finest of these, s.
    pub finest_s: Option<f64>,
    /// Of the sensor.
    pub jitter: Option<Jitter>,
    /// Of frames.
    pub costs: Costs,
}

/// A way of rendering a picture, against the same in f64.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Picture {
    /// Name of the rule set.
    pub rules: String,
    /// What was rendered.
    pub what: String,
    /// What a frame costs.
    pub cost: Cost,
    /// Of luminance, with 255 grey as the peak, dB; `None` where nothing differs.
    pub psnr_db: Option<f64>,
    /// Largest difference, grey.
    pub worst_grey: f64,
}

/// PSNR (`None` of equal images), and the largest difference, of luminance on the scale 0..1.
///
/// # Panics
/// If the images differ in number or size.
#[must_use]
pub fn differences(found: &[Image<f32>], reference: &[Image<f32>]) -> (Option<f64>, f64) {
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
    let psnr = (squares > 0.0).then(|| -10.0 * libm::log10(squares / count as f64));
    (psnr, 255.0 * worst)
}

/// All that a study found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Study {
    /// Scene and trajectory.
    pub scene: String,
    /// Of the frames.
    pub size: Size,
    /// Cores that the program may use.
    pub cores: usize,
    /// What the machine calls its processor, where it says so.
    pub processor: Option<String>,
    /// Length of the window, s.
    pub seconds: f64,
    /// Frames a second of the references.
    pub finest: u32,
    /// Whether the sensors had their noise.
    pub noise: bool,
    /// Rule sets, the one that is held against first.
    pub rules: Vec<OfRules>,
    /// Settings.
    pub rows: Vec<Row>,
    /// Ways of rendering.
    pub pictures: Vec<Picture>,
}

/// The rows of a pass, and what else it says of its rule set.
#[must_use]
pub fn judge(passed: &Passed, grids: &[grid::Grid], rules: &str, costs: &Costs) -> Vec<Row> {
    let row = |fed: &pass::Fed| {
        let grid = &grids[fed.grid];
        let (frames, cost) = (grid.places.len(), costs.of(fed.between));
        Row {
            rules: rules.to_owned(),
            between: fed.between,
            steps: grid.steps,
            rate: grid.rate,
            frames,
            rms_th: fed.rms_th,
            errors: Errors::of(&fed.events, &passed.reference),
            render: cost.frame * frames as f64,
            sensor: fed.spent,
            pairs: cost.pairs * frames as f64,
            peak_mb: cost.peak_mb,
        }
    };
    passed.fed.iter().map(row).collect()
}

/// Steps and errors of the finest three uniform rates of `hermite`, or of the best interpolation that was asked for.
fn finest(rows: &[Row]) -> Vec<(f64, f64)> {
    let of = |between: Between| {
        let uniform = rows.iter().filter(move |row| row.steps == Steps::Uniform && row.between == between);
        let mut points: Vec<(f64, f64)> =
            uniform.map(|row| (1.0 / f64::from(row.rate), row.rms_th)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.truncate(3);
        points
    };
    let best = [Between::Hermite, Between::Catmull, Between::Linear].map(of);
    best.into_iter().find(|points| !points.is_empty()).unwrap_or_default()
}

/// The law of `hermite` at the finest three uniform rates, and the step of the finest, s.
#[must_use]
pub fn law(rows: &[Row]) -> (Option<Law>, Option<f64>) {
    let points = finest(rows);
    (Law::through(&points), points.first().map(|(step, _)| *step))
}

impl OfRules {
    /// What jumps of the renderer leave at the finest rate, thresholds: no interpolation gets below it there.
    #[must_use]
    pub fn left_by_jumps(&self) -> Option<f64> {
        let (law, step) = self.law.zip(self.finest_s)?;
        Some((law.jumps * step).sqrt())
    }
}

impl Study {
    /// What the times were taken on, in words.
    #[must_use]
    pub fn machine(&self) -> String {
        let cores = if self.cores == 1 { "1 core".to_owned() } else { format!("{} cores", self.cores) };
        self.processor.as_ref().map_or_else(|| cores.clone(), |name| format!("{name}, {cores}"))
    }

    /// The setting that the others are held against: the first rule set at even steps, linear where it was asked for, at
    /// [`BASE_RATE`] or else the finest rate.
    #[must_use]
    pub fn base(&self) -> Option<&Row> {
        let rules = &self.rules.first()?.rules;
        let first = self.rows.iter().filter(|row| row.rules == *rules && row.steps == Steps::Uniform);
        first.max_by_key(|row| (row.between == Between::Linear, row.rate == BASE_RATE, row.rate))
    }

    /// What each method costs at the error of [`Self::base`], by every measure.
    #[must_use]
    pub fn picks(&self) -> Vec<Pick> {
        let Some(base) = self.base() else { return Vec::new() };
        Measure::ALL.iter().filter_map(|measure| Pick::at(*measure, base, &self.rows)).collect()
    }

    /// The cheapest setting of the other rule sets whose signal is nearer to its limit than the first rule set's gets at
    /// these rates, and the lowest error of the first.
    #[must_use]
    pub fn below_the_first(&self) -> Option<(f64, Option<&Row>)> {
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
        let (psnr, worst) = differences(std::slice::from_ref(&b), std::slice::from_ref(&a));
        assert!((psnr.unwrap() - 20.0).abs() < 1e-5 && (worst - 51.0).abs() < 1e-5);
        assert_eq!(differences(std::slice::from_ref(&a), std::slice::from_ref(&a)), (None, 0.0));
    }
}
