//! Calibration of a rig, in the folder `calibration` of a trajectory of the body: `camchain.yaml` in Kalibr's
//! form, `cam_to_cam.yaml` in DSEC's, and the maps of stereo pairs.
//!
//! Cameras are numbered in the order of the recipe, from 0, and each file names them. Lengths are in scene
//! units. Pixels are OpenCV's, with the centre of the first pixel at (0, 0), so that principal points are
//! half a pixel less than those of `scene.json`. Rectified cameras have no distortion. Kalibr's forms are
//! those of its wiki ("YAML formats"), and DSEC's those of its description of `cam_to_cam.yaml`: `T_XY` maps
//! points of camera Y to points of camera X, and `R_rectX` maps points of camera X to those of its rectified
//! version.

use super::scene::{SceneRecord, TrajectoryPart};
use gs2e_image::npy;
use gs2e_recipe::{Recipe, RigCamera};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::stereo::Rectification;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// The folder, in that of a body's trajectory.
pub(super) const FOLDER: &str = "calibration";
/// Name of the file in Kalibr's form.
const KALIBR: &str = "camchain.yaml";
/// Name of the file in DSEC's form.
const DSEC: &str = "cam_to_cam.yaml";
/// Ends of the names of the maps of a camera, after its own name: DSEC's, and that of OpenCV's `remap`.
const MAPS: [&str; 2] = ["_rectify_map.npy", "_remap.npy"];

/// Names of the files of a trajectory, by the description of its scene; maps only if they are passed on.
pub fn names(scene: &SceneRecord, part: &TrajectoryPart) -> BTreeSet<String> {
    if part.cameras.is_empty() {
        return BTreeSet::new();
    }
    let texts = [KALIBR, DSEC].map(str::to_owned);
    let pairs = scene.recipe.pointer("/rig/stereo").and_then(Value::as_array);
    let paired = pairs.into_iter().flatten().filter_map(Value::as_array).flatten().filter_map(Value::as_str);
    let included = paired.filter(|_| !scene.licence.withheld);
    let maps = included.flat_map(|name| MAPS.map(|end| format!("{name}{end}")));
    texts.into_iter().chain(maps).map(|name| format!("{FOLDER}/{name}")).collect()
}

/// The files of a trajectory, by their names in its folder; none for a trajectory that is not that of a body.
pub fn compose(recipe: &Recipe, scene: &SceneRecord, part: &TrajectoryPart) -> BTreeMap<String, Vec<u8>> {
    if part.cameras.is_empty() {
        return BTreeMap::new();
    }
    let cameras = cameras(recipe, scene, part);
    let pairs = pairs(&cameras);
    let mut files = BTreeMap::from([
        (format!("{FOLDER}/{KALIBR}"), kalibr(&cameras).into_bytes()),
        (format!("{FOLDER}/{DSEC}"), dsec(&cameras, &pairs).into_bytes()),
    ]);
    for (pair, rectified) in &pairs {
        for (k, camera) in pair.iter().enumerate() {
            let (own, Camera { size, .. }) = cameras[*camera];
            let shape = [size.height.into(), size.width.into(), 2];
            let maps = [rectified.rectify_map(k), rectified.source_map(k)];
            for (end, map) in MAPS.iter().zip(maps) {
                let mut bytes = Vec::new();
                npy::write_values(&shape, map.as_flattened(), &mut bytes).expect("a Vec takes any bytes");
                files.insert(format!("{FOLDER}/{}{end}", own.name), bytes);
            }
        }
    }
    files
}

/// The cameras of the rig as they see along a body's trajectory.
fn cameras<'a>(
    recipe: &'a Recipe,
    scene: &SceneRecord,
    body: &TrajectoryPart,
) -> Vec<(&'a RigCamera, Camera)> {
    let seen = |own: &'a RigCamera| {
        let name = format!("{}/{}", body.name, own.name);
        let part = scene.trajectories.iter().find(|part| part.name == name)?;
        Some((own, scene.camera_of(part).camera()))
    };
    recipe.rig.iter().filter_map(seen).collect()
}

/// The stereo pairs, by the numbers of their cameras.
fn pairs(cameras: &[(&RigCamera, Camera)]) -> Vec<([usize; 2], Rectification)> {
    let find = |name: &str| cameras.iter().position(|(own, _)| own.name == name);
    let pair = |(first, (own, camera)): (usize, &(&RigCamera, Camera))| {
        let second = find(&own.second.as_ref()?.name)?;
        let found = Rectification::new([*camera, cameras[second].1], &own.second_from_first()?);
        Some(([first, second], found.ok()?))
    };
    cameras.iter().enumerate().filter_map(pair).collect()
}

/// The rectification of the stereo pair whose first camera sees along a trajectory, if there is one.
pub fn rectification(recipe: &Recipe, scene: &SceneRecord, part: &TrajectoryPart) -> Option<Rectification> {
    let mounted = recipe.mounted(&part.name)?;
    let own = &mounted.camera;
    let second = format!("{}/{}", mounted.body, own.second.as_ref()?.name);
    let second = scene.trajectories.iter().find(|part| part.name == second)?;
    let cameras = [part, second].map(|part| scene.camera_of(part).camera());
    Rectification::new(cameras, &own.second_from_first()?).ok()
}

const HEAD: &str = "# Lengths are in scene units. The centre of the first pixel is at (0, 0).\n";

/// Model and coefficients of a camera's lens, as Kalibr names them.
fn distortion(camera: &Camera) -> (&'static str, String) {
    let (model, k) = camera.lens.map_or(("radtan", vec![0.0; 4]), |lens| lens.kalibr());
    (model, list(&k))
}

/// Kalibr's form. Its inertial sensor is the body.
fn kalibr(cameras: &[(&RigCamera, Camera)]) -> String {
    let mut text = HEAD.to_owned();
    for (k, (own, camera)) in cameras.iter().enumerate() {
        let from_body = own.mount.body_from_camera().inverse();
        let _ =
            writeln!(text, "# {}\ncam{k}:\n  T_cam_imu:\n{}", own.name, rows(&from_body.matrix_rows(), 2));
        if let Some((before, _)) = k.checked_sub(1).map(|before| cameras[before]) {
            let from_before = from_body.compose(&before.mount.body_from_camera());
            let _ = writeln!(text, "  T_cn_cnm1:\n{}", rows(&from_before.matrix_rows(), 2));
        }
        let (model, coefficients) = distortion(camera);
        let _ = writeln!(
            text,
            "  camera_model: pinhole\n  distortion_coeffs: {coefficients}\n  distortion_model: {model}\n  \
             intrinsics: {}\n  resolution: [{}, {}]\n  rostopic: /{}\n  timeshift_cam_imu: 0.0",
            list(&camera.opencv_intrinsics()),
            camera.size.width,
            camera.size.height,
            own.name
        );
    }
    text
}

/// DSEC's form.
fn dsec(cameras: &[(&RigCamera, Camera)], pairs: &[([usize; 2], Rectification)]) -> String {
    let mut text = HEAD.to_owned();
    text.push_str("intrinsics:\n");
    let mut camera_text = |name: String, comment: &str, numbers: [f64; 4], camera: &Camera| {
        let (model, coefficients) = distortion(camera);
        let _ = writeln!(
            text,
            "  # {comment}\n  {name}:\n    camera_model: pinhole\n    camera_matrix: {}\n    distortion_model: {model}\n    \
             distortion_coeffs: {coefficients}\n    resolution: [{}, {}]",
            list(&numbers),
            camera.size.width,
            camera.size.height
        );
    };
    for (k, (own, camera)) in cameras.iter().enumerate() {
        camera_text(format!("cam{k}"), &own.name, camera.opencv_intrinsics(), camera);
    }
    let rectified =
        || pairs.iter().flat_map(|(pair, of)| pair.iter().zip(of.rotations).map(move |(k, r)| (*k, r, of)));
    for (k, _, of) in rectified() {
        let [cx, cy] = of.centre;
        let (own, camera) = &cameras[k];
        let comment = format!("{}, rectified", own.name);
        let rectified = Camera { lens: None, ..*camera };
        camera_text(format!("camRect{k}"), &comment, [of.focal, of.focal, cx, cy], &rectified);
    }
    // A rig of one camera has no motion between cameras.
    text.push_str(if cameras.len() > 1 { "extrinsics:\n" } else { "extrinsics: {}\n" });
    for (k, pair) in cameras.windows(2).enumerate() {
        let next = pair[1].0.mount.body_from_camera().inverse();
        let motion = next.compose(&pair[0].0.mount.body_from_camera());
        let _ = writeln!(text, "  T_{}{k}:\n{}", k + 1, rows(&motion.matrix_rows(), 2));
    }
    for (k, rotation, _) in rectified() {
        let columns = rotation.to_cols_array_2d();
        // The matrix is kept by columns, and the file has rows.
        let row = |i: usize| [columns[0][i], columns[1][i], columns[2][i]];
        let _ = writeln!(text, "  R_rect{k}:\n{}", rows(&[row(0), row(1), row(2)], 2));
    }
    // A key with nothing after it would be null in YAML; an empty mapping stays a mapping.
    text.push_str(if pairs.is_empty() { "disparity_to_depth: {}\n" } else { "disparity_to_depth:\n" });
    for ([first, second], of) in pairs {
        let _ = writeln!(text, "  cams_{first}{second}:\n{}", rows(&of.disparity_to_depth(), 2));
    }
    text
}

/// The rows of a matrix as a list of lists, without a final newline.
fn rows<const N: usize>(matrix: &[[f64; N]], indent: usize) -> String {
    let row = |row: &[f64; N]| format!("{}- {}", " ".repeat(indent), list(row));
    matrix.iter().map(row).collect::<Vec<_>>().join("\n")
}

/// Numbers as a list.
fn list(numbers: &[f64]) -> String {
    format!("[{}]", numbers.iter().map(|v| number(*v)).collect::<Vec<_>>().join(", "))
}

/// A number that every reader of YAML takes for one: readers of version 1.1 want a point, and a sign in an
/// exponent.
fn number(value: f64) -> String {
    // Without the sign of zero.
    let text = format!("{:?}", value + 0.0);
    let Some((mantissa, exponent)) = text.split_once('e') else { return text };
    let point = if mantissa.contains('.') { "" } else { ".0" };
    let sign = if exponent.starts_with('-') { "" } else { "+" };
    format!("{mantissa}{point}e{sign}{exponent}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_numbers_in_yaml_1_1() {
        for (value, wanted) in [
            (0.0, "0.0"),
            (-0.0, "0.0"),
            (0.1, "0.1"),
            (1e-16, "1.0e-16"),
            (-1.5e-9, "-1.5e-9"),
            (3e20, "3.0e+20"),
        ] {
            assert_eq!(number(value), wanted);
            assert_eq!(wanted.parse::<f64>().unwrap().to_bits(), (value + 0.0f64).to_bits());
        }
    }
}
