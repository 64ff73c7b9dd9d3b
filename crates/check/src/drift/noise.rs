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

    fn receptor_events(&self, luminance: f64) -> f64 {
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
