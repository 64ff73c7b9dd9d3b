//! `transforms.json`: a trajectory's poses and camera in nerfstudio's form, with OpenGL camera
//! axes.

use super::Trajectory;
use glam::DMat4;
use gs2e_num::se3::{OPENCV_FROM_OPENGL, Se3};
use gs2e_scene::camera::Camera;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The pictures of a trajectory, by name.
#[derive(Debug, Clone, Copy)]
pub struct PictureLinks<'a> {
    /// Names of sharp pictures, sorted. `000012.png` belongs to pose 12.
    pub sharp: &'a [&'a str],
    /// Time from the first row of a sharp picture to the last, us, if the shutter rolls.
    pub readout_us: Option<u32>,
    /// Exposure of each blurred picture, microseconds, by the index of its pose.
    pub blurred: &'a BTreeMap<usize, [i64; 2]>,
}

/// Composes the file. It lists the poses with a sharp picture, because readers of this form open a
/// picture for each frame; without sharp pictures it lists all poses. `poses.txt` always has every
/// pose. A frame also names its blurred picture. `readout_us` says that row r of H of a sharp picture was
/// seen at `t_us + readout_us (r / (H - 1) - 1/2)`: the pose is that of the middle row.
#[must_use]
pub fn compose_transforms(camera: &Camera, path: &Trajectory, pictures: &PictureLinks<'_>) -> Value {
    let frames: Vec<Value> = path
        .world_from_camera
        .iter()
        .zip(&path.stamps_us)
        .enumerate()
        .filter_map(|(j, (pose, t_us))| {
            let name = format!("{j:06}.png");
            let mut frame = json!({ "transform_matrix": opengl_matrix(pose), "t_us": t_us });
            if !pictures.sharp.is_empty() {
                pictures.sharp.binary_search(&name.as_str()).ok()?;
                frame["file_path"] = json!(format!("sharp/{name}"));
            }
            if let Some([start_us, end_us]) = pictures.blurred.get(&j) {
                frame["blur_file_path"] = json!(format!("blur/{name}"));
                frame["exposure_start_us"] = json!(start_us);
                frame["exposure_end_us"] = json!(end_us);
            }
            Some(frame)
        })
        .collect();
    let (model, coefficients) = camera.lens.map_or(("PINHOLE", Vec::new()), |lens| lens.nerfstudio());
    let mut file = json!({
        "camera_model": model, "w": camera.size.width, "h": camera.size.height,
        "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy, "pixel_center": 0.5,
        "frames": frames,
    });
    for (name, value) in coefficients {
        file[name] = json!(value);
    }
    if let Some(readout_us) = pictures.readout_us.filter(|_| !pictures.sharp.is_empty()) {
        file["readout_us"] = json!(readout_us);
    }
    file
}

/// Camera to world with OpenGL camera axes, by rows.
fn opengl_matrix(world_from_camera: &Se3) -> [[f64; 4]; 4] {
    let turn = world_from_camera.rotation_matrix();
    // OpenGL's camera looks along `-z` with `y` up, so two axes change their sign.
    let flip = OPENCV_FROM_OPENGL;
    let matrix = DMat4::from_cols(
        (turn.x_axis * flip.x).extend(0.0),
        (turn.y_axis * flip.y).extend(0.0),
        (turn.z_axis * flip.z).extend(0.0),
        world_from_camera.translation.extend(1.0),
    );
    // The array lists columns. Those of the transpose are the rows.
    matrix.transpose().to_cols_array_2d()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn an_opencv_camera_without_turn_looks_along_minus_z_of_opengl() {
        let pose = Se3 { rotation: DQuat::IDENTITY, translation: DVec3::new(1.0, 2.0, 3.0) };
        let rows = opengl_matrix(&pose);
        assert_eq!(
            rows,
            [[1.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 2.0], [0.0, 0.0, -1.0, 3.0], [0.0, 0.0, 0.0, 1.0]]
        );
    }
}
