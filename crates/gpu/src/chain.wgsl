// Backward pass 3: from the sums of a splat to the gradients of its Gaussian, one thread per splat; the
// projection backwards, as in `cpu/backward/chain.rs`. With the moments of `e = W d`:
//
// dL/dmean  = 2 ln 2 W^T (sum a e)
// dL/dSigma = 2 (ln 2)^2 W^T (sum a e e^T) W
//
// The clamp of the slopes, the floor of the antialiased rule and the clamp of a colour at 0 are
// constant where they hold.

@group(1) @binding(0) var<uniform> part: Part;
@group(1) @binding(1) var<storage, read> means: array<vec4f>;
@group(1) @binding(2) var<storage, read> axes: array<f32>;
@group(1) @binding(3) var<storage, read> harmonics: array<f32>;
// Stored quaternions: w, x, y, z.
@group(1) @binding(4) var<storage, read> rotations: array<vec4f>;
@group(1) @binding(5) var<storage, read> splats: array<vec4u>;
@group(1) @binding(6) var<storage, read> sums: array<f32>;
@group(1) @binding(7) var<storage, read> totals: array<u32>;
// Rows of four words per splat:
//   0: position, index in the scene   1: log scales, logit   2: quaternion w, x, y, z
//   3: colour, score                  4: direction of view, -
@group(1) @binding(8) var<storage, read_write> gradients: array<vec4u>;

struct Part {
    count: u32,
    groups: u32,
    first: u32,
}

// The gradient by the slopes, the depth, and the scaled axes in camera axes.
struct OnImage {
    slopes: vec2f,
    depth: f32,
    axes: mat3x3f,
}

@compute @workgroup_size(GROUP)
fn chain(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let at = group.x * GROUP + local;
    if at >= within(totals[SPLATS], frame.splat_room) {
        return;
    }
    let number = splats[at * SPLAT_ROWS + 3u].w;
    // Each part of the scene takes its own Gaussians. Below its first, the difference wraps.
    let i = number - part.first;
    if i >= part.count {
        return;
    }
    let mean = means[i];
    let ray = array(
        from_camera(mean.x, frame.origin_high.x, frame.origin_low.x),
        from_camera(mean.y, frame.origin_high.y, frame.origin_low.y),
        from_camera(mean.z, frame.origin_high.z, frame.origin_low.z),
    );
    let point = array(along(0u, ray), along(1u, ray), along(2u, ray));
    let slopes = vec2f(quotient2(point[0], point[2]).x, quotient2(point[1], point[2]).x);
    let depth = point[2].x;
    let scaled = mat3x3f(axis(i, 0u), axis(i, 1u), axis(i, 2u));
    let found = on_image(at, scaled, slopes, depth);
    // Moving the point by d changes u = x/z by (dx - u dz) / z.
    let seen = vec3f(found.slopes / depth, found.depth - dot(found.slopes, slopes) / depth);
    let from_eye = vec3f(ray[0].x, ray[1].x, ray[2].x);
    let distance = length(from_eye);
    let direction = from_eye / distance;
    let colour = colour_gradient(at);
    let turned = direction_gradient(i, direction, colour);
    // Only the component across the ray turns it.
    let position = to_world(seen) + (turned - direction * dot(direction, turned)) / distance;
    let by_axes = mat3x3f(to_world(found.axes[0]), to_world(found.axes[1]), to_world(found.axes[2]));
    // A scaled axis is a column of the rotation times `exp(log scale)`, and so its own derivative.
    let log_scale =
        vec3f(dot(by_axes[0], scaled[0]), dot(by_axes[1], scaled[1]), dot(by_axes[2], scaled[2]));
    // `d ln o / d logit = 1 - o` for `o = 1 / (1 + exp(-logit))`: exact where `o` nearly vanishes,
    // unlike a quotient of small numbers.
    let logit = sum_at(at, 0u) * (1.0 - mean.w);
    let row = at * GRADIENT_ROWS;
    // Words and not floats: an index looks like a denormal, which a device may flush to zero.
    gradients[row] = vec4u(bitcast<vec3u>(position), number);
    gradients[row + 1u] = bitcast<vec4u>(vec4f(log_scale, logit));
    gradients[row + 2u] = bitcast<vec4u>(rotation_gradient(rotations[i], scaled, by_axes));
    gradients[row + 3u] = bitcast<vec4u>(vec4f(colour, sum_at(at, 9u)));
    gradients[row + 4u] = bitcast<vec4u>(vec4f(direction, 0.0));
}

fn sum_at(at: u32, k: u32) -> f32 {
    return sums[at * SUMS + k];
}

fn axis(i: u32, k: u32) -> vec3f {
    let at = 9u * i + 3u * k;
    return vec3f(axes[at], axes[at + 1u], axes[at + 2u]);
}

// Camera axes to world axes. Gradients go back by the transpose of the rotation's rows.
fn to_world(g: vec3f) -> vec3f {
    return frame.rotation_high[0].xyz * g.x + frame.rotation_high[1].xyz * g.y
        + frame.rotation_high[2].xyz * g.z;
}

fn to_camera(v: vec3f) -> vec3f {
    return vec3f(
        dot(frame.rotation_high[0].xyz, v),
        dot(frame.rotation_high[1].xyz, v),
        dot(frame.rotation_high[2].xyz, v),
    );
}

// From the image plane to slopes, depth and scaled axes.
fn on_image(at: u32, scaled: mat3x3f, slopes: vec2f, depth: f32) -> OnImage {
    let row = at * SPLAT_ROWS;
    let w = vec3f(bitcast<vec2f>(splats[row].zw), bitcast<f32>(splats[row + 1u].x));
    let first = vec2f(sum_at(at, 1u), sum_at(at, 2u));
    let second = vec3f(sum_at(at, 3u), sum_at(at, 4u), sum_at(at, 5u));
    let mean = 2.0 * LN_2 * vec2f(w.x * first.x, w.y * first.x + w.z * first.y);
    // `dL = xx dSxx + 2 xy dSxy + yy dSyy`.
    let k = 2.0 * LN_2 * LN_2;
    let xx = k * w.x * w.x * second.x;
    let xy = k * w.x * (w.y * second.x + w.z * second.y);
    let yy = k * (w.y * w.y * second.x + 2.0 * w.y * w.z * second.y + w.z * w.z * second.z);
    // The forward pass clamps the slopes in the derivative of the projection only. The position of
    // the splat keeps the slopes as they are.
    let low = frame.slack.xz;
    let high = frame.slack.yw;
    let clamped = clamp(slopes, low, high);
    let scale = frame.focal.xy / depth;
    let turned = transpose(mat3x3f(to_camera(scaled[0]), to_camera(scaled[1]), to_camera(scaled[2])));
    // The covariance is `a0.a0, a0.a1, a1.a1` and the dilation. No entry of it is divided by its
    // determinant.
    let a0 = scale.x * (turned[0] - clamped.x * turned[2]);
    let a1 = scale.y * (turned[1] - clamped.y * turned[2]);
    var by_a0 = 2.0 * (xx * a0 + xy * a1);
    var by_a1 = 2.0 * (xy * a0 + yy * a1);
    if ANTIALIASED {
        compensate(a0, a1, sum_at(at, 0u), &by_a0, &by_a1);
    }
    // At its bound, the slope of the derivative is constant.
    let free = (low < slopes) & (slopes < high);
    let tilt = -scale * vec2f(dot(by_a0, turned[2]), dot(by_a1, turned[2]));
    // Both rows are proportional to 1 / depth, so the derivative by depth is minus their share over
    // it.
    let shrink = dot(by_a0, a0) + dot(by_a1, a1);
    var found: OnImage;
    found.slopes = frame.focal.xy * mean + select(vec2f(0.0), tilt, free);
    found.depth = -shrink / depth;
    for (var n = 0u; n < 3u; n++) {
        let xy_part = scale * vec2f(by_a0[n], by_a1[n]);
        found.axes[n] = vec3f(xy_part, -dot(clamped, xy_part));
    }
    return found;
}

// Adds the gradient through the factor of the antialiased rule, `sqrt(det0 / det)`, with `total` =
// `dL/d ln opacity`. With `n = a0 x a1`: `det0 = |n|^2`, `det = det0 + 0.3 (|a0|^2 + |a1|^2) + 0.09`,
// so nothing cancels where the undilated determinant nearly vanishes.
fn compensate(
    a0: vec3f, a1: vec3f, total: f32, by_a0: ptr<function, vec3f>, by_a1: ptr<function, vec3f>,
) {
    let n = cross(a0, a1);
    let det0 = dot(n, n);
    let det = det0 + DILATION * (dot(a0, a0) + dot(a1, a1)) + DILATION * DILATION;
    // At its floor the factor is constant.
    if det0 / det <= COMPENSATION_FLOOR {
        return;
    }
    // Half of `d ln det0 - d ln det`, by `det0` and by the sum of squares.
    let by_det0 = 0.5 * total * (1.0 / det0 - 1.0 / det);
    let by_squares = -0.5 * total * DILATION / det;
    *by_a0 += 2.0 * (by_det0 * cross(a1, n) + by_squares * a0);
    *by_a1 += 2.0 * (by_det0 * cross(n, a0) + by_squares * a1);
}

// By the colour before its clamp at 0. A colour that the clamp holds at 0 does not follow a small
// change.
fn colour_gradient(at: u32) -> vec3f {
    let colour = bitcast<vec3f>(splats[at * SPLAT_ROWS + 2u].xyz);
    return select(vec3f(0.0), vec3f(sum_at(at, 6u), sum_at(at, 7u), sum_at(at, 8u)), colour > vec3f(0.0));
}

// By the direction of view, through the harmonics of degree 1 to 3; see `scene/sh.rs`.
fn direction_gradient(i: u32, direction: vec3f, colour: vec3f) -> vec3f {
    var w: array<f32, 16>;
    for (var k = 0u; k < SH_LEN; k++) {
        let at = 3u * (i * SH_LEN + k);
        w[k] = dot(vec3f(harmonics[at], harmonics[at + 1u], harmonics[at + 2u]), colour);
    }
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    var sum = vec3f(0.0);
    if SH_LEN > 1u {
        sum += SH_1 * vec3f(-w[3], -w[1], w[2]);
    }
    if SH_LEN > 4u {
        for (var k = 0u; k < 5u; k++) {
            w[4u + k] *= SH_2[k];
        }
        sum += vec3f(
            w[4] * y - 2.0 * w[6] * x + w[7] * z + 2.0 * w[8] * x,
            w[4] * x + w[5] * z - 2.0 * w[6] * y - 2.0 * w[8] * y,
            w[5] * y + 4.0 * w[6] * z + w[7] * x,
        );
    }
    if SH_LEN > 9u {
        for (var k = 0u; k < 7u; k++) {
            w[9u + k] *= SH_3[k];
        }
        let xx = x * x;
        let yy = y * y;
        let zz = z * z;
        let xy = x * y;
        let yz = y * z;
        let zx = z * x;
        sum += vec3f(
            6.0 * w[9] * xy + w[10] * yz - 2.0 * w[11] * xy - 6.0 * w[12] * zx
                + w[13] * (4.0 * zz - 3.0 * xx - yy) + 2.0 * w[14] * zx + 3.0 * w[15] * (xx - yy),
            3.0 * w[9] * (xx - yy) + w[10] * zx + w[11] * (4.0 * zz - xx - 3.0 * yy) - 6.0 * w[12] * yz
                - 2.0 * w[13] * xy - 2.0 * w[14] * yz - 6.0 * w[15] * xy,
            w[10] * xy + 8.0 * w[11] * yz + 3.0 * w[12] * (2.0 * zz - xx - yy) + 8.0 * w[13] * zx
                + w[14] * (xx - yy),
        );
    }
    return sum;
}

// By the stored quaternion. Only its component across the quaternion turns, so a stored length does
// not matter; a zero quaternion has the gradient 0.
fn rotation_gradient(stored: vec4f, scaled: mat3x3f, by_axes: mat3x3f) -> vec4f {
    let norm = length(stored);
    if norm <= MIN_NORM {
        return vec4f(0.0);
    }
    let unit = stored / norm;
    let w = unit.x;
    let x = unit.y;
    let y = unit.z;
    let z = unit.w;
    // `d[k]` is the gradient by column `k` of the rotation.
    let d = mat3x3f(
        by_axes[0] * length(scaled[0]),
        by_axes[1] * length(scaled[1]),
        by_axes[2] * length(scaled[2]),
    );
    let by_unit = 2.0 * vec4f(
        z * (d[0].y - d[1].x) + y * (d[2].x - d[0].z) + x * (d[1].z - d[2].y),
        y * (d[1].x + d[0].y) + z * (d[2].x + d[0].z) - 2.0 * x * (d[1].y + d[2].z) + w * (d[1].z - d[2].y),
        x * (d[1].x + d[0].y) + z * (d[2].y + d[1].z) - 2.0 * y * (d[0].x + d[2].z) + w * (d[2].x - d[0].z),
        x * (d[2].x + d[0].z) + y * (d[2].y + d[1].z) - 2.0 * z * (d[0].x + d[1].y) + w * (d[0].y - d[1].x),
    );
    return (by_unit - dot(by_unit, unit) * unit) / norm;
}
