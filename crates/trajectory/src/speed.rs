//! Speed laws: the relative speed of a trajectory over its normalised time `t` in [0, 1].

pub mod function;
pub mod list;

use function::SpeedExpression;
use list::SpeedLevels;
use serde::{Deserialize, Serialize};

/// The speed law of a recipe. Only its shape matters: trajectories divide by its sum.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpeedChoice {
    /// An expression in `t`.
    Function(SpeedExpression),
    /// Levels over equal parts of time, blended.
    List(SpeedLevels),
    /// Image speed.
    Flow(FlowSpeed),
}

/// Speed as image motion: the median optical flow over the pixels of a frame, as a function of
/// time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlowSpeed {
    /// Mean over the trajectory, px/s, positive and finite.
    pub px_s: f64,
    /// Shape over the trajectory.
    pub shape: SpeedExpression,
}

/// The part of a speed that is not twice differentiable.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SpeedFault {
    /// The part.
    pub because: String,
    /// Advice for the author of the recipe.
    pub instead: &'static str,
}

/// The effect of large values of a speed law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpeedMeaning {
    /// Relative speed along the path.
    Speed,
    /// Relative density of the frames, at a constant speed; not with `law: integral`.
    FrameRate,
}

/// A positive function on [0, 1].
pub trait SpeedLaw {
    /// `v(t)`, dimensionless, positive and finite.
    fn speed(&self, t: f64) -> f64;

    /// The integrals of the speed from 0 to `k / steps`, for every k from 0 to `steps`.
    fn distances(&self, steps: usize) -> Vec<f64>;

    /// The part of the law that is not twice differentiable, if there is one.
    fn roughness(&self) -> Option<String>;
}

impl SpeedChoice {
    /// The law of the recipe's choice.
    #[must_use]
    pub fn as_law(&self) -> &dyn SpeedLaw {
        match self {
            Self::Function(f) => f,
            Self::List(l) => l,
            Self::Flow(f) => &f.shape,
        }
    }

    /// The reason why a camera at this speed has accelerations that no real one has, if there is one.
    #[must_use]
    pub fn accelerometer_fault(&self) -> Option<SpeedFault> {
        match self {
            // The measured flow of a path has errors, which the second derivative of the path enlarges.
            Self::Flow(_) => Some(SpeedFault {
                because: "`flow` follows a measurement".to_owned(),
                instead: "write speed: { function: \"1\" }, with a duration in the path",
            }),
            Self::List(list) => {
                let instead = "write blend: 0.1, or another number above 0, in the list";
                Some(SpeedFault { because: list.roughness()?, instead })
            }
            Self::Function(function) => {
                let instead = "write a formula without corners, such as 0.25*sin(t) + 1.1";
                Some(SpeedFault { because: function.roughness()?, instead })
            }
        }
    }

    /// The effect of its large values.
    #[must_use]
    pub fn meaning(&self) -> SpeedMeaning {
        match self {
            Self::List(list) => list.meaning(),
            Self::Function(_) | Self::Flow(_) => SpeedMeaning::Speed,
        }
    }
}
