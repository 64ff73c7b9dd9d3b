//! The published sampler (Lin et al., ECCV 2022; Lynn0306/DVS-Voltmeter, `src/simulator_utils.py`), for comparisons.
//!
//! Between two frames drift and noise are those of their middle. A pixel's next polarity is drawn first, with the
//! probability of the exit between both barriers; then the time to that barrier, as if there were no other. If it lies
//! before the later frame, there is an event and the voltage is 0 again; otherwise the voltage goes along the straight
//! line to it, and the polarity is forgotten. So streams depend on the frame rate, and noise is far from what the
//! process has (numerics.md 2.2 lists by how much); the law `exact` does neither.
//!
//! Kept as published, though wrong: the midpoint gain, the polarity before the time, the one-barrier times, the factor 2
//! in the time where the drift is 0, the truncated draw against the drift, the straight residual, voltages from 0, and
//! that the terms of sigma add.
//!
//! Not as published, where the program breaks down: the polarity has its stable form (`0/0` became ON); the inverse
//! Gaussian is formed without cancellation; against the drift, where the truncated draw underflows, the time is that
//! of a drift the other way; a loop takes the place of a recursion; times are 64-bit nanoseconds in place of 32-bit
//! microseconds; each draw belongs to seed, pixel and frame; events of one microsecond have one order. To lengthen
//! either list is another law: raise `VERSION`.

use super::drift::{Process, Sample};
use super::{Gain, Voltmeter};
use crate::event::Polarity;
use crate::seed::{Draws, Space, normal};
use crate::sensor::noise::poisson::{Rates, Train};
use crate::sensor::noise::{HotPixels, Site, mismatch};
use crate::sensor::pairs::{Law, Pair, Writer};
use crate::sensor::statistics::Renewal;
use std::ops::ControlFlow;

/// Version of the law: raised when a draw or one of the lists above changes.
pub(super) const VERSION: u32 = 1;

/// Least threshold of a pixel, as a share of the nominal one.
const FLOOR: f64 = 0.01;

/// The law.
#[derive(Debug)]
pub(super) struct Official {
    process: Process,
    thresholds: [f64; 2],
    spread: f64,
    hot: HotPixels,
}

/// State of one pixel.
#[derive(Debug)]
pub(super) struct Pixel {
    voltage: f64,
    thresholds: [f64; 2],
    own: Train,
}

impl Official {
    pub(super) fn new(sensor: &Voltmeter) -> Self {
        let midpoint = Voltmeter { gain: Gain::Midpoint, ..sensor.clone() };
        Self {
            process: Process::new(&midpoint),
            thresholds: [sensor.threshold_on, sensor.threshold_off],
            spread: sensor.threshold_spread,
            hot: sensor.hot_pixels,
        }
    }

    /// Drift and standard deviation of the noise between two frames, per ns and per square root of a ns.
    fn motion(&self, pair: &Pair) -> [f64; 2] {
        let [from, to] = pair.luminance;
        #[expect(clippy::cast_possible_truncation, reason = "luminance was 32 bits wide")]
        let sample = |luminance: f64| Sample { luminance: luminance as f32, log: 0.0 };
        let drift = self.process.between(sample(from), sample(to), 1.0 / pair.length).rate(0.0);
        [drift, self.process.sigma(0.5 * (from + to))]
    }

    /// Moves the voltage from frame to frame.
    fn walk(&self, pixel: &mut Pixel, pair: &Pair, writer: &mut Writer<'_>) -> ControlFlow<()> {
        let [drift, sigma] = self.motion(pair);
        let mut draws = pair.site.draws(Space::Pair, pair.frame);
        let [up, down] = pixel.thresholds;
        let mut t = 0.0;
        loop {
            let x = pixel.voltage;
            let exit = Renewal { drift, variance: sigma * sigma, up: up - x, down: down + x };
            let on = draws.uniform() <= exit.on_share();
            let (distance, speed) = if on { (exit.up, drift) } else { (exit.down, -drift) };
            let tau = passage(distance, speed, sigma, &mut draws);
            if t + tau >= pair.length {
                let way = distance * ((pair.length - t) / tau);
                pixel.voltage += if on { way } else { -way };
                return ControlFlow::Continue(());
            }
            t += tau;
            pixel.voltage = 0.0;
            writer.event(t, if on { Polarity::On } else { Polarity::Off })?;
        }
    }

    /// The events that a hot pixel makes by itself.
    fn own(&self, pixel: &mut Pixel, pair: &Pair, writer: &mut Writer<'_>) -> ControlFlow<()> {
        let rates = Rates { ends: [self.hot.per_ns(); 2], length: pair.length };
        let mut start = 0.0;
        while let Some(t) = pixel.own.advance(&rates, start) {
            writer.event(t, Polarity::On)?;
            pixel.own.wait(pair.site, Space::Hot);
            start = t;
        }
        ControlFlow::Continue(())
    }
}

impl Law for Official {
    type Pixel = Pixel;

    fn begin(&self, site: Site, _: f64) -> Pixel {
        let floors = self.thresholds.map(|threshold| FLOOR * threshold);
        let thresholds = mismatch::thresholds(self.thresholds, self.spread, floors, site, 0);
        Pixel { voltage: 0.0, thresholds, own: self.hot.train(site) }
    }

    fn cross(&self, pixel: &mut Pixel, pair: &Pair, writer: &mut Writer<'_>) -> ControlFlow<()> {
        self.walk(pixel, pair, writer)?;
        self.own(pixel, pair, writer)
    }

    /// The residual is drawn anew in each frame, so events and drift part.
    fn imbalance(&self, _: &Pixel, _: u32, _: u32) -> Option<f64> {
        None
    }
}

/// The published time to a barrier at `distance`, by a drift of `speed` towards it.
fn passage(distance: f64, speed: f64, sigma: f64, draws: &mut Draws) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    if sigma == 0.0 {
        return if speed > 0.0 { distance / speed } else { f64::INFINITY };
    }
    let root = distance / sigma;
    let (shape, phi) = (root * root, distance * speed.abs() / (sigma * sigma));
    let underflows = 2.0 * phi.sqrt() > TRUNCATION;
    if speed == 0.0 {
        let z = draws.normal();
        // Twice the Lévy time `shape / z^2`.
        2.0 * (root / z) * (root / z)
    } else if speed > 0.0 || underflows {
        let (z, u) = (draws.normal(), draws.uniform());
        inverse_gaussian(shape, phi, z, u)
    } else {
        against(shape, phi, draws.uniform())
    }
}

/// Beyond so many deviations a truncated normal draw has lost its digits.
const TRUNCATION: f64 = 8.0;

/// An inverse Gaussian time of shape `shape` and mean `shape / phi` from a normal and a uniform draw: Michael, Schucany,
/// Haas (The American Statistician 30, 1976), in a form that adds only like signs.
fn inverse_gaussian(shape: f64, phi: f64, z: f64, u: f64) -> f64 {
    let z = z.abs();
    let q = phi + 0.5 * z * z + z * (0.25 * z * z + phi).sqrt();
    if u * (q + phi) <= q { shape / q } else { shape / phi * (q / phi) }
}

/// What the same transform makes of a negative mean and a normal draw below `-2 sqrt(phi)`, of which `u` is the share:
/// its acceptance always takes the smaller root.
fn against(shape: f64, phi: f64, u: f64) -> f64 {
    let edge = 0.5 * libm::erfc(2.0 * phi.sqrt() / std::f64::consts::SQRT_2);
    let z = normal::quantile((edge * u).max(f64::MIN_POSITIVE));
    let y = (z * z).max(4.0 * phi);
    2.0 * shape / ((y - 2.0 * phi) + (y * (y - 4.0 * phi)).sqrt())
}
