//! Closed forms for a pixel of constant brightness: a Brownian motion with drift between two barriers that starts at 0
//! after each event (numerics.md 8.1; the two-barrier exit problem as in Darling, Siegert, Annals of Mathematical
//! Statistics 24, 1953).

/// The voltage of a pixel of constant brightness: drift and variance per unit time, and the two thresholds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Renewal {
    /// Drift, thresholds per unit time.
    pub drift: f64,
    /// Variance of the noise, squared thresholds per unit time.
    pub variance: f64,
    /// Distance of the ON barrier from 0, above 0.
    pub up: f64,
    /// Distance of the OFF barrier from 0, above 0.
    pub down: f64,
}

impl Renewal {
    /// Probability that an event is ON; NaN where there are no events at all.
    #[must_use]
    pub fn on_share(self) -> f64 {
        let Self { drift, variance, up, down } = self;
        let (pa, pb) = (2.0 * drift.abs() * up / variance, 2.0 * drift.abs() * down / variance);
        if drift == 0.0 {
            return if variance == 0.0 { f64::NAN } else { down / (up + down) };
        }
        if pa + pb == 0.0 {
            return down / (up + down);
        }
        if !(pa + pb).is_finite() {
            return if drift > 0.0 { 1.0 } else { 0.0 };
        }
        let share = libm::expm1(-pb) / libm::expm1(-(pa + pb));
        if drift > 0.0 { share } else { libm::exp(-pa) * share }
    }

    /// Mean time between events; infinite where there are none.
    #[must_use]
    pub fn mean_interval(self) -> f64 {
        let Self { drift, variance, up, down } = self;
        let skew = 2.0 * drift / variance;
        if skew.abs() * (up + down) < 1e-4 {
            // The closed form cancels here. Its expansion: the next term is of order (skew W)^2, below 1e-8.
            return up * down / variance * (1.0 + skew * (up - down) / 6.0);
        }
        if drift == 0.0 {
            return f64::INFINITY;
        }
        (self.on_share() * (up + down) - down) / drift
    }

    /// Events of either polarity per unit time.
    #[must_use]
    pub fn rate(self) -> f64 {
        1.0 / self.mean_interval()
    }

    /// Variance of the time between events, where the two thresholds are equal.
    ///
    /// # Panics
    /// Where they are not: there the form does not hold.
    #[must_use]
    #[expect(clippy::float_cmp, reason = "the form holds for equal thresholds only")]
    pub fn symmetric_interval_variance(self) -> f64 {
        assert!(self.up == self.down, "the closed form is for equal thresholds");
        let Self { drift, variance, up, .. } = self;
        let nu = drift.abs() * up / variance;
        if nu < 1e-3 {
            return 2.0 / 3.0 * up.powi(4) / (variance * variance);
        }
        let (sinh, cosh) = (libm::tanh(nu), 1.0 / libm::cosh(nu));
        up * variance * sinh / drift.abs().powi(3) - (up / drift * cosh).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, wanted: f64, relative: f64) {
        assert!((found - wanted).abs() <= relative * wanted.abs(), "{found:e}, wanted {wanted:e}");
    }

    fn renewal(drift: f64, variance: f64) -> Renewal {
        Renewal { drift, variance, up: 1.0, down: 1.0 }
    }

    #[test]
    fn anchors() {
        // numerics.md 8.2, computed there from the series of the interval law.
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
        // Wald: E x(tau) = drift E tau, whatever the thresholds.
        for drift in [-30.0, -1.0, -1e-5, 1e-5, 0.3, 4.0] {
            let r = Renewal { drift, variance: 0.7, up: 1.2, down: 0.7 };
            let net = (r.on_share() * r.up - (1.0 - r.on_share()) * r.down) * r.rate();
            assert!((net - drift).abs() < 1e-8 * drift.abs().max(1e-3), "{drift}: {net}");
        }
    }

    #[test]
    fn without_noise_or_without_anything() {
        let silent = renewal(0.0, 0.0);
        assert!(silent.mean_interval().is_infinite() && silent.on_share().is_nan());
        let clock = Renewal { drift: -2.0, variance: 0.0, up: 1.0, down: 3.0 };
        near(clock.mean_interval(), 1.5, 1e-15);
        assert_eq!(clock.on_share().to_bits(), 0.0f64.to_bits());
    }
}
