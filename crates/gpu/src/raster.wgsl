// Passes 4 and 5: a workgroup blends a tile, one thread per pixel, front to back, and writes its
// images; see `cpu/raster.rs` and `cpu/resolve.rs`. Splats are loaded into workgroup memory in
// batches.

@group(1) @binding(0) var<storage, read> splats: array<vec4u>;
@group(1) @binding(1) var<storage, read> pairs: array<vec2u>;
@group(1) @binding(2) var<storage, read> lists: array<vec2u>;
@group(1) @binding(3) var<storage, read_write> images: array<f32>;
@group(1) @binding(4) var<storage, read_write> totals: array<atomic<u32>>;

const PIXELS: u32 = TILE * TILE;

var<workgroup> near: array<vec4u, BATCH * SPLAT_ROWS>;
var<workgroup> open: atomic<u32>;
var<workgroup> goes_on: u32;
var<workgroup> blended_by: array<u32, PIXELS>;
var<workgroup> stopped: atomic<u32>;

struct Pixel {
    at: vec2f,
    open: bool,
    colour: vec3f,
    grey: f32,
    depth: f32,
    doubtful: f32,
    rest: f32,
    rest_rate: f32,
    grey_rate: f32,
    blended: u32,
    stopped: bool,
    // Number of entries of the tile's list up to the last blended one.
    last: u32,
}

@compute @workgroup_size(PIXELS)
fn raster(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = (frame.first + group.xy) * TILE + vec2u(local % TILE, local / TILE);
    let inside = all(place < frame.size);
    var pixel: Pixel;
    pixel.at = vec2f(place) + 0.5;
    pixel.open = inside;
    pixel.rest = 1.0;
    var loaded = 0u;
    let range = lists[group.y * (frame.end.x - frame.first.x) + group.x];
    for (var base = range.x; base < range.y; base += BATCH) {
        if local == 0u {
            atomicStore(&open, 0u);
        }
        workgroupBarrier();
        if pixel.open {
            atomicStore(&open, 1u);
        }
        workgroupBarrier();
        if local == 0u {
            goes_on = atomicLoad(&open);
        }
        // A uniform load: barriers follow, so all threads must decide alike.
        if workgroupUniformLoad(&goes_on) == 0u {
            break;
        }
        let count = min(BATCH, range.y - base);
        loaded += count;
        // All threads have passed the barriers above, so no thread still reads the previous batch.
        for (var k = local; k < count; k += PIXELS) {
            let from_row = pairs[base + k].y * SPLAT_ROWS;
            for (var row = 0u; row < SPLAT_ROWS; row++) {
                near[k * SPLAT_ROWS + row] = splats[from_row + row];
            }
        }
        workgroupBarrier();
        for (var k = 0u; k < count && pixel.open; k++) {
            blend(k * SPLAT_ROWS, base - range.x + k + 1u, &pixel);
        }
    }
    if inside {
        store(place - frame.first * TILE, pixel);
    }
    account(pixel, loaded, local);
}

// Blends one layer over the pixel. `place` is its place in the tile's list, counted from 1.
fn blend(row: u32, place: u32, pixel: ptr<function, Pixel>) {
    let first = bitcast<vec4f>(near[row]);
    let second = bitcast<vec4f>(near[row + 1u]);
    let d = (*pixel).at - first.xy;
    let e1 = first.z * d.x + first.w * d.y;
    let e2 = second.x * d.y;
    let q = e1 * e1 + e2 * e2;
    // Outside the ellipse no opacity counts, so the exponential is saved.
    if q > second.z {
        return;
    }
    let free = second.y * exp2(-q);
    var alpha = min(free, MAX_ALPHA);
    if alpha < MIN_ALPHA {
        return;
    }
    var slope = 1.0;
    if RULES == SOFT {
        let u = clamp(255.0 * alpha - 0.5, 0.0, 1.0);
        let ramp = u * u * (3.0 - 2.0 * u);
        slope = ramp + alpha * (6.0 * 255.0) * u * (1.0 - u);
        alpha = alpha * ramp;
    }
    let rest = (*pixel).rest;
    let after = rest * (1.0 - alpha);
    if after < STOP {
        (*pixel).open = false;
        (*pixel).stopped = true;
        return;
    }
    if RATE {
        blend_rate(row, vec4f(d, e1, e2), vec3f(free, slope, alpha), pixel);
    }
    let weight = rest * alpha;
    let third = bitcast<vec4f>(near[row + 2u]);
    if RGB_AT != ABSENT {
        (*pixel).colour += weight * third.xyz;
    }
    if GREY_AT != ABSENT {
        (*pixel).grey += weight * third.w;
    }
    if DEPTH_AT != ABSENT {
        (*pixel).depth += weight * second.w;
    }
    if DOUBT_AT != ABSENT {
        (*pixel).doubtful += weight * f32(near[row + 3u].z);
    }
    (*pixel).rest = after;
    (*pixel).blended += u32(alpha > 0.0);
    if TRACE_AT != ABSENT {
        (*pixel).last = place;
    }
}

// The rates of the layer, before it is blended. `seen` is dx, dy, e1, e2; `opacity` holds the
// layer's opacity at the pixel before clamp and ramp, the derivative of the ramp, and the blended
// value.
fn blend_rate(row: u32, seen: vec4f, opacity: vec3f, pixel: ptr<function, Pixel>) {
    let w = vec3f(bitcast<vec2f>(near[row].zw), bitcast<f32>(near[row + 1u].x));
    let moving = bitcast<vec4f>(near[row + 4u]);
    let more = bitcast<vec4f>(near[row + 5u]);
    let e1_rate = moving.z * seen.x + moving.w * seen.y - w.x * moving.x - w.y * moving.y;
    let e2_rate = more.x * seen.y - w.z * moving.y;
    let power_rate = 2.0 * LN_2 * (seen.z * e1_rate + seen.w * e2_rate);
    var rate = opacity.x * (more.y - power_rate) * opacity.y;
    if opacity.x >= MAX_ALPHA {
        rate = 0.0;
    }
    let weight_rate = (*pixel).rest_rate * opacity.z + (*pixel).rest * rate;
    let grey = bitcast<f32>(near[row + 2u].w);
    (*pixel).grey_rate += weight_rate * grey + (*pixel).rest * opacity.z * more.z;
    // `Tdot (1 - alpha) - T alphadot` is `Tdot` minus the rate of the weight.
    (*pixel).rest_rate -= weight_rate;
}

// Writes the pixel's images, with the background added. Pixels of the region are row by row, images
// one after another.
fn store(place: vec2u, pixel: Pixel) {
    let extent = min(frame.end * TILE, frame.size) - frame.first * TILE;
    let pixels = extent.x * extent.y;
    let at = place.y * extent.x + place.x;
    if RGB_AT != ABSENT {
        let colour = pixel.colour + pixel.rest * frame.background.xyz;
        images[RGB_AT * pixels + 3u * at] = colour.x;
        images[RGB_AT * pixels + 3u * at + 1u] = colour.y;
        images[RGB_AT * pixels + 3u * at + 2u] = colour.z;
    }
    if GREY_AT != ABSENT {
        images[GREY_AT * pixels + at] = pixel.grey + pixel.rest * frame.background.w;
    }
    let alpha = 1.0 - pixel.rest;
    if ALPHA_AT != ABSENT {
        images[ALPHA_AT * pixels + at] = alpha;
    }
    if DEPTH_AT != ABSENT {
        // A mark, because NaN is not portable in WGSL.
        images[DEPTH_AT * pixels + at] = select(pixel.depth / alpha, UNDEFINED, alpha < DEPTH_MIN_ALPHA);
    }
    if DOUBT_AT != ABSENT {
        images[DOUBT_AT * pixels + at] = pixel.doubtful;
    }
    if RATE_AT != ABSENT {
        images[RATE_AT * pixels + at] = pixel.grey_rate + pixel.rest_rate * frame.background.w;
    }
    if TRACE_AT != ABSENT {
        // The light itself: of `1 - alpha`, a difference, nothing would be left behind opaque layers.
        let trace = TRACE_AT * pixels + at;
        images[trace] = pixel.rest;
        // As a number and not by its bits: small integers look like denormals, which a device may
        // flush to zero. Scenes with gradients are small enough for 24 bits.
        images[trace + pixels] = f32(pixel.last);
    }
}

// Adds to the counts. The number of blended layers has a carry, because a large image exceeds 2^32.
fn account(pixel: Pixel, loaded: u32, local: u32) {
    blended_by[local] = pixel.blended;
    if local == 0u {
        atomicStore(&stopped, 0u);
    }
    workgroupBarrier();
    atomicAdd(&stopped, u32(pixel.stopped));
    for (var width = PIXELS / 2u; width > 0u; width /= 2u) {
        if local < width {
            blended_by[local] += blended_by[local + width];
        }
        workgroupBarrier();
    }
    if local == 0u {
        let added = blended_by[0];
        let before = atomicAdd(&totals[BLENDED], added);
        if before + added < before {
            atomicAdd(&totals[BLENDED_CARRY], 1u);
        }
        atomicAdd(&totals[STOPPED], atomicLoad(&stopped));
        atomicAdd(&totals[LOADED], loaded);
    }
}
