//! Speed laws: the relative speed of a trajectory over its normalised time `t` in [0, 1].

pub mod function;
pub mod list;

use function::Expression;
use list::List;
use serde::Serialize;

/// A law of the recipe. Only its shape matters: trajectories divide by its sum.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Speed {
    /// An expression in `t`.
    Function(Expression),
    /// Levels over equal parts, blended.
    List(List),
}

/// A positive function on [0, 1].
pub trait Law {
    /// `v(t)`, dimensionless, positive and finite.
    fn speed(&self, t: f64) -> f64;

    /// What in the law makes speed less than twice differentiable, if anything does.
    fn roughness(&self) -> Option<String>;
}

impl Speed {
    /// The law behind the recipe's choice.
    #[must_use]
    pub fn as_law(&self) -> &dyn Law {
        match self {
            Self::Function(f) => f,
            Self::List(l) => l,
        }
    }
}
