//! Poses at any time, and their forms in files.

use super::ExportPlan;
use glam::DVec3;
use gs2e_num::se3::rotation::slerp;
use gs2e_num::se3::{OPENCV_FROM_OPENGL, Se3};
use gs2e_scene::camera::Camera;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::text::significant_digits;

/// The pose at `t_us` from the start of the interval: a straight line between centres, and a slerp
/// between rotations. Times outside of the interval have the pose of its end.
pub(super) fn pose_at(plan: &ExportPlan<'_>, t_us: f64) -> Se3 {
    let [start, end] = plan.window_us().map(|stamp| stamp as f64);
    let at = (start + t_us).clamp(start, end);
    let Trajectory { world_from_camera: poses, stamps_us } = &plan.subject.poses;
    // A trajectory has two poses at least, and `at` lies between the first and the last.
    let after = stamps_us.partition_point(|stamp| *stamp as f64 <= at).clamp(1, poses.len() - 1);
    let ([t0, t1], [a, b]) =
        ([after - 1, after].map(|k| stamps_us[k] as f64), [poses[after - 1], poses[after]]);
    let share = (at - t0) / (t1 - t0);
    Se3 {
        rotation: slerp(a.rotation, b.rotation, share),
        translation: a.translation.lerp(b.translation, share),
    }
}

/// Camera to world, OpenCV axes, by rows.
pub(super) fn matrix(pose: &Se3) -> [[f64; 4]; 4] {
    let turn = pose.rotation_matrix().transpose();
    // glam stores columns, so the columns of the transpose are the rows.
    let row = |of: DVec3, t: f64| [of.x, of.y, of.z, t];
    let DVec3 { x, y, z } = pose.translation;
    [row(turn.x_axis, x), row(turn.y_axis, y), row(turn.z_axis, z), [0.0, 0.0, 0.0, 1.0]]
}

/// Camera to world, OpenGL axes, by rows.
pub(super) fn opengl_matrix(pose: &Se3) -> [[f64; 4]; 4] {
    let mut rows = matrix(pose);
    // Camera axes are columns.
    let flip = OPENCV_FROM_OPENGL.to_array();
    rows[..3].iter_mut().for_each(|row| row.iter_mut().zip(flip).for_each(|(v, sign)| *v *= sign));
    rows
}

/// A row of LLFF's `poses_bounds.npy`: three rows of the camera axes down, right and back, the place, and
/// one of height, width and focal length; then the nearest and the furthest distance.
pub(super) fn llff_row(camera: &Camera, pose: &Se3, depth: [f64; 2]) -> [f64; 17] {
    let sides = [f64::from(camera.size.height), f64::from(camera.size.width), camera.fx];
    let mut row = [0.0; 17];
    for ((out, [right, down, forward, place]), side) in
        row.as_chunks_mut::<5>().0.iter_mut().zip(matrix(pose)).zip(sides)
    {
        *out = [down, right, -forward, place, side];
    }
    row[15..].copy_from_slice(&depth);
    row
}

/// A matrix as text, one row per line.
pub(super) fn matrix_text(rows: &[[f64; 4]]) -> String {
    let line = |row: &[f64; 4]| row.map(significant_digits).join(" ");
    rows.iter().map(|row| line(row) + "\n").collect()
}

/// The camera matrix, 4x4, with `shift` subtracted from the principal point.
pub(super) fn intrinsics(plan: &ExportPlan<'_>, shift: f64) -> [[f64; 4]; 4] {
    let camera = &plan.subject.camera;
    [
        [camera.fx, 0.0, camera.cx - shift, 0.0],
        [0.0, camera.fy, camera.cy - shift, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
}
