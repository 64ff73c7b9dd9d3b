//! Stage `checks`: hands what was made of a trajectory to the validation passes.

use super::{Context, Stage, StageError, Target};
use crate::artifact::{EventStream, Motion, Verdicts, write_json};
use crate::check::{Finding, Limits};
use serde::Serialize;

/// Name of the stage.
pub const NAME: &str = "checks";

/// Parameters: the recipe's limits and waivers.
#[derive(Debug, Serialize)]
pub struct Checking {
    /// Limits and waivers.
    pub limits: Limits,
}

impl Stage for Checking {
    const NAME: &'static str = NAME;
    const REVISION: u32 = 1;
    type Inputs = (Target<Motion>, Option<Target<EventStream>>);
    type Output = Verdicts;

    fn run(
        &self,
        (_motion, _events): (Motion, Option<EventStream>),
        cx: &mut Context<'_>,
    ) -> Result<(), StageError> {
        let findings: Vec<Finding> = Vec::new();
        let out = cx.out.join("checks.json");
        write_json(&out, &findings).map_err(StageError::io(&out))
    }
}
