//! Contrast thresholds (the paper's appendix B, as a measurement): the share of events at each
//! threshold that comes from the scene's smooth motion, and the share that comes from jumps of the
//! renderer.
//!
//! The same path is rendered twice: under the rules of the release, and under rules that make the
//! image a continuous function of the view (`soft` with a blended order). The same sensor sees both
//! with the same noise, so the two streams differ by the effect of the rules. An event of the first
//! stream is
//! - **smooth** if the second stream has an event of the same pixel and polarity within a frame
//!   interval, each used once;
//! - otherwise **near a jump** if, since the pixel's previous event, the difference of the two
//!   renderings changed between two neighbouring frames by more than `JUMP` of the threshold in
//!   `k1 ln(L + k2)`;
//! - otherwise **other**: late or early after a jump, or under a difference that grew slowly.

use gs2e_event::picture::WindowCounts;
use gs2e_event::{Event, EventSink};
use gs2e_image::{Image, Size};
use gs2e_num::seed::Seed;
use gs2e_sensor::frames::{DenseFrame, FrameSequence};
use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use gs2e_sensor::{SensorError, SensorModel as _, SensorPixels, SimulateError, SimulationAccount};
use serde::Serialize;
use std::ops::ControlFlow;

/// Change of the difference of the renderings between two frames, in thresholds, that counts as a
/// jump.
pub(crate) const JUMP: f64 = 0.1;

/// Share of smooth events from which on a threshold is recommended.
pub const ENOUGH: f64 = 0.95;

/// The parameters of a sweep.
#[derive(Debug, Clone)]
pub struct ThresholdSweep {
    /// The sensor; its thresholds are replaced.
    pub sensor: VoltmeterModel,
    /// Thresholds of ON and OFF events in the unit of the sensor, ascending.
    pub thresholds: Vec<f64>,
    /// Seed of the noise.
    pub seed: Seed,
    /// A frame interval: the largest distance between matching events, ns.
    pub within_ns: i64,
    /// Events of this time appear in the pictures, us.
    pub window_us: std::ops::Range<i64>,
}

/// The result at one threshold.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ThresholdRow {
    /// Threshold of ON and OFF events.
    pub threshold: f64,
    /// The threshold as a step of `ln(L + k2)`.
    pub contrast: f64,
    /// Events under the rules of the release.
    pub events: u64,
    /// ON events among them.
    pub on: u64,
    /// Events per pixel and second.
    pub rate_ev_px_s: f64,
    /// Events under the smooth rules.
    pub smooth_stream: u64,
    /// Events that the smooth stream has as well.
    pub smooth: u64,
    /// Events near a jump of the renderer.
    pub near_jump: u64,
    /// Other events.
    pub other: u64,
}

impl ThresholdRow {
    /// Share of the events that the scene's smooth motion explains; 1 without events.
    #[must_use]
    pub fn explained(&self) -> f64 {
        if self.events == 0 { 1.0 } else { self.smooth as f64 / self.events as f64 }
    }
}

/// The result of a sweep.
#[derive(Debug, Clone)]
pub struct SweepResult {
    /// One row per threshold.
    pub rows: Vec<ThresholdRow>,
    /// The events of the window at each threshold, under the rules of the release.
    pub pictures: Vec<Image<[u8; 3]>>,
    /// Number of frames, each rendered under both rules.
    pub frames: usize,
    /// Duration from the first frame to the last, seconds.
    pub seconds: f64,
    /// The preset of the sensor. Thresholds mean nothing without it.
    pub preset: Option<VoltmeterPreset>,
}

impl SweepResult {
    /// Lowest threshold at which enough events also occur in the smooth rendering, and the reason;
    /// `None` if none does.
    #[must_use]
    pub fn recommended(&self) -> (Option<&ThresholdRow>, String) {
        let percent = |row: &ThresholdRow| 100.0 * row.explained();
        let enough = 100.0 * ENOUGH;
        // A row without events has a share of 1, and recommends nothing.
        let Some(at) = self.rows.iter().position(|row| row.events > 0 && row.explained() >= ENOUGH) else {
            let best = self.rows.iter().filter(|row| row.events > 0);
            let Some(best) = best.max_by(|a, b| a.explained().total_cmp(&b.explained())) else {
                return (None, "no threshold makes any events".to_owned());
            };
            // The advice follows from the larger part of the rest.
            let rest = if best.near_jump >= best.other {
                "most of the rest follows jumps of the renderer, which the rules `soft` do not make"
            } else {
                "most of the rest is late, early, or under a slow difference of the two renderings: the rules `soft` \
                 are those of the smooth rendering"
            };
            let because = format!(
                "no threshold has {enough} % of its events explained by smooth motion; the best is {} with {:.1} %: {rest}",
                best.threshold,
                percent(best)
            );
            return (None, because);
        };
        let row = &self.rows[at];
        let before = at.checked_sub(1).map(|i| &self.rows[i]);
        let below = before.map_or_else(String::new, |below| {
            format!("; at threshold {}, {:.1} %", below.threshold, percent(below))
        });
        let because = format!(
            "the lowest threshold at which smooth motion explains {enough} % of the events: {:.1} % of {}{below}",
            percent(row),
            row.events
        );
        (Some(row), because)
    }
}

impl SweepResult {
    /// Lines of a recipe that follow from the sweep.
    #[must_use]
    pub fn recipe_fragment(&self) -> String {
        match self.recommended().0 {
            Some(row) => {
                let threshold = row.threshold;
                let preset =
                    self.preset.map_or_else(String::new, |preset| format!("preset: {}, ", preset.name()));
                format!(
                    "sensor:\n  voltmeter: {{ {preset}threshold: {{ on: {threshold}, off: {threshold} }} }}"
                )
            }
            None => "render: { rules: soft }".to_owned(),
        }
    }
}

/// Sweeps over two renderings of one path, frame by frame: under the rules of the release, and
/// under smooth rules. `tap` is called after each frame, and may stop the sweep.
///
/// # Errors
/// A frame cannot be rendered, a sensor fails, or `tap` stops.
///
/// # Panics
/// The sequences differ in size or number of frames.
pub fn sweep_thresholds(
    sweep: &ThresholdSweep,
    released: &mut dyn FrameSequence,
    smooth: &mut dyn FrameSequence,
    tap: &mut dyn FnMut(usize) -> ControlFlow<()>,
) -> Result<SweepResult, SimulateError> {
    let size = released.size();
    assert_eq!((size, released.len()), (smooth.size(), smooth.len()), "they are renderings of one path");
    let mut pairs = sweep.pairs(size)?;
    // The lowest threshold decides what is stored; higher ones filter it again.
    let mut jumps = JumpMap::new(&sweep.sensor, sweep.thresholds.first().copied().unwrap_or(1.0));
    let mut stamps = Vec::new();
    while let (Some(a), Some(b)) = (released.next()?, smooth.next()?) {
        for [first, second] in &mut pairs {
            first.see(&a)?;
            second.see(&b)?;
        }
        jumps.see(&a, &b);
        stamps.push(a.t.0);
        if tap(a.index).is_break() {
            return Err(SimulateError::Interrupted);
        }
    }
    let jumps = jumps.sorted();
    let seconds = stamps.last().map_or(0.0, |t| *t as f64 * 1e-9);
    let mut found = SweepResult {
        rows: Vec::new(),
        pictures: Vec::new(),
        frames: stamps.len(),
        seconds,
        preset: VoltmeterPreset::with_constants_of(&sweep.sensor),
    };
    for (&threshold, [first, second]) in sweep.thresholds.iter().zip(pairs) {
        let ((events, account), (other, smooth)) = (first.end()?, second.end()?);
        let picture = WindowCounts::new(size, sweep.window_us.clone()).map_err(std::io::Error::from);
        let mut picture = picture.map_err(SensorError::from)?;
        picture.append(&events).map_err(SensorError::from)?;
        found.pictures.push(picture.image());
        let [smooth_events, near_jump, rest] =
            EventMatching { sweep, threshold, jumps: &jumps, stamps: &stamps }
                .sort(by_pixel(events, size), by_pixel(other, size));
        let per_second = size.pixels() as f64 * seconds;
        found.rows.push(ThresholdRow {
            threshold,
            contrast: threshold / sweep.sensor.k[0],
            events: account.events,
            on: account.on,
            rate_ev_px_s: if per_second > 0.0 { account.events as f64 / per_second } else { 0.0 },
            smooth_stream: smooth.events,
            smooth: smooth_events,
            near_jump,
            other: rest,
        });
    }
    Ok(found)
}

/// A sensor and its events.
struct SweptSensor {
    pixels: Box<dyn SensorPixels>,
    events: Vec<Event>,
}

impl SweptSensor {
    fn see(&mut self, frame: &DenseFrame) -> Result<(), SensorError> {
        self.pixels.advance(frame, &mut self.events)
    }

    fn end(mut self) -> Result<(Vec<Event>, SimulationAccount), SensorError> {
        let account = self.pixels.finish(&mut self.events)?;
        Ok((self.events, account))
    }
}

impl ThresholdSweep {
    /// Two sensors per threshold.
    fn pairs(&self, size: Size) -> Result<Vec<[SweptSensor; 2]>, SensorError> {
        let swept = |threshold: f64| {
            let sensor =
                VoltmeterModel { threshold_on: threshold, threshold_off: threshold, ..self.sensor.clone() };
            Ok::<_, SensorError>(SweptSensor {
                pixels: sensor.start(size, [0, 0], self.seed)?,
                events: Vec::new(),
            })
        };
        self.thresholds.iter().map(|&t| Ok([swept(t)?, swept(t)?])).collect()
    }
}

/// Places at which the difference of two renderings changed quickly.
struct JumpMap {
    k1: f64,
    k2: f64,
    /// Change below which nothing is stored, in the voltage of the sensor.
    least: f64,
    /// Difference of `k1 ln(L + k2)` between the renderings at the last frame.
    last: Vec<f64>,
    found: Vec<JumpAt>,
}

/// One jump: its pixel, the later of the two frames, and its size.
#[derive(Debug, Clone, Copy)]
struct JumpAt {
    pixel: usize,
    frame: usize,
    by: f64,
}

impl JumpMap {
    fn new(sensor: &VoltmeterModel, lowest_threshold: f64) -> Self {
        let [k1, k2, ..] = sensor.k;
        Self { k1, k2, least: JUMP * lowest_threshold, last: Vec::new(), found: Vec::new() }
    }

    fn see(&mut self, a: &DenseFrame, b: &DenseFrame) {
        let voltage = |l: &f32| self.k1 * libm::log(f64::from(l.max(0.0)) + self.k2);
        let pairs = a.luminance.pixels().iter().zip(b.luminance.pixels());
        let now: Vec<f64> = pairs.map(|(a, b)| voltage(a) - voltage(b)).collect();
        // At the first frame, `last` is empty.
        for (pixel, (now, last)) in now.iter().zip(&self.last).enumerate() {
            let by = (now - last).abs();
            if by > self.least {
                self.found.push(JumpAt { pixel, frame: a.index, by });
            }
        }
        self.last = now;
    }

    /// Sorted by pixel, then by time.
    fn sorted(mut self) -> Vec<JumpAt> {
        self.found.sort_by_key(|jump| (jump.pixel, jump.frame));
        self.found
    }
}

/// The events of each pixel in order of time, pixels row by row.
fn by_pixel(events: Vec<Event>, size: Size) -> Vec<Vec<Event>> {
    let mut pixels = vec![Vec::new(); size.pixels()];
    for event in events {
        pixels[usize::from(event.y) * size.width as usize + usize::from(event.x)].push(event);
    }
    // Within a microsecond, a stream is ordered by pixel and polarity, not by time.
    pixels.iter_mut().for_each(|events: &mut Vec<Event>| events.sort_by_key(|event| event.t));
    pixels
}

/// The classification of events.
struct EventMatching<'a> {
    sweep: &'a ThresholdSweep,
    threshold: f64,
    jumps: &'a [JumpAt],
    stamps: &'a [i64],
}

impl EventMatching<'_> {
    /// Counts the events that are smooth, near a jump, and other.
    fn sort(&self, events: Vec<Vec<Event>>, smooth: Vec<Vec<Event>>) -> [u64; 3] {
        let mut counts = [0; 3];
        for (pixel, (events, smooth)) in events.into_iter().zip(smooth).enumerate() {
            let mut used = vec![false; smooth.len()];
            let mut before = i64::MIN;
            for event in events {
                let kind = if self.take(&event, &smooth, &mut used) {
                    0
                } else {
                    usize::from(!self.is_near_jump(pixel, before, event.t.0)) + 1
                };
                counts[kind] += 1;
                before = event.t.0;
            }
        }
        counts
    }

    /// Consumes the first event of `smooth` that can match this one.
    fn take(&self, event: &Event, smooth: &[Event], used: &mut [bool]) -> bool {
        let from = smooth.partition_point(|other| other.t.0 < event.t.0 - self.sweep.within_ns);
        let near = smooth[from..].iter().take_while(|other| other.t.0 <= event.t.0 + self.sweep.within_ns);
        let found = near.zip(from..).find(|(other, i)| !used[*i] && other.polarity == event.polarity);
        found.is_some_and(|(_, i)| {
            used[i] = true;
            true
        })
    }

    /// Returns true if the pixel jumped between its previous event and the frame after this event.
    fn is_near_jump(&self, pixel: usize, before: i64, at: i64) -> bool {
        let from = self.jumps.partition_point(|jump| jump.pixel < pixel);
        let of_pixel = self.jumps[from..].iter().take_while(|jump| jump.pixel == pixel);
        let stamp = |frame: usize| self.stamps.get(frame).copied().unwrap_or(i64::MAX);
        // A jump lies between two frames: the later is after the previous event, the earlier before
        // this event.
        let mut within =
            of_pixel.filter(|jump| stamp(jump.frame) > before && stamp(jump.frame.saturating_sub(1)) <= at);
        within.any(|jump| jump.by > JUMP * self.threshold)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};

    const SIZE: Size = Size { width: 4, height: 1 };
    const FRAME_US: i64 = 400;

    fn frames(grey: impl Fn(usize, usize) -> f64) -> ArrayFrames {
        let samples = (0..100).flat_map(|j| (0..4).map(move |x| (j, x)));
        #[expect(clippy::cast_possible_truncation, reason = "frames are f32")]
        let samples = samples.map(|(j, x)| grey(j, x) as f32).collect();
        let stamps: Vec<i64> = (0..100).map(|j| FRAME_US * j).collect();
        ArrayFrames::new(SIZE, ArraySamples::Floats(samples, FullScale::Grey255), &stamps).unwrap()
    }

    fn swept(released: impl Fn(usize, usize) -> f64, smooth: impl Fn(usize, usize) -> f64) -> SweepResult {
        let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
        let asked = ThresholdSweep {
            sensor: VoltmeterModel::new([k1, k2, 0.0, 0.0, 0.0, 0.0]),
            thresholds: vec![0.25, 0.5, 1.0, 2.0],
            seed: Seed(1),
            within_ns: 1000 * FRAME_US,
            window_us: 0..1000,
        };
        let (mut a, mut b) = (frames(released), frames(smooth));
        sweep_thresholds(&asked, &mut a, &mut b, &mut |_| ControlFlow::Continue(())).unwrap()
    }

    /// Brightness such that `k1 ln(L + k2)` rises or falls by half a threshold per frame.
    fn ramp(j: usize) -> f64 {
        let way = 0.05 * if j < 50 { j as f64 } else { 100.0 - j as f64 };
        libm::exp(3.5 + way / 5.265 * 10.0 * 0.5) - 20.0
    }

    #[test]
    fn a_rendering_that_is_smooth_is_explained() {
        let found = swept(|j, _| ramp(j), |j, _| ramp(j));
        for row in &found.rows {
            assert!(row.events > 0 && row.smooth == row.events && row.smooth_stream == row.events, "{row:?}");
        }
        assert_eq!(found.recommended().0.map(|row| row.threshold), Some(0.25));
        assert_eq!((found.frames, found.pictures.len()), (100, 4));
    }

    /// One pixel flickers between two frames by 0.8 thresholds, like a popping splat: the lowest
    /// thresholds see it.
    #[test]
    fn jumps_make_the_events_that_they_make_and_no_others() {
        let pop = |j: usize, x: usize| {
            let up = x == 2 && j % 2 == 1;
            libm::exp(4.0 + if up { 0.8 / 5.265 } else { 0.0 }) - 20.0
        };
        let found = swept(pop, |_, _| libm::exp(4.0) - 20.0);
        let counts: Vec<[u64; 3]> = found.rows.iter().map(|r| [r.smooth, r.near_jump, r.other]).collect();
        assert!(counts[0][1] > 100 && counts[1][1] > 50, "{counts:?}");
        assert!(counts[2..].iter().all(|c| *c == [0; 3]), "{counts:?}");
        assert!(counts.iter().all(|c| c[0] == 0 && c[2] == 0), "{counts:?}");
        let (row, because) = found.recommended();
        assert!(row.is_none() && because.contains("no threshold has"), "{because}");
    }

    #[test]
    fn a_threshold_is_recommended_once_jumps_are_below_it() {
        let ramped = |j: usize, x: usize| {
            let pops = x == 2 && j % 2 == 1;
            (ramp(j) + 20.0) * if pops { libm::exp(0.8 / 5.265) } else { 1.0 } - 20.0
        };
        let found = swept(ramped, |j, _| ramp(j));
        let shares: Vec<f64> = found.rows.iter().map(ThresholdRow::explained).collect();
        assert!(shares[0] < ENOUGH && shares[3] > shares[0], "{shares:?}");
    }
}
