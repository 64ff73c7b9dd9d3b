//! Noise of a pixel by the sensor's law: of its voltage, shots, the floor, and hot pixels.

use super::light_table::LightTable;
use super::{BrightnessScale, DriftLaw};
use gs2e_sensor::statistics::RenewalProcess;
use gs2e_sensor::v2e::V2eModel;
use std::f64::consts::{LN_10, SQRT_2};

/// Error of the predicted events of the photoreceptor's noise in pixels that leak.
const LEAKING: f64 = 1.25;

/// Shot noise in the dark, Hz; it falls towards white as in v2e.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShotNoise {
    pub(super) dark_hz: f64,
    pub(super) leak_hz: f64,
}

impl ShotNoise {
    /// Shots per second at this luminance.
    fn at(self, luminance: f64) -> f64 {
        V2eModel::shots_at(self.dark_hz, luminance)
    }
}

/// Noise that returns, at the events of a pixel, see [`DriftLaw::receptor_lean`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NoiseLean {
    /// Its mean at the events of a steady drift, in thresholds.
    pub(crate) steady: f64,
    /// The time in which it returns, us.
    time_us: f64,
}

impl NoiseLean {
    /// The mean at an event, from that at another event `dt_us` before: the noise forgets another drift
    /// in the time in which it returns.
    pub(crate) fn after(self, before: f64, dt_us: f64) -> f64 {
        self.steady + (before - self.steady) * libm::exp(-dt_us / self.time_us)
    }
}

impl DriftLaw {
    /// Standard deviation of the voltage after `dt_us` microseconds at this luminance.
    #[must_use]
    pub fn noise(&self, luminance: f64, dt_us: f64) -> f64 {
        let [_, k2, k3, _, _, k6] = self.k;
        // The constants of the other laws may divide 0 by 0.
        if self.scale != BrightnessScale::Log {
            return 0.0;
        }
        (k3 * luminance.max(0.0).sqrt() / (luminance.max(0.0) + k2) + k6) * dt_us.sqrt()
    }

    /// The largest standard deviation of the voltage after `dt_us` microseconds over all luminances.
    #[must_use]
    pub(crate) fn most_noise(&self, dt_us: f64) -> f64 {
        // That of a Brownian motion is largest at `L = k2`.
        let brownian = self.noise(self.k[1], dt_us);
        let most = self.receptor.map_or(0.0, LightTable::most);
        libm::hypot(brownian, SQRT_2 * most)
    }

    /// Variance by the photoreceptor's noise of the difference between the voltages at two distant times. It
    /// does not grow with time.
    #[must_use]
    pub(crate) fn receptor_variance(&self, luminance: f64) -> f64 {
        self.receptor.map_or(0.0, |table| 2.0 * table.at(luminance)[0].powi(2))
    }

    /// Mean of the photoreceptor's noise at the events of a pixel whose drift has this rate, in
    /// thresholds per microsecond.
    ///
    /// Noise that helps brings the event about: its mean at the events is not 0, but leans towards the
    /// drift. Let the noise have the deviation `d` and return in a time `tau`, and let a threshold `a`
    /// be crossed at the rate `r` in a time that is short beside `tau`. Within it, the noise is a
    /// Brownian motion with the variance `s^2 = 2 d^2 / tau` per time. From one event to the next, the
    /// integral of a motion that ends at its first passage is on average `a s^2 / r^2` less than that
    /// of its first value (Ito's formula for the martingale of `v^2 / 2r - s^2 v / 2r^2`). A noise of
    /// `n` lasts longer until the next event if it falls, `a / (r - n / tau)`, which adds `a d^2 / (tau
    /// r^2)`. Over all times the mean of the noise is 0, so at the events it is `s^2 / r - d^2 / (tau
    /// r) = d^2 / (tau r)`. Slow drifts leave it below `d`.
    ///
    /// `None` without such noise at this light, and for an unknown rate.
    pub(crate) fn receptor_lean(&self, luminance: f64, rate: f64) -> Option<NoiseLean> {
        let [deviation, _, returning] = self.receptor?.at(luminance);
        if returning <= 0.0 || rate.is_nan() {
            return None;
        }
        let steady = (returning / rate.abs()).min(deviation).copysign(rate);
        Some(NoiseLean { steady, time_us: deviation * deviation / returning })
    }

    /// Events per microsecond that the photoreceptor's noise makes at a pixel of constant luminance.
    #[must_use]
    pub(crate) fn receptor_events(&self, luminance: f64) -> f64 {
        self.receptor.map_or(0.0, |table| 1e-6 * table.at(luminance)[1])
    }

    /// Events that a pixel of constant luminance makes per microsecond by its noise and leak.
    #[must_use]
    pub(crate) fn noise_events(&self, luminance: f64) -> f64 {
        let Some(shots) = self.shots else {
            let noise = self.noise(luminance, 1.0);
            let [up, down] = self.thresholds;
            let drift = self.drift(0.0, 1.0, luminance);
            let law = RenewalProcess { drift, variance: noise * noise, up, down }.rate();
            return law + self.floor_events(luminance) + self.receptor_events(luminance);
        };
        1e-6 * (shots.at(luminance) + shots.leak_hz)
    }

    /// ON and OFF events of the noise floor of a pixel per microsecond. They do not move its voltage.
    #[must_use]
    pub(crate) fn floor_rates(&self, luminance: f64) -> [f64; 2] {
        self.floor.map_or([0.0; 2], |floor| floor.at(luminance).map(|hz| 1e-6 * hz))
    }

    fn floor_events(&self, luminance: f64) -> f64 {
        self.floor_rates(luminance).iter().sum()
    }

    /// Returns true if the sensor has a noise floor.
    #[must_use]
    pub(crate) fn has_floor(&self) -> bool {
        self.floor.is_some()
    }

    /// Expected number of shots of a pixel in `dt_us` microseconds. They move its reference.
    #[must_use]
    pub fn shots(&self, luminance: f64, dt_us: f64) -> f64 {
        self.shots.map_or(0.0, |shots| 1e-6 * shots.at(luminance) * dt_us)
    }

    /// Chance that shots, or the events of a hot pixel, make the events of a pixel differ from its
    /// brightness change in `dt_us` microseconds; above 1 if there are several shots. All events of a hot
    /// pixel count as one, because they spoil one pixel. The noise floor is `DriftLaw::floor_rates`.
    #[must_use]
    pub fn disturbances(&self, luminance: f64, dt_us: f64) -> f64 {
        self.shots(luminance, dt_us) + (1e-6 * self.hot.mean_hz() * dt_us).min(self.hot.share)
    }

    /// Expected number of events of the hot pixels among `pixels` in `dt_us` microseconds, all of
    /// them ON, and its standard deviation: the number of hot pixels, their rates and their events are
    /// drawn.
    #[must_use]
    pub(crate) fn hot_events(&self, pixels: f64, dt_us: f64) -> [f64; 2] {
        if self.hot.is_absent() {
            return [0.0; 2];
        }
        let of_a_pixel = 1e-6 * self.hot.mean_hz() * dt_us;
        let (events, each) = (of_a_pixel * pixels, of_a_pixel / self.hot.share);
        // The mean square of a log-normal factor, in squares of its mean.
        let deviation = self.hot.spread * LN_10;
        let unequal = libm::exp(deviation * deviation);
        // A compound count: to the variance of the events adds that of the pixels, by their mean squares.
        [events, (events * (1.0 + each * unequal)).sqrt()]
    }

    /// An upper bound of the events of a pixel of constant luminance in `dt_us` microseconds. The
    /// renewal rate is `(mu / Th) coth(mu Th / sigma^2)`, and `coth x <= 1 + 1/x`.
    #[must_use]
    pub(crate) fn most_noise_events(&self, luminance: f64, dt_us: f64) -> f64 {
        let own = self.hot.mean_hz() * 1e-6 * dt_us;
        if self.shots.is_some() {
            return self.noise_events(luminance) * dt_us + own;
        }
        // The lower threshold is reached more often, so it bounds the events of both.
        let threshold = self.least_threshold();
        let noise = self.noise(luminance, dt_us) / threshold;
        let own = own + (self.floor_events(luminance) + LEAKING * self.receptor_events(luminance)) * dt_us;
        self.drift(0.0, dt_us, luminance * dt_us).abs() / threshold + noise * noise + own
    }
}

#[cfg(test)]
mod tests {
    use crate::drift::DriftLaw;
    use crate::planted::SplitMixDraws;
    use gs2e_sensor::SensorChoice;
    use gs2e_sensor::noise::{PhotoreceptorNoise, ReceptorPoint};
    use gs2e_sensor::voltmeter::VoltmeterModel;

    /// The mean at the events of pixels that are simulated in short steps.
    #[test]
    fn noise_leans_towards_a_steady_drift() {
        let (deviation, time_us, rate, step_us) = (0.3, 2000.0, 1e-3, 2.0);
        let cutoff_hz = 1e6 / (std::f64::consts::TAU * time_us);
        let points = vec![ReceptorPoint { lux: 1.0, deviation, cutoff_hz }];
        let noise = PhotoreceptorNoise { spread: 0.0, points };
        let plain = VoltmeterModel::new([1.0, 20.0, 0.0, 0.0, 0.0, 0.0]);
        let sensor = VoltmeterModel { photoreceptor_noise: noise, ..plain.clone() };
        let law = |sensor: VoltmeterModel| DriftLaw::for_sensor(&SensorChoice::Voltmeter(sensor));
        let lean = law(sensor).receptor_lean(100.0, rate).unwrap();
        let kept = libm::exp(-step_us / time_us);
        let added = deviation * f64::sqrt(1.0 - kept * kept);
        let mut draws = SplitMixDraws(2);
        let (mut sum, mut events) = (0.0, 0.0);
        for _ in 0..600 {
            let (mut noise, mut reference) = (deviation * draws.normal(), -draws.share());
            for i in 0..12_000 {
                noise = kept * noise + added * draws.normal();
                if f64::from(i) * step_us * rate + noise - reference >= 1.0 {
                    reference += 1.0;
                    // The first events know how the pixel began.
                    if i > 2000 {
                        (sum, events) = (sum + noise, events + 1.0);
                    }
                }
            }
        }
        // The noise has 600 * 10 independent values, and more.
        let (found, within) = (sum / events, 4.0 * deviation / f64::sqrt(6000.0));
        println!("{found} of {events} events, {lean:?} expected");
        assert!((found - lean.steady).abs() < within && within < 0.4 * lean.steady, "{found}");
        assert!(
            (lean.after(0.2, time_us) - lean.steady - (0.2 - lean.steady) / std::f64::consts::E).abs() < 1e-9
        );
        assert_eq!(law(plain).receptor_lean(100.0, rate), None);
    }
}
