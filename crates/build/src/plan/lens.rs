//! Lenses that do not fit the camera of their source.

use super::Plan;
use gs2e_demo as procedural;
use gs2e_recipe::{Recipe, SceneSource};
use gs2e_scene::camera::{Camera, CameraChoice};

/// A lens of a recipe that folds within the picture, or leaves the field of a pinhole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnfitLens {
    /// Id of the scene.
    pub scene: String,
    /// The fault.
    pub because: String,
}

/// The first lens that does not fit the camera of its source. A source that cannot be read, or whose poses
/// are still to be found, is left to its steps.
#[must_use]
pub fn unfit_lens(plan: &Plan) -> Option<UnfitLens> {
    plan.scenes().iter().find_map(|recipe| {
        let because = lens_fault(recipe)?;
        Some(UnfitLens { scene: recipe.scene.clone(), because })
    })
}

fn lens_fault(recipe: &Recipe) -> Option<String> {
    let choices = recipe.camera.iter().chain(recipe.rig.iter().filter_map(|camera| camera.camera.as_ref()));
    // A camera with a focal length of its own was judged with its recipe.
    let open: Vec<&CameraChoice> =
        choices.filter(|choice| choice.lens.is_some() && choice.resolve(None).is_none()).collect();
    if open.is_empty() {
        return None;
    }
    let own = source_camera(recipe)?;
    open.into_iter().find_map(|choice| choice.resolve(Some(&own))?.check_lens().err())
}

/// The camera of the source.
fn source_camera(recipe: &Recipe) -> Option<Camera> {
    let capture = match &recipe.source {
        SceneSource::Procedural(still_life) => procedural::still_capture(still_life),
        SceneSource::Captured(captured, _) => captured.glance().ok()?.0,
        SceneSource::None => return None,
    };
    capture.camera().map(|(own, _)| own)
}
