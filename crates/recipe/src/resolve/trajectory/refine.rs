//! The captured path, and the parts that it shares with other paths: the metric and the curve.

use super::PathContext;
use super::count::PoseSpread;
use crate::field::{Field, NumberLiteral};
use crate::problem::{FieldProblem, bare_text};
use crate::resolve::Resolver;
use crate::resolve::number::{RealRange, WholeRange};
use crate::schema;
use crate::text::TextSpan;
use gs2e_trajectory::curve::CurveKind;
use gs2e_trajectory::refine::{RefinePath, TranslationScale};

/// Range of the degree of a Bezier curve. At higher degrees, the control points say little about
/// the course.
const DEGREE: WholeRange = WholeRange::new(1, 20);

impl Resolver<'_> {
    pub(super) fn refine(
        &self,
        field: &Field<schema::RefineSection>,
        within: TextSpan,
        context: PathContext<'_>,
    ) -> Option<RefinePath> {
        if !context.setting.has_views() {
            let instead = "write orbit or keyframes, whose poses come from the recipe";
            let problem = match field.place() {
                Some(place) => {
                    FieldProblem::of_key("needs a capture, but the source is none").help(instead).at(place)
                }
                None => FieldProblem::missing_field("orbit").help(instead).at(within),
            };
            return self.refuse(problem);
        }
        let help = "write refine: {} for the path of the paper: the captured path, smoothed and densified";
        let (raw, place) = self.required(field, "refine", within, help)?;
        let default = RefinePath::default();
        let schema::RefineSection { factor, frames, duration, literal, .. } = raw;
        let spread = PoseSpread { factor: Some(factor), frames, duration, literal: Some(literal) };
        let (count, literal) = self.spread(spread, default.count, place, context);
        resolved!(RefinePath {
            window: self.small(&raw.window, default.window, WholeRange::new(0, 1000)),
            count,
            order: raw.order.or(default.order),
            rotation: raw.rotation.or(default.rotation),
            ends: raw.ends.or(default.ends),
            scale: self.scale(&raw.metric),
            gaps: raw.gaps.or(default.gaps),
            curve: self.curve(&raw.curve),
            literal,
        })
    }

    pub(super) fn scale(&self, field: &Field<schema::MetricSection>) -> Option<TranslationScale> {
        let field = field.or_default()?.scale;
        let Some((NumberLiteral(text), place)) = field.given() else {
            return field.is_absent().then_some(TranslationScale::Scene);
        };
        let units = RealRange::above(0.0, 1e12);
        match text.as_str() {
            "scene" => Some(TranslationScale::Scene),
            "none" => Some(TranslationScale::None),
            number => match number.parse::<f64>() {
                Ok(number) if units.holds(number) => Some(TranslationScale::Fixed(number)),
                _ => {
                    let message = format!("is {}, wanted scene, none, or {units}", bare_text(number));
                    self.refuse(FieldProblem::of_field(message).at(place))
                }
            },
        }
    }

    pub(super) fn curve(&self, field: &Field<schema::CurveSection>) -> Option<CurveKind> {
        match field {
            Field::Absent | Field::Given(schema::CurveSection::Cubic, _) => Some(CurveKind::Cubic),
            Field::Bad => None,
            Field::Given(schema::CurveSection::Cumulative, _) => Some(CurveKind::Cumulative),
            Field::Given(schema::CurveSection::SlerpLerp, _) => Some(CurveKind::SlerpLerp),
            Field::Given(schema::CurveSection::Bezier(raw), _) => self.bezier(raw),
        }
    }

    pub(super) fn bezier(&self, field: &Field<schema::BezierSection>) -> Option<CurveKind> {
        let (raw, place) = field.given()?;
        self.required(&raw.degree, "degree", place, "write bezier: { degree: 3 }")?;
        self.small(&raw.degree, 1, DEGREE).map(|degree| CurveKind::Bezier { degree })
    }
}
