//! The captured path, and the parts that it shares with other paths: the metric and the curve.

use super::Around;
use super::count::Spread;
use crate::recipe::field::{Field, Literal};
use crate::recipe::problem::{Problem, bare_text};
use crate::recipe::resolve::Resolver;
use crate::recipe::resolve::number::{Range, Whole};
use crate::recipe::schema;
use crate::recipe::text::Place;
use crate::trajectory::curve::Curve;
use crate::trajectory::refine::{Ends, Gaps, Order, Refine, RotationMean, Scale};

/// Maximum degree of a Bezier curve. At higher degrees, the control points say little about the
/// course.
const DEGREE: Whole = Whole::new(1, 20);

impl Resolver<'_> {
    pub(super) fn refine(
        &self,
        field: &Field<schema::Refine>,
        within: Place,
        around: Around<'_>,
    ) -> Option<Refine> {
        if !around.setting.has_views() {
            let instead = "write orbit or keyframes, whose poses come from the recipe";
            let problem = match field.place() {
                Some(place) => {
                    Problem::of_key("needs a capture, and the source is none").help(instead).at(place)
                }
                None => Problem::missing_field("orbit").help(instead).at(within),
            };
            return self.refuse(problem);
        }
        let help = "write refine: {} for the paper's: the captured path, smoothed and densified";
        let (raw, place) = self.required(field, "refine", within, help)?;
        let usual = Refine::default();
        let window = self.small(&raw.window, usual.window, Whole::new(0, 1000));
        let spread = Spread {
            factor: Some(&raw.factor),
            frames: &raw.frames,
            duration: &raw.duration,
            literal: Some(&raw.literal),
        };
        let spread = self.spread(spread, usual.count, place, around);
        let order = self.or(&raw.order, schema::Order::Name);
        let rotation = self.or(&raw.rotation, schema::Rotation::Mean);
        let ends = self.or(&raw.ends, schema::Ends::Truncated);
        let scale = self.scale(&raw.metric);
        let gaps = self.or(&raw.gaps, schema::Gaps::Bridge);
        let curve = self.curve(&raw.curve);
        let (count, literal) = spread?;
        Some(Refine {
            window: window?,
            count,
            order: match order? {
                schema::Order::Name => Order::Name,
                schema::Order::Nearest => Order::Nearest,
            },
            rotation: match rotation? {
                schema::Rotation::Mean => RotationMean::Mean,
                schema::Rotation::SlerpMidpoint => RotationMean::SlerpMidpoint,
            },
            ends: match ends? {
                schema::Ends::Truncated => Ends::Truncated,
                schema::Ends::Pinned => Ends::Pinned,
            },
            scale: scale?,
            gaps: match gaps? {
                schema::Gaps::Bridge => Gaps::Bridge,
                schema::Gaps::Refuse => Gaps::Refuse,
            },
            curve: curve?,
            literal,
        })
    }

    pub(super) fn scale(&self, field: &Field<schema::Metric>) -> Option<Scale> {
        let absent = schema::Metric::default();
        let field = &self.section(field, &absent)?.scale;
        let Some((Literal(text), place)) = field.given() else {
            return field.is_absent().then_some(Scale::Scene);
        };
        let units = Range::above(0.0, 1e12);
        match text.as_str() {
            "scene" => Some(Scale::Scene),
            "none" => Some(Scale::None),
            number => match number.parse::<f64>() {
                Ok(number) if units.holds(number) => Some(Scale::Fixed(number)),
                _ => {
                    let message = format!("is {}, wanted scene, none, or {units}", bare_text(number));
                    self.refuse(Problem::of_field(message).at(place))
                }
            },
        }
    }

    pub(super) fn curve(&self, field: &Field<schema::Curve>) -> Option<Curve> {
        match field {
            Field::Absent | Field::Given(schema::Curve::Cubic, _) => Some(Curve::Cubic),
            Field::Bad => None,
            Field::Given(schema::Curve::Cumulative, _) => Some(Curve::Cumulative),
            Field::Given(schema::Curve::SlerpLerp, _) => Some(Curve::SlerpLerp),
            Field::Given(schema::Curve::Bezier(raw), _) => self.bezier(raw),
        }
    }

    pub(super) fn bezier(&self, field: &Field<schema::Bezier>) -> Option<Curve> {
        let (raw, place) = field.given()?;
        self.required(&raw.degree, "degree", place, "write bezier: { degree: 3 }")?;
        self.small(&raw.degree, 1, DEGREE).map(|degree| Curve::Bezier { degree })
    }
}
