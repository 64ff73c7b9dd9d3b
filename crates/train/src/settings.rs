//! Parameters of a training.

use gs2e_render::{LayerOrder, RenderChoice, RenderRules, RenderStyle};
use serde::Serialize;

/// Parameters of a training. All of them may change the result, so all are part of a step's key.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrainingSettings {
    /// Number of Gaussians, at most.
    pub gaussians: u32,
    /// Number of iterations.
    pub iterations: u32,
    /// Width of the photos, px, at most.
    pub resolution: u32,
    /// Seed of all draws.
    pub seed: u64,
    /// Every n-th view is held out, the first included; 0 holds out none.
    pub hold_out: u32,
    /// Rendering rules.
    pub rules: RenderRules,
    /// True if opacity is compensated for the screen-space dilation.
    pub antialiased: bool,
    /// Colour behind the scene, 0..1.
    pub background: [f32; 3],
    /// Reasons to end early.
    #[serde(skip_serializing_if = "TrainingGoal::is_none")]
    pub until: TrainingGoal,
}

/// Reasons to end a training before its last iteration.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TrainingGoal {
    /// Mean PSNR of the held-out views that is enough, dB. It is compared at every report.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr: Option<f64>,
    /// Time that is enough, minutes. How many iterations it allows depends on the machine, so a
    /// training that it ends has no promise of equal bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub minutes: Option<f64>,
}

impl TrainingGoal {
    /// Returns true if only the number of iterations ends the training.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for TrainingSettings {
    fn default() -> Self {
        Self {
            gaussians: 200_000,
            iterations: 7000,
            resolution: 640,
            seed: 0,
            hold_out: 8,
            rules: RenderRules::Soft,
            antialiased: false,
            background: [0.0; 3],
            until: TrainingGoal::default(),
        }
    }
}

impl TrainingSettings {
    /// This training, of another rendering.
    #[must_use]
    pub fn with_render(self, render: &RenderChoice) -> Self {
        // A scene that is trained says nothing yet, so `auto` is off.
        let RenderStyle { rules, antialiased, background, .. } = render.resolve(None);
        Self { rules, antialiased, background, ..self }
    }

    pub(super) fn style(&self) -> RenderStyle {
        RenderStyle {
            rules: self.rules,
            order: LayerOrder::Depth,
            antialiased: self.antialiased,
            background: self.background,
        }
    }
}
