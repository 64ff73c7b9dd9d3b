//! Speed laws: the relative speed of a trajectory over its normalised time `t` in [0, 1].

pub mod function;

use function::Expression;
use serde::Serialize;

/// A law of the recipe. Only its shape matters: trajectories divide by its sum.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Speed {
    /// An expression in `t`.
    Function(Expression),
}

/// A positive function on [0, 1] and its integral.
pub trait Law {
    /// `v(t)`, dimensionless.
    fn speed(&self, t: f64) -> f64;
}

impl Speed {
    /// The law behind the recipe's choice.
    #[must_use]
    pub fn as_law(&self) -> &dyn Law {
        match self {
            Self::Function(f) => f,
        }
    }

    /// What in the law makes speed less than twice differentiable, if anything does.
    #[must_use]
    pub fn roughness(&self) -> Option<String> {
        match self {
            Self::Function(f) => f.roughness(),
        }
    }
}
