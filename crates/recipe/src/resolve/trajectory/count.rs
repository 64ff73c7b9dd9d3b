//! Number of poses of a path.

use super::PathContext;
use crate::field::{Field, NumberLiteral};
use crate::problem::FieldProblem;
use crate::resolve::Resolver;
use crate::resolve::number::{RealRange, WholeRange};
use crate::text::TextSpan;
use gs2e_num::units::{Hertz, Ratio};
use gs2e_trajectory::MAX_POSES;
use gs2e_trajectory::travel::PoseCount;

/// Fields of a path that define the number of its poses and their spacing.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseSpread<'f> {
    /// `None` if the path has no views to multiply.
    pub(super) factor: Option<&'f Field<NumberLiteral>>,
    pub(super) frames: &'f Field<u64>,
    pub(super) duration: &'f Field<NumberLiteral>,
    /// `None` if the path has no chords to take literally.
    pub(super) literal: Option<&'f Field<bool>>,
}

impl Resolver<'_> {
    /// Resolves the number of poses and the flag of literal chords.
    pub(super) fn spread(
        &self,
        raw: PoseSpread<'_>,
        default: PoseCount,
        place: TextSpan,
        context: PathContext<'_>,
    ) -> (Option<PoseCount>, Option<bool>) {
        let count = if context.flows {
            self.flow_count(raw)
        } else {
            self.count(raw, default, place, context.setting.rate)
        };
        (count, self.literal(raw, context))
    }

    /// Refuses any number of poses, because a flow determines it.
    fn flow_count(&self, raw: PoseSpread<'_>) -> Option<PoseCount> {
        let factor = raw.factor.and_then(given_place);
        let given = [factor, given_place(raw.frames), given_place(raw.duration)];
        // Each key is reported, not only the first.
        for place in given.iter().flatten().flatten() {
            let problem = FieldProblem::of_key("cannot be combined with a speed in px/s");
            self.report(
                problem.help("remove it: such a speed determines the duration of the path").at(*place),
            );
        }
        given.iter().all(Option::is_none).then_some(PoseCount::Flow)
    }

    fn count(
        &self,
        raw: PoseSpread<'_>,
        default: PoseCount,
        place: TextSpan,
        rate: Option<Hertz>,
    ) -> Option<PoseCount> {
        let factor = raw.factor.filter(|factor| !factor.is_absent());
        let (frames, duration) = (!raw.frames.is_absent(), !raw.duration.is_absent());
        if [factor.is_some(), frames, duration].iter().filter(|given| **given).count() > 1 {
            let keys =
                if raw.factor.is_some() { "factor, frames and duration" } else { "frames and duration" };
            let problem = FieldProblem::of_field(format!("has more than one of {keys}"));
            return self.refuse(problem.help("give one of them: it sets the number of poses").at(place));
        }
        if frames {
            return self.whole(raw.frames, 1, WholeRange::new(1, MAX_POSES)).map(PoseCount::Frames);
        }
        if duration {
            return self.duration(raw.duration, rate);
        }
        match factor {
            Some(factor) => self.ratio(factor, 1, RealRange::above(0.0, 1e6)).map(PoseCount::Factor),
            None => Some(default),
        }
    }

    fn duration(&self, field: &Field<NumberLiteral>, rate: Option<Hertz>) -> Option<PoseCount> {
        const DAY: f64 = 86_400.0;
        let seconds: Ratio = self.ratio(&in_seconds(field), 1, RealRange::above(0.0, DAY))?;
        let rate = rate?.to_f64();
        let frames = 1.0 + (seconds.to_f64() * rate).ceil();
        if frames > MAX_POSES as f64 {
            let problem =
                FieldProblem::of_field(format!("makes {frames} frames, wanted at most {MAX_POSES}"));
            return self
                .refuse(problem.help(format!("the rate is {rate} frames per second")).at(field.place()?));
        }
        Some(PoseCount::Duration(seconds))
    }

    fn literal(&self, raw: PoseSpread<'_>, context: PathContext<'_>) -> Option<bool> {
        let Some(field) = raw.literal else { return Some(false) };
        let literal = field.or(false)?;
        if literal && context.flows {
            let problem = FieldProblem::of_key(
                "cannot be combined with a speed in px/s, which is not a share of chords",
            );
            return self.refuse(problem.help("remove it").at(field.place()?));
        }
        Some(literal)
    }
}

/// Returns a time without its unit: `2 s` is `2`, and a time in milliseconds is a fraction of seconds.
fn in_seconds(field: &Field<NumberLiteral>) -> Field<NumberLiteral> {
    let plain = |NumberLiteral(text): &NumberLiteral| {
        let text = text.trim();
        match (text.strip_suffix("ms"), text.strip_suffix('s')) {
            (Some(number), _) => number.trim().parse().map(|ms: u64| format!("{ms}/1000")).ok(),
            (_, Some(number)) => Some(number.trim_end().to_owned()),
            _ => None,
        }
    };
    match field {
        Field::Given(literal, place) => {
            Field::Given(plain(literal).map_or_else(|| literal.clone(), NumberLiteral), *place)
        }
        other => other.clone(),
    }
}

/// Returns the place of a field; the outer `None` means absent, the inner one faulty.
fn given_place<T>(field: &Field<T>) -> Option<Option<TextSpan>> {
    (!field.is_absent()).then(|| field.place())
}
