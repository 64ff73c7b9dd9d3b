//! Closed forms for a pixel of constant brightness: a Brownian motion with drift between two
//! barriers that restarts at 0 after each event. The two-barrier exit problem is treated in Darling
//! and Siegert, Annals of Mathematical Statistics 24, 1953.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::statistics::RenewalProcess;
//!
//! // Without drift, the nearer barrier is reached more often, and the mean time is `up down / variance`.
//! let noise = RenewalProcess { drift: 0.0, variance: 0.5, up: 1.0, down: 3.0 };
//! assert_eq!(noise.on_share(), 0.75);
//! assert_eq!(noise.mean_interval(), 6.0);
//! // Drift alone reaches its barrier at steady intervals.
//! let leak = RenewalProcess { drift: 0.25, variance: 0.0, ..noise };
//! assert_eq!((leak.on_share(), leak.rate()), (1.0, 0.25));
//! ```

pub mod interval_law;
pub mod receptor_rate;

/// The voltage of a pixel at constant brightness: drift and variance per unit time, and both
/// thresholds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenewalProcess {
    /// Drift, thresholds per unit time.
    pub drift: f64,
    /// Variance of the noise, squared thresholds per unit time.
    pub variance: f64,
    /// Distance of the ON barrier from 0, above 0.
    pub up: f64,
    /// Distance of the OFF barrier from 0, above 0.
    pub down: f64,
}

impl RenewalProcess {
    /// Probability that an event is ON; NaN if there are no events.
    #[must_use]
    pub fn on_share(self) -> f64 {
        let Self { drift, variance, up, down } = self;
        let (pa, pb) = (2.0 * drift.abs() * up / variance, 2.0 * drift.abs() * down / variance);
        // Without drift `pa` is 0, or NaN without noise, so this case comes before the others.
        if drift == 0.0 {
            return if variance == 0.0 { f64::NAN } else { down / (up + down) };
        }
        // Both exponents have underflowed, and the quotient below would be 0/0.
        if pa + pb == 0.0 {
            return down / (up + down);
        }
        // Without noise, or with next to none, the drift alone decides.
        if !(pa + pb).is_finite() {
            return if drift > 0.0 { 1.0 } else { 0.0 };
        }
        // Negative exponents cannot overflow, and `expm1` keeps the digits of small ones.
        let share = libm::expm1(-pb) / libm::expm1(-(pa + pb));
        if drift > 0.0 { share } else { libm::exp(-pa) * share }
    }

    /// Mean time between events; infinite if there are no events.
    #[must_use]
    pub fn mean_interval(self) -> f64 {
        let Self { drift, variance, up, down } = self;
        let skew = 2.0 * drift / variance;
        // NaN without drift and noise. The comparison is then false, and the case of no drift
        // applies.
        if skew.abs() * (up + down) < 1e-4 {
            // The closed form cancels here, so its expansion is used. The next term is of order
            // (skew W)^2, below 1e-8.
            return up * down / variance * (1.0 + skew * (up - down) / 6.0);
        }
        if drift == 0.0 {
            return f64::INFINITY;
        }
        // Wald's identity: the mean voltage at an exit is the drift times the mean time of the exit.
        (self.on_share() * (up + down) - down) / drift
    }

    /// Events of both polarities per unit time.
    #[must_use]
    pub fn rate(self) -> f64 {
        1.0 / self.mean_interval()
    }

    /// Variance of the time between events, for equal thresholds.
    ///
    /// # Panics
    /// The thresholds differ; the form does not hold for them.
    #[must_use]
    #[expect(clippy::float_cmp, reason = "the form holds for equal thresholds only")]
    pub fn symmetric_interval_variance(self) -> f64 {
        assert!(self.up == self.down, "the closed form is for equal thresholds");
        let Self { drift, variance, up, .. } = self;
        let (nu, time) = (drift.abs() * up / variance, up / drift);
        if nu < 1e-3 {
            // The closed form cancels here. The relative error of its limit is of order nu^2.
            return 2.0 / 3.0 * (up * up / variance) * (up * up / variance);
        }
        let sech = 1.0 / libm::cosh(nu);
        time * time * (libm::tanh(nu) / nu - sech * sech)
    }

    /// The voltage of a pixel observed at a random time long after its first event, as the quantile
    /// `u` of its distribution. The density is the mean time that the renewal process spends at
    /// each voltage.
    #[must_use]
    pub fn residual(self, u: f64) -> f64 {
        let Self { drift, variance, up, down } = self;
        if variance == 0.0 {
            // Drift alone moves evenly from 0 to its barrier, so all voltages on the way are equally likely.
            return if drift > 0.0 {
                u * up
            } else if drift < 0.0 {
                -u * down
            } else {
                0.0
            };
        }
        let skew = 2.0 * drift / variance;
        let scale = 2.0 / (variance * self.mean_interval());
        // The share of OFF by the mirrored process: one less the share of ON would lose its digits.
        let (on, off) = (self.on_share(), Self { drift: -drift, up: down, down: up, ..self }.on_share());
        let below = |depth: f64| off * scale * occupation_tail(skew, depth);
        let above = |depth: f64| on * scale * occupation_tail(-skew, depth);
        let inside = below(down);
        // Each side is measured from its own barrier, so that a small share is never a difference
        // of two large ones.
        if u < inside {
            bisect_below(down, |depth| below(depth) < u) - down
        } else {
            up - bisect_below(up, |depth| above(depth) < 1.0 - u)
        }
    }
}

/// `(e^y - 1 - y) / skew^2` with `y = skew depth`: the integral of the occupation density on one
/// side from its barrier to `depth`. Where it overflows, the probability by which it is multiplied
/// is zero to all digits, and the result is 0.
fn occupation_tail(skew: f64, depth: f64) -> f64 {
    let y = skew * depth;
    if y > 500.0 {
        return 0.0;
    }
    let share = if y.abs() < 0.1 {
        // The next term is y^8/10!, at most 3e-15.
        [2.0, 6.0, 24.0, 120.0, 720.0, 5040.0, 40320.0, 362_880.0]
            .iter()
            .rev()
            .fold(0.0, |sum, n| sum * y + 1.0 / n)
    } else {
        (libm::expm1(y) - y) / (y * y)
    };
    share * depth * depth
}

/// The largest number below `limit` for which `holds` is true, to the last bits.
fn bisect_below(limit: f64, holds: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, limit);
    for _ in 0..53 {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, wanted: f64, relative: f64) {
        assert!((found - wanted).abs() <= relative * wanted.abs(), "{found:e}, wanted {wanted:e}");
    }

    fn renewal(drift: f64, variance: f64) -> RenewalProcess {
        RenewalProcess { drift, variance, up: 1.0, down: 1.0 }
    }

    #[test]
    fn anchors() {
        // From the series of the interval law, computed independently.
        let r = renewal(0.5, 1.0);
        near(r.mean_interval(), 0.924_234_315, 1e-9);
        near(r.symmetric_interval_variance(), 0.551_146_326, 1e-8);
        near(renewal(0.0, 1.0).mean_interval(), 1.0, 1e-15);
        near(renewal(0.0, 1.0).symmetric_interval_variance(), 2.0 / 3.0, 1e-15);
    }

    #[test]
    fn equal_thresholds_have_the_logistic_polarity_and_the_coth_rate() {
        for exponent in -20..=2 {
            let nu = 10f64.powi(exponent);
            for drift in [nu, -nu] {
                let r = renewal(drift, 1.0);
                assert!((r.on_share() - 1.0 / (1.0 + (-2.0 * drift).exp())).abs() < 5e-16, "{drift:e}");
                let mean = if nu > 1e-8 { nu.tanh() / nu } else { 1.0 };
                near(r.mean_interval(), mean, 1e-8);
            }
        }
    }

    #[test]
    fn net_rate_is_the_drift() {
        // Wald's identity: E x(tau) = drift E tau, for any thresholds.
        for drift in [-30.0, -1.0, -1e-5, 1e-5, 0.3, 4.0] {
            let r = RenewalProcess { drift, variance: 0.7, up: 1.2, down: 0.7 };
            let net = (r.on_share() * r.up - (1.0 - r.on_share()) * r.down) * r.rate();
            assert!((net - drift).abs() < 1e-8 * drift.abs().max(1e-3), "{drift}: {net}");
        }
    }

    #[test]
    fn without_noise_or_without_anything() {
        let silent = renewal(0.0, 0.0);
        assert!(silent.mean_interval().is_infinite() && silent.on_share().is_nan());
        let clock = RenewalProcess { drift: -2.0, variance: 0.0, up: 1.0, down: 3.0 };
        near(clock.mean_interval(), 1.5, 1e-15);
        assert_eq!(clock.on_share().to_bits(), 0.0f64.to_bits());
    }

    /// Mean of a function over the residual law, by the midpoint rule over its quantiles.
    fn residual_mean(process: RenewalProcess, f: impl Fn(f64) -> f64) -> f64 {
        let n = 10_000;
        (0..n).map(|i| f(process.residual((f64::from(i) + 0.5) / f64::from(n)))).sum::<f64>() / f64::from(n)
    }

    #[test]
    fn residuals_stay_where_a_stationary_pixel_is() {
        // The generator of the process, `f''/2 variance + f' drift` between events and a jump to 0
        // at each, has mean 0 under the stationary law: `mean(drift) = rate (on A - off B)` for f =
        // v, and for f = v^2 `mean(variance + 2 drift v) = rate (on A^2 + off B^2)`.
        for (drift, variance) in
            [(0.0, 1.0), (1e-9, 1.0), (0.01, 1.0), (0.3, 1.0), (-2.0, 1.0), (40.0, 1.0), (-1.0, 1e-4)]
        {
            let process = RenewalProcess { drift, variance, up: 1.2, down: 0.7 };
            let on = process.on_share();
            let found = residual_mean(process, |v| variance + 2.0 * drift * v);
            let wanted = process.rate() * (on * 1.44 + (1.0 - on) * 0.49);
            assert!((found - wanted).abs() < 3e-5 * wanted.max(1.0), "{drift} {variance}: {found} {wanted}");
        }
    }

    #[test]
    fn residuals_without_noise_are_uniform_and_without_anything_zero() {
        let at = |drift, u| RenewalProcess { drift, variance: 0.0, up: 1.2, down: 0.7 }.residual(u);
        assert!((at(2.0, 0.25) - 0.3).abs() < 1e-15 && (at(-2.0, 0.5) + 0.35).abs() < 1e-15);
        assert_eq!(at(0.0, 0.3).to_bits(), 0.0f64.to_bits());
    }

    #[test]
    fn residuals_of_pure_noise_are_triangular() {
        // Density 2(A-v)/(AW) above 0 and 2(B+v)/(BW) below.
        let process = RenewalProcess { drift: 0.0, variance: 0.3, up: 1.2, down: 0.7 };
        assert!((process.residual(0.7 / 1.9)).abs() < 1e-8);
        assert!((process.residual(0.7 / 1.9 / 4.0) + 0.35).abs() < 1e-12);
        assert!((process.residual(1.0 - 1.2 / 1.9 / 4.0) - 0.6).abs() < 1e-12);
    }
}
