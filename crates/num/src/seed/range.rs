//! Laws of numbers that are drawn from a range: uniform, log-uniform and truncated normal.
//!
//! A number is the quantile of one uniform draw, so a stream of one draw gives one number, and the
//! map is monotonic.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::seed::Seed;
//! use gs2e_num::seed::range::RangeLaw;
//!
//! let uniform = RangeLaw::Uniform { low: 2.0, high: 6.0 };
//! uniform.validate()?;
//! assert_eq!(uniform.quantile(0.25), 3.0);
//! // Half of the draws of a log-uniform law are below the geometric mean.
//! let wide = RangeLaw::LogUniform { low: 1.0, high: 100.0 };
//! assert!((wide.quantile(0.5) - 10.0).abs() < 1e-12);
//! assert!((1.0..=100.0).contains(&wide.draw(Seed(5))));
//! assert!(RangeLaw::LogUniform { low: 0.0, high: 1.0 }.validate().is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::normal::normal_quantile;
use super::{DrawSpace, Seed, SeedCell};

/// The law of a drawn number. All numbers are finite, and the upper end is above the lower one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RangeLaw {
    /// Each value of the range is equally likely.
    Uniform {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// The logarithm is uniform.
    LogUniform {
        /// Lower end, above 0.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// A normal law, conditioned on a range.
    Normal {
        /// Mean before truncation.
        mean: f64,
        /// Standard deviation before truncation, above 0.
        deviation: f64,
        /// Lower end of the range.
        low: f64,
        /// Upper end of the range.
        high: f64,
    },
}

/// Smallest probability of the range under a normal law. Below it, the range is a far tail, and
/// the quantiles lose their digits.
const LEAST_SHARE: f64 = 1e-6;

impl RangeLaw {
    /// Lower and upper end of the values.
    #[must_use]
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::Uniform { low, high } | Self::LogUniform { low, high } | Self::Normal { low, high, .. } => {
                [low, high]
            }
        }
    }

    /// Returns the fault of the parameters, as the end of a sentence about the law.
    ///
    /// # Errors
    /// The range is empty or inverted, a logarithm does not exist, or the law hardly reaches its
    /// range.
    pub fn validate(self) -> Result<(), String> {
        let [low, high] = self.ends();
        if low >= high {
            return Err(format!("has the range {low} to {high}, wanted the lower end first"));
        }
        match self {
            Self::LogUniform { low, .. } if low <= 0.0 => {
                Err(format!("is log_uniform from {low}, wanted a lower end above 0"))
            }
            Self::Normal { deviation, .. } if deviation <= 0.0 => {
                Err(format!("has the standard deviation {deviation}, wanted a number above 0"))
            }
            Self::Normal { mean, deviation, low, high } => {
                let [below, inside] = shares(mean, deviation, [low, high]);
                // The comparison is false for NaN, which an overflow can give.
                if inside >= LEAST_SHARE && below.is_finite() {
                    return Ok(());
                }
                Err(format!(
                    "is normal with mean {mean} and standard deviation {deviation}, which lies within {low} to \
                     {high} with a probability below {LEAST_SHARE}"
                ))
            }
            _ => Ok(()),
        }
    }

    /// The value below which a draw lies with probability `p`, from 0 to 1.
    #[must_use]
    pub fn quantile(self, p: f64) -> f64 {
        let [low, high] = self.ends();
        let value = match self {
            Self::Uniform { .. } => low + p * (high - low),
            Self::LogUniform { .. } => {
                let [from, to] = [libm::log(low), libm::log(high)];
                libm::exp(from + p * (to - from))
            }
            // The tail nearer to the range keeps its digits; the other one is close to 1.
            Self::Normal { mean, deviation, .. } if low > mean => {
                let [above, inside] = shares(-mean, deviation, [-high, -low]);
                mean - deviation * normal_quantile(above + (1.0 - p) * inside)
            }
            Self::Normal { mean, deviation, .. } => {
                let [below, inside] = shares(mean, deviation, [low, high]);
                mean + deviation * normal_quantile(below + p * inside)
            }
        };
        // Rounding may pass an end by an ulp.
        value.clamp(low, high)
    }

    /// The draw of a stream.
    #[must_use]
    pub fn draw(self, stream: Seed) -> f64 {
        let cell = SeedCell { x: 0, y: 0, level: 0, index: 0 };
        self.quantile(stream.draws(cell, DrawSpace::Choice).uniform())
    }
}

/// Probabilities of a normal law below a range and inside it.
fn shares(mean: f64, deviation: f64, range: [f64; 2]) -> [f64; 2] {
    let [below, up_to] =
        // `erfc` and not `1 + erf`, which would cancel for a range far below the mean.
        range.map(|end| 0.5 * libm::erfc((mean - end) / (deviation * std::f64::consts::SQRT_2)));
    [below, up_to - below]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::ks;

    const LAWS: [RangeLaw; 5] = [
        RangeLaw::Uniform { low: -2.0, high: 5.0 },
        RangeLaw::LogUniform { low: 0.5, high: 40.0 },
        RangeLaw::Normal { mean: 0.2, deviation: 0.03, low: 0.1, high: 0.3 },
        // Cut at one side, and a tail from two to five standard deviations.
        RangeLaw::Normal { mean: 1.0, deviation: 2.0, low: 0.0, high: 9.0 },
        RangeLaw::Normal { mean: 1.0, deviation: 0.5, low: 2.0, high: 3.5 },
    ];

    /// Distribution function, by a midpoint sum of the density over the range. 20,000 cells of a
    /// smooth density leave an error far below that of 10,000 draws.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to the cells")]
    fn distribution(law: RangeLaw) -> impl Fn(f64) -> f64 {
        const CELLS: usize = 20_000;
        let density = move |x: f64| match law {
            RangeLaw::Uniform { .. } => 1.0,
            RangeLaw::LogUniform { .. } => 1.0 / x,
            RangeLaw::Normal { mean, deviation, .. } => (-0.5 * ((x - mean) / deviation).powi(2)).exp(),
        };
        let [low, high] = law.ends();
        let width = (high - low) / CELLS as f64;
        let mut sums = vec![0.0];
        for i in 0..CELLS {
            sums.push(sums[i] + density(low + (i as f64 + 0.5) * width));
        }
        move |x| {
            let at = ((x - low) / width).clamp(0.0, CELLS as f64);
            let cell = (at.floor() as usize).min(CELLS - 1);
            (sums[cell] + (at - cell as f64) * (sums[cell + 1] - sums[cell])) / sums[CELLS]
        }
    }

    /// 10,000 trajectories of one recipe. The critical value 2.40 is that of alpha 1e-5, so 5e-5
    /// for the five laws together.
    #[test]
    fn draws_have_their_laws() {
        for law in LAWS {
            let stream = |i: u32| Seed::for_parameter(7, "scene", &format!("t{i}"), "", "v2e.cutoff");
            let draws: Vec<f64> = (0..10_000).map(|i| law.draw(stream(i))).collect();
            let [low, high] = law.ends();
            assert!(draws.iter().all(|x| (low..=high).contains(x)), "{law:?}");
            let found = ks::scaled_distance(draws.clone(), distribution(law));
            let spoilt = ks::scaled_distance(
                draws.iter().map(|x| x + 0.05 * (high - low)).collect(),
                distribution(law),
            );
            println!("{law:?}: KS {found:.3}, shifted by a twentieth of the range {spoilt:.1} (limit 2.40)");
            assert!(found < 2.40 && spoilt > 2.40, "{law:?}: {found} {spoilt}");
        }
    }

    #[test]
    fn streams_of_names_are_independent() {
        let draw = |trajectory: &str, sensor: &str, path: &str| {
            LAWS[0].draw(Seed::for_parameter(7, "scene", trajectory, sensor, path)).to_bits()
        };
        let all = [
            draw("a", "", "v2e.cutoff"),
            draw("b", "", "v2e.cutoff"),
            draw("a", "s", "v2e.cutoff"),
            draw("a", "", "v2e.shot"),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a != b), "{i}");
        }
    }

    #[test]
    fn faulty_laws_are_refused() {
        let t = |law: RangeLaw, wanted: &str| {
            let message = law.validate().unwrap_err();
            assert!(message.contains(wanted), "{message}");
        };
        t(RangeLaw::Uniform { low: 2.0, high: 1.0 }, "range 2 to 1");
        t(RangeLaw::Uniform { low: 2.0, high: 2.0 }, "range 2 to 2");
        t(RangeLaw::LogUniform { low: 0.0, high: 1.0 }, "above 0");
        let normal = |deviation, low, high| RangeLaw::Normal { mean: 0.0, deviation, low, high };
        t(normal(0.0, 1.0, 2.0), "standard deviation 0");
        t(normal(-1.0, 1.0, 2.0), "standard deviation -1");
        t(normal(1.0, 20.0, 30.0), "probability below");
        assert_eq!(LAWS.map(RangeLaw::validate), [const { Ok(()) }; 5]);
    }
}
