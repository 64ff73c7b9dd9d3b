//! Events against frames: the event counts of pixels must match the change between frames. This is
//! the core pass. A gate.
//!
//! For the span from the first frame to each anchor and for every pixel, `dv` is the drift by the
//! sensor's law, and `s = A N_on - B N_off`. The statements are:
//!
//! - `gain`: `c = <s, dv> / <s, s>` over the pixels with `|dv|` above a threshold, both directions
//!   together and each by itself. The limit is `1 +- (0.1 + allowance)`. It finds flipped polarity,
//!   a wrong logarithm, and lost halves.
//! - `threshold-on`, `threshold-off`: the voltage at which events happen, see [`fit::EventEdge`].
//!   The limit is 7 % from the stated threshold.
//! - `residual`: the share of the pixels of `gain` with a possible residual, at least 0.997. It
//!   finds lost resets, dropped chunks, and offsets.
//! - `sign`: the share of pixels with `|dv|` above two thresholds whose `s` has the sign of `dv`,
//!   at least 0.995. It finds wrong polarity.
//!
//! The definitions follow from two properties of residuals, which are not noise. First, spans start
//! at the first frame, where the residual is 0. Between two later instants it may change by
//! `A + B`, and 3 to 5 % of the pixels of a sound stream lie beyond 1.5. Second, `c` does not
//! estimate the threshold: in a scene that only grows brighter, all residuals have one sign, and
//! sound streams give 1.1 to 1.7. Its limits are therefore widened by the possible effect of
//! residuals, `fit::SlopeSums::allowance`. The threshold is read from the edge of the residuals,
//! which is sharp to 2 %.
//!
//! A residual is possible if `|dv - s| <= max(A, B)`, plus 2 %, six standard deviations of the
//! noise and two of the leak. If voltages do not start at 0, the bound is `A + B`, and there is no
//! edge.
//!
//! If thresholds differ between pixels, their mean and spread are known. The bound of a residual
//! grows by three standard deviations of the thresholds of the pixel's events, and the share of
//! `residual` may be lower by the pixels beyond. `s` in `gain` has the thresholds at which its mean
//! is `dv`, and `<s, s>` is less what the spread adds to it. The edge is as wide as the spread, so
//! its place is compared with the place that the stated law gives it for the same drifts. All limits
//! grow by four standard deviations of their scatter.
//!
//! The events of a noise floor do not depend on the frames. Their numbers are expected at the light
//! of each pixel. In `gain`, they are subtracted like the spread. The shares of `residual` and `sign`
//! may be lower by the pixels that the floor is expected to spoil, and five standard deviations of
//! their number. For `sign`, these are the pixels that have more contrary noise events than the rest
//! of their drift makes up for.
//!
//! Frames of 8 bits add the largest error of their rounding to the bound of each pixel. A pixel for
//! which this is more than half of a threshold is left out, as is one with a channel at full scale,
//! where the picture is clipped. Shots of noise move the reference of a pixel. The shares may be
//! lower by twice the expected number of such events per pixel. If noise spoils more than a fifth of
//! the pixels, the statements are not made.

pub mod fit;

use super::drift::DriftLaw;
use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{StreamTally, TrajectorySubject, ValidationPass, Verdict, limits};
use fit::{AnchorFit, EventEdge, SlopeSums, SpoiltPixels};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest relative difference between the measured and the stated threshold. Default:
    /// `THRESHOLD`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f64>,
    /// Largest difference of the gain from 1, in addition to what residuals can do. Default:
    /// `GAIN`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Smallest share of pixels whose residual is possible. Default: `RESIDUAL`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub residual: Option<f64>,
    /// Smallest share of pixels whose events and frames agree in sign. Default: `SIGN`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub sign: Option<f64>,
}

const THRESHOLD: f64 = 0.07;
const GAIN: f64 = 0.1;
const RESIDUAL: f64 = 0.997;
const SIGN: f64 = 0.995;

/// Largest number of disturbing events per pixel.
const MAX_DISTURBED: f64 = 0.2;

/// Minimum number of pixels for a statement.
const MIN_PIXELS: u64 = 100;
/// Minimum of [`fit::EventEdge::reachable`]. Below it, an edge shows the scene and not the sensor.
const MIN_REACHABLE: f64 = 0.98;
/// For unequal pixels: smallest change of the edge for a change of the thresholds.
const MIN_ANSWER: f64 = 0.7;

/// The pass.
pub(crate) struct EventFrame;

impl ValidationPass for EventFrame {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let (tally, law) = subject.compared_at_once()?;
        let pass = EventFramePass { subject, tally, law };
        if let Some(because) = law.loose {
            return Ok(vec![("", Err(because.into())), ("sign", pass.sign())]);
        }
        let all = |fit: &AnchorFit| fit.slopes[0] + fit.slopes[1];
        Ok(vec![
            ("gain", pass.gain(all)),
            ("gain-on", pass.gain(|fit| fit.slopes[0])),
            ("gain-off", pass.gain(|fit| fit.slopes[1])),
            ("threshold-on", pass.threshold(0)),
            ("threshold-off", pass.threshold(1)),
            ("residual", pass.residual()),
            ("sign", pass.sign()),
        ])
    }
}

/// A number of pixels among others.
#[derive(Debug, Clone, Copy)]
struct PixelShare {
    count: u64,
    of: u64,
    /// All pixels that are compared.
    compared: u64,
    /// Number of the others that noise may keep out.
    spoilt: SpoiltPixels,
}

impl PixelShare {
    fn measured(&self) -> f64 {
        self.count as f64 / self.of as f64
    }
}

struct EventFramePass<'a> {
    subject: &'a TrajectorySubject<'a>,
    tally: &'a StreamTally,
    law: DriftLaw,
}

impl EventFramePass<'_> {
    fn limits(&self) -> Limits {
        self.subject.limits.event_frame.unwrap_or_default()
    }

    fn gain(&self, of: impl Fn(&AnchorFit) -> SlopeSums) -> JudgementResult {
        let most = self.law.most_residual();
        let tolerance = self.limits().gain.unwrap_or(GAIN);
        // Instants differ in what residuals allow, so they are compared by the excess.
        let excess = |s: &SlopeSums| (s.factor() - 1.0).abs() - s.allowance(most);
        self.require_calm()?;
        self.require_equal()?;
        let slopes =
            self.tally.compared.fits.iter().map(of).filter(|s| s.pixels >= MIN_PIXELS && s.squares > 0.0);
        let slope = slopes.max_by(|a, b| excess(a).total_cmp(&excess(b))).ok_or_else(too_few)?;
        let factor = slope.factor();
        let width = tolerance + slope.allowance(most);
        // The gain has a limit on each side of 1. The finding states the one on its own side.
        let limit = if factor < 1.0 { 1.0 - width } else { 1.0 + width };
        let verdict = LimitSide::gate(width).at_most((factor - 1.0).abs());
        let because = format!(
            "at {} pixels, the brightness change of the frames is {factor:.3} times that of the events; 1 +- {width:.3} is allowed",
            slope.pixels
        );
        Ok(self.judgement(verdict, factor, limit, because))
    }

    /// The largest threshold over the instants. A lower one may only mean that no pixel was about
    /// to fire, but no pixel can show a threshold that is too large.
    fn threshold(&self, side: usize) -> JudgementResult {
        if !self.law.from_zero {
            return Err("the threshold cannot be measured, because pixel voltages do not start at 0".into());
        }
        self.require_equal()?;
        let stated = self.law.thresholds[side];
        let tolerance = self.limits().threshold.unwrap_or(THRESHOLD);
        let edges = self.tally.compared.fits.iter().filter_map(|fit| fit.edges[side]);
        let least = if self.law.spread > 0.0 { MIN_ANSWER } else { MIN_REACHABLE };
        let usable = edges.filter(|edge| edge.reachable >= least);
        let EventEdge { pixels, measured, within: [low, high], .. } = usable
            .max_by(|a, b| a.measured.total_cmp(&b.measured))
            .ok_or("too few pixels with a well-known brightness change were close to firing")?;
        let [least, most] = [low * (1.0 - tolerance), high * (1.0 + tolerance)];
        let (verdict, limit) = if measured < 1.0 {
            (LimitSide::gate(least).at_least(measured), least)
        } else {
            (LimitSide::gate(most).at_most(measured), most)
        };
        let what = if self.law.spread > 0.0 { "mean threshold" } else { "threshold" };
        let because = format!(
            "the events of {pixels} pixels imply a {what} of {:.3}; the recipe states {}",
            measured * stated,
            // Four digits: the OFF threshold of a preset may have no short form.
            (1e4 * stated).round() / 1e4
        );
        Ok(self.judgement(verdict, measured * stated, limit * stated, because))
    }

    fn residual(&self) -> JudgementResult {
        let shares = self.tally.compared.fits.iter().map(|fit| PixelShare {
            count: fit.possible,
            of: fit.slopes[0].pixels + fit.slopes[1].pixels,
            compared: fit.compared,
            spoilt: fit.maybe_impossible,
        });
        let limits = (self.limits().residual, RESIDUAL);
        self.share(limits, shares, "have events that match it to within the thresholds")
    }

    fn sign(&self) -> JudgementResult {
        let shares = self.tally.compared.fits.iter().map(|fit| PixelShare {
            count: fit.doubled[1],
            of: fit.doubled[0],
            compared: fit.compared,
            spoilt: fit.turned_by_floor,
        });
        self.share((self.limits().sign, SIGN), shares, "have events of the same sign")
    }

    /// The share that is lowest against its limit, of all instants with enough pixels and little
    /// noise. `limit` is the recipe's, and the default.
    fn share(
        &self,
        limit: (Option<f64>, f64),
        shares: impl Iterator<Item = PixelShare>,
        what: &str,
    ) -> JudgementResult {
        self.require_calm()?;
        let (asked, default) = limit;
        let least = |share: &PixelShare| {
            let noise = 2.0 * self.disturbed() + share.spoilt.most(share.of);
            asked.unwrap_or_else(|| default - noise - self.beyond_tolerance(share))
        };
        let mut enough: Vec<PixelShare> = shares.filter(|share| share.of >= MIN_PIXELS).collect();
        if enough.is_empty() {
            return Err(too_few());
        }
        enough.retain(|share| self.beyond_tolerance(share) <= MAX_DISTURBED);
        if enough.is_empty() {
            return Err("too few pixels changed by more than their threshold at once, for frames that the recipe's tolerance chose".into());
        }
        let clear = enough.into_iter().filter(|share| share.spoilt.share(share.of) <= MAX_DISTURBED);
        let worst = clear
            .min_by(|a, b| (a.measured() - least(a)).total_cmp(&(b.measured() - least(b))))
            .ok_or("the noise floor spoils more than a fifth of the pixels with a brightness change")?;
        let (measured, limit) = (worst.measured(), least(&worst));
        let mut because = format!("{} of {} pixels with a brightness change {what}", worst.count, worst.of);
        let spoilt = worst.spoilt.share(worst.of);
        if spoilt > 0.0 {
            let cause = match (self.law.has_floor(), self.law.spread > 0.0) {
                (true, false) => "the noise floor",
                (true, true) => "the noise floor and unequal thresholds",
                (false, _) => "unequal thresholds",
            };
            because += &format!("; {cause} may spoil {:.2} %", 100.0 * spoilt);
        }
        Ok(self.judgement(LimitSide::gate(limit).at_least(measured), measured, limit, because))
    }

    /// Share of the pixels whose frames may miss what the sensor saw by more than is added for a tolerance:
    /// five times its root mean square, hence at most a 25th of all pixels by Chebyshev's inequality. Any of
    /// them may be among those that changed.
    fn beyond_tolerance(&self, share: &PixelShare) -> f64 {
        if self.subject.is_release && self.subject.tolerance.is_some() {
            share.compared as f64 / (25.0 * share.of as f64)
        } else {
            0.0
        }
    }

    /// Number of events per pixel that move its reference although its brightness does not change.
    fn disturbed(&self) -> f64 {
        self.tally.compared.fits.iter().map(|fit| fit.disturbed).fold(0.0, f64::max)
    }

    fn require_calm(&self) -> Result<(), String> {
        let disturbed = self.disturbed();
        if disturbed > MAX_DISTURBED {
            return Err(format!(
                "the sensor's noise makes {disturbed:.2} events per pixel, and each moves the reference of its pixel"
            ));
        }
        Ok(())
    }

    fn require_equal(&self) -> Result<(), String> {
        let spread = self.law.spread / self.law.least_threshold();
        if spread > fit::MAX_SPREAD {
            return Err(format!(
                "the thresholds of the pixels differ by {:.0} %, too much for a mean",
                100.0 * spread
            ));
        }
        Ok(())
    }

    fn judgement(&self, verdict: Verdict, measured: f64, limit: f64, mut because: String) -> Judgement {
        if self.tally.compared.left_out() > 0.0 {
            let share = 100.0 * self.tally.compared.left_out();
            let hot = if self.tally.hot_left_out { "hot, or " } else { "" };
            because += &format!("; {share:.1} % of the pixels are {hot}too dark or clipped in 8-bit frames");
        }
        Judgement::new(verdict, measured, limit, "1", because)
    }
}

fn too_few() -> String {
    format!("fewer than {MIN_PIXELS} pixels changed by more than their threshold")
}

#[cfg(test)]
mod tests;
