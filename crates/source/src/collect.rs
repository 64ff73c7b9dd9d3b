//! Views that a reader found, made into a capture.

use super::{Capture, CapturedView, LensModel, SourceError, SourcePlace};
use gs2e_files::natural;
use gs2e_image::MAX_PIXELS;
use gs2e_scene::camera::Camera;
use std::path::Path;

/// A view before it is collected, with its place in the source.
pub(super) struct FoundView {
    pub(super) view: CapturedView,
    pub(super) place: SourcePlace,
}

/// Collects views into a capture, sorted by name.
///
/// # Errors
/// There are no views, or a name appears twice or has a control character.
pub(super) fn collect_views(path: &Path, mut found: Vec<FoundView>) -> Result<Capture, SourceError> {
    if let Some(odd) = found.iter().find(|found| found.view.name.contains(char::is_control)) {
        let because = format!("the image name {:?} holds a control character", odd.view.name);
        return Err(SourceError::Content { path: path.to_owned(), place: odd.place.clone(), because });
    }
    found.sort_by(|a, b| natural::compare_names(&a.view.name, &b.view.name));
    // The order is total, so equal names are neighbours.
    if let Some([first, second]) = found.array_windows().find(|[a, b]| a.view.name == b.view.name) {
        let because = format!("the image name `{}` is already used by {}", second.view.name, first.place);
        return Err(SourceError::Content { path: path.to_owned(), place: second.place.clone(), because });
    }
    if found.is_empty() {
        return Err(SourceError::Absent { dir: path.to_owned(), because: "it contains no view".to_owned() });
    }
    Ok(found.into_iter().map(|f| f.view).collect::<Vec<CapturedView>>().into())
}

/// Largest accepted side of a photo, px.
const MAX_PIXELS_A_SIDE: f64 = 100_000.0;

/// Checks the plausibility of a camera: sides from 1 to 100,000 pixels, focal lengths finite and
/// positive, all other numbers finite.
pub(super) fn screen_camera(camera: &Camera, lens: &LensModel) -> Result<(), String> {
    for side in [camera.size.width, camera.size.height] {
        if !(1.0..=MAX_PIXELS_A_SIDE).contains(&f64::from(side)) {
            return Err(format!(
                "the image size is {}, wanted sides of 1 to {MAX_PIXELS_A_SIDE}",
                camera.size
            ));
        }
    }
    // Both sides may be acceptable, and their product still be too large.
    if camera.size.pixels() > MAX_PIXELS {
        return Err(format!("the image size is {}, wanted at most {MAX_PIXELS} pixels", camera.size));
    }
    for f in [camera.fx, camera.fy] {
        if !(f.is_finite() && f > 0.0) {
            return Err(format!("the focal length is {f}, wanted a positive number of pixels"));
        }
    }
    let rest = [camera.cx, camera.cy].into_iter().chain(lens.coefficients());
    match rest.into_iter().find(|v| !v.is_finite()) {
        Some(bad) => Err(format!("a camera parameter is {bad}, wanted a finite number")),
        None => Ok(()),
    }
}
