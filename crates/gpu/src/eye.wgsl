// From the scene to the camera's axes, with 48 bits. Far from the origin, the difference of a position
// and the camera's centre loses most digits of 32.

fn from_camera(position: f32, high: f32, low: f32) -> vec2f {
    let sum = exact_sum(high, position);
    return ordered_sum(sum.x, sum.y + low);
}

// One camera axis of a ray.
fn along(k: u32, ray: array<vec2f, 3>) -> vec2f {
    let high = frame.rotation_high[k];
    let low = frame.rotation_low[k];
    let first = sum2(product2(vec2f(high.x, low.x), ray[0]), product2(vec2f(high.y, low.y), ray[1]));
    return sum2(first, product2(vec2f(high.z, low.z), ray[2]));
}
