//! Choice of frame times: at a rate, or for an error.

use super::Resolver;
use super::number::RealRange;
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::rig::RigCamera;
use crate::schema;
use gs2e_num::units::Hertz;
use gs2e_sampling::{ErrorTolerance, PilotMethod};
use gs2e_sensor::SensorSet;
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::{MAX_RATE_HZ, MIN_RATE_HZ};

/// Accepted errors, in thresholds. Beyond one threshold, whole events appear and vanish.
const TOLERANCE: RealRange = RealRange::above(0.0, 1.0);

impl Resolver<'_> {
    pub(super) fn rate(&self, field: &Field<schema::SamplingSection>) -> Option<Hertz> {
        let range = RealRange::new(MIN_RATE_HZ, MAX_RATE_HZ);
        self.ratio(&field.or_default()?.rate, 2400, range).map(Hertz)
    }

    /// Resolves the summation of speed laws: the paper's sum, or the integral. The integral defines
    /// speeds between the poses too, and a tolerance needs it.
    pub(super) fn summation(&self, field: &Field<schema::SamplingSection>) -> Option<SummationRule> {
        let raw = field.or_default()?;
        match (raw.law.given(), raw.tolerance.is_absent()) {
            (Some((SummationRule::Sum, at)), false) => {
                let found = "is sum, which defines no speed between the poses, where tolerance puts frames";
                self.refuse(FieldProblem::of_field(found).help("write law: integral, or leave it out").at(at))
            }
            (Some((SummationRule::Integral, _)), _) | (None, false) => Some(SummationRule::Integral),
            (Some((SummationRule::Sum, _)), true) => Some(SummationRule::Sum),
            (None, true) => raw.law.is_absent().then_some(SummationRule::Sum),
        }
    }

    /// Resolves the interpolation between frames; `linear` by default. A tolerance chooses its own
    /// if the recipe has none.
    pub(super) fn between(&self, field: &Field<schema::SamplingSection>) -> Option<BetweenFrames> {
        field.or_default()?.between.or(BetweenFrames::Linear)
    }

    /// Resolves the error for which frames are chosen, if the recipe has one. It is defined for the
    /// law `exact` only.
    pub(super) fn tolerance(
        &self,
        field: &Field<schema::SamplingSection>,
        sensors: Option<&SensorSet>,
    ) -> Option<Option<ErrorTolerance>> {
        let raw = field.or_default()?;
        let Some((_, place)) = raw.tolerance.given() else {
            return raw.tolerance.is_absent().then_some(None);
        };
        let rms = self.real(&raw.tolerance, 0.0, TOLERANCE)?;
        if sensors?.iter().any(|(_, sensor)| !sensor.as_model().takes_tolerance()) {
            return self.refuse(intolerant(&raw).at(place));
        }
        // Without the key, the pilot chooses the interpolation.
        let between = if raw.between.is_absent() { None } else { Some(self.between(field)?) };
        Some(Some(ErrorTolerance { rms, between, pilot: PilotMethod::default() }))
    }

    /// Refuses a tolerance for own sensors of cameras for which it is not defined.
    pub(super) fn refuse_intolerant(&self, field: &Field<schema::SamplingSection>, rig: &[RigCamera]) {
        let Some((raw, _)) = field.given() else { return };
        let Some(place) = raw.tolerance.place() else { return };
        let mut own = rig.iter().flat_map(|camera| &camera.sensors).flat_map(SensorSet::iter);
        if own.any(|(_, sensor)| !sensor.as_model().takes_tolerance()) {
            self.report(intolerant(raw).at(place));
        }
    }
}

fn intolerant(raw: &schema::SamplingSection) -> FieldProblem {
    let help = match raw.rate.is_absent() {
        true => "write sampling: { rate: 2400 } instead: frames per second, at most 1 px of motion apart",
        false => {
            "remove it: the frames are then at sampling.rate, frames per second, at most 1 px of motion apart"
        }
    };
    FieldProblem::of_key("applies only to the sensor voltmeter with the law exact").help(help)
}
