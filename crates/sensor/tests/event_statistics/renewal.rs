//! Static pixels make a renewal process with known rates, polarities and intervals
//! (docs/design/numerics-sensor.md, "Closed forms").

use super::interval_law::BarrierExit;
use super::{by_pixel, frames, ks, ks_of_two, run};
use gs2e_event::Polarity;
use gs2e_image::Size;
use gs2e_sensor::statistics::RenewalProcess;
use gs2e_sensor::voltmeter::{InitialVoltage, VoltmeterModel};
use gs2e_testing::absent::runs_slow_tests;

const SIZE: Size = Size { width: 40, height: 25 };
/// Number of intervals taken from each pixel.
const TAKEN: usize = 8;
/// Alpha 1e-6 for each of some thirty statistics: 3e-5 over the family.
const KS_LIMIT: f64 = 2.69;
const Z_LIMIT: f64 = 5.0;

/// Events of 1000 pixels of one constant brightness, observed for 32 mean intervals.
struct Watched {
    process: RenewalProcess,
    /// Time of observation, us.
    duration: f64,
    pixels: Vec<Vec<(i64, Polarity)>>,
}

/// Simulates a process whose times are in us. The simulated noise is `distortion` times the right
/// one.
fn watch(process: RenewalProcess, distortion: f64, seed: u64) -> Watched {
    let sigma = process.variance.sqrt() * distortion;
    let sensor = VoltmeterModel {
        threshold_on: process.up,
        threshold_off: process.down,
        ..VoltmeterModel::new([1.0, 1.0, 0.0, process.drift, 0.0, sigma]).without_cap()
    };
    let duration = (32.0 * process.mean_interval()).ceil();
    let (events, account) = run(&sensor, &frames(SIZE, &[0, duration as i64], |_, _, _| 77.0), seed);
    assert_eq!(account.drift_violations, 0, "worst {}", account.drift_worst);
    Watched { process, duration, pixels: by_pixel(SIZE, &events) }
}

impl Watched {
    /// The first intervals of every pixel in us, sorted; of one polarity alone if `only` names it.
    fn intervals(&self, only: Option<Polarity>) -> Vec<f64> {
        let mut intervals = Vec::new();
        for events in &self.pixels {
            // 32 intervals are expected, with a deviation of at most sqrt(32 2/3): 8 is 5.2
            // deviations below.
            assert!(events.len() >= TAKEN, "a pixel made only {} events", events.len());
            let mut before = 0;
            for &(t, polarity) in &events[..TAKEN] {
                if only.is_none_or(|only| only == polarity) {
                    intervals.push((t - before) as f64 * 1e-3);
                }
                before = t;
            }
        }
        intervals.sort_unstable_by(f64::total_cmp);
        intervals
    }

    /// KS distance of the intervals from their law.
    fn interval_distance(&self) -> f64 {
        let RenewalProcess { drift, variance, up, down } = self.process;
        ks(&self.intervals(None), |t| BarrierExit { drift, variance, up, down }.by(t))
    }

    /// Deviation of the ON share of the first events, in standard errors.
    fn polarity_score(&self) -> f64 {
        let taken = self.pixels.iter().flat_map(|events| &events[..TAKEN]);
        let (n, share) = ((TAKEN * self.pixels.len()) as f64, self.process.on_share());
        let on = taken.filter(|event| event.1 == Polarity::On).count() as f64;
        let deviation = (n * share * (1.0 - share)).sqrt();
        (on - n * share) / deviation.max(1.0)
    }

    /// Deviation of the balance of the two polarities, in standard errors: drift, noise and the
    /// voltages at the end, each below 1.
    fn net_score(&self) -> f64 {
        let RenewalProcess { drift, variance, up, down } = self.process;
        let balance: f64 =
            self.pixels.iter().flatten().map(|e| if e.1 == Polarity::On { up } else { -down }).sum();
        let n = self.pixels.len() as f64;
        // A renewal process from 0 ends with a mean voltage equal to that of its stationary law.
        let left_over = stationary_mean(self.process);
        let spread = variance * self.duration + up.max(down).powi(2);
        (balance - n * (drift * self.duration - left_over)) / (n * spread).sqrt()
    }

    /// Deviation of the number of events after five mean intervals, in standard errors. Thresholds
    /// must be equal.
    fn rate_score(&self) -> f64 {
        let mean = self.process.mean_interval();
        let from = 5.0 * mean;
        let n = self.pixels.len() as f64;
        let events = self.pixels.iter().flatten().filter(|event| event.0 as f64 * 1e-3 > from).count() as f64;
        let expected = n * (self.duration - from) / mean;
        let variance = expected * self.process.symmetric_interval_variance() / (mean * mean);
        (events - expected) / variance.sqrt()
    }
}

/// Mean voltage of a pixel long after its first frame, by integrating the Green's function of the
/// exit problem: the mean time spent at each voltage, by Simpson's rule over the occupation density
/// (docs/design/numerics-sensor.md, "Stationary voltage").
fn stationary_mean(process: RenewalProcess) -> f64 {
    let RenewalProcess { drift, variance, up, down } = process;
    let q = 2.0 * drift / variance;
    let share = process.on_share();
    let mass = drift * process.mean_interval();
    let density = |v: f64| {
        if drift == 0.0 {
            let reach = if v >= 0.0 { (up - v) / up } else { (down + v) / down };
            return 2.0 * reach / (up + down);
        }
        let side = if v >= 0.0 {
            -share * (-q * (up - v)).exp_m1()
        } else {
            (1.0 - share) * (q * (down + v)).exp_m1()
        };
        side / mass
    };
    let simpson = |from: f64, to: f64, f: &dyn Fn(f64) -> f64| {
        let n = 20_000;
        let h = (to - from) / f64::from(n);
        let weight = |i| if i == 0 || i == n { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
        (0..=n).map(|i| weight(i) * f(from + f64::from(i) * h)).sum::<f64>() * h / 3.0
    };
    let (below, above) = (simpson(-down, -1e-12, &density), simpson(0.0, up, &density));
    assert!((below + above - 1.0).abs() < 1e-6, "the stationary density has mass {}", below + above);
    simpson(-down, -1e-12, &|v| v * density(v)) + simpson(0.0, up, &|v| v * density(v))
}

/// A process with drift over noise `nu = drift up/variance`, and a mean interval of about this
/// number of us.
fn process(nu: f64, mean_us: f64, [up, down]: [f64; 2]) -> RenewalProcess {
    let unit = RenewalProcess { drift: nu / up, variance: 1.0, up, down };
    let speed = unit.mean_interval() / mean_us;
    RenewalProcess { drift: nu / up * speed, variance: speed, up, down }
}

/// Checks every known property of a static pixel.
fn check(nu: f64, mean_us: f64, thresholds: [f64; 2], seed: u64) {
    let watched = watch(process(nu, mean_us, thresholds), 1.0, seed);
    let interval = watched.interval_distance();
    let (polarity, net) = (watched.polarity_score(), watched.net_score());
    println!(
        "nu {nu} mean {mean_us} us thresholds {thresholds:?}: intervals KS {interval:.2} (limit {KS_LIMIT}), \
         polarity z {polarity:.2}, net z {net:.2} (limit {Z_LIMIT})"
    );
    assert!(interval < KS_LIMIT && polarity.abs() < Z_LIMIT && net.abs() < Z_LIMIT);
    if thresholds[0].to_bits() == thresholds[1].to_bits() {
        let rate = watched.rate_score();
        println!("  rate z {rate:.2}");
        assert!(rate.abs() < Z_LIMIT);
    }
}

#[test]
fn pure_noise() {
    check(0.0, 4000.0, [1.0, 1.0], 1);
}

#[test]
fn noise_with_some_drift() {
    check(0.3, 4000.0, [1.0, 1.0], 2);
    check(-1.0, 4000.0, [1.0, 1.0], 3);
}

#[test]
fn drift_with_some_noise() {
    check(10.0, 4000.0, [1.0, 1.0], 4);
    check(-100.0, 700.0, [1.0, 1.0], 5);
}

#[test]
fn many_events_in_a_leaf_of_the_clock() {
    check(0.5, 3.0, [1.0, 1.0], 6);
}

#[test]
fn few_events_in_many_root_cells() {
    check(0.5, 30_000.0, [1.0, 1.0], 7);
}

#[test]
fn unequal_thresholds() {
    check(0.4, 4000.0, [1.2, 0.7], 8);
    check(0.0, 1000.0, [0.7, 1.2], 9);
    check(0.1, 2000.0, [1e-3, 1e-3], 10);
    check(0.1, 2000.0, [1e3, 1e3], 11);
}

/// With equal thresholds an interval is independent of the polarity of the event that ends it.
#[test]
fn intervals_and_polarities_are_independent() {
    let watched = watch(process(0.3, 2000.0, [1.0, 1.0]), 1.0, 12);
    let (on, off) = (watched.intervals(Some(Polarity::On)), watched.intervals(Some(Polarity::Off)));
    let distance = ks_of_two(&on, &off);
    println!("{} ON and {} OFF: KS {distance:.2} (limit {KS_LIMIT})", on.len(), off.len());
    assert!(distance < KS_LIMIT);
}

/// An hour of four static pixels: 3.4 million root cells each.
#[test]
fn rates_hold_for_an_hour() {
    if !runs_slow_tests() {
        return;
    }
    let process = process(2.0, 1e6, [1.0, 1.0]);
    let sensor =
        VoltmeterModel::new([1.0, 1.0, 0.0, process.drift, 0.0, process.variance.sqrt()]).without_cap();
    let (size, hour) = (Size { width: 2, height: 2 }, 3_600_000_000);
    let (events, account) = run(&sensor, &frames(size, &[0, hour], |_, _, _| 77.0), 15);
    let watched = Watched { process, duration: hour as f64, pixels: by_pixel(size, &events) };
    println!("{account:?}: rate z {:.2}, net z {:.2}", watched.rate_score(), watched.net_score());
    assert!(watched.rate_score().abs() < Z_LIMIT && watched.net_score().abs() < Z_LIMIT);
    assert_eq!(account.drift_violations, 0);
}

/// Planted defects: the statistics of the tests above detect noise that is 5 % too strong.
#[test]
fn five_percent_of_noise_are_noticed() {
    let watched = watch(process(0.0, 4000.0, [1.0, 1.0]), 1.05, 13);
    let (interval, rate) = (watched.interval_distance(), watched.rate_score());
    println!("intervals KS {interval:.2} (limit {KS_LIMIT}), rate z {rate:.2} (limit {Z_LIMIT})");
    assert!(interval > KS_LIMIT && rate.abs() > Z_LIMIT);
}

/// With `initial: stationary` the first second of a static pixel is like any other
/// (docs/design/numerics-sensor.md, "Stationary voltage").
#[test]
fn stationary_pixels_fire_evenly_from_the_start() {
    let process = process(3.0, 4000.0, [1.0, 1.0]);
    let sensor = |initial| VoltmeterModel {
        initial,
        ..VoltmeterModel::new([1.0, 1.0, 0.0, process.drift, 0.0, process.variance.sqrt()])
    };
    let counts = |initial| {
        let (events, account) = run(&sensor(initial), &frames(SIZE, &[0, 10_000], |_, _, _| 77.0), 14);
        assert_eq!(account.drift_violations, 0, "worst {}", account.drift_worst);
        let mut counts = [0.0; 5];
        events.iter().for_each(|event| counts[(event.t.0 - 1) as usize / 2_000_000] += 1.0);
        counts
    };
    // Each fifth is half a mean interval long: a pixel fires in it at most about once, so the count
    // is binomial.
    let expected = SIZE.pixels() as f64 * 2000.0 / process.mean_interval();
    let scores = |initial| counts(initial).map(|count| (count - expected) / expected.sqrt());
    let (even, in_step) = (scores(InitialVoltage::Stationary), scores(InitialVoltage::Zero));
    println!("z by fifth: stationary {even:.2?}, zero {in_step:.2?} (limit {Z_LIMIT})");
    assert!(even.iter().all(|z| z.abs() < Z_LIMIT));
    assert!(in_step.iter().any(|z| z.abs() > Z_LIMIT), "pixels that start at 0 fire in step");
}
