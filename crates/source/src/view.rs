//! One view from a user-named source: of a capture, or of a camera JSON.
//!
//! A camera JSON is an object `{"W", "H", "fx", "fy", "cx", "cy", "R", "t"}`: size, intrinsics in
//! pixels, and the motion from world to camera axes, `x_camera = R x_world + t`, `R` row by row.
//! Axes and pixels are the program's own. Other fields are not read.

use super::kind::CaptureKind;
use super::node::{JsonNode, load_document};
use super::{Capture, CapturedView, LensModel, SourceError, SourceWarning, model, nerfstudio, screen_camera};
use glam::{DMat3, DVec3};
use gs2e_image::Size;
use gs2e_num::se3;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use std::path::Path;

/// Reads the views at `path`: a camera JSON with one view, a `transforms.json`, or a folder with a
/// capture of any kind. Files are distinguished by their content.
///
/// # Errors
/// The reader of the kind fails, or a folder contains no capture or two.
pub fn read_views(path: &Path) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    if super::is_folder(path)? {
        return CaptureKind::kind_of(path)?.read(path);
    }
    let document = load_document(path)?;
    let top = JsonNode::top_node(path, &document);
    if document.is_array() {
        return model::read_capture(path);
    }
    if top.find("frames").is_some() {
        return nerfstudio::read_capture(path);
    }
    let (view, warning) = read_camera(&top)?;
    Ok((vec![view].into(), warning.into_iter().collect()))
}

/// Returns one of the views at a path, with the warnings that concern it.
///
/// Returns `None` if the index is out of range.
#[must_use]
pub fn choose_view(
    capture: Capture,
    warnings: Vec<SourceWarning>,
    index: usize,
) -> Option<(CapturedView, Vec<SourceWarning>)> {
    let view = capture.views.into_iter().nth(index)?;
    let concerns = |warning: &SourceWarning| match warning {
        SourceWarning::Projected { image, .. } | SourceWarning::PhotoSize { image, .. } => {
            *image == view.name
        }
        // These warnings concern all views together. The warning for this view is added below.
        SourceWarning::DistortionIgnored { .. } | SourceWarning::CamerasDiffer { .. } => false,
        SourceWarning::PhotosMissing { .. } | SourceWarning::FewViews { .. } => false,
        SourceWarning::CountsDiffer { .. } | SourceWarning::Exposure { .. } => true,
    };
    let mut kept: Vec<SourceWarning> = warnings.into_iter().filter(concerns).collect();
    let alone = Capture::from(vec![view.clone()]);
    kept.extend(alone.distortion());
    Some((view, kept))
}

fn read_camera(top: &JsonNode<'_>) -> Result<(CapturedView, Option<SourceWarning>), SourceError> {
    let size = Size { width: top.get("W")?.side()?, height: top.get("H")?.side()? };
    let [fx, fy, cx, cy] = ["fx", "fy", "cx", "cy"].map(|key| top.get(key)?.number());
    let camera = Camera { size, fx: fx?, fy: fy?, cx: cx?, cy: cy?, lens: None };
    screen_camera(&camera, &LensModel::Pinhole).map_err(|e| top.fault(e))?;
    let rows = top.get("R")?;
    // The file has rows, `from_cols_array_2d` takes columns.
    let screened = se3::rotation_from_matrix(&DMat3::from_cols_array_2d(&rows.matrix()?).transpose())
        .map_err(|e| rows.fault(e.to_string()))?;
    let translation = DVec3::from_array(top.get("t")?.numbers()?);
    let camera_from_world = Se3 { rotation: screened.rotation, translation };
    let file = top.path().file_name().unwrap_or_default();
    let name = file.to_string_lossy().into_owned();
    let deviation = screened.deviation;
    let warning = screened.projected.then(|| SourceWarning::Projected { image: name.clone(), deviation });
    let world_from_camera = camera_from_world.inverse();
    Ok((CapturedView { name, world_from_camera, camera, lens: LensModel::Pinhole, sha256: None }, warning))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// A turn by 90 degrees about y, world to camera: the world's x is the camera's -z.
    fn planted() -> Value {
        json!({ "W": 64, "H": 48.0, "fx": 60, "fy": 61.5, "cx": 31.5, "cy": 24,
            "R": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], "t": [1, 2, 3], "note": "not read" })
    }

    fn written(file: &str, value: &Value) -> (tempfile::TempDir, std::path::PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(file);
        std::fs::write(&path, value.to_string()).unwrap();
        (dir, path)
    }

    #[test]
    fn a_camera_json_is_one_view() {
        let (_dir, path) = written("camera.json", &planted());
        let view_at = |index: usize| {
            let (capture, warnings) = read_views(&path).unwrap();
            choose_view(capture, warnings, index)
        };
        let (view, message) = view_at(0).unwrap();
        let size = Size { width: 64, height: 48 };
        assert_eq!(view.camera, Camera { size, fx: 60.0, fy: 61.5, cx: 31.5, cy: 24.0, lens: None });
        assert_eq!((view.name.as_str(), view.lens, message), ("camera.json", LensModel::Pinhole, Vec::new()));
        // Images of three points, world to camera, computed by hand: (z + 1, y + 2, -x + 3).
        // Entries of 1 and 0 pass through a quaternion with roundings of 1e-16 each.
        let camera_from_world = view.world_from_camera.inverse();
        for ([x, y, z], wanted) in [
            ([0.0, 0.0, 0.0], [1.0, 2.0, 3.0]),
            ([1.0, 0.0, 0.0], [1.0, 2.0, 2.0]),
            ([0.0, 5.0, -4.0], [-3.0, 7.0, 3.0]),
        ] {
            let found = camera_from_world.rotation * DVec3::new(x, y, z) + camera_from_world.translation;
            assert!((found - DVec3::from_array(wanted)).length() < 1e-14, "{found}");
        }
        assert!(view_at(1).is_none());
    }

    #[test]
    fn a_rotation_that_is_none_by_little_is_told() {
        let mut camera = planted();
        camera["R"][1][1] = json!(1.0001);
        let (_dir, path) = written("camera.json", &camera);
        let (capture, warnings) = read_views(&path).unwrap();
        let (_, found) = choose_view(capture, warnings, 0).unwrap();
        assert!(
            matches!(&found[..], [SourceWarning::Projected { image, .. }] if image == "camera.json"),
            "{found:?}"
        );
    }

    #[test]
    fn what_is_wrong_is_told_with_its_field() {
        let t = |key: &str, value: Value, wanted: &str| {
            let mut camera = planted();
            camera[key] = value;
            let (_dir, path) = written("camera.json", &camera);
            let error = read_views(&path).unwrap_err().to_string();
            assert!(error.contains(wanted), "{key}: {error}");
        };
        t("W", json!(null), "`W`: it is missing");
        t("W", json!(0), "`W`: 0, wanted a whole number of pixels");
        t("H", json!(1.5), "`H`: 1.5, wanted a whole number of pixels");
        t("H", json!(200_000), "the image size is 64x200000");
        t("fx", json!("60"), "`fx`: \"60\", wanted a number");
        t("fy", json!(-1), "the focal length is -1");
        t("cx", json!(null), "`cx`: it is missing");
        t("R", json!([[1, 0, 0], [0, 1, 0]]), "`R`: [[1,0,0],[0,1,0]], wanted 3 rows of 3 numbers");
        t("R", json!([[1, 0, 0], [0, 1, 0], [0, 0, 2]]), "`R`: a rotation is not orthonormal");
        t("R", json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]]), "`R`: a rotation contains a reflection");
        t("t", json!([1, 2]), "`t`: [1,2], wanted 3 numbers");
        t("frames", json!([]), "it contains no view");
    }
}
