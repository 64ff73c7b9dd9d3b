// What every pass knows of the view, and the counts that the passes hand on. `Frame` is laid out by `frame.rs`.

struct Frame {
    // Camera from world, row by row: each entry is the sum of the two.
    rotation_high: array<vec4f, 3>,
    rotation_low: array<vec4f, 3>,
    // The scene's local origin minus the camera's centre, world axes: a sum of two as well.
    origin_high: vec4f,
    origin_low: vec4f,
    // Focal lengths, px: two highs, two lows; the principal point likewise.
    focal: vec4f,
    centre: vec4f,
    // Least and largest x / z, then y / z, at which the projection's derivative is taken.
    slack: vec4f,
    // Velocity of the camera in its own axes, and of the ray to any point in world axes.
    linear: vec4f,
    angular: vec4f,
    ray_rate: vec4f,
    background: vec4f,
    // Of the image, px.
    size: vec2u,
    // The tiles that are made: first and end.
    first: vec2u,
    end: vec2u,
    // Most splats and most pairs that there is room for.
    splat_room: u32,
    pair_room: u32,
    // 0, which no compiler knows.
    zero: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;

// A count that there is no room for stops the passes after it: the host makes room and begins again.
fn within(count: u32, room: u32) -> u32 {
    return select(count, 0u, count > room);
}

// Sums of counts end here, well above any room and below a carry.
const MANY: u32 = 1u << 30u;

fn sum_up_to_many(a: u32, b: u32) -> u32 {
    return min(min(a, MANY) + min(b, MANY), MANY);
}
