//! Inertial data against the poses of the same path: states against poses, and samples against states.
//!
//! Neither comparison knows the path that made the data. States are interpolated at the times of the poses;
//! the samples at both ends of an interval are compared with the turn and the change of velocity of the
//! states over it. No sample is beyond the range of its sensor, and one at its bound belongs to states beyond
//! that bound. What noise and interpolation allow follows from the model of the sensor, and from the states
//! themselves.

use super::ImuModel;
use crate::Trajectory;
use glam::{DQuat, DVec3};
use gs2e_num::se3::rotation::log_vector;
use std::fmt;

/// The lines of a file: the stamp, ns, and the values.
pub(crate) type InertialLines = Vec<(i64, Vec<f64>)>;

/// A comparison: the difference, and the largest one that is allowed.
#[derive(Debug, Clone, PartialEq)]
pub struct InertialDifference {
    /// A sentence without its end, such as "the gyroscope differs from the turn of the states by".
    pub what: &'static str,
    /// The difference.
    pub off: f64,
    /// The largest allowed one.
    pub allowed: f64,
    /// Unit of both, after a space; empty for a pure number.
    pub unit: &'static str,
}

impl InertialDifference {
    /// Returns true if the difference is small enough, and a number.
    #[must_use]
    pub fn is_allowed(&self) -> bool {
        self.off <= self.allowed
    }
}

impl fmt::Display for InertialDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, off, allowed, unit } = self;
        write!(f, "{what} {off:.3e}{unit}; at most {allowed:.3e}{unit} is allowed")
    }
}

/// The comparisons of the inertial data of a path.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InertialComparison {
    /// The differences, allowed or not.
    pub differences: Vec<InertialDifference>,
    /// The sensors of which every sample is next to one at its bound, so that nothing was compared with the
    /// states.
    pub bounded: Vec<&'static str>,
}

/// Half of the rounding of a pose's stamp, s.
const HALF_STAMP: f64 = 0.5e-6;
/// Rounding of the numbers of both files, in their units.
const ROUNDING: f64 = 1e-7;
/// Margin of the measured noise, as a share, without and with the error of estimating it from few samples.
const MARGIN: f64 = 0.05;
const DEVIATIONS: f64 = 6.0;
/// Noise is compared with its density where its square exceeds that of the interpolation by this factor.
const CLEAR: f64 = 100.0;

/// One state of the file.
#[derive(Debug, Clone, Copy)]
struct StatedMotion {
    seconds: f64,
    position: DVec3,
    rotation: DQuat,
    velocity: DVec3,
    biases: [DVec3; 2],
}

/// What the states say of the interval between two of them.
#[derive(Debug, Clone, Copy)]
struct StatedInterval {
    length: f64,
    /// Mean rate of the turn in body axes, rad/s.
    rate: DVec3,
    /// Mean acceleration in world axes, m/s^2.
    acceleration: DVec3,
}

/// Compares samples and states of a path with its poses. `gravity` is in world axes, m/s^2.
///
/// # Errors
/// The files have other stamps than the rate of the sensor gives for the duration of the poses, or fewer than
/// three lines.
pub fn compare_inertial(
    model: &ImuModel,
    samples: &InertialLines,
    states: &InertialLines,
    gravity: DVec3,
    poses: &Trajectory,
) -> Result<InertialComparison, String> {
    if samples.len() < 3 {
        return Err(format!("there are {} samples, wanted at least 3", samples.len()));
    }
    if !samples.iter().map(|(t, _)| t).eq(states.iter().map(|(t, _)| t)) {
        return Err("the states have other stamps than the samples".to_owned());
    }
    check_stamps(model, samples, poses)?;
    let states: Vec<StatedMotion> = states.iter().map(StatedMotion::from_line).collect();
    let intervals: Vec<StatedInterval> = states.windows(2).map(StatedInterval::between).collect();
    let three_axes =
        |first: usize| samples.iter().map(move |(_, v)| vector(v, first)).collect::<Vec<DVec3>>();
    let turned = AxisSamples {
        samples: three_axes(0),
        axes: model.gyroscope,
        rate: model.rate.to_f64(),
        of_states: &|i, sample| sample - states[i].biases[0],
        expected_sample: &|i, rate| rate + states[i].biases[0],
        mean: &|i| intervals[i].rate,
        words: &GYROSCOPE,
    };
    let pushed = AxisSamples {
        samples: three_axes(3),
        axes: model.accelerometer,
        rate: model.rate.to_f64(),
        of_states: &|i, sample| states[i].rotation * (sample - states[i].biases[1]) + gravity,
        expected_sample: &|i, rate| states[i].rotation.conjugate() * (rate - gravity) + states[i].biases[1],
        mean: &|i| intervals[i].acceleration,
        words: &ACCELEROMETER,
    };
    let mut found = InertialComparison {
        differences: against_poses(&states, &intervals, poses, model.metres_per_unit).to_vec(),
        bounded: Vec::new(),
    };
    turned.compare(&mut found);
    pushed.compare(&mut found);
    Ok(found)
}

/// Checks that the samples have the stamps of the sensor's rate, from the first pose to the last.
fn check_stamps(model: &ImuModel, samples: &InertialLines, poses: &Trajectory) -> Result<(), String> {
    let wanted = (0..).map(|i| model.rate.stamp_ns(i));
    let wrong = samples.iter().zip(wanted).enumerate().find(|(_, ((found, _), wanted))| found != wanted);
    if let Some((i, ((found, _), wanted))) = wrong {
        let rate = model.rate.to_f64();
        return Err(format!("sample {i} is at {found} ns, wanted {wanted} ns at {rate} samples per second"));
    }
    let end_ns = poses.stamps_us.last().map_or(0, |end| end * 1000);
    let next = model.rate.stamp_ns(samples.len() as u64);
    // The stamp of the last pose is rounded to a microsecond.
    if next + 1000 <= end_ns {
        return Err(format!(
            "the samples end before {next} ns, wanted some until the last pose at {end_ns} ns"
        ));
    }
    Ok(())
}

fn vector(values: &[f64], first: usize) -> DVec3 {
    DVec3::from_slice(&values[first..first + 3])
}

impl StatedMotion {
    fn from_line(line: &(i64, Vec<f64>)) -> Self {
        let (t_ns, v) = line;
        Self {
            seconds: *t_ns as f64 * 1e-9,
            position: vector(v, 0),
            rotation: DQuat::from_xyzw(v[4], v[5], v[6], v[3]).normalize(),
            velocity: vector(v, 7),
            biases: [vector(v, 10), vector(v, 13)],
        }
    }
}

impl StatedInterval {
    fn between(pair: &[StatedMotion]) -> Self {
        let length = pair[1].seconds - pair[0].seconds;
        let turn = pair[0].rotation.conjugate() * pair[1].rotation;
        let acceleration = (pair[1].velocity - pair[0].velocity) / length;
        Self { length, rate: log_vector(turn) / length, acceleration }
    }
}

/// The largest differences of positions and of rotations, each as a share of what is allowed there.
fn against_poses(
    states: &[StatedMotion],
    intervals: &[StatedInterval],
    poses: &Trajectory,
    metres: f64,
) -> [InertialDifference; 2] {
    let difference = |what, unit| InertialDifference { what, off: 0.0, allowed: f64::INFINITY, unit };
    let mut worst = [
        difference("the positions of the states differ from the poses by", " m"),
        difference("the rotations of the states differ from the poses by", " rad"),
    ];
    for (pose, stamp) in poses.world_from_camera.iter().zip(&poses.stamps_us) {
        let t = *stamp as f64 * 1e-6;
        let after = states.partition_point(|state| state.seconds <= t);
        // The last pose may lie behind the last sample.
        let Some(i) = after.checked_sub(1).filter(|i| *i < intervals.len()) else { continue };
        let (a, b, h) = (states[i], states[i + 1], intervals[i].length);
        let s = (t - a.seconds) / h;
        // The changes between the intervals around; at an end, those of the three there: two of them may have
        // the same mean on both sides of a peak.
        let last = intervals.len() - 1;
        let first = i.saturating_sub(1).min(last.saturating_sub(2));
        let around = |of: &dyn Fn(&StatedInterval) -> DVec3| {
            let pairs = intervals[first..=last.min(first + 2)].windows(2);
            pairs.map(|pair| (of(&pair[1]) - of(&pair[0])).length()).sum::<f64>()
        };
        // A cubic through values and slopes errs by at most h^2/32 of the range of the second derivative, and
        // a turn at a constant rate by h^2/8 of the derivative of the rate. Twice that, since both are
        // estimates.
        let bends = [h * h / 16.0 * around(&|m| m.acceleration), h / 4.0 * around(&|m| m.rate)];
        let moved = [a.velocity.length(), intervals[i].rate.length()].map(|speed| speed * HALF_STAMP);
        let position = cubic_between([a.position, b.position], [a.velocity * h, b.velocity * h], s);
        let rotation = a.rotation.slerp(b.rotation, s);
        let scale = position.length().max(1.0);
        let off = [
            (position - metres * pose.translation).length(),
            log_vector(rotation.conjugate() * pose.rotation).length(),
        ];
        for (k, worst) in worst.iter_mut().enumerate() {
            let allowed = bends[k] + moved[k] + ROUNDING * if k == 0 { scale } else { 1.0 };
            // Not `>`: a difference of 0 must still replace the start, whose allowed value is infinite.
            if off[k] / allowed >= worst.off / worst.allowed {
                (worst.off, worst.allowed) = (off[k], allowed);
            }
        }
    }
    worst
}

/// The cubic through two values with these slopes per unit of `s`, 0..1.
fn cubic_between([p, q]: [DVec3; 2], [a, b]: [DVec3; 2], s: f64) -> DVec3 {
    let rise = q - p;
    p + s * (a + s * (3.0 * rise - 2.0 * a - b + s * (a + b - 2.0 * rise)))
}

/// The phrases about a sensor.
struct SensorWords {
    name: &'static str,
    unit: &'static str,
    largest: &'static str,
    bounded: &'static str,
    off: &'static str,
}

const GYROSCOPE: SensorWords = SensorWords {
    name: "gyroscope",
    unit: " rad/s",
    largest: "the largest value of the gyroscope is",
    bounded: "the gyroscope shows its bound where the states are below it by",
    off: "the gyroscope differs from the turn of the states by",
};
const ACCELEROMETER: SensorWords = SensorWords {
    name: "accelerometer",
    unit: " m/s^2",
    largest: "the largest value of the accelerometer is",
    bounded: "the accelerometer shows its bound where the states are below it by",
    off: "the accelerometer differs from the motion of the states by",
};

/// The samples of three axes, and what the states say of them.
struct AxisSamples<'a> {
    samples: Vec<DVec3>,
    axes: super::AxisModel,
    rate: f64,
    /// A sample as a rate that the states have, without its bias.
    of_states: &'a dyn Fn(usize, DVec3) -> DVec3,
    /// The sample without noise and range that shows a rate of the states.
    expected_sample: &'a dyn Fn(usize, DVec3) -> DVec3,
    /// The mean of that rate over an interval.
    mean: &'a dyn Fn(usize) -> DVec3,
    words: &'static SensorWords,
}

/// Sums over the intervals that have no end at its bound.
#[derive(Default)]
struct IntervalSums {
    squares: f64,
    bends: f64,
    used: u32,
}

impl AxisSamples<'_> {
    fn compare(&self, found: &mut InertialComparison) {
        found.differences.extend(self.range_differences());
        match self.interval_sums() {
            IntervalSums { used: 0, .. } => found.bounded.push(self.words.name),
            sums => found.differences.extend(self.noise_differences(&sums)),
        }
    }

    fn is_bounded(&self, i: usize) -> bool {
        self.axes.range.is_some_and(|range| self.samples[i].abs().max_element() >= range)
    }

    /// The largest value, and the largest distance of the states from the bound that a sample shows.
    fn range_differences(&self) -> Vec<InertialDifference> {
        let Some(range) = self.axes.range else { return Vec::new() };
        let SensorWords { unit, largest, bounded, .. } = *self.words;
        let most = self.samples.iter().map(|sample| sample.abs().max_element()).fold(0.0, f64::max);
        let mut found = vec![InertialDifference { what: largest, off: most, allowed: range, unit }];
        let places = (0..self.samples.len()).filter(|i| self.is_bounded(*i));
        let below = places.flat_map(|i| self.below_bound(i, range));
        let share = |(off, allowed): &(f64, f64)| off / allowed;
        let worst = below.max_by(|a, b| share(a).total_cmp(&share(b)));
        found.extend(worst.map(|(off, allowed)| InertialDifference { what: bounded, off, allowed, unit }));
        found
    }

    /// For each axis of a sample that shows its bound, the distance by which the states are below it, and
    /// what noise and interpolation allow.
    fn below_bound(&self, i: usize, range: f64) -> impl Iterator<Item = (f64, f64)> {
        let last = self.samples.len() - 2;
        let [before, after] = [i.saturating_sub(1), i.min(last)].map(|k| (self.mean)(k));
        let expected = (self.expected_sample)(i, 0.5 * (before + after));
        let allowed = DEVIATIONS * self.axes.noise * self.rate.sqrt()
            + self.local_change(i)
            + ROUNDING * range.max(1.0);
        let axes = self.samples[i].to_array().into_iter().zip(expected.to_array());
        axes.filter(move |(value, _)| value.abs() >= range)
            .map(move |(value, expected)| (range - expected * value.signum(), allowed))
    }

    /// The changes of the rate over the two intervals on either side of a sample. At a peak with a bend, or
    /// at an end of the path, the rate is outside of the means by half of a change, and the changes
    /// themselves are estimates.
    fn local_change(&self, i: usize) -> f64 {
        let last = self.samples.len() - 2;
        let means: Vec<DVec3> =
            (i.min(last).saturating_sub(2)..=last.min(i + 1)).map(|k| (self.mean)(k)).collect();
        // An end has two intervals on one side alone.
        let outer = if i == 0 && last > 1 { ((self.mean)(2) - (self.mean)(1)).length() } else { 0.0 };
        outer + means.windows(2).map(|pair| (pair[1] - pair[0]).length()).sum::<f64>()
    }

    fn interval_sums(&self) -> IntervalSums {
        let count = self.samples.len() - 1;
        let mut sums = IntervalSums::default();
        for i in (0..count).filter(|i| !self.is_bounded(*i) && !self.is_bounded(i + 1)) {
            let ends = [i, i + 1].map(|k| (self.of_states)(k, self.samples[k]));
            let own = (self.mean)(i);
            sums.squares += (0.5 * (ends[0] + ends[1]) - own).length_squared();
            let before = i.checked_sub(1).map_or(own, |j| (self.mean)(j));
            let next = if i + 1 < count { (self.mean)(i + 1) } else { own };
            // The mean of both ends misses that of the interval by a twelfth of the second difference, or by
            // an eighth of a bend within it, which shows as 3/4 there. A turn about a moving axis adds a
            // twelfth of w x dw.
            let bend = (next - 2.0 * own + before).length() / 6.0;
            let turning = own.length() * (next - before).length() / (24.0 * self.rate);
            sums.bends += (bend + turning) * (bend + turning);
            sums.used += 1;
        }
        sums
    }

    /// The root mean square of the differences over the intervals; and where noise is all that differs, how
    /// far its density is below the stated one.
    fn noise_differences(&self, sums: &IntervalSums) -> Vec<InertialDifference> {
        let SensorWords { unit, off: what, .. } = *self.words;
        let n = f64::from(sums.used);
        let (off, bend) = ((sums.squares / n).sqrt(), sums.bends / n);
        // Of three axes, each the mean of two draws of `density * sqrt(rate)`.
        let noise = 1.5 * self.axes.noise * self.axes.noise * self.rate;
        // Neighbouring intervals share a draw, so there are about half as many squares.
        let margin = MARGIN + DEVIATIONS / (3.0 * n).sqrt();
        let allowed = (1.0 + margin) * (noise + bend).sqrt() + ROUNDING;
        let mut found = vec![InertialDifference { what, off, allowed, unit }];
        if noise > CLEAR * bend && margin < 0.5 {
            let what = "the stated density of the noise exceeds that of the samples by a factor of";
            found.push(InertialDifference {
                what,
                off: noise.sqrt() / off,
                allowed: 1.0 / (1.0 - margin),
                unit: "",
            });
        }
        found
    }
}
