//! Lines in the spectrum of all events: light of the mains and of lamps flickers.

use crate::recording::PixelTrains;
use serde::Serialize;

/// Length of a bin, us, and of a part of the recording, bins: lines are resolved to 1 Hz.
const BIN_US: i64 = 500;
const PART: usize = 2000;
/// Highest frequency, Hz: half of what bins of this length show.
const HIGHEST_HZ: usize = 500;
/// Frequencies below are those of motion.
const LOWEST_HZ: usize = 10;
/// Half of the frequencies that are compared with a line, Hz.
const NEIGHBOURS: usize = 20;
/// Power of a line by the median of its neighbours. For events without lines, the power of a part is
/// exponential, so a mean over a single part exceeds this in one frequency of 10^5.
const STRONG: f64 = 17.0;
/// Fewest events.
const FEWEST: usize = 1000;

/// A line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FlickerLine {
    /// Frequency, to 1 Hz.
    pub hz: usize,
    /// Power by the median of its neighbours.
    pub times_median: f64,
}

/// The spectrum of the number of events.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EventSpectrum {
    /// Power at 0, 1, 2, … Hz, by that of events that do not know of each other.
    pub power: Vec<f64>,
    /// Its lines, by frequency.
    pub lines: Vec<FlickerLine>,
}

/// The spectrum of the events of `pixels` from `span_us.0` to `span_us.1`: the mean over parts of a second
/// under a Hann window (Welch, 1967). `None` for less than a second or few events.
pub(crate) fn event_spectrum(
    trains: &PixelTrains,
    pixels: &[usize],
    span_us: (i64, i64),
) -> Option<EventSpectrum> {
    let bins = usize::try_from((span_us.1 - span_us.0) / BIN_US).unwrap_or(0);
    let parts = bins / PART;
    if parts == 0 {
        return None;
    }
    let mut counts = vec![0.0; parts * PART];
    let mut events = 0;
    for us in pixels.iter().flat_map(|pixel| trains.of(*pixel).0) {
        let bin = usize::try_from((us - span_us.0).div_euclid(BIN_US)).ok();
        if let Some(count) = bin.and_then(|bin| counts.get_mut(bin)) {
            *count += 1.0;
            events += 1;
        }
    }
    if events < FEWEST {
        return None;
    }
    let power = mean_power(&counts);
    let lines = lines(&power);
    Some(EventSpectrum { power, lines })
}

fn mean_power(counts: &[f64]) -> Vec<f64> {
    let parts = counts.len() / PART;
    let mut power = vec![0.0; HIGHEST_HZ + 1];
    let turn = std::f64::consts::TAU / PART as f64;
    let circle: Vec<[f64; 2]> =
        (0..PART).map(|i| turn * i as f64).map(|angle| [libm::cos(angle), libm::sin(angle)]).collect();
    let window: Vec<f64> = circle.iter().map(|[cos, _]| 0.5 - 0.5 * cos).collect();
    for part in counts.chunks_exact(PART) {
        let mean = part.iter().sum::<f64>() / PART as f64;
        // Poisson counts of this mean have a power of 1.
        let scale = 1.0 / (mean.max(1e-9) * window.iter().map(|w| w * w).sum::<f64>() * parts as f64);
        let shaped: Vec<f64> = part.iter().zip(&window).map(|(count, w)| (count - mean) * w).collect();
        for (hz, power) in power.iter_mut().enumerate() {
            // A part lasts 1 s, so the frequency is a number of turns.
            let [re, im] = shaped.iter().enumerate().fold([0.0; 2], |[re, im], (i, value)| {
                let [cos, sin] = circle[i * hz % PART];
                [re + value * cos, im + value * sin]
            });
            *power += scale * (re * re + im * im);
        }
    }
    power
}

/// Peaks far above their neighbours.
fn lines(power: &[f64]) -> Vec<FlickerLine> {
    let strength = |hz: usize| {
        let (from, to) = (hz.saturating_sub(NEIGHBOURS), (hz + NEIGHBOURS + 1).min(power.len()));
        let mut near: Vec<f64> = power[from..to].to_vec();
        power[hz] / crate::estimate::median(&mut near).max(f64::MIN_POSITIVE)
    };
    let is_peak = |hz: &usize| power[*hz] >= power[hz - 1] && power[*hz] > power[hz + 1];
    let peaks = (LOWEST_HZ..HIGHEST_HZ).filter(is_peak);
    let lines = peaks.map(|hz| FlickerLine { hz, times_median: strength(hz) });
    lines.filter(|line| line.times_median > STRONG).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::{Event, EventLabel, Polarity};
    use gs2e_image::Size;
    use gs2e_num::units::Timestamp;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    const SIZE: Size = Size { width: 20, height: 10 };

    fn all_pixels() -> Vec<usize> {
        (0..SIZE.pixels()).collect()
    }

    /// Events of 4 s at 5,000 per second; a share of them prefers the crests of a wave of `hz`.
    fn events(hz: f64, depth: f64) -> PixelTrains {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut all = Vec::new();
        while all.len() < 20_000 {
            let at: f64 = random.random::<f64>() * 4.0;
            let keep = 1.0 + depth * libm::sin(std::f64::consts::TAU * hz * at);
            if random.random::<f64>() * (1.0 + depth) < keep {
                #[expect(clippy::cast_possible_truncation, reason = "within 4 s")]
                all.push((at * 1e6) as i64);
            }
        }
        all.sort_unstable();
        let event = |us: i64| Event {
            t: Timestamp::from_micros(us),
            x: random.random_range(0..20),
            y: random.random_range(0..10),
            polarity: Polarity::On,
            label: EventLabel::Signal,
        };
        PixelTrains::new(SIZE, &all.into_iter().map(event).collect::<Vec<_>>())
    }

    /// Half of the amplitude of a wave squared, by the square of the mean, is the power that it adds to
    /// Poisson counts: `depth^2 / 4` times the events of a part, times 2/3 for the window.
    #[test]
    fn a_line_has_the_power_of_its_wave() {
        let spectrum = event_spectrum(&events(120.0, 0.3), &all_pixels(), (0, 4_000_000)).unwrap();
        let [line] = spectrum.lines[..] else { panic!("{:?}", spectrum.lines) };
        assert_eq!(line.hz, 120);
        let wanted = 1.0 + 0.3 * 0.3 / 4.0 * 5000.0 * (2.0 / 3.0);
        // The power of a part is that of a wave with noise: a deviation of sqrt(2 wanted / parts).
        let error = 4.0 * f64::sqrt(2.0 * wanted / 4.0);
        assert!((spectrum.power[120] - wanted).abs() < error, "{} for {wanted}", spectrum.power[120]);
    }

    #[test]
    fn events_of_chance_have_no_line() {
        let spectrum = event_spectrum(&events(120.0, 0.0), &all_pixels(), (0, 4_000_000)).unwrap();
        assert_eq!(spectrum.lines, []);
        let mean = spectrum.power[10..].iter().sum::<f64>() / 491.0;
        assert!((mean - 1.0).abs() < 0.1, "{mean}");
    }

    #[test]
    fn short_recordings_have_no_spectrum() {
        assert_eq!(event_spectrum(&events(120.0, 0.3), &all_pixels(), (0, 900_000)), None);
    }
}
