// Pass 1: projects every Gaussian onto the image plane, or culls it; the operations are those of
// `cpu/project.rs`. `measure` counts the splats. After the scan of the counts, `place` writes them
// in file order.

@group(1) @binding(0) var<uniform> part: Part;
// Position relative to the scene's origin; opacity, or a mark in its place.
@group(1) @binding(1) var<storage, read> means: array<vec4f>;
// Nine floats: the columns of `Rq S`.
@group(1) @binding(2) var<storage, read> axes: array<f32>;
@group(1) @binding(3) var<storage, read> harmonics: array<f32>;
@group(1) @binding(4) var<storage, read_write> drawn: array<u32>;
@group(1) @binding(5) var<storage, read_write> sums: array<u32>;
@group(1) @binding(6) var<storage, read_write> totals: array<atomic<u32>>;
@group(1) @binding(7) var<storage, read_write> splats: array<vec4u>;
// Bits of the depth, and place.
@group(1) @binding(8) var<storage, read_write> order: array<vec2u>;

struct Part {
    // Number of Gaussians in the part.
    count: u32,
    // Number of workgroups of the part.
    groups: u32,
    // Index of its first Gaussian in the scene.
    first: u32,
}

struct Footprint {
    a: vec2f,
    b: vec2f,
    c: vec2f,
    det: vec2f,
    det0: vec2f,
    depth_deviation: f32,
}

struct Found {
    // DRAWN, or an index into `totals`.
    fate: u32,
    outline: Outline,
    opacity: vec2f,
    depth: f32,
    deviation: f32,
    mean_rate: vec2f,
    w_rate: vec3f,
    // The ray from the camera's centre to the mean, in world axes.
    from_camera: vec3f,
}

const DRAWN: u32 = 0xffffffffu;

// Counts of the workgroup, in the order of `totals` from BEHIND on.
var<workgroup> fates: array<atomic<u32>, FATES>;

@compute @workgroup_size(GROUP)
fn measure(thread: Thread) {
    let i = thread.group.x * GROUP + thread.local;
    if thread.local < FATES {
        atomicStore(&fates[thread.local], 0u);
    }
    workgroupBarrier();
    var counts = 0u;
    if i < part.count {
        let found = project(i);
        if found.fate == DRAWN {
            atomicAdd(&fates[DOUBTFUL - BEHIND], u32(found.deviation > AFFINE_DOUBTFUL * found.depth));
            atomicAdd(&fates[INVALID - BEHIND], u32(found.deviation > AFFINE_INVALID * found.depth));
            // A region takes its own splats only, but the fates are counted for the whole image.
            counts = u32(is_in_region(found.outline));
        } else {
            atomicAdd(&fates[found.fate - BEHIND], 1u);
        }
        drawn[i] = counts;
    }
    let sum = sum_of(counts, thread);
    if thread.local == 0u {
        sums[thread.group.x] = sum;
    }
    if thread.local < FATES {
        atomicAdd(&totals[BEHIND + thread.local], atomicLoad(&fates[thread.local]));
    }
}

@compute @workgroup_size(GROUP)
fn place(thread: Thread) {
    let i = thread.group.x * GROUP + place_of(thread);
    var counts = 0u;
    if i < part.count {
        counts = drawn[i];
    }
    let at = sums[thread.group.x] + sums_of(counts, thread).before;
    // Splats beyond the capacity are counted but not written. The host then submits again.
    if counts == 1u && at < frame.splat_room {
        write(i, at);
    }
}

fn is_in_region(outline: Outline) -> bool {
    let columns = tiles_of(outline.columns, frame.first.x, frame.end.x);
    let rows = tiles_of(outline.rows, frame.first.y, frame.end.y);
    return columns.x < columns.y && rows.x < rows.y;
}

fn write(i: u32, at: u32) {
    let found = project(i);
    let outline = found.outline;
    let colour = colour_of(i, found.from_camera);
    let value = vec3f(colour[0].x, colour[1].x, colour[2].x);
    let row = at * SPLAT_ROWS;
    splats[row] = bitcast<vec4u>(vec4f(outline.mean, outline.w.xy));
    splats[row + 1u] = bitcast<vec4u>(vec4f(outline.w.z, found.opacity.x, outline.reach, found.depth));
    splats[row + 2u] = bitcast<vec4u>(vec4f(value, luminance(value)));
    let doubtful = u32(found.deviation > AFFINE_DOUBTFUL * found.depth);
    splats[row + 3u] = vec4u(pack(outline.columns), pack(outline.rows), doubtful, part.first + i);
    if RATE {
        let grey_rate = luminance(vec3f(colour[0].y, colour[1].y, colour[2].y));
        let opacity_rate = found.opacity.y / found.opacity.x;
        splats[row + 4u] = bitcast<vec4u>(vec4f(found.mean_rate, found.w_rate.xy));
        splats[row + 5u] = bitcast<vec4u>(vec4f(found.w_rate.z, opacity_rate, grey_rate, 0.0));
    }
    order[at] = vec2u(bitcast<u32>(found.depth), at);
}

fn luminance(c: vec3f) -> f32 {
    return LUMINANCE_R * c.x + LUMINANCE_G * c.y + LUMINANCE_B * c.z;
}

// True for a value that is neither infinite nor NaN. The test is by bits, because compilers may
// assume that all values are finite.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn project(i: u32) -> Found {
    var found: Found;
    let mean = means[i];
    let ray = array(
        from_camera(mean.x, frame.origin_high.x, frame.origin_low.x),
        from_camera(mean.y, frame.origin_high.y, frame.origin_low.y),
        from_camera(mean.z, frame.origin_high.z, frame.origin_low.z),
    );
    found.from_camera = vec3f(ray[0].x, ray[1].x, ray[2].x);
    let point = array(along(0u, ray), along(1u, ray), along(2u, ray));
    found.depth = point[2].x;
    found.fate = BEHIND;
    // Marks in place of the opacity, because NaN is not portable in WGSL.
    if mean.w == LOST || !is_in_front(found.depth) {
        return found;
    }
    found.fate = DEGENERATE;
    if mean.w == SPOILT {
        return found;
    }
    outline(i, point, &found);
    return found;
}

// Fills in the projection of a Gaussian with a mean in front of the camera.
fn outline(i: u32, point: array<vec2f, 3>, found: ptr<function, Found>) {
    let p = vec3f(point[0].x, point[1].x, point[2].x);
    let rate = -frame.linear.xyz - cross(frame.angular.xyz, p);
    let slope_x = quotient2(point[0], point[2]);
    let slope_y = quotient2(point[1], point[2]);
    let turning = (rate.xy - vec2f(slope_x.x, slope_y.x) * rate.z) / p.z;
    let mean_x = sum2(product2(frame.focal.xz, slope_x), frame.centre.xz);
    let mean_y = sum2(product2(frame.focal.yw, slope_y), frame.centre.yw);
    let mean = vec2f(mean_x.x, mean_y.x);
    let slopes = array(
        clamped(vec2f(slope_x.x, turning.x), frame.slack.xy),
        clamped(vec2f(slope_y.x, turning.y), frame.slack.zw),
    );
    let shape = footprint(i, slopes, vec2f(p.z, rate.z));
    (*found).deviation = shape.depth_deviation;
    let sound = is_finite(shape.det.x) && shape.det.x > 0.0 && is_finite(mean.x) && is_finite(mean.y);
    // The fate is still DEGENERATE.
    if !sound {
        return;
    }
    (*found).fate = OUTSIDE;
    var opacity = still(means[i].w);
    if ANTIALIASED {
        let share = over(shape.det0, shape.det);
        let kept = select(still(COMPENSATION_FLOOR), share, share.x > COMPENSATION_FLOOR);
        opacity = times(opacity, root(kept));
    }
    if opacity.x < MIN_ALPHA {
        return;
    }
    let w1 = times(root(over(shape.c, shape.det)), still(TO_BINARY));
    let w2 = times(-over(shape.b, shape.c), w1);
    let w3 = over(still(TO_BINARY), root(shape.c));
    let reach = reach_of(opacity.x);
    let side = extents(mean, shape, reach);
    (*found).outline = Outline(mean, vec3f(w1.x, w2.x, w3.x), reach, side[0], side[1]);
    (*found).opacity = opacity;
    (*found).mean_rate = frame.focal.xy * turning;
    (*found).w_rate = vec3f(w1.y, w2.y, w3.y);
    if side[0].x < side[0].y && side[1].x < side[1].y {
        (*found).fate = DRAWN;
    }
}

fn is_in_front(z: f32) -> bool {
    if RULES == GSPLAT {
        return z >= GSPLAT_NEAR && z <= GSPLAT_FAR;
    }
    return z > NEAR;
}

// At a bound, the rate is 0.
fn clamped(a: vec2f, bounds: vec2f) -> vec2f {
    let inside = bounds.x < a.x && a.x < bounds.y;
    return vec2f(clamp(a.x, bounds.x, bounds.y), select(0.0, a.y, inside));
}

// The dilated covariance. Rows of the projection's derivative times the axes are formed in the
// Gaussian's own axes, where the cross product does not cancel.
fn footprint(i: u32, slopes: array<vec2f, 2>, z: vec2f) -> Footprint {
    let scale_x = over(still(frame.focal.x), z);
    let scale_y = over(still(frame.focal.y), z);
    var a0: array<vec2f, 3>;
    var a1: array<vec2f, 3>;
    var deep = 0.0;
    for (var k = 0u; k < 3u; k++) {
        let at = 9u * i + 3u * k;
        let axis = vec3f(axes[at], axes[at + 1u], axes[at + 2u]);
        let seen = vec3f(
            dot(frame.rotation_high[0].xyz, axis),
            dot(frame.rotation_high[1].xyz, axis),
            dot(frame.rotation_high[2].xyz, axis),
        );
        // The axes turn against the camera.
        let rate = cross(seen, frame.angular.xyz);
        let back = vec2f(seen.z, rate.z);
        a0[k] = times(scale_x, vec2f(seen.x, rate.x) - times(slopes[0], back));
        a1[k] = times(scale_y, vec2f(seen.y, rate.y) - times(slopes[1], back));
        deep += seen.z * seen.z;
    }
    let n = cross3(a0, a1);
    let aa = dot3(a0, a0);
    let cc = dot3(a1, a1);
    let det0 = dot3(n, n);
    let d = still(DILATION);
    let det = det0 + DILATION * (aa + cc) + still(DILATION * DILATION);
    return Footprint(aa + d, dot3(a0, a1), cc + d, det, det0, sqrt(deep));
}

// Columns and rows that may be touched; see `cpu/extent.rs`.
fn extents(mean: vec2f, shape: Footprint, reach: f32) -> array<vec2u, 2> {
    let variances = vec2f(shape.a.x, shape.c.x);
    let half = sqrt(2.0 * LN_2 * reach * variances);
    let size = vec2f(frame.size);
    let wide = half + vec2f(edge_margin(half.x), edge_margin(half.y));
    var columns = pixels_within(mean.x + vec2f(-wide.x, wide.x), size.x);
    var rows = pixels_within(mean.y + vec2f(-wide.y, wide.y), size.y);
    let tile = f32(TILE);
    if RULES == OFFICIAL {
        let middle = 0.5 * (variances.x + variances.y);
        let apart = 0.5 * (variances.x - variances.y);
        let longest = middle + sqrt(max(apart * apart + shape.b.x * shape.b.x, EXTENT_ROOT_FLOOR));
        let radius = ceil(EXTENT_SIGMAS * sqrt(longest));
        let low = whole_tiles(trunc((mean - 0.5 - radius) / tile));
        let high = whole_tiles(trunc((mean - 0.5 + radius + (tile - 1.0)) / tile));
        columns = vec2u(max(columns.x, low.x), min(columns.y, high.x));
        rows = vec2u(max(rows.x, low.y), min(rows.y, high.y));
    }
    if RULES == GSPLAT {
        let sigmas = min(sqrt(2.0 * LN_2 * reach), GSPLAT_SIGMAS);
        let radius = ceil(sigmas * sqrt(variances));
        let low = whole_tiles(floor((mean - radius) / tile));
        let high = whole_tiles(ceil((mean + radius) / tile));
        columns = vec2u(max(columns.x, low.x), min(columns.y, high.x));
        rows = vec2u(max(rows.x, low.y), min(rows.y, high.y));
    }
    return array(columns, rows);
}

// Tile coordinates as pixels of the image.
fn whole_tiles(tile: vec2f) -> vec2u {
    return vec2u(clamp(tile * f32(TILE), vec2f(0.0), vec2f(frame.size)));
}

// The colour along a ray, each channel at least 0, with its rate.
fn colour_of(i: u32, ray: vec3f) -> array<vec2f, 3> {
    let distance = length(ray);
    let direction = ray / distance;
    // Only the component of the rate across the ray turns it.
    let rate = frame.ray_rate.xyz;
    let turning = (rate - direction * dot(direction, rate)) / distance;
    let basis = basis_of(
        vec2f(direction.x, turning.x),
        vec2f(direction.y, turning.y),
        vec2f(direction.z, turning.z),
    );
    var sum = array<vec2f, 3>();
    for (var k = 0u; k < SH_LEN; k++) {
        let at = 3u * (i * SH_LEN + k);
        for (var c = 0u; c < 3u; c++) {
            sum[c] += harmonics[at + c] * basis[k];
        }
    }
    for (var c = 0u; c < 3u; c++) {
        let value = sum[c] + still(0.5);
        sum[c] = select(vec2f(0.0), value, value.x > 0.0);
    }
    return sum;
}

// The harmonics of degree 0 to 3; see `scene/sh.rs`.
fn basis_of(x: vec2f, y: vec2f, z: vec2f) -> array<vec2f, 16> {
    var b: array<vec2f, 16>;
    b[0] = still(SH_0);
    if SH_LEN > 1u {
        b[1] = -SH_1 * y;
        b[2] = SH_1 * z;
        b[3] = -SH_1 * x;
    }
    let xx = times(x, x);
    let yy = times(y, y);
    let zz = times(z, z);
    if SH_LEN > 4u {
        b[4] = SH_2[0] * times(x, y);
        b[5] = SH_2[1] * times(y, z);
        b[6] = SH_2[2] * (zz + zz - xx - yy);
        b[7] = SH_2[3] * times(x, z);
        b[8] = SH_2[4] * (xx - yy);
    }
    if SH_LEN > 9u {
        let ring = 4.0 * zz - xx - yy;
        b[9] = SH_3[0] * times(y, 3.0 * xx - yy);
        b[10] = SH_3[1] * times(times(x, y), z);
        b[11] = SH_3[2] * times(y, ring);
        b[12] = SH_3[3] * times(z, zz + zz - 3.0 * (xx + yy));
        b[13] = SH_3[4] * times(x, ring);
        b[14] = SH_3[5] * times(z, xx - yy);
        b[15] = SH_3[6] * times(x, xx - 3.0 * yy);
    }
    return b;
}
