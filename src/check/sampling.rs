//! Movement between rendered frames (numerics.md section 9, pass 14; pipeline.md section 2.7). Warning; a gate where
//! the recipe sets the limit.
//!
//! Events between two frames come from a brightness that is interpolated between them, which is true to the scene
//! while the picture moves by at most about a pixel. The paper's own setting moves tens; that is why it only warns.

use super::subject::{Bound, Judged};
use super::{Check, Finding, Subject, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest 95 % quantile of the optical flow, px per frame.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

/// Default limit, px per frame.
const MOST: f64 = 1.0;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct Sampling;

const NAME: &str = "sampling";

impl Check for Sampling {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_trajectory(&self, subject: &Subject<'_>) -> Vec<Finding> {
        let Some(flow) = subject.flow else {
            return vec![subject.not_run(NAME, "", "no pixel has a depth, so there is no optical flow")];
        };
        let limit = Bound::of(subject.limits.sampling.and_then(|l| l.max), Bound::warning(MOST));
        let measured = f64::from(flow.p95);
        let because = format!(
            "95 % of pixels move by at most {measured:.2} px between frames (half by {:.2}, the fastest by {:.2})",
            flow.median, flow.max
        );
        let judged = Judged {
            verdict: limit.at_most(measured),
            measured: Some(measured),
            limit: Some(limit.value),
            unit: "px/frame",
            because,
        };
        vec![subject.finding(NAME, "", judged)]
    }
}
