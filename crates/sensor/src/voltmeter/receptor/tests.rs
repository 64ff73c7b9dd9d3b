//! The law of the photoreceptor's noise, judged by the Fokker-Planck equation, by moments of first passages,
//! and by a fine grid.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "stamps are below 2^53 ns, and places are those of grids of a few thousand"
)]

use super::super::exact::ExactSampler;
use crate::chain::PixelArray;
use crate::frames::DenseFrame;
use crate::noise::{PhotoreceptorNoise, ReceptorPoint};
use crate::voltmeter::{InitialVoltage, VoltmeterModel};
use crate::{SensorModel as _, SensorParameters as _, SensorPixels as _};
use gs2e_event::{Event, Polarity};
use gs2e_image::{Image, Size};
use gs2e_num::seed::Seed;
use gs2e_num::units::Timestamp;
use gs2e_testing::absent::runs_slow_tests;
use gs2e_testing::rival;
use std::f64::consts::{PI, SQRT_2, TAU};

/// A pixel in constant light whose noise is `start` at time 0, with time in units of `1 / theta`.
#[derive(Debug, Clone, Copy)]
struct Passage {
    cutoff_hz: f64,
    /// Standard deviation of the noise, and its value when the pixel was reset.
    deviation: f64,
    start: f64,
    /// Drift in units of `theta`.
    drift: f64,
    /// Standard deviation of the Brownian motion over a unit.
    brownian: f64,
    up: f64,
    down: f64,
}

impl Passage {
    /// ns per unit of time.
    fn unit_ns(&self) -> f64 {
        1e9 / (TAU * self.cutoff_hz)
    }

    fn sensor(&self) -> VoltmeterModel {
        let point = ReceptorPoint { lux: 250.0, deviation: self.deviation, cutoff_hz: self.cutoff_hz };
        // k4 is per us, k6 per root of a us. One threshold is a contrast of 1.
        let unit_us = self.unit_ns() * 1e-3;
        let (k4, k6) = (self.drift / unit_us, self.brownian / unit_us.sqrt());
        VoltmeterModel {
            threshold_on: self.up,
            threshold_off: self.down,
            photoreceptor_noise: PhotoreceptorNoise { spread: 0.0, points: vec![point] },
            ..VoltmeterModel::new([1.0, 1.0, 0.0, k4, 0.0, k6]).without_cap()
        }
    }

    /// Events of `n` pixels that all begin with `start`, up to `until` in units.
    fn events(&self, n: u32, until: f64, seed: u64) -> Vec<Event> {
        let size = Size { width: 1000, height: n / 1000 };
        let sensor = self.sensor();
        let array = PixelArray { size, origin: [0, 0], seed: Seed(seed), labels: false };
        let mut sampler = ExactSampler::new(&sensor, u32::MAX, array);
        let frame = |index, t| DenseFrame {
            index,
            t: Timestamp(t),
            luminance: Image::filled(size, 77.0),
            rate: None,
        };
        let mut events = Vec::new();
        sampler.advance(&frame(0, 0), &mut events).unwrap();
        sampler.set_receptor(self.start);
        sampler.advance(&frame(1, (until * self.unit_ns()).ceil() as i64), &mut events).unwrap();
        let account = sampler.finish(&mut events).unwrap();
        assert_eq!(account.drift_violations, 0, "worst {}", account.drift_worst);
        events
    }

    /// Time and polarity of the first event of each of `n` pixels that makes one before `until`; times in
    /// units, in order.
    fn first_events(&self, n: u32, until: f64, seed: u64) -> Vec<(f64, Polarity)> {
        let mut seen = vec![false; n as usize];
        let mut first = Vec::new();
        for event in self.events(n, until, seed) {
            let pixel = usize::from(event.y) * 1000 + usize::from(event.x);
            if !std::mem::replace(&mut seen[pixel], true) {
                first.push((event.t.0 as f64 / self.unit_ns(), event.polarity));
            }
        }
        first.sort_by(|a, b| a.0.total_cmp(&b.0));
        first
    }

    /// Probabilities that the first event is ON and happens by the end of each of `steps` steps up to
    /// `until`, and the same of OFF. The Fokker-Planck equation of the voltage between its barriers, whose
    /// drift is `drift - u` with the noise `u = start + x - drift t`, by Crank and Nicolson's scheme on
    /// cells.
    fn fokker_planck(&self, until: f64, steps: usize) -> Vec<[f64; 2]> {
        const CELLS: usize = 800;
        assert!(self.brownian <= 0.0, "with both noises, the voltage alone is no Markov process");
        let width = (self.up + self.down) / CELLS as f64;
        let diffusion = self.deviation * self.deviation;
        let centre = |i: usize| -self.down + (i as f64 + 0.5) * width;
        // Half a step from the start, before a barrier is felt, the law is a normal one.
        let h = until / steps as f64;
        let begin = 0.5 * h;
        let (mean, spread) = ((self.drift - self.start) * begin, (2.0 * diffusion * begin).sqrt());
        let mut density: Vec<f64> = (0..CELLS)
            .map(|i| {
                let z = |x: f64| 0.5 * libm::erfc(-(x - mean) / (spread * SQRT_2));
                (z(centre(i) + 0.5 * width) - z(centre(i) - 0.5 * width)) / width
            })
            .collect();
        let mut made = vec![[0.0; 2]; steps];
        let mut total = [0.0; 2];
        let (mut t, mut i) = (begin, 0);
        while i < steps {
            // The first step ends where the others do. Four half-sized ones damp what the start excites.
            let end = h * (i + 1) as f64;
            let inner = if i < 8 { 16 } else { 2 };
            for _ in 0..inner {
                let dt = (end - h * i as f64 - if i == 0 { begin } else { 0.0 }) / inner as f64;
                let out = self.step(&mut density, [t, dt], width);
                total.iter_mut().zip(out).for_each(|(total, out)| *total += out);
                t += dt;
            }
            made[i] = total;
            i += 1;
        }
        made
    }

    /// One step of the density; returns what left it upwards and downwards.
    fn step(&self, density: &mut [f64], [t, dt]: [f64; 2], width: f64) -> [f64; 2] {
        let n = density.len();
        let diffusion = self.deviation * self.deviation;
        // Velocity at a face, in the middle of the step.
        let velocity = |face: usize| {
            let x = -self.down + face as f64 * width;
            self.drift - self.start - x + self.drift * (t + 0.5 * dt)
        };
        // Flux through face i, from cell i - 1 to cell i, is `a[i] left + b[i] right`. At a barrier the
        // density is 0, half a cell away.
        let face = |i: usize| {
            let v = velocity(i);
            let across = diffusion / width;
            match i {
                0 => (0.0, -2.0 * across),
                i if i == n => (2.0 * across, 0.0),
                _ => (0.5 * v + across, 0.5 * v - across),
            }
        };
        let faces: Vec<(f64, f64)> = (0..=n).map(face).collect();
        let r = 0.5 * dt / width;
        let mut right = vec![0.0; n];
        for i in 0..n {
            let flux = |f: usize| {
                let left = if f > 0 { density[f - 1] } else { 0.0 };
                let right = if f < n { density[f] } else { 0.0 };
                faces[f].0 * left + faces[f].1 * right
            };
            right[i] = density[i] - r * (flux(i + 1) - flux(i));
        }
        let before = [density[n - 1], density[0]];
        // The tridiagonal system of the implicit half.
        let (mut upper, mut solved) = (vec![0.0; n], right);
        let mut pivot = 1.0 + r * (faces[1].0 - faces[0].1);
        for i in 0..n {
            if i > 0 {
                let lower = -r * faces[i].0;
                pivot = 1.0 + r * (faces[i + 1].0 - faces[i].1) - lower * upper[i - 1];
                solved[i] = (solved[i] - lower * solved[i - 1]) / pivot;
            } else {
                solved[0] /= pivot;
            }
            upper[i] = r * faces[i + 1].1 / pivot;
        }
        for i in (0..n - 1).rev() {
            solved[i] -= upper[i] * solved[i + 1];
        }
        density.copy_from_slice(&solved);
        let after = [density[n - 1], density[0]];
        let out = [faces[n].0, -faces[0].1];
        [0, 1].map(|side| 0.5 * dt * out[side] * (before[side] + after[side]))
    }

    /// Largest distance of first events of `n` pixels from the Fokker-Planck equation, of ON and of OFF,
    /// times the square root of `n`.
    fn distance(&self, n: u32, until: f64, seed: u64, judged: &Self) -> f64 {
        self.distance_from(n, until, seed, &judged.fokker_planck(until, 800))
    }

    /// [`Passage::distance`] from a law that is given at the ends of equal steps.
    fn distance_from(&self, n: u32, until: f64, seed: u64, law: &[[f64; 2]]) -> f64 {
        let first = self.first_events(n, until, seed);
        let mut farthest = 0.0f64;
        for (side, polarity) in [Polarity::On, Polarity::Off].into_iter().enumerate() {
            let times: Vec<f64> =
                first.iter().filter(|event| event.1 == polarity).map(|event| event.0).collect();
            for i in 1..law.len() {
                let t = until * i as f64 / law.len() as f64;
                let share = times.partition_point(|time| *time < t) as f64 / f64::from(n);
                farthest = farthest.max((share - law[i - 1][side]).abs());
            }
        }
        farthest * f64::from(n).sqrt()
    }

    /// Shares of `n` paths whose first event is ON, and OFF, by the end of each unit's hundredth: Euler's
    /// scheme, `steps` steps a hundredth, which looks for a crossing at the end of each step only.
    fn grid(&self, n: u32, until: u32, steps: u32) -> Vec<[f64; 2]> {
        let h = 0.01 / f64::from(steps);
        let (noise, voltage) = (self.deviation * (2.0 * h).sqrt(), self.brownian * h.sqrt());
        let slots = 100 * until as usize;
        let mut made = vec![[0.0; 2]; slots];
        let mut normals = rival::draws(&rand_distr::StandardNormal, u64::from(steps));
        for _ in 0..n {
            let (mut x, mut u) = (0.0, self.start);
            'path: for slot in &mut made {
                for _ in 0..steps {
                    let step = noise * normals.next().unwrap() - u * h;
                    u += step;
                    x += step + self.drift * h;
                    if voltage > 0.0 {
                        x += voltage * normals.next().unwrap();
                    }
                    if x >= self.up || x <= -self.down {
                        slot[usize::from(x < 0.0)] += 1.0 / f64::from(n);
                        break 'path;
                    }
                }
            }
        }
        for i in 1..slots {
            made[i] = [0, 1].map(|side| made[i][side] + made[i - 1][side]);
        }
        made
    }
}

/// Scaled distance that the sup of an empirical law exceeds with a probability of 1e-6.
const LIMIT: f64 = 2.69;
const CUTOFFS: [f64; 5] = [5.0, 20.0, 60.0, 200.0, 1000.0];
const DRIFTS: [f64; 3] = [0.0, 0.4, -0.7];

fn passage(cutoff_hz: f64, drift: f64, start: f64) -> Passage {
    Passage { cutoff_hz, deviation: 0.5, start, drift, brownian: 0.0, up: 1.0, down: 0.8 }
}

/// The scheme against a closed form: without return (a short time beside `1 / theta`), exits are those of a
/// Brownian motion, and at equal distances half of them are ON.
#[test]
fn the_judge_conserves_and_converges() {
    let symmetric = Passage { up: 1.0, down: 1.0, ..passage(60.0, 0.0, 0.0) };
    let made = symmetric.fokker_planck(40.0, 4000);
    let [on, off] = made[made.len() - 1];
    assert!((on - off).abs() < 1e-9, "{on} {off}");
    // Mean exit time from (-1, 1), in units of `1 / theta`, for a deviation of 0.5: `2 a^2 / 2 ...` by
    // quadrature of the scale function, `T(0) = 2 ∫_0^A e^(z^2/2) ∫_0^z e^(-w^2/2) dw dz` with A = 2.
    let simpson = |to: f64, f: &dyn Fn(f64) -> f64| {
        let n = 400;
        let weight = |i: i32| if i == 0 || i == n { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
        (0..=n).map(|i| weight(i) * f(to * f64::from(i) / f64::from(n))).sum::<f64>() * to
            / (3.0 * f64::from(n))
    };
    let inner = |z: f64| (0.5 * PI).sqrt() * libm::erf(z / SQRT_2);
    let wanted = simpson(2.0, &|z| libm::exp(0.5 * z * z) * inner(z));
    let h = 40.0 / 4000.0;
    let left: f64 = made.iter().map(|[on, off]| 1.0 - on - off).sum::<f64>() * h;
    // The sum of survival at the ends of the steps misses half a step.
    let found = left + 0.5 * h;
    println!("mean exit {found:.5}, wanted {wanted:.5}");
    assert!((found - wanted).abs() < 1e-3 * wanted);
}

#[test]
fn first_events_have_the_law_of_the_fokker_planck_equation() {
    let slow = runs_slow_tests();
    let n = if slow { 1_000_000 } else { 50_000 };
    let mut worst = 0.0f64;
    for (i, cutoff_hz) in CUTOFFS.into_iter().enumerate() {
        for (j, drift) in DRIFTS.into_iter().enumerate() {
            // Otherwise each bandwidth with one drift.
            if !slow && i % 3 != j {
                continue;
            }
            let start = [0.0, 0.6, -0.9][(i + j) % 3];
            let passage = passage(cutoff_hz, drift, start);
            let distance = passage.distance(n, 5.0, (10 * i + j) as u64, &passage);
            println!("{cutoff_hz} Hz, drift {drift}, from {start}: {distance:.3} (limit {LIMIT})");
            worst = worst.max(distance);
        }
    }
    assert!(worst < LIMIT);
}

/// With a Brownian motion as well, no equation of one dimension holds. The error of a grid falls with the
/// root of its step, so two grids, one with steps of a fourth, give the limit without steps.
#[test]
fn first_events_of_both_noises_have_the_law_of_an_extrapolated_grid() {
    if !runs_slow_tests() {
        return;
    }
    let n = 1_000_000;
    for (i, drift) in DRIFTS.into_iter().enumerate() {
        for brownian in [0.0, 0.4] {
            let passage = Passage { brownian, ..passage(CUTOFFS[i], drift, 0.3) };
            let [coarse, fine] = [1, 4].map(|steps| passage.grid(n, 5, steps));
            let limit: Vec<[f64; 2]> = coarse
                .iter()
                .zip(&fine)
                .map(|(coarse, fine)| [0, 1].map(|side| 2.0 * fine[side] - coarse[side]))
                .collect();
            let distances = [&coarse, &fine, &limit].map(|law| passage.distance_from(n, 5.0, 7, law));
            println!("drift {drift}, Brownian {brownian}: coarse, fine, limit {distances:.2?}");
            // The sample, and twice the fine grid less the coarse one.
            assert!(distances[2] < LIMIT * 6.0_f64.sqrt());
        }
    }
}

#[test]
fn planted_defects_of_the_law_are_noticed() {
    let right = passage(60.0, 0.4, 0.6);
    for (defect, wrong) in [
        ("2 % of the deviation", Passage { deviation: 0.51, ..right }),
        ("a start that is forgotten", Passage { start: 0.0, ..right }),
        ("5 % of the drift", Passage { drift: 0.36, ..right }),
    ] {
        let distance = right.distance(100_000, 5.0, 5, &wrong);
        println!("{defect}: {distance:.2} (limit {LIMIT})");
        assert!(distance > LIMIT, "{defect}");
    }
}

/// Mean and second moment of the first passage from 0 to a level `a`, in deviations: Siegert's recursion
/// (Physical Review 81, 1951), with the values of Ricciardi and Sato (Journal of Applied Probability 25,
/// 1988).
#[test]
fn first_passages_through_one_level_have_siegerts_moments() {
    let level = 1.5;
    let n = 4000;
    let step = |from: f64, to: f64| (to - from) / f64::from(n);
    // On a grid from -8 deviations: `T(x) = ∫_x^a sqrt(2 pi) e^(z^2/2) Phi(z) dz`.
    let from = -8.0;
    let h = step(from, level);
    let x = |i: i32| from + h * f64::from(i);
    let slope = |z: f64| TAU.sqrt() * libm::exp(0.5 * z * z) * 0.5 * libm::erfc(-z / SQRT_2);
    let mut first = vec![0.0; n as usize + 1];
    for i in (0..n).rev() {
        let [a, b] = [slope(x(i)), slope(x(i + 1))];
        let middle = slope(x(i) + 0.5 * h);
        first[i as usize] = first[i as usize + 1] + h * (a + 4.0 * middle + b) / 6.0;
    }
    // `T2(x) = 2 ∫_x^a e^(z^2/2) ∫_-inf^z e^(-w^2/2) T(w) dw dz`, by the trapezium rule.
    let (mut inner, mut inners) = (0.0, vec![0.0; n as usize + 1]);
    for i in 1..=n {
        let weight = |i: i32| libm::exp(-0.5 * x(i) * x(i)) * first[i as usize];
        inner += 0.5 * h * (weight(i - 1) + weight(i));
        inners[i as usize] = inner;
    }
    let zero = (-from / h).round() as i32;
    let second: f64 = (zero..n)
        .map(|i| {
            let outer = |i: i32| libm::exp(0.5 * x(i) * x(i)) * inners[i as usize];
            h * (outer(i) + outer(i + 1))
        })
        .sum();
    let (mean, deviation) = (first[zero as usize], (second - first[zero as usize].powi(2)).sqrt());
    // The other barrier is never met.
    let pixels = if runs_slow_tests() { 1_000_000 } else { 200_000 };
    let passage = Passage { deviation: 1.0 / level, up: 1.0, down: 100.0, ..passage(60.0, 0.0, 0.0) };
    let until = 14.0 * mean;
    let mut times: Vec<f64> = passage.first_events(pixels, until, 9).iter().map(|event| event.0).collect();
    // The tail is exponential: what has not fired by the end does so after one mean more.
    let missing = pixels as usize - times.len();
    assert!(missing < pixels as usize / 10_000, "{missing}");
    times.extend(std::iter::repeat_n(until + mean, missing));
    let count = f64::from(pixels);
    let found_mean = times.iter().sum::<f64>() / count;
    let found = (times.iter().map(|t| (t - found_mean).powi(2)).sum::<f64>() / count).sqrt();
    println!("mean {found_mean:.4} of {mean:.4}, deviation {found:.4} of {deviation:.4}");
    assert!((found_mean / mean - 1.0).abs() < 0.01 && (found / deviation - 1.0).abs() < 0.01);
}

/// With equal thresholds and without drift, the noise at events lies on a lattice around its value at the
/// first frame, and walks on it: from `r` up with the probability that the exit from `(r - 1, r + 1)` is up.
/// Rates and alternation follow from the stationary law of that walk.
#[test]
fn later_events_have_the_rate_of_a_walk_on_a_lattice() {
    let passage = Passage { deviation: 0.6, up: 1.0, down: 1.0, ..passage(60.0, 0.0, 0.3) };
    // In deviations: scale function and mean exit time by quadrature.
    let s = passage.deviation;
    let simpson = |from: f64, to: f64, f: &dyn Fn(f64) -> f64| {
        let n = 200;
        let h = (to - from) / f64::from(n);
        let weight = |i: i32| if i == 0 || i == n { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
        (0..=n).map(|i| weight(i) * f(from + h * f64::from(i))).sum::<f64>() * h / 3.0
    };
    let scale = |z: f64| libm::exp(0.5 * z * z);
    let normal = |w: f64| libm::exp(-0.5 * w * w);
    let exit = |r: f64| {
        let [low, at, high] = [(r - 1.0) / s, r / s, (r + 1.0) / s];
        let up = simpson(low, at, &scale) / simpson(low, high, &scale);
        // Green's function of the exit problem, for the generator `f'' - z f'`.
        let below = simpson(low, at, &|w| normal(w) * simpson(low, w, &scale));
        let above = simpson(at, high, &|w| normal(w) * simpson(w, high, &scale));
        (up, (1.0 - up) * below + up * above)
    };
    let reach = 5;
    let exits: Vec<(f64, f64)> = (-reach..=reach).map(|k| exit(passage.start + f64::from(k))).collect();
    // Detailed balance: `pi(k) up(k) = pi(k + 1) down(k + 1)`.
    let mut weights = vec![1.0];
    for pair in exits.windows(2) {
        weights.push(weights[weights.len() - 1] * pair[0].0 / (1.0 - pair[1].0));
    }
    let total: f64 = weights.iter().sum();
    let mean = weights.iter().zip(&exits).map(|(w, exit)| w * exit.1).sum::<f64>() / total;
    // An event alternates with the next where an up is followed by a down from the place above.
    let alternate: f64 = (0..weights.len())
        .map(|k| {
            let up = exits.get(k + 1).map_or(0.0, |next| exits[k].0 * (1.0 - next.0));
            let down = k.checked_sub(1).map_or(0.0, |below| (1.0 - exits[k].0) * exits[below].0);
            weights[k] * (up + down) / total
        })
        .sum();
    let (n, until) = (20_000, 120.0);
    let events = passage.events(n, until, 3);
    let settled = 20.0;
    let late = events.iter().filter(|event| event.t.0 as f64 > settled * passage.unit_ns()).count() as f64;
    let rate = late / f64::from(n) / (until - settled);
    let mut pixels = vec![Vec::new(); n as usize];
    events.iter().for_each(|e| pixels[usize::from(e.y) * 1000 + usize::from(e.x)].push(e.polarity));
    let pairs = |test: fn(&[Polarity]) -> bool| {
        pixels.iter().flat_map(|events| events.windows(2)).filter(|pair| test(pair)).count() as f64
    };
    let found = pairs(|pair| pair[0] != pair[1]) / pairs(|_| true);
    println!("rate {rate:.4} of {:.4}, alternate {found:.4} of {alternate:.4}", 1.0 / mean);
    // Some 10^6 events: a tenth of a percent each, and what the first 20 units leave of the start.
    assert!((rate * mean - 1.0).abs() < 5e-3 && (found - alternate).abs() < 5e-3);
}

/// Rates that a sensor predicts of itself, where the noise is up to a third of the thresholds.
#[test]
fn rates_are_those_that_the_sensor_predicts() {
    let size = Size { width: 120, height: 120 };
    // The last number is the error: that of the pairs between 32 voltages, or of a start that is forgotten.
    for (deviation, spread, threshold_spread, k4, initial, error) in [
        (0.2, 0.2, 0.0, 0.0, InitialVoltage::Stationary, 0.05),
        (0.2, 0.0, 0.05, 0.0, InitialVoltage::Stationary, 0.05),
        (0.3, 0.0, 0.0, 0.0, InitialVoltage::Zero, 0.08),
        (0.25, 0.1, 0.0, 2e-6, InitialVoltage::Stationary, 0.25),
        (0.2, 0.1, 0.04, -1e-6, InitialVoltage::Stationary, 0.25),
    ] {
        let point = ReceptorPoint { lux: 250.0, deviation, cutoff_hz: 60.0 };
        let sensor = VoltmeterModel {
            initial,
            threshold_spread,
            photoreceptor_noise: PhotoreceptorNoise { spread, points: vec![point] },
            ..VoltmeterModel::new([1.0, 1.0, 0.0, k4, 0.0, 0.0]).without_cap()
        };
        let predicted = sensor.array_noise(77.0);
        let mut pixels = sensor.start(size, [0, 0], Seed(4)).unwrap();
        let frame = |index, t| DenseFrame {
            index,
            t: Timestamp(t),
            luminance: Image::filled(size, 77.0),
            rate: None,
        };
        let mut events: Vec<Event> = Vec::new();
        pixels.advance(&frame(0, 0), &mut events).unwrap();
        pixels.advance(&frame(1, 1_000_000_000), &mut events).unwrap();
        pixels.finish(&mut events).unwrap();
        let count = |from: f64, to: f64| {
            let inside = |event: &&Event| (from..to).contains(&event.t.seconds());
            events.iter().filter(inside).count() as f64 / size.pixels() as f64 / (to - from)
        };
        let on = events.iter().filter(|event| event.polarity == Polarity::On).count() as f64;
        let [first, rest] = [[0.0, 0.1], [0.1, 1.0]].map(|[from, to]| count(from, to));
        let (share, wanted) = (on / events.len() as f64, predicted.total_hz);
        let predicted = predicted.on_share.unwrap();
        println!(
            "{deviation} {threshold_spread} {k4}: {first:.3}, {rest:.3} of {wanted:.3} Hz, ON {share:.3} of {predicted:.3}"
        );
        // Five standard deviations of a count of pairs.
        let scatter =
            |seconds: f64| 5.0 * (2.0 * wanted / (size.pixels() as f64 * seconds)).sqrt() + error * wanted;
        assert!((rest - wanted).abs() < scatter(0.9) && (share - predicted).abs() < 0.04);
        // The first tenth of a second is like the rest: the pixels start as if they had seen the grey before.
        assert!((first - wanted).abs() < scatter(0.1));
    }
}
