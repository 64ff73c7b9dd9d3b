//! Proof of positivity over [0, 1]: interval bounds on repeated halves of [0, 1], down to a width
//! of 2^-16.
//!
//! A law that is only sampled passes or fails depending on the number of poses. A law that cannot
//! be proved positive is refused: one that touches zero, or one with bounds wider than its value
//! (the same `t` in opposing places).

use super::interval::ValueInterval;
use super::{BinaryOperator, ExpressionError, SyntaxNode};

/// Maximum number of halvings of [0, 1].
const DEPTH: u32 = 16;
/// Number of cells of the grid on which a counterexample is searched after the proof has failed.
const GRID: u32 = 1024;

/// Proves that the value of `node` is positive and finite for all t in [0, 1]. Reports the leftmost
/// failure.
pub(super) fn prove_positive(node: &SyntaxNode) -> Result<(), ExpressionError> {
    let mut open = vec![(0.0, 1.0, 0)];
    while let Some((from, to, depth)) = open.pop() {
        let bounds = node.bounds(ValueInterval { low: from, high: to });
        if bounds.is_some_and(|b| b.low > 0.0) {
            continue;
        }
        if depth == DEPTH || bounds.is_some_and(|b| b.high <= 0.0) {
            return Err(explain_failure(node, from, to, bounds));
        }
        // Bounds are dyadic, so halving is exact.
        let middle = f64::midpoint(from, to);
        // The left half is popped first, so the reported failure is the leftmost one.
        open.push((middle, to, depth + 1));
        open.push((from, middle, depth + 1));
    }
    Ok(())
}

/// The error for `[from, to]`, where the proof failed: a `t` at which the law fails, there or
/// anywhere on a grid, or the lack of a proof.
fn explain_failure(node: &SyntaxNode, from: f64, to: f64, bounds: Option<ValueInterval>) -> ExpressionError {
    let here = [from, f64::midpoint(from, to), to].map(|t| (t, from, to));
    let grid = (0..=GRID).map(|k| {
        let cell = |k: u32| f64::from(k.min(GRID)) / f64::from(GRID);
        (cell(k), cell(k.saturating_sub(1)), cell(k + 1))
    });
    for (t, from, to) in here.into_iter().chain(grid) {
        let value = node.value(t);
        if !value.is_finite() {
            return ExpressionError::NotFinite { from, to, t };
        }
        if value <= 0.0 {
            return ExpressionError::NotPositive { from, to, t, value };
        }
    }
    let bounds = bounds.map_or_else(
        || "it has no finite bounds there".to_owned(),
        |b| format!("it lies between {:e} and {:e} there", b.low, b.high),
    );
    ExpressionError::Unproved { from, to, bounds }
}

impl SyntaxNode {
    /// Bounds of the value for all `t` in an interval.
    fn bounds(&self, t: ValueInterval) -> Option<ValueInterval> {
        match self {
            Self::T => Some(t),
            Self::Pi | Self::E | Self::Number(_) => Some(ValueInterval::single_value(self.value(0.0))),
            Self::Negated(a) => a.bounds(t).map(ValueInterval::negated),
            Self::Binary(BinaryOperator::Power, operands) => {
                let base = operands[0].bounds(t)?;
                match operands[1].whole_number() {
                    Some(exponent) => base.whole_power(exponent),
                    None => ValueInterval::binary_bounds(BinaryOperator::Power, base, operands[1].bounds(t)?),
                }
            }
            Self::Binary(op, operands) => {
                ValueInterval::binary_bounds(*op, operands[0].bounds(t)?, operands[1].bounds(t)?)
            }
            Self::Call(f, a) => ValueInterval::call_bounds(*f, a.bounds(t)?),
        }
    }

    /// The value of a literal integer, with or without a sign.
    fn whole_number(&self) -> Option<f64> {
        match self {
            // Whole numbers below 1e15 are exact, so their parity is known.
            Self::Number(value) => (value.fract() == 0.0 && *value < 1e15).then_some(*value),
            Self::Negated(a) => a.whole_number().map(|v| -v),
            _ => None,
        }
    }
}
