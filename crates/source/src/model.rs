//! 3DGS model folders (GitHub graphdeco-inria/gaussian-splatting): the cameras that a scene was
//! trained with.
//!
//! `cameras.json` is a list (`utils/camera_utils.py`, `camera_to_JSON`): `img_name`, `width`,
//! `height`, `fx`, `fy`, `position` (the camera's centre) and `rotation` (rows, camera to world,
//! OpenCV camera axes). Its order is the order of training, which has no meaning. It has no
//! principal point; training assumes the centre of the image. Its sizes are those after the rescale
//! of large photos. It has no lenses, because training uses undistorted photos.
//!
//! `exposure.json`, which newer trainers write, is a mapping from `img_name` to a colour transform
//! of 3x4. It is read only to report that exposures were trained. `cfg_args` is Python text about
//! the training without poses, and is not read.

use super::layout::CaptureLayout;
use super::node::{JsonNode, load_document};
use super::photo::{PhotoScrutiny, or_here};
use super::{
    Capture, CapturedView, DiskCapture, FoundView, LensModel, SourceError, SourceWarning, collect_views,
    screen_camera,
};
use glam::{DMat3, DVec3};
use gs2e_files::is_there;
use gs2e_image::Size;
use gs2e_num::se3;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use std::path::{Path, PathBuf};

/// Name of the file that identifies a model folder.
const CAMERAS: &str = "cameras.json";
/// Folder of the Gaussians: one subfolder per saved iteration, with one file in each.
const SCENES: &str = "point_cloud";
const ITERATION: &str = "iteration_";
const SCENE: &str = "point_cloud.ply";
/// Name of the file with the colour transforms.
const EXPOSURES: &str = "exposure.json";

/// The identity colour transform.
const NEUTRAL: [[f64; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
/// Maximum difference of an entry from the identity. Three channels and a constant then change a
/// colour by at most 4 * 4e-4 * 255 = 0.41 of an 8-bit level, so no 8-bit colour changes.
const NEAR: f64 = 4e-4;

/// Returns the path of the camera file, given the file or its folder.
pub(super) fn locate_cameras(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(CAMERAS) } else { path.to_owned() }
}

/// Returns true if a file has the name of the camera file.
pub(super) fn is_cameras(file: &Path) -> bool {
    file.file_name().is_some_and(|name| name == CAMERAS)
}

/// 3DGS model folders.
pub(super) struct ModelLayout;

impl CaptureLayout for ModelLayout {
    fn name(&self) -> &'static str {
        "model"
    }

    fn words(&self) -> &'static str {
        "a cameras.json"
    }

    fn is_in(&self, folder: &Path) -> bool {
        is_there(&locate_cameras(folder))
    }

    fn is_file(&self, file: &Path) -> bool {
        is_cameras(file)
    }

    fn read(
        &self,
        captured: &DiskCapture,
        _: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        read_capture(&captured.path)
    }

    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        let file = locate_cameras(&captured.path);
        let exposures = file.with_file_name(EXPOSURES);
        let exposures = is_there(&exposures).then(|| (EXPOSURES.to_owned(), exposures));
        Ok([(CAMERAS.to_owned(), file)].into_iter().chain(exposures).collect())
    }

    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf> {
        vec![or_here(locate_cameras(&captured.path).parent().unwrap_or(Path::new("")))]
    }

    fn has_gaussians(&self) -> bool {
        true
    }
}

/// Reads a model folder, or its `cameras.json`, as a capture. The photos are not part of the
/// folder.
///
/// # Errors
/// The folder is no model folder, a value is missing or wrong, a pose is invalid, or two images
/// have the same name.
pub fn read_capture(path: &Path) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let file = locate_cameras(path);
    let document = load_document(&file)?;
    let mut warnings = Vec::new();
    let mut found = Vec::new();
    for camera in JsonNode::top_node(&file, &document).elements()? {
        let (view, warning) = read_camera(&camera)?;
        warnings.extend(warning);
        found.push(FoundView { view, place: camera.place() });
    }
    let exposures = file.with_file_name(EXPOSURES);
    if is_there(&exposures) {
        warnings.extend(exposure_warning(&exposures)?);
    }
    Ok((collect_views(&file, found)?, warnings))
}

/// Returns the newest Gaussians of a model folder, given the folder or its `cameras.json`. The
/// newest are those with the highest iteration.
///
/// # Errors
/// The folder has no Gaussians, or it cannot be listed.
pub fn newest_scene(path: &Path) -> Result<PathBuf, SourceError> {
    let scenes = scenes_folder(path);
    let kept = list_iterations(&scenes)?;
    // The last iteration may still be in training: its folder then exists before its file.
    let newest = kept.into_iter().filter(|(_, dir)| is_there(&dir.join(SCENE))).max();
    newest.map(|(_, dir)| dir.join(SCENE)).ok_or_else(|| SourceError::Absent {
        dir: scenes,
        because: format!("it contains no Gaussians, wanted {ITERATION}N/{SCENE}"),
    })
}

/// Returns the folders whose listing determines [`newest_scene`].
#[must_use]
pub fn scene_folders(path: &Path) -> Vec<PathBuf> {
    let scenes = scenes_folder(path);
    let iterations = list_iterations(&scenes).unwrap_or_default();
    [scenes].into_iter().chain(iterations.into_iter().map(|(_, dir)| dir)).collect()
}

fn scenes_folder(path: &Path) -> PathBuf {
    or_here(locate_cameras(path).parent().unwrap_or(Path::new(""))).join(SCENES)
}

/// Returns the folders of iterations, by number.
fn list_iterations(scenes: &Path) -> Result<Vec<(u64, PathBuf)>, SourceError> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(scenes).map_err(SourceError::io_error(scenes))? {
        let path = entry.map_err(SourceError::io_error(scenes))?.path();
        let name =
            path.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_prefix(ITERATION));
        if let Some(number) = name.and_then(|number| number.parse().ok()) {
            found.push((number, path));
        }
    }
    // By number: by name, iteration 30000 would come before iteration 7000.
    found.sort();
    Ok(found)
}

/// Reads a view, with a warning if there is one.
fn read_camera(camera: &JsonNode<'_>) -> Result<(CapturedView, Option<SourceWarning>), SourceError> {
    let name = camera.text("img_name")?.to_owned();
    let size = Size { width: camera.get("width")?.side()?, height: camera.get("height")?.side()? };
    let [fx, fy] = [camera.get("fx")?.number()?, camera.get("fy")?.number()?];
    let [cx, cy] = [f64::from(size.width) / 2.0, f64::from(size.height) / 2.0];
    let pinhole = Camera { size, fx, fy, cx, cy, lens: None };
    screen_camera(&pinhole, &LensModel::Pinhole).map_err(|e| camera.fault(e))?;
    let translation = DVec3::from_array(camera.get("position")?.numbers()?);
    let rows = camera.get("rotation")?;
    // The file has rows, `from_cols_array_2d` takes columns.
    let screened = se3::rotation_from_matrix(&DMat3::from_cols_array_2d(&rows.matrix()?).transpose())
        .map_err(|e| rows.fault(e.to_string()))?;
    let deviation = screened.deviation;
    let warning = screened.projected.then(|| SourceWarning::Projected { image: name.clone(), deviation });
    let world_from_camera = Se3 { rotation: screened.rotation, translation };
    Ok((
        CapturedView { name, world_from_camera, camera: pinhole, lens: LensModel::Pinhole, sha256: None },
        warning,
    ))
}

/// Returns a warning if colour transforms were trained, because trajectories do not apply them.
fn exposure_warning(file: &Path) -> Result<Option<SourceWarning>, SourceError> {
    let document = load_document(file)?;
    let mut count = 0;
    for exposure in JsonNode::top_node(file, &document).members()? {
        let transform: [[f64; 4]; 3] = exposure.matrix()?;
        let parts = transform.as_flattened().iter().zip(NEUTRAL.as_flattened());
        count += usize::from(parts.into_iter().any(|(found, neutral)| (found - neutral).abs() > NEAR));
    }
    Ok((count > 0).then_some(SourceWarning::Exposure { count }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kind::CaptureKind;
    use serde_json::{Value, json};

    /// Rotations of 90 degrees about y and about z, and centres. The training order differs from
    /// the order of names.
    fn planted() -> Value {
        json!([
            { "id": 0, "img_name": "img 10", "width": 1600, "height": 899, "position": [1.0, 2.0, 3.0],
              "rotation": [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], "fy": 1001.5, "fx": 1000.25 },
            { "id": 1, "img_name": "img 9", "width": 1600.0, "height": 900, "position": [-1e-3, 0.0, 4e6],
              "rotation": [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "fy": 1000.0, "fx": 1000.0 },
        ])
    }

    fn folder(cameras: &str, exposures: Option<&str>) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join(CAMERAS), cameras).unwrap();
        if let Some(text) = exposures {
            std::fs::write(dir.path().join(EXPOSURES), text).unwrap();
        }
        dir
    }

    #[test]
    fn cameras_are_read_as_they_were_planted() {
        let dir = folder(&planted().to_string(), None);
        let (capture, warnings) = read_capture(dir.path()).unwrap();
        assert_eq!(warnings, []);
        let [first, second] = &capture.views[..] else { panic!("{capture:?}") };
        assert_eq!([first.name.as_str(), second.name.as_str()], ["img 9", "img 10"]);
        assert_eq!(second.world_from_camera.translation, DVec3::new(1.0, 2.0, 3.0));
        let wanted = Camera::pinhole(Size { width: 1600, height: 899 }, [1000.25, 1001.5, 800.0, 449.5]);
        assert_eq!((second.camera, &second.lens), (wanted, &LensModel::Pinhole));
        // The camera's own axes in the world: the columns of the matrix, which is stored in rows.
        for (view, axes) in
            [(first, [DVec3::Y, -DVec3::X, DVec3::Z]), (second, [-DVec3::Z, DVec3::Y, DVec3::X])]
        {
            for (own, wanted) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(axes) {
                let found = view.world_from_camera.rotation * own;
                // The conversion of a quaternion to a matrix costs a few roundings of numbers up to
                // 1.
                assert!((found - wanted).length() < 2e-15, "{}: {own} to {found}", view.name);
            }
        }
        // The path of the file is equivalent to the path of its folder.
        assert_eq!(read_capture(&dir.path().join(CAMERAS)).unwrap().0, capture);
    }

    #[test]
    fn what_is_read_is_listed() {
        let model = |path: &Path| DiskCapture::all_views(CaptureKind::Model, path.to_owned());
        let names = |dir: &Path| -> Vec<String> {
            model(dir).files().unwrap().into_iter().map(|(name, _)| name).collect()
        };
        let dir = folder("[]", Some("{}"));
        assert_eq!(names(dir.path()), [CAMERAS, EXPOSURES]);
        assert_eq!(names(folder("[]", None).path()), [CAMERAS]);
        assert_eq!(model(dir.path()).folders(), [dir.path()]);
        assert_eq!(model(Path::new(CAMERAS)).folders(), [Path::new(".")]);
    }

    #[test]
    fn the_newest_scene_is_the_one_of_most_iterations() {
        let dir = folder("[]", None);
        let scenes = dir.path().join(SCENES);
        assert!(matches!(newest_scene(dir.path()).unwrap_err(), SourceError::Io { .. }), "no folder at all");
        std::fs::create_dir(&scenes).unwrap();
        let message = newest_scene(dir.path()).unwrap_err().to_string();
        assert!(
            message.contains("point_cloud") && message.contains("wanted iteration_N/point_cloud.ply"),
            "{message}"
        );
        for name in ["iteration_7000", "iteration_30000", "iteration_100000", "iteration_best", "notes"] {
            std::fs::create_dir(scenes.join(name)).unwrap();
            // The last iteration is still being trained: its file does not exist yet.
            if name != "iteration_100000" {
                std::fs::write(scenes.join(name).join(SCENE), "").unwrap();
            }
        }
        let newest = scenes.join("iteration_30000").join(SCENE);
        assert_eq!(newest_scene(dir.path()).unwrap(), newest);
        assert_eq!(newest_scene(&dir.path().join(CAMERAS)).unwrap(), newest);
        let watched = ["", "iteration_7000", "iteration_30000", "iteration_100000"];
        assert_eq!(
            scene_folders(dir.path()),
            watched.map(|name| scenes.join(name).components().collect::<PathBuf>())
        );
    }

    #[test]
    fn trained_exposures_are_told() {
        let t = |exposures: Value, wanted: Option<usize>| {
            let dir = folder(&planted().to_string(), Some(&exposures.to_string()));
            let found = read_capture(dir.path()).unwrap().1;
            assert_eq!(
                found,
                wanted.map(|count| SourceWarning::Exposure { count }).into_iter().collect::<Vec<_>>()
            );
        };
        t(json!({}), None);
        t(json!({ "img 9": NEUTRAL, "img 10": NEUTRAL }), None);
        let mut brighter = NEUTRAL;
        brighter[1][3] = 0.05;
        t(json!({ "img 9": NEUTRAL, "img 10": brighter }), Some(1));
    }

    #[test]
    fn what_cannot_be_read_is_told_with_its_place() {
        let t = |change: &dyn Fn(&mut Value), wanted: &str| {
            let mut cameras = planted();
            change(&mut cameras);
            let dir = folder(&cameras.to_string(), None);
            let message = read_capture(dir.path()).unwrap_err().to_string();
            assert_eq!(message, format!("{}: {wanted}", dir.path().join(CAMERAS).display()));
        };
        let set =
            |key: &'static str, value: Value| move |cameras: &mut Value| cameras[1][key] = value.clone();
        t(&|c| *c = json!({ "frames": [] }), "line 1: {\"frames\":[]}, wanted a list");
        t(&|c| *c = json!([]), "it contains no view");
        t(&set("img_name", json!("img 10")), "`[1]`: the image name `img 10` is already used by `[0]`");
        t(&set("img_name", Value::Null), "`[1].img_name`: it is missing, wanted a value");
        t(&set("width", json!(0)), "`[1].width`: 0, wanted a whole number of pixels");
        t(&set("width", json!(1.5)), "`[1].width`: 1.5, wanted a whole number of pixels");
        t(
            &set("height", json!(200_000)),
            "`[1]`: the image size is 1600x200000, wanted sides of 1 to 100000",
        );
        t(&set("fy", json!(-3.0)), "`[1]`: the focal length is -3, wanted a positive number of pixels");
        t(&set("fx", json!("wide")), "`[1].fx`: \"wide\", wanted a number");
        t(&set("position", json!([1.0, 2.0])), "`[1].position`: [1.0,2.0], wanted 3 numbers");
        t(&set("rotation", json!([[1, 0, 0]])), "`[1].rotation`: [[1,0,0]], wanted 3 rows of 3 numbers");
        t(
            &set("rotation", json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]])),
            "`[1].rotation`: a rotation contains a reflection: its determinant is -1.000000, wanted 1",
        );
        t(
            &set("rotation", json!([[1, 0, 0], [0, 1, 0], [0, 0, 2]])),
            "`[1].rotation`: a rotation is not orthonormal: it deviates by 3.000e0, wanted at most 1e-3",
        );
    }

    #[test]
    fn a_file_that_is_none_is_told_with_its_line() {
        let dir = folder("[\n{ \"id\": NaN }]", None);
        let message = read_capture(dir.path()).unwrap_err().to_string();
        assert!(message.contains("cameras.json: line 2: "), "{message}");
        let gone = read_capture(&dir.path().join("gone")).unwrap_err();
        assert!(matches!(gone, SourceError::Io { .. }), "{gone}");
        let odd = folder(&planted().to_string(), Some("{\"a\": [[1, 0], [0, 1]]}"));
        let message = read_capture(odd.path()).unwrap_err().to_string();
        assert!(
            message.ends_with("exposure.json: `a`: [[1,0],[0,1]], wanted 3 rows of 4 numbers"),
            "{message}"
        );
    }

    #[test]
    fn a_rotation_that_is_slightly_off_is_told() {
        let mut cameras = planted();
        cameras[0]["rotation"][1][1] = json!(1.0 + 1e-5);
        let dir = folder(&cameras.to_string(), None);
        let warnings = read_capture(dir.path()).unwrap().1;
        let [SourceWarning::Projected { image, deviation }] = &warnings[..] else { panic!("{warnings:?}") };
        // |R^T R - I| is (1 + e)^2 - 1.
        assert!(image == "img 10" && (deviation - 2e-5).abs() < 2e-10, "{deviation}");
    }
}
