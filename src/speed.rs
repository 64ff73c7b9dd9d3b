//! Speed laws: the relative speed of a trajectory over its normalised time `t` in [0, 1].

pub mod function;
pub mod list;

use function::Expression;
use list::List;
use serde::{Deserialize, Serialize};

/// A law of the recipe. Only its shape matters: trajectories divide by its sum.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Speed {
    /// An expression in `t`.
    Function(Expression),
    /// Levels over equal parts, blended.
    List(List),
    /// How fast the picture moves.
    Flow(Flow),
}

/// Speed by what the camera sees: the median optical flow, over the pixels of a frame, as a function of time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Flow {
    /// Its mean over the trajectory, px/s, positive and finite.
    pub px_s: f64,
    /// Its shape.
    pub shape: Expression,
}

/// What large values of a speed law mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Meaning {
    /// Large steps at a constant frame rate.
    Speed,
    /// Many frames: small steps in little time, at a constant speed.
    FrameRate,
}

/// A positive function on [0, 1].
pub trait Law {
    /// `v(t)`, dimensionless, positive and finite.
    fn speed(&self, t: f64) -> f64;

    /// The integral of the speed from 0 to `k / steps`, for every k from 0 to `steps`.
    fn distances(&self, steps: usize) -> Vec<f64>;

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
            Self::Flow(f) => &f.shape,
        }
    }

    /// What its large values mean.
    #[must_use]
    pub fn meaning(&self) -> Meaning {
        match self {
            Self::List(list) => list.meaning(),
            Self::Function(_) | Self::Flow(_) => Meaning::Speed,
        }
    }
}
