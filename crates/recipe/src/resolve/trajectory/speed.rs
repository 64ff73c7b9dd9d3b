//! Speeds: a formula, a list of levels, or pixels per second.

use crate::field::Field;
use crate::problem::FieldProblem;
use crate::resolve::number::RealRange;
use crate::resolve::{Resolver, all};
use crate::schema;
use crate::text::TextSpan;
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::function::{ExpressionError, SpeedExpression};
use gs2e_trajectory::speed::list::SpeedLevels;
use gs2e_trajectory::speed::{FlowSpeed, SpeedChoice, SpeedMeaning};

/// The paper's speed law (appendix A.1), the default of a refined path.
pub(crate) const PAPERS_SPEED: &str = "0.25*sin(t) + 1.1";

/// The default law of all other paths, and the default shape of a flow.
pub(crate) const CONSTANT_SPEED: &str = "1";

impl Resolver<'_> {
    pub(super) fn speed(
        &self,
        field: &Field<schema::SpeedSection>,
        constant_by_default: bool,
        law: Option<SummationRule>,
    ) -> Option<SpeedChoice> {
        match field {
            Field::Absent => {
                let text = if constant_by_default { CONSTANT_SPEED } else { PAPERS_SPEED };
                Some(SpeedChoice::Function(default_speed(text)))
            }
            Field::Bad => None,
            Field::Given(schema::SpeedSection::Function(text), _) => {
                let (text, place) = text.given()?;
                self.law(text, place).map(SpeedChoice::Function)
            }
            Field::Given(schema::SpeedSection::List(raw), _) => {
                let (raw, place) = raw.given()?;
                self.list(raw, place, law).map(SpeedChoice::List)
            }
            Field::Given(schema::SpeedSection::Flow(raw), _) => {
                let (raw, place) = raw.given()?;
                self.flow(raw, place).map(SpeedChoice::Flow)
            }
        }
    }

    fn list(
        &self,
        raw: &schema::ListSection,
        place: TextSpan,
        law: Option<SummationRule>,
    ) -> Option<SpeedLevels> {
        let help = "write multipliers: [1, 0.5, 2], one for each part of the time";
        let levels = self.required(&raw.multipliers, "multipliers", place, help);
        let levels = levels.and_then(|(levels, place)| {
            if levels.is_empty() {
                let problem = FieldProblem::of_field("is an empty list, wanted at least one multiplier");
                return self.refuse(problem.help(help).at(place));
            }
            all(levels, |level| self.real(level, 1.0, RealRange::above(0.0, 1e12)))
        });
        let blend = self.blend(&raw.blend);
        let meaning = self.meaning(&raw.meaning, law);
        SpeedLevels::new(levels?, blend?, meaning?).map_or_else(
            |error| self.refuse(FieldProblem::of_field(format!("is not a speed: {error}")).at(place)),
            Some,
        )
    }

    fn blend(&self, field: &Field<f64>) -> Option<f64> {
        let Some((value, place)) = field.given() else { return field.is_absent().then_some(0.1) };
        let range = RealRange::new(0.0, 0.5);
        if range.holds(*value) {
            return Some(*value);
        }
        let problem = FieldProblem::of_field(format!("is {value}, wanted {range}"));
        self.refuse(
            problem
                .help("0 leaves steps; beyond 0.5 the windows of neighbouring levels would overlap")
                .at(place),
        )
    }

    fn meaning(&self, field: &Field<SpeedMeaning>, law: Option<SummationRule>) -> Option<SpeedMeaning> {
        let meaning = field.or(SpeedMeaning::Speed)?;
        if meaning == SpeedMeaning::FrameRate && law == Some(SummationRule::Integral) {
            let problem = FieldProblem::of_field("is frame-rate, which sums steps and cannot be integrated");
            let help = "write sampling: { law: sum }, without a tolerance";
            return self.refuse(problem.help(help).at(field.place()?));
        }
        Some(meaning)
    }

    fn flow(&self, raw: &schema::FlowSection, place: TextSpan) -> Option<FlowSpeed> {
        let help = "write flow: { px_s: 400 }, the median flow of a frame in pixels per second";
        self.required(&raw.px_s, "px_s", place, help);
        resolved!(FlowSpeed {
            px_s: self.real(&raw.px_s, 1.0, RealRange::above(0.0, 1e9)),
            shape: match &raw.function {
                Field::Absent => Some(default_speed(CONSTANT_SPEED)),
                Field::Bad => None,
                Field::Given(text, place) => self.law(text, *place),
            },
        })
    }

    fn law(&self, text: &str, place: TextSpan) -> Option<SpeedExpression> {
        let error = match SpeedExpression::parse(text) {
            Ok(law) => return Some(law),
            Err(error) => error,
        };
        let help = "write a formula in t that stays above 0 for t from 0 to 1, such as 0.25*sin(t) + 1.1";
        let problem = FieldProblem::of_field(format!("is not a speed law: {error}")).help(help).at(place);
        self.refuse(match error_range(&error) {
            Some(bytes) => problem.in_text(place, text, bytes),
            None => problem,
        })
    }
}

fn default_speed(text: &str) -> SpeedExpression {
    SpeedExpression::parse(text).expect("the usual laws are positive")
}

/// Returns the bytes of the formula that an error concerns.
fn error_range(error: &ExpressionError) -> Option<std::ops::Range<usize>> {
    match error {
        ExpressionError::Name { at, name } => Some(*at..*at + name.len()),
        ExpressionError::Syntax { at, .. } | ExpressionError::TooDeep { at, .. } => Some(*at..*at),
        // The other errors concern the formula as a whole.
        _ => None,
    }
}
