//! Attributes of a scene, by which users of a release select scenes.

use super::{QuantityExtent, TrajectoryPart};
use crate::products::products;
use crate::provenance::Provenance;
use gs2e_recipe::{Recipe, SceneScale};
use gs2e_source::licence::{ComposedTerms, Redistributability};
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::speed::SpeedMeaning;
use serde::{Deserialize, Serialize};

/// The axes of appendix D of the paper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneAttributes {
    /// `sharp`, `blurry`: the kinds of pictures in the tree.
    pub data_type: Vec<String>,
    /// `object`, `medium`, `large` or `unknown`.
    pub scene_scale: String,
    /// True: poses are exact.
    pub gt_poses: bool,
    /// `uniform` if the speed varies by at most 1 %.
    pub speed_profile: String,
    /// True if there is more than one trajectory.
    pub multi_trajectory: bool,
    /// Simulated device.
    pub device: String,
    /// The source.
    pub data_source: String,
}

/// Composes the attributes of a scene.
pub(super) fn scene_attributes<'r>(
    recipe: &Recipe,
    licence: &ComposedTerms,
    mut reports: impl Iterator<Item = &'r SpeedReport>,
    trajectories: &[TrajectoryPart],
) -> SceneAttributes {
    let is_included = licence.passing != Redistributability::Withheld;
    let made = products().filter(|product| is_included && recipe.outputs.contains(&product.output));
    // If the law varies the frame rate instead of the camera's speed, the speed is uniform by
    // definition.
    let is_uniform = |report: &SpeedReport| {
        report.meaning == SpeedMeaning::FrameRate
            || QuantityExtent::from_values(&report.u).is_none_or(|range| range.max <= UNIFORM * range.min)
    };
    // Lengths of captures are arbitrary, so only the dataset indicates the size of objects.
    let kind = recipe.source.kind();
    let (scale, data_source) =
        kind.dataset().map_or(("unknown", kind.name()), |dataset| (dataset.scale, dataset.name));
    let uniform = reports.all(is_uniform);
    SceneAttributes {
        data_type: made.filter_map(|product| product.data_type).map(str::to_owned).collect(),
        scene_scale: recipe.scale.map_or(scale, SceneScale::name).into(),
        gt_poses: true,
        speed_profile: if uniform { "uniform" } else { "non-uniform" }.into(),
        // The cameras of a rig are on one trajectory.
        multi_trajectory: recipe.trajectories.iter().filter(|path| path.mounted.is_none()).count() > 1,
        device: Provenance::device(trajectories),
        data_source: data_source.into(),
    }
}

/// Speeds are called uniform if their extremes differ by no more than this factor.
const UNIFORM: f64 = 1.01;
