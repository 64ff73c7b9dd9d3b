//! Inertial measurements of a camera that moves along a path.
//!
//! ```text
//! gyroscope      w = body rate                        + bias + noise   rad/s
//! accelerometer  a = R^T (acceleration - gravity)     + bias + noise   m/s^2
//! bias: a random walk from a drawn start              noise: white, density * sqrt(rate)
//! ```
//! The rates are the derivatives of the C2 path through the poses, on which the frames between poses lie too.
//! The body is the camera, with OpenCV axes. The model of noise is that of Kalibr and ESIM (Forster et al.,
//! "On-Manifold Preintegration", 2016, section IV).

pub mod consistency;
pub mod files;
mod preset;

pub use preset::ImuPreset;

use crate::sampled::SampledPath;
use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
use gs2e_num::units::Hertz;
use serde::Serialize;

/// Standard gravity, m/s^2 (ISO 80000-3).
pub const GRAVITY: f64 = 9.806_65;

/// An inertial sensor, and what it needs to know of the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImuModel {
    /// Samples per second.
    pub rate: Hertz,
    /// The gyroscope, rad/s.
    pub gyroscope: AxisModel,
    /// The accelerometer, m/s^2.
    pub accelerometer: AxisModel,
    /// Strength of gravity, m/s^2.
    pub gravity: f64,
    /// The direction against gravity, in world axes and of any length. Without it, the mean of the up
    /// directions of the captured views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Metres per unit of the scene.
    pub metres_per_unit: f64,
}

/// Errors of each axis of a sensor, in its unit `u`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AxisModel {
    /// Density of the white noise, u/sqrt(Hz).
    pub noise: f64,
    /// Density of the random walk of the bias, u/s/sqrt(Hz).
    pub walk: f64,
    /// Standard deviation of the bias at the start, u.
    pub bias: f64,
    /// The largest value that it shows, u; `None` without a bound.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<f64>,
}

impl ImuModel {
    /// The direction against gravity: its own, or else this one of the captured views.
    #[must_use]
    pub fn up_or(&self, found: Option<DVec3>) -> Option<DVec3> {
        self.up.map(DVec3::from_array).or(found)
    }
}

impl AxisModel {
    /// A sensor without errors.
    pub const IDEAL: Self = Self { noise: 0.0, walk: 0.0, bias: 0.0, range: None };
}

/// A sample, and the truth behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Time since the first pose, ns.
    pub t_ns: i64,
    /// The gyroscope, rad/s in body axes.
    pub gyroscope: DVec3,
    /// The accelerometer, m/s^2 in body axes.
    pub accelerometer: DVec3,
    /// The truth.
    pub state: ImuState,
}

/// Motion and biases at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuState {
    /// Pose of the body in world axes, metres.
    pub world_from_body: Se3,
    /// Velocity in world axes, m/s.
    pub velocity: DVec3,
    /// Bias of the gyroscope, rad/s.
    pub gyroscope_bias: DVec3,
    /// Bias of the accelerometer, m/s^2.
    pub accelerometer_bias: DVec3,
}

/// The samples along a path.
#[derive(Debug)]
pub struct ImuSampler<'a> {
    model: &'a ImuModel,
    path: &'a SampledPath,
    gravity: DVec3,
    errors: [AxisErrors; 2],
    next: u64,
    /// Number of samples with a value that was bounded.
    pub saturated: u64,
}

impl<'a> ImuSampler<'a> {
    /// The samples of `model` along a path, with gravity against the direction `up`.
    #[must_use]
    pub fn new(model: &'a ImuModel, path: &'a SampledPath, up: DVec3, seed: Seed) -> Self {
        Self::under(model, path, -model.gravity * up.normalize_or_zero(), seed)
    }

    /// The samples of `model` along a path under this gravity, m/s^2 in world axes.
    #[must_use]
    pub fn under(model: &'a ImuModel, path: &'a SampledPath, gravity: DVec3, seed: Seed) -> Self {
        let rate = model.rate.to_f64();
        let errors = [(0, model.gyroscope), (3, model.accelerometer)];
        Self {
            model,
            path,
            gravity,
            errors: errors.map(|(first, axes)| AxisErrors::new(axes, rate, first, seed)),
            next: 0,
            saturated: 0,
        }
    }

    /// Gravity in world axes, m/s^2.
    #[must_use]
    pub fn gravity(&self) -> DVec3 {
        self.gravity
    }
}

impl Iterator for ImuSampler<'_> {
    type Item = ImuSample;

    fn next(&mut self) -> Option<ImuSample> {
        let Self { model, path, gravity, errors, .. } = self;
        let t_ns = model.rate.stamp_ns(self.next);
        // The motion is that of the written stamp, so the rounding of the stamp is no error of the data.
        let seconds = t_ns as f64 * 1e-9;
        if seconds > path.seconds() {
            return None;
        }
        let motion = path.motion(seconds);
        let metres = model.metres_per_unit;
        let force = metres * motion.acceleration - *gravity;
        let body_from_world = motion.pose.rotation.conjugate();
        let [gyroscope, accelerometer] = errors;
        let (gyroscope_bias, accelerometer_bias) = (gyroscope.bias, accelerometer.bias);
        let samples = [gyroscope.show(motion.angular), accelerometer.show(body_from_world * force)];
        self.saturated += u64::from(samples.iter().any(|(_, is_bounded)| *is_bounded));
        self.next += 1;
        let state = ImuState {
            world_from_body: Se3 { translation: metres * motion.pose.translation, ..motion.pose },
            velocity: metres * motion.velocity,
            gyroscope_bias,
            accelerometer_bias,
        };
        Some(ImuSample { t_ns, gyroscope: samples[0].0, accelerometer: samples[1].0, state })
    }
}

/// The errors of the three axes of a sensor, sample by sample.
#[derive(Debug)]
pub struct AxisErrors {
    /// The bias of the next sample.
    pub bias: DVec3,
    axes: AxisModel,
    rate: f64,
    /// Number of the first axis among the draws.
    first: u16,
    seed: Seed,
    index: u64,
}

/// Draws of a sample and axis.
const WHITE: u32 = 0;
const WALK: u32 = 1;

impl AxisErrors {
    /// Errors at `rate` samples per second. `first` numbers the axes of the sensor among those that share the
    /// seed.
    #[must_use]
    pub fn new(axes: AxisModel, rate: f64, first: u16, seed: Seed) -> Self {
        let mut errors = Self { bias: DVec3::ZERO, axes, rate, first, seed, index: 0 };
        // The first sample has index 1, so that index 0 draws the start.
        errors.bias = axes.bias * errors.draws(WHITE);
        errors.index = 1;
        errors
    }

    fn draws(&self, number: u32) -> DVec3 {
        let draw = |axis: u16| {
            let cell = SeedCell { x: self.first + axis, y: 0, level: 0, index: self.index };
            self.seed.normal(cell, DrawSpace::Choice, number)
        };
        DVec3::new(draw(0), draw(1), draw(2))
    }

    /// The value that the sensor shows for a true one, and whether it was bounded.
    pub fn show(&mut self, truth: DVec3) -> (DVec3, bool) {
        let AxisModel { noise, walk, range, .. } = self.axes;
        let mut value = truth + self.bias;
        // What is zero needs no draws.
        if noise > 0.0 {
            value += noise * self.rate.sqrt() * self.draws(WHITE);
        }
        if walk > 0.0 {
            // After the value, which shows the bias of this sample and not of the next.
            self.bias += walk / self.rate.sqrt() * self.draws(WALK);
        }
        self.index += 1;
        let bound = range.map_or(f64::INFINITY, |range| range);
        let bounded = value.clamp(DVec3::splat(-bound), DVec3::splat(bound));
        (bounded, bounded != value)
    }
}

#[cfg(test)]
mod tests;
