// The view as all passes see it, and the counts that passes share. `Frame` is laid out by
// `frame.rs`.

struct Frame {
    // `camera_from_world` by rows: each entry is a sum of two floats.
    rotation_high: array<vec4f, 3>,
    rotation_low: array<vec4f, 3>,
    // The scene's local origin minus the camera's centre in world axes, as a sum of two.
    origin_high: vec4f,
    origin_low: vec4f,
    // Focal lengths, px: two high parts, two low parts. Then the principal point in the same form.
    focal: vec4f,
    centre: vec4f,
    // Bounds of x / z, then of y / z, at which the projection's derivative is taken.
    slack: vec4f,
    // Velocity of the camera in its own axes, and of the ray to any point in world axes.
    linear: vec4f,
    angular: vec4f,
    ray_rate: vec4f,
    background: vec4f,
    // Size of the image, px.
    size: vec2u,
    // The region of tiles: first and end.
    first: vec2u,
    end: vec2u,
    // Capacities for splats and pairs.
    splat_room: u32,
    pair_room: u32,
    // Always 0, which no compiler can know.
    zero: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;

// A count above its capacity stops the later passes. The host then increases the capacity and
// starts again.
fn within(count: u32, room: u32) -> u32 {
    return select(count, 0u, count > room);
}

// Sums of counts saturate here: far above any capacity, and without overflow.
const MANY: u32 = 1u << 30u;

fn sum_up_to_many(a: u32, b: u32) -> u32 {
    return min(min(a, MANY) + min(b, MANY), MANY);
}
