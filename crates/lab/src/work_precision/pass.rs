//! One pass over the fine frames of a rule set that feeds all settings.

use super::TimeSpent;
use super::errors::{CompactEvents, active_pixels};
use super::grid::FrameGrid;
use super::voltage::{FrameVoltage, IntervalVoltages};
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_sampling::jitter::IntervalNoise;
use gs2e_sensor::frames::{DenseFrame, FrameSequence};
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel};
use gs2e_sensor::{SensorError, SensorModel as _, SensorPixels, SimulateError};
use std::ops::ControlFlow;
use std::sync::Arc;

/// The inputs of a pass.
#[derive(Debug)]
pub(crate) struct PassSetup<'a> {
    /// The sensor of all settings; its interpolation is replaced.
    pub sensor: &'a VoltmeterModel,
    /// Seed of its noise, the same for all.
    pub seed: Seed,
    /// The grids.
    pub grids: &'a [FrameGrid],
    /// The interpolations for each grid.
    pub between: &'a [BetweenFrames],
}

/// The result of one setting.
#[derive(Debug)]
pub(crate) struct SettingRun {
    /// Index of the grid.
    pub grid: usize,
    /// Interpolation between its frames.
    pub between: BetweenFrames,
    /// RMS error of k1 V at the middles of intervals, in thresholds.
    pub rms_th: f64,
    /// Its events, sorted.
    pub events: Vec<u64>,
    /// Time of its sensor.
    pub spent: TimeSpent,
}

/// The result of a pass.
#[derive(Debug)]
pub(crate) struct PassResult {
    /// Events of the finest frames with `hermite`, sorted.
    pub reference: Vec<u64>,
    /// The settings, grid by grid.
    pub fed: Vec<SettingRun>,
    /// Mean luminance of the first frame, grey.
    pub grey: f64,
}

impl PassResult {
    /// Time jitter by noise of a sensor in this window; `None` without events.
    #[must_use]
    pub(crate) fn jitter(&self, sensor: &VoltmeterModel, seconds: f64) -> Option<IntervalNoise> {
        let counts = [self.reference.len(), active_pixels(&self.reference)].map(|n| n as u64);
        IntervalNoise::for_sensor(sensor, self.grey, counts, seconds)
    }
}

/// Feeds the settings from fine frames with rates. `clock` returns the time spent so far. `tap` is
/// called after each frame, and may stop the pass.
///
/// # Errors
/// A frame cannot be rendered, a sensor fails, or `tap` stops.
pub(crate) fn feed_settings(
    setup: &PassSetup<'_>,
    frames: &mut dyn FrameSequence,
    clock: &dyn Fn() -> TimeSpent,
    tap: &mut dyn FnMut(usize) -> ControlFlow<()>,
) -> Result<PassResult, SimulateError> {
    let size = frames.size();
    let mut reference = SensorAtWork::start_sensor(setup, BetweenFrames::Hermite, size)?;
    let mut gridded = setup.grids.iter().map(|grid| GridSettings::start_grid(setup, grid, size));
    let mut gridded = gridded.by_ref().collect::<Result<Vec<_>, _>>()?;
    let mut grey = 0.0;
    while let Some(frame) = frames.next()? {
        reference.see(&frame, clock)?;
        if frame.index == 0 {
            let sum: f64 = frame.luminance.pixels().iter().map(|l| f64::from(*l)).sum();
            grey = sum / size.pixels() as f64;
        }
        // The logarithms of a frame are computed once for all grids, and only for frames that one
        // needs.
        let wanted = gridded.iter().any(|grid| grid.wants(frame.index));
        let voltage = wanted.then(|| Arc::new(FrameVoltage::new(&frame, setup.sensor.k[1])));
        if let Some(voltage) = voltage {
            gridded.iter_mut().try_for_each(|grid| grid.see(&frame, &voltage, clock))?;
        }
        if tap(frame.index).is_break() {
            return Err(SimulateError::Interrupted);
        }
    }
    let mut fed = Vec::new();
    for (number, grid) in gridded.into_iter().enumerate() {
        grid.end(setup, number, clock, &mut fed)?;
    }
    Ok(PassResult { reference: reference.end(clock)?.0, fed, grey })
}

/// A sensor during the pass.
struct SensorAtWork {
    pixels: Box<dyn SensorPixels>,
    events: CompactEvents,
    spent: TimeSpent,
}

impl SensorAtWork {
    fn start_sensor(setup: &PassSetup<'_>, between: BetweenFrames, size: Size) -> Result<Self, SensorError> {
        let sensor = VoltmeterModel { between, ..setup.sensor.clone() };
        let pixels = sensor.start(size, [0, 0], setup.seed)?;
        Ok(Self { pixels, events: CompactEvents::new(size.width), spent: TimeSpent::default() })
    }

    fn see(&mut self, frame: &DenseFrame, clock: &dyn Fn() -> TimeSpent) -> Result<(), SensorError> {
        // Only the sensor is timed here; the cost of frames is measured by itself.
        let before = clock();
        self.pixels.advance(frame, &mut self.events)?;
        self.spent += clock() - before;
        Ok(())
    }

    fn end(mut self, clock: &dyn Fn() -> TimeSpent) -> Result<(Vec<u64>, TimeSpent), SensorError> {
        let before = clock();
        self.pixels.finish(&mut self.events)?;
        let spent = self.spent + (clock() - before);
        Ok((self.events.sorted(), spent))
    }
}

/// The settings of one grid.
struct GridSettings<'a> {
    grid: &'a FrameGrid,
    /// Index of its next frame among the grid's frames.
    next: usize,
    sensing: Vec<SensorAtWork>,
    voltages: IntervalVoltages,
}

impl<'a> GridSettings<'a> {
    fn start_grid(setup: &PassSetup<'_>, grid: &'a FrameGrid, size: Size) -> Result<Self, SensorError> {
        let sensing = setup.between.iter().map(|between| SensorAtWork::start_sensor(setup, *between, size));
        Ok(Self {
            grid,
            next: 0,
            sensing: sensing.collect::<Result<_, _>>()?,
            voltages: IntervalVoltages::new(setup.between),
        })
    }

    /// The fine frame in the middle of the interval before the next frame.
    fn middle(&self) -> Option<usize> {
        let interval = self.grid.places.get(self.next.checked_sub(1)?..=self.next)?;
        Some(usize::midpoint(interval[0], interval[1]))
    }

    fn wants(&self, fine: usize) -> bool {
        self.grid.places.get(self.next) == Some(&fine) || self.middle() == Some(fine)
    }

    fn see(
        &mut self,
        frame: &DenseFrame,
        voltage: &Arc<FrameVoltage>,
        clock: &dyn Fn() -> TimeSpent,
    ) -> Result<(), SensorError> {
        if self.middle() == Some(frame.index) {
            self.voltages.middle(voltage);
        }
        if self.grid.places.get(self.next) == Some(&frame.index) {
            self.sensing.iter_mut().try_for_each(|sensing| sensing.see(frame, clock))?;
            self.voltages.node(voltage);
            self.next += 1;
        }
        Ok(())
    }

    fn end(
        self,
        setup: &PassSetup<'_>,
        number: usize,
        clock: &dyn Fn() -> TimeSpent,
        fed: &mut Vec<SettingRun>,
    ) -> Result<(), SensorError> {
        // The error has no sign, so it is stated in the mean of both thresholds.
        let in_thresholds =
            setup.sensor.k[0] / f64::midpoint(setup.sensor.threshold_on, setup.sensor.threshold_off);
        let rms = self.voltages.finish();
        for ((sensing, rms), between) in self.sensing.into_iter().zip(rms).zip(setup.between) {
            let (events, spent) = sensing.end(clock)?;
            fed.push(SettingRun {
                grid: number,
                between: *between,
                rms_th: rms * in_thresholds,
                events,
                spent,
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::errors::StreamErrors;
    use super::*;
    use gs2e_image::Image;
    use gs2e_num::units::Timestamp;
    use gs2e_sensor::frames::FrameError;
    use gs2e_sensor::voltmeter::VoltmeterPreset;

    const SIZE: Size = Size { width: 8, height: 8 };
    const INTERVALS: usize = 960;
    const FINEST: u32 = 9600;

    /// `k1 V` of each pixel is a sine with its own phase, an amplitude of 6 thresholds, and a
    /// frequency of 30 Hz.
    #[derive(Debug)]
    struct Waves(usize);

    impl FrameSequence for Waves {
        fn size(&self) -> Size {
            SIZE
        }

        fn len(&self) -> usize {
            INTERVALS + 1
        }

        #[expect(clippy::cast_possible_truncation, reason = "frames are f32")]
        fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
            if self.0 > INTERVALS {
                return Ok(None);
            }
            let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
            let index = self.0;
            let us = (index as f64 * 1e6 / f64::from(FINEST)).round() as i64;
            self.0 += 1;
            let omega = 60.0 * std::f64::consts::PI;
            let (mut luminance, mut rate) = (Image::filled(SIZE, 0.0f32), Image::filled(SIZE, 0.0f32));
            for (i, (l, r)) in luminance.pixels_mut().iter_mut().zip(rate.pixels_mut()).enumerate() {
                let phase = us as f64 * 1e-6 * omega + i as f64;
                let level = 90.0 * libm::exp(6.0 / k1 * libm::sin(phase));
                *l = (level - k2) as f32;
                *r = (level * 6.0 / k1 * omega * libm::cos(phase)) as f32;
            }
            Ok(Some(DenseFrame { index, t: Timestamp::from_micros(us), luminance, rate: Some(rate) }))
        }
    }

    fn passed() -> PassResult {
        let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
        let sensor = VoltmeterModel::new([k1, k2, 0.0, 0.0, 0.0, 0.0]);
        let grids = [300, 600].map(|rate| FrameGrid::uniform_steps(rate, FINEST, INTERVALS));
        let between = [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite];
        let setup = PassSetup { sensor: &sensor, seed: Seed(1), grids: &grids, between: &between };
        let mut go_on = |_| ControlFlow::Continue(());
        feed_settings(&setup, &mut Waves(0), &TimeSpent::default, &mut go_on).unwrap()
    }

    /// Over whole periods, the curvature of a sine of amplitude A is `A w^2/sqrt(2)` rms, so lines
    /// miss middles by `h^2/8` of it; Hermite's cubics miss by `h^4/384` of the fourth derivative,
    /// `A w^4/sqrt(2)`.
    #[test]
    fn planted_waves_have_the_errors_of_the_textbook() {
        let passed = passed();
        let omega = 60.0 * std::f64::consts::PI;
        let amplitude = 6.0 / f64::sqrt(2.0);
        for (grid, rate) in [(0, 300.0), (1, 600.0)] {
            let rms = |b: usize| passed.fed[3 * grid + b].rms_th;
            let w = omega / rate;
            // The next terms of both series are w^2/48 and w^2/32 of the first; stamps round h by
            // 0.5 us.
            let slack = w * w / 30.0 + 0.5e-6 * rate * 8.0;
            for (found, wanted) in
                [(rms(0), amplitude * w * w / 8.0), (rms(2), amplitude * libm::pow(w, 4.0) / 384.0)]
            {
                assert!((found / wanted - 1.0).abs() < slack, "{rate}: {found}, wanted {wanted}");
            }
            assert!(rms(2) < rms(1) && rms(1) < rms(0));
        }
    }

    #[test]
    fn finer_frames_and_cubics_make_the_events_of_the_reference() {
        let passed = passed();
        // Three periods of 12 thresholds up and down: 72 events of a pixel, except at the turns.
        let each = passed.reference.len() as f64 / SIZE.pixels() as f64;
        assert!((60.0..72.0).contains(&each), "{each}");
        let errors: Vec<StreamErrors> = passed
            .fed
            .iter()
            .map(|fed| StreamErrors::compare_streams(&fed.events, &passed.reference))
            .collect();
        let median = |at: usize| errors[at].median_us.unwrap();
        // Linear at 300 and 600 Hz: times fall with the square of the step.
        assert!((3.0..5.0).contains(&(median(0) / median(3))), "{} {}", median(0), median(3));
        for grid in [0, 3] {
            assert!(median(grid + 2) < 0.2 * median(grid), "{errors:?}");
            assert!(errors[grid + 2].miscount <= errors[grid].miscount);
        }
        assert!(errors[5].f1[0] > 0.98, "{errors:?}");
        assert!((50.0..120.0).contains(&passed.grey));
    }
}
