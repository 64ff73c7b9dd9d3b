// A projected Gaussian, as in `cpu/splat.rs`: its opacity at a pixel is `opacity 2^-q`,
// `q = (w1 dx + w2 dy)^2 + (w3 dy)^2`. In memory, it is rows of four words:
//   0: mean x, y, w1, w2             1: w3, opacity, reach, depth
//   2: red, green, blue, luminance   3: columns, rows (first | end << 16), doubtful, index in the scene
//   4: rates of mean x, y, w1, w2    5: rate of w3, of the opacity over it, of the luminance, -
// The last two rows exist if a rate is requested. They are words and not floats: a pair of columns
// may look like a denormal, which a device may flush to zero.

struct Outline {
    mean: vec2f,
    w: vec3f,
    reach: f32,
    // First and end.
    columns: vec2u,
    rows: vec2u,
}

// No pixel with a larger exponent reaches the smallest blended opacity. WGSL's log2 has an error of
// 2^-21 or 3 ulp, and its exp2 of 3 + 2q ulp: for q < 8 less than 5e-6 together; q itself adds some
// ulp.
fn reach_of(opacity: f32) -> f32 {
    return max(log2(opacity / MIN_ALPHA), 0.0) * (1.0 + 1e-5) + 2e-5;
}

// Bound on the error that rounding adds to an edge of an extent, px, at `distance` px from the
// mean, for quotients and roots of 2.5 ulp.
fn edge_margin(distance: f32) -> f32 {
    return 0.02 + 2e-6 * distance;
}

// The pixels with centres between the two edges: first and end.
fn pixels_within(edges: vec2f, end: f32) -> vec2u {
    return vec2u(clamp(edges + 0.5, vec2f(0.0), vec2f(end)));
}

fn unpack(range: u32) -> vec2u {
    return vec2u(range & 0xffffu, range >> 16u);
}

fn pack(range: vec2u) -> u32 {
    return range.x | (range.y << 16u);
}

// The interval in x that the ellipse covers on the line `dy` px below the mean; reversed if the
// line misses it.
fn chord(splat: Outline, dy: f32) -> vec2f {
    let e = splat.w.z * dy;
    let room = splat.reach - e * e;
    if room < 0.0 {
        return vec2f(1.0, -1.0);
    }
    let half = sqrt(room) / splat.w.x;
    let shift = -splat.w.y / splat.w.x * dy;
    let wide = half + edge_margin(half + abs(shift));
    return splat.mean.x + shift + vec2f(-wide, wide);
}

// The columns that may be touched in these rows, which lie within the splat's rows.
fn columns_in(splat: Outline, first: u32, end: u32) -> vec2u {
    let w = splat.w;
    let skew = sqrt(w.y * w.y + w.z * w.z);
    let half = sqrt(splat.reach) * skew / (w.x * w.z);
    let wide = half + edge_margin(half);
    // The ellipse is widest to the right at dy = turn, to the left at dy = -turn.
    let turn = -w.y * sqrt(splat.reach) / (w.z * skew);
    let top = f32(first) + 0.5 - splat.mean.y;
    let bottom = f32(end) - 0.5 - splat.mean.y;
    let slack = edge_margin(abs(turn));
    var edges = splat.mean.x + vec2f(-wide, wide);
    // Only away from the widest point: an edge then recedes, and the nearest row decides.
    if !(-turn >= top - slack && -turn <= bottom + slack) {
        let found = chord(splat, clamp(-turn, top, bottom));
        edges.x = select(edges.x, found.x, found.x <= found.y);
    }
    if !(turn >= top - slack && turn <= bottom + slack) {
        let found = chord(splat, clamp(turn, top, bottom));
        edges.y = select(edges.y, found.y, found.x <= found.y);
    }
    let columns = pixels_within(edges, f32(splat.columns.y));
    return vec2u(max(columns.x, splat.columns.x), columns.y);
}

// First and end tile of a range of pixels, within the region.
fn tiles_of(pixels: vec2u, first: u32, end: u32) -> vec2u {
    return clamp((pixels + vec2u(0u, TILE - 1u)) / TILE, vec2u(first), vec2u(end));
}
