//! Trajectories: path and speed.

use super::number::{Range, Whole};
use super::{MAX_FRAMES, Resolver};
use crate::recipe::field::{Field, Literal};
use crate::recipe::problem::{Problem, bare, quoted};
use crate::recipe::text::Place;
use crate::recipe::{TrajectoryRecipe, names, schema};
use crate::speed::Speed;
use crate::speed::function::{Expression, ExpressionError};
use crate::trajectory::curve::Curve;
use crate::trajectory::refine::{Ends, Gaps, Order, Refine, RotationMean, Scale};
use crate::trajectory::travel::Count;
use crate::units::{Hertz, Ratio};

/// The paper's speed law (appendix A.1).
pub(in crate::recipe) const DEFAULT_SPEED: &str = "0.25*sin(t) + 1.1";

const PATHS: &str = "this gs2e makes trajectories with refine";
const CURVES: &str = "this gs2e has the curve cubic";

impl Resolver<'_> {
    pub(super) fn trajectories(
        &self,
        field: &Field<Vec<Field<schema::Trajectory>>>,
        rate: Option<Hertz>,
    ) -> Option<Vec<TrajectoryRecipe>> {
        let help = "write trajectories: [{ name: base, refine: {} }]";
        let (list, place) = self.required(field, "trajectories", self.root, help)?;
        if list.is_empty() {
            return self
                .refuse(Problem::of_field("is an empty list, wanted at least one").help(help).at(place));
        }
        self.refuse_repeated_names(list);
        let all: Vec<Option<TrajectoryRecipe>> =
            list.iter().map(|item| self.trajectory(item, rate)).collect();
        all.into_iter().collect()
    }

    /// Names that differ in case alone are one folder on some systems.
    fn refuse_repeated_names(&self, list: &[Field<schema::Trajectory>]) {
        let mut seen: Vec<String> = Vec::new();
        for (name, place) in list.iter().filter_map(|item| item.given()?.0.name.given()) {
            let folded = name.to_lowercase();
            if seen.contains(&folded) {
                let problem =
                    Problem::of_field(format!("is {}, as an earlier trajectory's is", quoted(name)));
                self.report(
                    problem.help("names are folders, which some systems tell apart without case").at(place),
                );
            }
            seen.push(folded);
        }
    }

    fn trajectory(&self, item: &Field<schema::Trajectory>, rate: Option<Hertz>) -> Option<TrajectoryRecipe> {
        let (raw, place) = item.given()?;
        let name = self.required(&raw.name, "name", place, "write name: base, its folder in the release");
        let name =
            name.and_then(|(name, at)| self.named(name, at, names::trajectory(name), names::TRAJECTORY_HELP));
        let later = [&raw.novel, &raw.orbit, &raw.keyframes];
        later.iter().for_each(|field| self.later(field, PATHS));
        let has_path = !raw.refine.is_absent() || later.iter().all(|field| field.is_absent());
        let refine = if has_path { self.refine(&raw.refine, place, rate) } else { None };
        let speed = self.speed(&raw.speed);
        Some(TrajectoryRecipe { name: name?, refine: refine?, speed: speed? })
    }

    fn refine(&self, field: &Field<schema::Refine>, within: Place, rate: Option<Hertz>) -> Option<Refine> {
        let help = "write refine: {} for the paper's: the captured path, smoothed and densified";
        let (raw, place) = self.required(field, "refine", within, help)?;
        let window = self.small(&raw.window, 2, Whole::new(0, 1000));
        let count = self.count(raw, place, rate);
        let order = self.or(&raw.order, schema::Order::Name);
        let rotation = self.or(&raw.rotation, schema::Rotation::Mean);
        let ends = self.or(&raw.ends, schema::Ends::Truncated);
        let scale = self.scale(&raw.metric);
        let gaps = self.or(&raw.gaps, schema::Gaps::Bridge);
        let curve = self.curve(&raw.curve);
        let literal = self.or(&raw.literal, false);
        Some(Refine {
            window: window?,
            count: count?,
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
            literal: literal?,
        })
    }

    fn count(&self, raw: &schema::Refine, place: Place, rate: Option<Hertz>) -> Option<Count> {
        let given = [!raw.factor.is_absent(), !raw.frames.is_absent(), !raw.duration.is_absent()];
        if given.iter().filter(|given| **given).count() > 1 {
            let problem = Problem::of_field("has more than one of factor, frames and duration");
            return self.refuse(problem.help("one of them says how many poses there are").at(place));
        }
        if !raw.frames.is_absent() {
            return self.whole(&raw.frames, 1, Whole::new(1, MAX_FRAMES)).map(Count::Frames);
        }
        if !raw.duration.is_absent() {
            return self.duration(&raw.duration, rate);
        }
        self.ratio(&raw.factor, 5, Range::above(0.0, 1e6)).map(Count::Factor)
    }

    fn duration(&self, field: &Field<Literal>, rate: Option<Hertz>) -> Option<Count> {
        const DAY: f64 = 86_400.0;
        let seconds: Ratio = self.ratio(field, 1, Range::above(0.0, DAY))?;
        let rate = rate?.to_f64();
        let frames = 1.0 + (seconds.to_f64() * rate).ceil();
        if frames > MAX_FRAMES as f64 {
            let problem = Problem::of_field(format!("makes {frames} frames, wanted at most {MAX_FRAMES}"));
            return self.refuse(problem.help(format!("there are {rate} frames a second")).at(field.place()?));
        }
        Some(Count::Duration(seconds))
    }

    fn scale(&self, field: &Field<schema::Metric>) -> Option<Scale> {
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
                    let message = format!("is {}, wanted scene, none, or {units}", bare(number));
                    self.refuse(Problem::of_field(message).at(place))
                }
            },
        }
    }

    fn curve(&self, field: &Field<schema::Curve>) -> Option<Curve> {
        match field {
            Field::Absent | Field::Given(schema::Curve::Cubic, _) => Some(Curve::Cubic),
            Field::Bad => None,
            Field::Given(schema::Curve::Cumulative, place) => self.word_later("cumulative", *place, CURVES),
            Field::Given(schema::Curve::SlerpLerp, place) => self.word_later("slerp-lerp", *place, CURVES),
            Field::Given(schema::Curve::Bezier(later), _) => {
                self.later(later, CURVES);
                None
            }
        }
    }

    fn speed(&self, field: &Field<schema::Speed>) -> Option<Speed> {
        match field {
            Field::Absent => {
                let law = Expression::parse(DEFAULT_SPEED).expect("the paper's law is positive");
                Some(Speed::Function(law))
            }
            Field::Bad => None,
            Field::Given(schema::Speed::Function(text), _) => {
                let (text, place) = text.given()?;
                self.law(text, place).map(Speed::Function)
            }
            Field::Given(schema::Speed::List(later) | schema::Speed::Flow(later), _) => {
                self.later(later, "this gs2e takes a speed as a function");
                None
            }
        }
    }

    fn law(&self, text: &str, place: Place) -> Option<Expression> {
        let error = match Expression::parse(text) {
            Ok(law) => return Some(law),
            Err(error) => error,
        };
        let help = "a formula in t that stays above 0 for t from 0 to 1, such as 0.25*sin(t) + 1.1";
        let problem = Problem::of_field(format!("is no speed law: {error}")).help(help).at(place);
        self.refuse(match seen_at(&error) {
            Some(bytes) => problem.in_text(place, text, bytes),
            None => problem,
        })
    }
}

/// The bytes of the formula that an error is about.
fn seen_at(error: &ExpressionError) -> Option<std::ops::Range<usize>> {
    match error {
        ExpressionError::Name { at, name } => Some(*at..*at + name.len()),
        ExpressionError::Syntax { at, .. } | ExpressionError::TooDeep { at, .. } => Some(*at..*at),
        // The others are about the formula as a whole.
        _ => None,
    }
}
