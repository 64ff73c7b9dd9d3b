//! The products that a recipe asks for, each with its name and its settings. Other files loop over
//! them: the steps are made in `plan::wire`, and the files described in `release::products`.

use super::Recipe;
use super::canonical::{fields_without, ratio_value};
use super::field::Field;
use super::schema::{EverySection, RecipeSchema, SharpSection};
use super::text::TextSpan;
use gs2e_trajectory::imu::{ImuModel, ImuPreset};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A product of each trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutputKind {
    /// The event stream of each sensor.
    Events,
    /// Sharp frames, 8-bit sRGB PNG.
    Sharp,
    /// Blurred frames, 8-bit sRGB PNG.
    Blur,
    /// Depth images, float32 `.npy`.
    Depth,
    /// Optical flow images, float32 `.npy`.
    Flow,
    /// Disparity of the stereo pairs of a rig, float32 `.npy`, for the first camera of each.
    Disparity,
    /// The object that each pixel shows, 8-bit grey PNG.
    Segmentation,
    /// Inertial data, CSV in the form of EuRoC.
    Imu,
}

impl OutputKind {
    /// All outputs, in the order of their steps.
    pub const ALL: [Self; 8] = [
        Self::Events,
        Self::Sharp,
        Self::Blur,
        Self::Depth,
        Self::Flow,
        Self::Disparity,
        Self::Segmentation,
        Self::Imu,
    ];

    /// Outputs of a recipe that names none.
    pub(super) const DEFAULT: [Self; 2] = [Self::Events, Self::Sharp];

    /// Name of the output in recipes. It is also the name of its step, and of its folder in the
    /// release.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Events => "events",
            Self::Sharp => "sharp",
            Self::Blur => "blur",
            Self::Depth => "depth",
            Self::Flow => "flow",
            Self::Disparity => "disparity",
            Self::Segmentation => "segmentation",
            Self::Imu => "imu",
        }
    }

    /// Returns true if it is measured on the path, without a rendering.
    #[must_use]
    pub fn is_measured(self) -> bool {
        self == Self::Imu
    }

    /// Returns true if it is simulated from frames, at times that the frames must resolve.
    #[must_use]
    pub fn is_simulated(self) -> bool {
        self == Self::Events
    }

    /// Returns true if `transforms.json` lists its pictures.
    #[must_use]
    pub fn is_listed(self) -> bool {
        self == Self::Sharp
    }

    /// Returns true if it compares the cameras of a stereo pair, and belongs to the first one.
    pub(crate) fn is_of_pair(self) -> bool {
        self == Self::Disparity
    }

    /// Returns true if it shows the objects of a scene, without which it is empty.
    pub(crate) fn shows_objects(self) -> bool {
        self == Self::Segmentation
    }

    /// The settings of this output in a recipe's full form, under the key of its name. A recipe
    /// without the output shows none, except for sharp frames, whose settings are always shown.
    pub(super) fn settings(self, recipe: &Recipe) -> Option<Value> {
        let asked = recipe.outputs.contains(&self);
        match self {
            Self::Events => None,
            Self::Blur => asked.then(|| json!(recipe.shutter)),
            Self::Imu => recipe.imu.as_ref().map(imu_value),
            Self::Sharp | Self::Depth | Self::Flow | Self::Disparity | Self::Segmentation => {
                let shown = asked || self == Self::Sharp;
                let mut settings = json!({ "every": recipe.every.poses(self) });
                if let Some(readout_us) = recipe.readout_us.filter(|_| self == Self::Sharp) {
                    settings["readout_us"] = json!(readout_us);
                }
                shown.then_some(settings)
            }
        }
    }
}

/// The settings of an inertial sensor, without the size of the scene, which has a section of its own.
fn imu_value(imu: &ImuModel) -> Value {
    let mut value = fields_without(imu, &["metres_per_unit"]);
    value["preset"] = json!(ImuPreset::Ideal);
    value["rate"] = ratio_value(imu.rate.0);
    value
}

/// The places of the sections of outputs in a recipe.
pub(super) fn sections(raw: &RecipeSchema) -> [(OutputKind, Option<TextSpan>); 7] {
    [
        (OutputKind::Blur, raw.blur.place()),
        (OutputKind::Depth, raw.depth.place()),
        (OutputKind::Flow, raw.flow.place()),
        (OutputKind::Disparity, raw.disparity.place()),
        (OutputKind::Segmentation, raw.segmentation.place()),
        (OutputKind::Sharp, raw.sharp.place()),
        (OutputKind::Imu, raw.imu.place()),
    ]
}

/// The spacing of pictures as a recipe writes it: in poses, or in pictures per second.
#[derive(Debug, Clone, Copy)]
pub(super) struct WrittenSpacing<'a> {
    pub(super) every: &'a Field<u64>,
    pub(super) fps: &'a Field<f64>,
}

/// The spacing of a section that may be left out; `None` if the section is faulty.
fn spacing_of<T>(
    section: &Field<T>,
    fields: impl FnOnce(&T) -> WrittenSpacing<'_>,
) -> Option<WrittenSpacing<'_>> {
    match section {
        Field::Absent => Some(WrittenSpacing { every: &Field::Absent, fps: &Field::Absent }),
        Field::Bad => None,
        Field::Given(section, _) => Some(fields(section)),
    }
}

/// Number of poses per picture, for each kind of picture with a spacing. Sharp frames in the middle
/// of an exposure are kept in addition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PictureSpacing(BTreeMap<OutputKind, u32>);

impl PictureSpacing {
    /// The spacings that a recipe writes; `None` for one whose section is faulty.
    pub(super) fn written(raw: &RecipeSchema) -> [(OutputKind, Option<WrittenSpacing<'_>>); 5] {
        let of = |section| spacing_of(section, |EverySection { every, fps }| WrittenSpacing { every, fps });
        let sharp = spacing_of(&raw.sharp, |SharpSection { every, fps, .. }| WrittenSpacing { every, fps });
        [
            (OutputKind::Sharp, sharp),
            (OutputKind::Depth, of(&raw.depth)),
            (OutputKind::Flow, of(&raw.flow)),
            (OutputKind::Disparity, of(&raw.disparity)),
            (OutputKind::Segmentation, of(&raw.segmentation)),
        ]
    }

    pub(super) fn from_spacings(spacings: BTreeMap<OutputKind, u32>) -> Self {
        Self(spacings)
    }

    /// Poses per picture; 1 for an output without a spacing.
    #[must_use]
    pub fn poses(&self, output: OutputKind) -> u32 {
        self.0.get(&output).copied().unwrap_or(1)
    }
}

impl Recipe {
    /// Returns true if any trajectory or camera has an output.
    pub(super) fn asks_for(&self, output: OutputKind) -> bool {
        self.outputs.contains(&output) || self.rig.iter().any(|camera| camera.outputs.contains(&output))
    }

    /// Returns true if sharp frames are made.
    #[must_use]
    pub fn has_sharp(&self) -> bool {
        self.outputs.contains(&OutputKind::Sharp)
    }

    /// Returns true if sharp frames are made along a trajectory.
    #[must_use]
    pub fn has_sharp_along(&self, trajectory: &str) -> bool {
        self.outputs_of(trajectory).contains(&OutputKind::Sharp)
    }

    /// Dense frames per exposure, if blurred frames are made along a trajectory.
    #[must_use]
    pub fn exposed_along(&self, trajectory: &str) -> Option<u32> {
        self.outputs_of(trajectory).contains(&OutputKind::Blur).then_some(self.shutter.frames)
    }
}
