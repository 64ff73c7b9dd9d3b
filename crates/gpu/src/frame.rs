//! The uniform data of a view, laid out as `Frame` in `frame.wgsl`.

#![expect(clippy::cast_possible_truncation, reason = "a value is cut into two of 32 bits")]

use super::TileRegion;
use glam::DVec3;
use gs2e_image::luminance;
use gs2e_render::RenderStyle;
use gs2e_render::cpu::eye::slope_bounds;
use gs2e_scene::camera::view::CameraView;

/// Size of `Frame`, bytes: fifteen rows of four words and nine words, rounded up to whole rows.
pub(super) const BYTES: u64 = 18 * 16;

/// The bytes of `Frame` for a view of a scene with positions relative to `origin`, for the tiles of
/// a region, with these capacities for splats and pairs.
pub(super) fn frame_bytes(
    view: &CameraView,
    origin: DVec3,
    style: &RenderStyle,
    region: TileRegion,
    room: [u32; 2],
) -> Vec<u8> {
    let camera = view.camera;
    let camera_from_world = view.world_from_camera.rotation_matrix().transpose();
    let rows = [0, 1, 2].map(|k| split_vector(camera_from_world.row(k)));
    // Subtracted in 64 bits: in 32 bits the difference of two far places would be rounded.
    let [high, low] = split_vector(origin - view.world_from_camera.translation);
    let pair = |[x, y]: [f64; 2]| {
        let [high, low] = split_vector(DVec3::new(x, y, 0.0));
        [high[0], high[1], low[0], low[1]]
    };
    let [x, y] = slope_bounds(&view.camera, style.rules).map(|bounds| bounds.map(|slope| slope as f32));
    let row = |v: DVec3| {
        let [x, y, z] = v.as_vec3().to_array();
        [x, y, z, 0.0]
    };
    let [red, green, blue] = style.background;
    let floats = [
        rows[0][0],
        rows[1][0],
        rows[2][0],
        rows[0][1],
        rows[1][1],
        rows[2][1],
        high,
        low,
        pair([camera.fx, camera.fy]),
        pair([camera.cx, camera.cy]),
        [x[0], x[1], y[0], y[1]],
        row(view.velocity.linear),
        row(view.velocity.angular),
        // Rate of the ray from the camera to any fixed point, in world axes.
        row(-(view.world_from_camera.rotation * view.velocity.linear)),
        [red, green, blue, luminance(style.background)],
    ];
    let ([x0, y0], [x1, y1]) = (region.first, region.end);
    let words = [camera.size.width, camera.size.height, x0, y0, x1, y1, room[0], room[1]];
    let floats = floats.into_iter().flatten().flat_map(f32::to_le_bytes);
    let mut bytes: Vec<u8> = floats.chain(words.into_iter().flat_map(u32::to_le_bytes)).collect();
    // `resize` adds the last word of `Frame`, which is zero, and the padding.
    bytes.resize(BYTES as usize, 0);
    bytes
}

/// A vector as the sum of two vectors of f32.
fn split_vector(v: DVec3) -> [[f32; 4]; 2] {
    let high = v.as_vec3();
    let low = (v - high.as_dvec3()).as_vec3();
    [high, low].map(|part| [part.x, part.y, part.z, 0.0])
}
