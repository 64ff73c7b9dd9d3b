//! Speeds: a formula, a list of levels, or pixels per second.

use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::resolve::Resolver;
use crate::recipe::resolve::number::Range;
use crate::recipe::schema;
use crate::recipe::text::Place;
use crate::speed::function::{Expression, ExpressionError};
use crate::speed::list::List;
use crate::speed::{Flow, Meaning, Speed};
use crate::trajectory::sample::Summation;

/// The paper's speed law (appendix A.1), the default of a refined path.
pub(in crate::recipe) const PAPERS_SPEED: &str = "0.25*sin(t) + 1.1";

/// The default law of all other paths, and the default shape of a flow.
pub(in crate::recipe) const CONSTANT_SPEED: &str = "1";

impl Resolver<'_> {
    pub(super) fn speed(
        &self,
        field: &Field<schema::Speed>,
        usually_constant: bool,
        law: Option<Summation>,
    ) -> Option<Speed> {
        match field {
            Field::Absent => {
                let text = if usually_constant { CONSTANT_SPEED } else { PAPERS_SPEED };
                Some(Speed::Function(default_speed(text)))
            }
            Field::Bad => None,
            Field::Given(schema::Speed::Function(text), _) => {
                let (text, place) = text.given()?;
                self.law(text, place).map(Speed::Function)
            }
            Field::Given(schema::Speed::List(raw), _) => {
                let (raw, place) = raw.given()?;
                self.list(raw, place, law).map(Speed::List)
            }
            Field::Given(schema::Speed::Flow(raw), _) => {
                let (raw, place) = raw.given()?;
                self.flow(raw, place).map(Speed::Flow)
            }
        }
    }

    fn list(&self, raw: &schema::List, place: Place, law: Option<Summation>) -> Option<List> {
        let help = "write multipliers: [1, 0.5, 2], one for each part of the time";
        let levels = self.required(&raw.multipliers, "multipliers", place, help);
        let levels = levels.and_then(|(levels, place)| {
            if levels.is_empty() {
                let problem = Problem::of_field("is an empty list, wanted at least one multiplier");
                return self.refuse(problem.help(help).at(place));
            }
            let all: Vec<Option<f64>> =
                levels.iter().map(|level| self.real(level, 1.0, Range::above(0.0, 1e12))).collect();
            all.into_iter().collect::<Option<Vec<f64>>>()
        });
        let blend = self.blend(&raw.blend);
        let meaning = self.meaning(&raw.meaning, law);
        let list = List::new(levels?, blend?, meaning?);
        list.map_or_else(
            |error| self.refuse(Problem::of_field(format!("is no speed: {error}")).at(place)),
            Some,
        )
    }

    fn blend(&self, field: &Field<f64>) -> Option<f64> {
        let Some((value, place)) = field.given() else { return field.is_absent().then_some(0.1) };
        let range = Range::new(0.0, 0.5);
        if range.holds(*value) {
            return Some(*value);
        }
        let problem = Problem::of_field(format!("is {value}, wanted {range}"));
        self.refuse(
            problem
                .help("0 leaves steps; beyond 0.5 the windows of neighbouring levels would overlap")
                .at(place),
        )
    }

    fn meaning(&self, field: &Field<schema::Meaning>, law: Option<Summation>) -> Option<Meaning> {
        match (self.or(field, schema::Meaning::Speed)?, law) {
            (schema::Meaning::Speed, _) => Some(Meaning::Speed),
            (schema::Meaning::FrameRate, Some(Summation::Integral)) => {
                let problem =
                    Problem::of_field("is frame-rate, whose steps are summed and have no integral here");
                self.refuse(
                    problem.help("write sampling: { law: sum }, without a tolerance").at(field.place()?),
                )
            }
            (schema::Meaning::FrameRate, _) => Some(Meaning::FrameRate),
        }
    }

    fn flow(&self, raw: &schema::Flow, place: Place) -> Option<Flow> {
        let help = "write flow: { px_s: 400 }, the median flow of a frame in pixels a second";
        self.required(&raw.px_s, "px_s", place, help);
        let px_s = self.real(&raw.px_s, 1.0, Range::above(0.0, 1e9));
        let shape = match &raw.function {
            Field::Absent => Some(default_speed(CONSTANT_SPEED)),
            Field::Bad => None,
            Field::Given(text, place) => self.law(text, *place),
        };
        Some(Flow { px_s: px_s?, shape: shape? })
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

fn default_speed(text: &str) -> Expression {
    Expression::parse(text).expect("the usual laws are positive")
}

/// Returns the bytes of the formula that an error concerns.
fn seen_at(error: &ExpressionError) -> Option<std::ops::Range<usize>> {
    match error {
        ExpressionError::Name { at, name } => Some(*at..*at + name.len()),
        ExpressionError::Syntax { at, .. } | ExpressionError::TooDeep { at, .. } => Some(*at..*at),
        // The other errors concern the formula as a whole.
        _ => None,
    }
}
