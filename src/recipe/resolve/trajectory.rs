//! Trajectories: path and speed.

use super::number::{Range, Whole};
use super::{MAX_FRAMES, Resolver};
use crate::recipe::field::Field;
use crate::recipe::problem::{Problem, quoted};
use crate::recipe::text::Place;
use crate::recipe::{TrajectoryRecipe, names, schema};
use crate::speed::Speed;
use crate::speed::function::Expression;
use crate::trajectory::refine::{Count, Curve, Ends, Gaps, Order, Refine, RotationMean, Scale};
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
        let help = "trajectories: [{ name: base, refine: {} }]";
        let (list, place) = self.required(field, "trajectories", self.root, help)?;
        if list.is_empty() {
            return self.refuse(Problem::of_field("is empty, wanted at least one").help(help).at(place));
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
                let problem = Problem::of_field(format!("is {}, as an earlier trajectory is", quoted(name)));
                self.report(
                    problem.help("names are folders: unique, in capitals and small letters alike").at(place),
                );
            }
            seen.push(folded);
        }
    }

    fn trajectory(&self, item: &Field<schema::Trajectory>, rate: Option<Hertz>) -> Option<TrajectoryRecipe> {
        let (raw, place) = item.given()?;
        for later in [&raw.novel, &raw.orbit, &raw.keyframes] {
            self.later(later, PATHS);
        }
        let name = self.required(&raw.name, "name", place, "name: base is its folder in the release");
        let name = name.and_then(|(name, place)| {
            self.named(name, place, names::trajectory(name), names::TRAJECTORY_HELP)
        });
        let only_later =
            raw.refine.is_absent() && [&raw.novel, &raw.orbit, &raw.keyframes].iter().any(|f| !f.is_absent());
        let refine = if only_later { None } else { self.refine(&raw.refine, place, rate) };
        let speed = self.speed(&raw.speed);
        Some(TrajectoryRecipe { name: name?, refine: refine?, speed: speed? })
    }

    fn refine(&self, field: &Field<schema::Refine>, within: Place, rate: Option<Hertz>) -> Option<Refine> {
        let help = "refine: {} smooths and densifies the captured path as the paper does";
        let (raw, place) = self.required(field, "refine", within, help)?;
        let window = self.whole(&raw.window, 2, Whole::new(0, 1000));
        let count = self.count(raw, place, rate);
        let order = self.or(&raw.order, schema::Order::Name);
        let rotation = self.or(&raw.rotation, schema::Rotation::Mean);
        let ends = self.or(&raw.ends, schema::Ends::Truncated);
        let scale = self.scale(&raw.metric);
        let gaps = self.or(&raw.gaps, schema::Gaps::Bridge);
        let curve = self.curve(&raw.curve);
        let literal = self.or(&raw.literal, false);
        Some(Refine {
            window: u32::try_from(window?).expect("within its range"),
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
        if given.iter().filter(|g| **g).count() > 1 {
            let problem = Problem::of_field("has more than one of factor, frames and duration");
            return self.refuse(problem.help("each of them alone says how many poses there are").at(place));
        }
        if !raw.frames.is_absent() {
            return self.whole(&raw.frames, 1, Whole::new(1, MAX_FRAMES)).map(Count::Frames);
        }
        if !raw.duration.is_absent() {
            let seconds = self.ratio(&raw.duration, 1, Range::above(0.0, 86_400.0))?;
            return self.duration(seconds, rate?, raw.duration.given()?.1);
        }
        self.ratio(&raw.factor, 5, Range::above(0.0, 1e6)).map(Count::Factor)
    }

    fn duration(&self, seconds: Ratio, rate: Hertz, place: Place) -> Option<Count> {
        let frames = 1.0 + (seconds.to_f64() * rate.to_f64()).ceil();
        if frames > MAX_FRAMES as f64 {
            let message =
                format!("makes {frames} frames at {} a second, wanted at most {MAX_FRAMES}", rate.to_f64());
            return self.refuse(Problem::of_field(message).at(place));
        }
        Some(Count::Duration(seconds))
    }

    fn scale(&self, field: &Field<schema::Metric>) -> Option<Scale> {
        let absent = schema::Metric::default();
        let field = &self.section(field, &absent)?.scale;
        let Some((text, place)) = field.given() else { return field.is_absent().then_some(Scale::Scene) };
        match text.as_str() {
            "scene" => Some(Scale::Scene),
            "none" => Some(Scale::None),
            number => match number.parse::<f64>() {
                Ok(units) if units > 0.0 && units <= 1e12 => Some(Scale::Fixed(units)),
                _ => {
                    let found = quoted(number);
                    let wanted = "scene, none, or a number above 0 and at most 1000000000000";
                    self.refuse(Problem::of_field(format!("is {found}, wanted {wanted}")).at(place))
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
                match Expression::parse(text) {
                    Ok(law) => Some(Speed::Function(law)),
                    Err(error) => {
                        let message = format!("is no speed law: {error}");
                        let help = "a formula in t from 0 to 1 that stays above 0, such as 0.25*sin(t) + 1.1";
                        self.refuse(Problem::of_field(message).help(help).at(place))
                    }
                }
            }
            Field::Given(schema::Speed::List(later) | schema::Speed::Flow(later), _) => {
                self.later(later, "this gs2e takes a speed as a function");
                None
            }
        }
    }
}
