//! Difference between interpolated and rendered brightness between two frames, in thresholds.

use super::between::{BetweenKnot, interpolated_value};
use gs2e_render::sample::TileSample;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The properties of a sensor that matter for brightness between frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorScale {
    /// Index of its front end in the viewer.
    pub front_end: usize,
    /// Offset of the logarithm, in grey.
    pub k2: f64,
    /// Thresholds per unit of `V`, for the lower threshold.
    pub thresholds: f64,
}

impl SensorScale {
    /// The scale of a sensor behind the front end of this index.
    #[must_use]
    pub fn for_sensor(sensor: &VoltmeterModel, front_end: usize) -> Self {
        let [k1, k2, ..] = sensor.k;
        Self { front_end, k2, thresholds: k1 / sensor.threshold_on.min(sensor.threshold_off) }
    }
}

/// Renders frames at any moment of a path.
pub trait PathViewer {
    /// The error of a frame.
    type Error;

    /// Shows the frames at these microseconds, in this order, each through all front ends; with
    /// rates if `rated`. Only the pixels of each sample are read.
    ///
    /// # Errors
    /// A frame cannot be rendered.
    fn show(
        &mut self,
        shots: &[SampledShot],
        rated: bool,
        look: &mut dyn FnMut(&[DenseFrame]),
    ) -> Result<(), Self::Error>;
}

/// A moment, us, and the pixels that are read.
pub type SampledShot = (i64, Arc<TileSample>);

/// Two neighbouring frames, a moment between them that is rendered for comparison, and the frames
/// beyond, if there are any; us.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SampledInterval {
    /// The two frames.
    pub ends: [i64; 2],
    /// The frames before and after.
    pub outer: [Option<i64>; 2],
    /// Index of the sample of the pixels.
    pub sample: usize,
}

impl SampledInterval {
    /// The moment of comparison.
    fn middle(&self) -> i64 {
        i64::midpoint(self.ends[0], self.ends[1])
    }

    /// Each moment of a frame, with the index of the sample.
    fn moments(&self, between: &[BetweenFrames]) -> impl Iterator<Item = (i64, usize)> {
        let outer = if between.contains(&BetweenFrames::Catmull) { self.outer } else { [None; 2] };
        let [from, to] = self.ends;
        let moments = [Some(from), Some(to), Some(self.middle())].into_iter().chain(outer).flatten();
        moments.map(|moment| (moment, self.sample))
    }
}

/// `V` of the pixels of a sample and its slope, of a frame for one sensor. 32 bits give them to 3e-7, far
/// below any threshold.
struct SampledVoltage {
    seconds: f64,
    v: Vec<f32>,
    slope: Vec<f32>,
}

impl SampledVoltage {
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
    fn new(frame: &DenseFrame, pixels: &[usize], k2: f64) -> Self {
        let luminance = frame.luminance.pixels();
        // Rounding may leave a luminance below 0.
        let level = |l: &f32| f64::from(l.max(0.0)) + k2;
        let v = pixels.par_iter().map(|i| libm::log(level(&luminance[*i])) as f32).collect();
        let slope = frame.rate.as_ref().map_or_else(Vec::new, |rate| {
            let rate = rate.pixels();
            pixels.iter().map(|i| (f64::from(rate[*i]) / level(&luminance[*i])) as f32).collect()
        });
        Self { seconds: frame.t.seconds(), v, slope }
    }

    fn knot(&self, i: usize) -> BetweenKnot {
        let slope = self.slope.get(i).copied().unwrap_or(0.0);
        BetweenKnot { seconds: self.seconds, v: f64::from(self.v[i]), slope: f64::from(slope) }
    }
}

/// The measurement of some intervals.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MeasuredIntervals {
    /// The mean over pixels of the squared error at the middle, thresholds squared, by interval and
    /// method. For several sensors, the largest.
    pub squares: Vec<Vec<f64>>,
    /// Number of frames rendered.
    pub frames: usize,
    /// Number of their pixels that were read.
    pub pixels: usize,
}

/// Measures methods on intervals, at the pixels of their samples. Frames are rendered in the order of the
/// intervals, and released after the last interval that needs them.
///
/// # Errors
/// A frame cannot be rendered.
pub(crate) fn measure_intervals<V: PathViewer>(
    viewer: &mut V,
    scales: &[SensorScale],
    intervals: &[SampledInterval],
    samples: &[Arc<TileSample>],
    between: &[BetweenFrames],
) -> Result<MeasuredIntervals, V::Error> {
    // A moment that several intervals of a sample share is rendered once, when the first of them needs it.
    let mut last_use = BTreeMap::new();
    let mut order = Vec::new();
    for (number, interval) in intervals.iter().enumerate() {
        for shot in interval.moments(between) {
            if last_use.insert(shot, number).is_none() {
                order.push(shot);
            }
        }
    }
    let pixels: Vec<Vec<usize>> = samples.iter().map(|sample| sample.pixels()).collect();
    let shots: Vec<SampledShot> =
        order.iter().map(|(moment, sample)| (*moment, samples[*sample].clone())).collect();
    let mut held: HeldFrames = BTreeMap::new();
    let mut squares: Vec<Vec<f64>> = Vec::with_capacity(intervals.len());
    let mut coming = order.iter();
    let rated = between.contains(&BetweenFrames::Hermite);
    viewer.show(&shots, rated, &mut |frames| {
        let shot = *coming.next().expect("as many frames as were asked for");
        let voltage =
            |scale: &SensorScale| SampledVoltage::new(&frames[scale.front_end], &pixels[shot.1], scale.k2);
        held.insert(shot, scales.iter().map(voltage).collect());
        while let Some(next) = intervals.get(squares.len()) {
            if !next.moments(between).all(|shot| held.contains_key(&shot)) {
                break;
            }
            squares.push(between.iter().map(|between| worst_square(next, *between, scales, &held)).collect());
            // The number of measured intervals is the index of the next one.
            held.retain(|shot, _| last_use[shot] >= squares.len());
        }
    })?;
    let read = order.iter().map(|(_, sample)| pixels[*sample].len()).sum();
    Ok(MeasuredIntervals { squares, frames: order.len(), pixels: read })
}

/// The frames that are needed again, by moment and sample, for each sensor.
type HeldFrames = BTreeMap<(i64, usize), Vec<SampledVoltage>>;

/// The largest mean square error of any sensor.
fn worst_square(
    interval: &SampledInterval,
    between: BetweenFrames,
    scales: &[SensorScale],
    held: &HeldFrames,
) -> f64 {
    let mean = |(number, scale): (usize, &SensorScale)| {
        let voltage = |moment: i64| held.get(&(moment, interval.sample)).map(|voltage| &voltage[number]);
        let outer = interval.outer.map(|moment| moment.and_then(voltage));
        let [from, to, middle] = [interval.ends[0], interval.ends[1], interval.middle()]
            .map(|moment| voltage(moment).expect("it is held"));
        scale.thresholds * scale.thresholds * mean_square(between, outer, [from, to], middle)
    };
    scales.iter().enumerate().map(mean).fold(0.0, f64::max)
}

/// Number of pixels in one partial sum. The total is then the same with any number of threads.
const CHUNK: usize = 4096;

fn mean_square(
    between: BetweenFrames,
    outer: [Option<&SampledVoltage>; 2],
    ends: [&SampledVoltage; 2],
    middle: &SampledVoltage,
) -> f64 {
    let error = |i: usize| {
        let outer = outer.map(|voltage| voltage.map(|voltage| voltage.knot(i)));
        interpolated_value(between, outer, ends.map(|voltage| voltage.knot(i)), middle.seconds)
            - f64::from(middle.v[i])
    };
    let sum = |(chunk, values): (usize, &[f32])| -> f64 {
        (0..values.len()).map(|i| error(chunk * CHUNK + i)).map(|error| error * error).sum()
    };
    let sums: Vec<f64> = middle.v.par_chunks(CHUNK).enumerate().map(sum).collect();
    sums.iter().sum::<f64>() / middle.v.len() as f64
}

#[cfg(test)]
pub(super) mod planted {
    use super::*;
    use gs2e_image::{Image, Size};
    use gs2e_num::units::Timestamp;
    use std::convert::Infallible;

    pub(crate) const K2: f64 = 20.0;

    /// Pixels with given `V` and slope at a moment.
    pub(crate) struct Planted<S> {
        pub(crate) size: Size,
        pub(crate) signal: S,
        /// The moments that were requested.
        pub(crate) requested: Vec<i64>,
    }

    impl<S: Fn(usize, f64) -> (f64, f64)> Planted<S> {
        pub(crate) fn new(size: Size, signal: S) -> Self {
            Self { size, signal, requested: Vec::new() }
        }
    }

    impl<S: Fn(usize, f64) -> (f64, f64)> PathViewer for Planted<S> {
        type Error = Infallible;

        #[expect(clippy::cast_possible_truncation, reason = "frames are f32")]
        fn show(
            &mut self,
            shots: &[SampledShot],
            rated: bool,
            look: &mut dyn FnMut(&[DenseFrame]),
        ) -> Result<(), Infallible> {
            for (moment, _) in shots {
                let of = |i: usize| (self.signal)(i, *moment as f64 * 1e-6);
                let image = |value: &dyn Fn(f64, f64) -> f64| {
                    let pixel = |i| {
                        let (v, slope) = of(i);
                        value(libm::exp(v), slope) as f32
                    };
                    Image::from_vec(self.size, (0..self.size.pixels()).map(pixel).collect())
                };
                look(&[DenseFrame {
                    index: 0,
                    t: Timestamp::from_micros(*moment),
                    luminance: image(&|level, _| level - K2),
                    rate: rated.then(|| image(&|level, slope| level * slope)),
                }]);
                self.requested.push(*moment);
            }
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::planted::{K2, Planted};
    use super::*;
    use gs2e_image::Size;

    const ALL: [BetweenFrames; 3] = [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite];
    const SIZE: Size = Size { width: 3, height: 2 };
    const SCALE: SensorScale = SensorScale { front_end: 0, k2: K2, thresholds: 5.0 };

    fn whole() -> [Arc<TileSample>; 1] {
        [Arc::new(TileSample::whole(SIZE))]
    }

    #[test]
    fn planted_errors_are_measured_in_thresholds() {
        // Parabolas of curvature 0 to 5: a line misses the middle by q h^2/4.
        let (h_us, h) = (2000, 2e-3);
        let signal = |i: usize, t: f64| (4.5 + 1000.0 * i as f64 * t * t, 2000.0 * i as f64 * t);
        let mut viewer = Planted::new(SIZE, signal);
        let interval =
            SampledInterval { ends: [h_us, 2 * h_us], outer: [Some(0), Some(3 * h_us)], sample: 0 };
        let found = measure_intervals(&mut viewer, &[SCALE], &[interval], &whole(), &ALL).unwrap();
        let mean = (0..6).map(|i| f64::from(i) * 1000.0 * h * h / 4.0).map(|e| e * e).sum::<f64>() / 6.0;
        let [linear, catmull, hermite] = found.squares[0][..] else { panic!() };
        // V is known to 3e-7, times five thresholds.
        assert!((linear.sqrt() - 5.0 * mean.sqrt()).abs() < 2e-6, "{linear} {mean}");
        assert!(catmull.sqrt() < 4e-6 && hermite.sqrt() < 4e-6, "{catmull} {hermite}");
        assert_eq!(found.frames, 5);
    }

    #[test]
    fn frames_are_shown_once_and_only_where_a_method_wants_them() {
        let mut viewer = Planted::new(SIZE, |_, t| (4.0 + t, 1.0));
        let nested = [
            SampledInterval { ends: [90, 110], outer: [Some(70), Some(130)], sample: 0 },
            SampledInterval { ends: [70, 130], outer: [Some(10), None], sample: 0 },
            SampledInterval { ends: [500, 520], outer: [None, None], sample: 0 },
        ];
        measure_intervals(&mut viewer, &[SCALE], &nested, &whole(), &ALL).unwrap();
        assert_eq!(viewer.requested, [90, 110, 100, 70, 130, 10, 500, 520, 510]);
        let mut viewer = Planted::new(SIZE, |_, t| (4.0 + t, 1.0));
        let found =
            measure_intervals(&mut viewer, &[SCALE], &nested, &whole(), &[BetweenFrames::Linear]).unwrap();
        assert_eq!(viewer.requested, [90, 110, 100, 70, 130, 500, 520, 510]);
        assert_eq!((found.squares.len(), found.squares[0].len()), (3, 1));
    }

    #[test]
    fn of_several_sensors_the_most_sensitive_counts() {
        let mut viewer = Planted::new(SIZE, |_, t| (4.5 + 1000.0 * t * t, 0.0));
        let interval = SampledInterval { ends: [0, 2000], outer: [None, None], sample: 0 };
        let scales = [SCALE, SensorScale { thresholds: 10.0, ..SCALE }];
        let found =
            measure_intervals(&mut viewer, &scales, &[interval], &whole(), &[BetweenFrames::Linear]).unwrap();
        assert!((found.squares[0][0].sqrt() - 10.0 * 1e-3).abs() < 4e-6);
    }
}
