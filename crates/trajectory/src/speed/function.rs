//! Speed as an expression in `t`, proved positive over [0, 1].
//!
//! ```text
//! sum     = product (("+" | "-") product)*
//! product = sign (("*" | "/") sign)*
//! sign    = ("-" | "+") sign | power
//! power   = atom (("^" | "**") sign)?
//! atom    = number | "t" | "pi" | "e" | function "(" sum ("," sum)* ")" | "(" sum ")"
//! ```
//! The functions are `sin cos tan exp log sqrt abs` of one argument, and `min max` of two or more.
//! `log` is natural, and angles are in radians. Values are `f64`; transcendental functions are
//! `libm`'s.

mod interval;
mod parse;
mod proof;

use super::SpeedLaw;
use gs2e_num::se3::arc_length::ArcLength;
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::sum::NeumaierSum;
use serde::Serialize;

/// An expression in `t`, stored as its syntax tree. Spaces do not change a key; the order of
/// operations does.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct SpeedExpression {
    root: SyntaxNode,
}

/// A node of the tree.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum SyntaxNode {
    T,
    Pi,
    E,
    Number(f64),
    Negated(Box<SyntaxNode>),
    Binary(BinaryOperator, Box<[SyntaxNode; 2]>),
    Call(UnaryFunction, Box<SyntaxNode>),
}

/// A binary operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum BinaryOperator {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
}

/// A unary function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum UnaryFunction {
    Sin,
    Cos,
    Tan,
    Exp,
    Log,
    Sqrt,
    Abs,
}

/// The reason why a text is not a speed law.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExpressionError {
    /// The text does not follow the grammar.
    #[error("found {found} at byte {at}, wanted {expected}")]
    Syntax {
        /// Byte offset in the text.
        at: usize,
        /// The tokens that may stand there.
        expected: &'static str,
        /// The token found.
        found: String,
    },
    /// A name that the grammar does not have.
    #[error(
        "`{name}` at byte {at} is not known; the known names are t, pi, e, sin, cos, tan, exp, log, sqrt, abs, min and max"
    )]
    Name {
        /// Byte offset in the text.
        at: usize,
        /// The name.
        name: String,
    },
    /// The text is too long.
    #[error("the expression is {bytes} bytes long; the limit is {limit}")]
    TooLong {
        /// Its length.
        bytes: usize,
        /// The limit.
        limit: usize,
    },
    /// The text nests too deeply.
    #[error("the expression nests more than {limit} levels deep at byte {at}")]
    TooDeep {
        /// Byte offset in the text.
        at: usize,
        /// The limit.
        limit: usize,
    },
    /// The value is zero or negative somewhere.
    #[error(
        "the speed is {value:.6} at t = {t}, but must be positive for every t from 0 to 1 (seen in [{from}, {to}])"
    )]
    NotPositive {
        /// Start of the interval where it fails.
        from: f64,
        /// End of the interval where it fails.
        to: f64,
        /// A point in it.
        t: f64,
        /// The value there.
        value: f64,
    },
    /// The value is infinite or undefined somewhere.
    #[error("the speed is not finite at t = {t} (seen in [{from}, {to}])")]
    NotFinite {
        /// Start of the interval where it fails.
        from: f64,
        /// End of the interval where it fails.
        to: f64,
        /// A point in it.
        t: f64,
    },
    /// Positivity could not be proved.
    #[error("the speed cannot be proved positive for t in [{from}, {to}]: {bounds}")]
    Unproved {
        /// Start of the interval.
        from: f64,
        /// End of the interval.
        to: f64,
        /// The known bounds of the value there.
        bounds: String,
    },
}

impl ExpressionError {
    /// The byte offset of the error in the text, if it has one.
    #[must_use]
    pub fn position(&self) -> Option<usize> {
        match self {
            Self::Syntax { at, .. } | Self::Name { at, .. } | Self::TooDeep { at, .. } => Some(*at),
            _ => None,
        }
    }
}

impl SpeedExpression {
    /// Parses `text`, and proves that the value is positive and finite over [0, 1].
    ///
    /// # Errors
    /// The text does not parse, or the value is not positive somewhere; the error has the place or
    /// the `t`.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        let root = parse::parse_expression(text)?;
        proof::prove_positive(&root)?;
        Ok(Self { root })
    }
}

impl SpeedLaw for SpeedExpression {
    fn speed(&self, t: f64) -> f64 {
        self.root.value(t)
    }

    fn distances(&self, steps: usize) -> Vec<f64> {
        // The integral of the speed over time is a length, so the quadrature of curves computes it.
        let arc = ArcLength::measure_curve(&[1.0], |at: CurvePlace| self.root.value(at.x));
        let place = |k: usize| CurvePlace { segment: 0, x: k as f64 / steps as f64 };
        // Compensated, because thousands of parts are added.
        let mut sum = NeumaierSum::default();
        let parts = (1..=steps).map(|k| {
            sum.add(arc.between(place(k - 1), place(k)));
            sum.value()
        });
        std::iter::once(0.0).chain(parts).collect()
    }

    fn roughness(&self) -> Option<String> {
        let mut names = Vec::new();
        self.root.rough_functions(&mut names);
        (!names.is_empty()).then(|| format!("it uses {}", names.join(", ")))
    }
}

impl SyntaxNode {
    fn value(&self, t: f64) -> f64 {
        match self {
            Self::T => t,
            Self::Pi => std::f64::consts::PI,
            Self::E => std::f64::consts::E,
            Self::Number(value) => *value,
            Self::Negated(a) => -a.value(t),
            Self::Binary(op, operands) => op.value(operands[0].value(t), operands[1].value(t)),
            Self::Call(f, a) => f.value(a.value(t)),
        }
    }

    fn rough_functions(&self, names: &mut Vec<&'static str>) {
        let name = match self {
            Self::T | Self::Pi | Self::E | Self::Number(_) => None,
            Self::Negated(a) => {
                a.rough_functions(names);
                None
            }
            Self::Binary(op, operands) => {
                operands.iter().for_each(|a| a.rough_functions(names));
                match op {
                    BinaryOperator::Min => Some("min"),
                    BinaryOperator::Max => Some("max"),
                    _ => None,
                }
            }
            Self::Call(f, a) => {
                a.rough_functions(names);
                (*f == UnaryFunction::Abs).then_some("abs")
            }
        };
        names.extend(name.filter(|n| !names.contains(n)));
    }
}

impl BinaryOperator {
    fn value(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => libm::pow(a, b),
            Self::Min => a.min(b),
            Self::Max => a.max(b),
        }
    }
}

impl UnaryFunction {
    fn value(self, a: f64) -> f64 {
        match self {
            Self::Sin => libm::sin(a),
            Self::Cos => libm::cos(a),
            Self::Tan => libm::tan(a),
            Self::Exp => libm::exp(a),
            Self::Log => libm::log(a),
            Self::Sqrt => a.sqrt(),
            Self::Abs => a.abs(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str, t: f64) -> f64 {
        SpeedExpression::parse(text).unwrap_or_else(|e| panic!("{text}: {e}")).speed(t)
    }

    #[test]
    fn expressions_follow_the_usual_order_of_operations() {
        let t = |text: &str, want: f64| {
            let got = value(text, 0.5);
            // Each case is at most five correctly rounded or libm operations.
            assert!((got - want).abs() <= 8.0 * f64::EPSILON * want.abs(), "{text}: {got}");
        };
        t("1 + 2 * 3", 7.0);
        t("10 - 4 - 3", 3.0);
        t("16 / 4 / 2", 2.0);
        t("2 ^ 3 ^ 2", 512.0);
        t("2 ** 3 ** 2", 512.0);
        t("5 - 2^2", 1.0);
        t("-2^2 + 5", 1.0);
        t("(-2)^2", 4.0);
        t("2^-1", 0.5);
        t("2^-t^2 * 4", 4.0 / 2.0f64.powf(0.25));
        t("3 - -t", 3.5);
        t("+t + .5", 1.0);
        t("2e1 + 1.5E-1", 20.15);
        t("t*2 + e", 1.0 + std::f64::consts::E);
        t("min(3, 2, t + 1)", 1.5);
        t("max(1, 2 * t, 0.5)", 1.0);
        t("sqrt(t * 8 + 5)", 3.0);
        t("abs(t - 3)", 2.5);
        t("log(e^2)", 2.0);
        t("exp(log(3))", 3.0);
        t("sin(pi * t) + cos(pi)+2", 2.0);
        t("tan(pi/4)", 1.0);
        t("0.25*sin(t) + 1.1", 0.25 * 0.479_425_538_604_203 + 1.1);
    }

    #[test]
    fn syntax_errors_name_the_byte_and_what_was_expected() {
        let t = |text: &str, at: usize, words: &str| {
            let error = SpeedExpression::parse(text).expect_err(text);
            assert_eq!(error.position(), Some(at), "{text}: {error}");
            assert!(error.to_string().contains(words), "{text}: {error}");
        };
        t("", 0, "a number");
        t("1 +", 3, "the end");
        t("1 + * 2", 4, "`*`");
        t("2 t", 2, "found `t` at byte 2, wanted an operator or the end");
        t("2e", 1, "an operator");
        t("(1 + t", 6, "`)`");
        t("1)", 1, "`)`");
        t("sin t", 4, "`(`");
        t("sin()", 4, "`)`");
        t("sin(t, 1)", 5, "`,`");
        t("min(t)", 5, "`,`");
        t("1 + x", 4, "`x`");
        t("1 + tau", 4, "`tau`");
        t("1e999", 0, "1e999");
        t(".", 0, "`.`");
        t("1 \u{d7} t", 2, "\u{d7}");
        t("\u{3c0}", 0, "\u{3c0}");
    }

    #[test]
    fn hostile_texts_are_refused_before_they_cost() {
        assert!(matches!(SpeedExpression::parse(&"1+".repeat(600)), Err(ExpressionError::TooLong { .. })));
        for text in
            ["(".repeat(999), "-".repeat(999), "2^".repeat(400), "sin(".repeat(240), "1+".repeat(400) + "1"]
        {
            assert!(matches!(SpeedExpression::parse(&text), Err(ExpressionError::TooDeep { .. })), "{text}");
        }
        assert!(SpeedExpression::parse(&("1+".repeat(90) + "1")).is_ok());
    }

    #[test]
    fn positivity_is_proved() {
        for text in [
            "1",
            "0.25*sin(t) + 1.1",
            "0.25*sin(2*pi*t) + 1.1",
            "1 + t - t",
            "(t - 0.5)^2 + 1e-4",
            "t^0.5 + 1e-9",
            "t**3 + 0.001",
            "(t-2)^-2",
            "1/(1.0001 - t)",
            "exp(-20*t)",
            "2 + sin(40*t)*cos(30*t)",
            "sqrt(t) + 0.01",
            "1.00001 + cos(pi*(t+0.3))",
            "max(t - 0.5, 0.1)",
            "1e-300 + t^2",
            "1e300",
        ] {
            assert!(SpeedExpression::parse(text).is_ok(), "{text}: {:?}", SpeedExpression::parse(text));
        }
    }

    #[test]
    fn laws_that_fail_somewhere_name_the_t() {
        let t = |text: &str, where_: f64, kind: fn(&ExpressionError) -> Option<(f64, f64)>| {
            let error = SpeedExpression::parse(text).expect_err(text);
            let (from, to) = kind(&error).unwrap_or_else(|| panic!("{text}: {error:?}"));
            assert!(from <= where_ && where_ <= to && error.position().is_none(), "{text}: {error}");
        };
        let not_positive = |e: &ExpressionError| match e {
            ExpressionError::NotPositive { from, to, t, value } => {
                assert!(from <= t && t <= to && *value <= 0.0);
                Some((*from, *to))
            }
            _ => None,
        };
        let not_finite = |e: &ExpressionError| match e {
            ExpressionError::NotFinite { from, to, .. } => Some((*from, *to)),
            _ => None,
        };
        let unproved = |e: &ExpressionError| match e {
            ExpressionError::Unproved { from, to, .. } => Some((*from, *to)),
            _ => None,
        };
        t("t", 0.0, not_positive);
        t("0", 0.5, not_positive);
        t("-1", 0.5, not_positive);
        t("1 - t", 1.0, not_positive);
        t("cos(pi*t) + 0.5", 0.66667, not_positive);
        // A dip that 150 samples would miss: the value is negative only within 1e-4 of 0.3141.
        t("1e6*(t-0.3141)^2 - 0.01", 0.314, not_positive);
        t("1/t", 0.0, not_finite);
        t("1/(t - 0.25)^2", 0.25, not_finite);
        t("log(t) + 1000", 0.0, not_finite);
        t("sqrt(0.5 - t) + 1", 0.500_01, not_finite);
        t("exp(1000*t)", 0.709_782_7, not_finite);
        t("(0-1)^0.5", 0.0, not_finite);
        t("t - t + 1e-6", 0.0, unproved);
        t("1 + 0*tan(pi*t)", 0.5, unproved);
    }

    #[test]
    fn the_tree_ignores_spelling_but_not_order() {
        let json = |text: &str| serde_json::to_string(&SpeedExpression::parse(text).unwrap()).unwrap();
        assert_eq!(json("0.25*sin(t)+1.1"), json(" 0.250 * sin( t ) + 11e-1 "));
        assert_eq!(json("2^t"), json("2 ** t"));
        assert_eq!(json("(1 + t) + 2"), json("1 + t + 2"));
        assert_ne!(json("1 + (t + 2)"), json("1 + t + 2"));
        assert_ne!(json("t + 1"), json("1 + t"));
        assert_eq!(
            json("0.25*sin(t) + 1"),
            r#"{"binary":["add",[{"binary":["multiply",[{"number":0.25},{"call":["sin","t"]}]]},{"number":1.0}]]}"#
        );
    }

    #[test]
    fn corners_are_told() {
        let rough = |text: &str| SpeedExpression::parse(text).unwrap().roughness();
        assert_eq!(rough("1 + sin(t)"), None);
        assert_eq!(rough("max(t, 1) + abs(t) + max(t, 2)").as_deref(), Some("it uses max, abs"));
    }
}
