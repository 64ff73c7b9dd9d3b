// Backward pass 1: from the gradient of the loss at each pixel to sums per pair of tile and splat. The
// formulas are those of `cpu/backward/raster.rs`:
//
// alpha_i = min(0.99, o 2^-q) r,   q = e1^2 + e2^2,   e = W (pixel - mean)
// dL/dalpha_i = T_i (g . c_i) - behind_i / (1 - alpha_i),   a = dL/d ln(o 2^-q)
//
// WGSL has no atomic float, and sums over a tile's 256 threads would need several barriers for each
// splat. So a thread owns a splat instead of a pixel, and the pixels stream past the threads:
//
// step       0    1    2    3    4
// thread 0   p0   p1   p2   p3   p4      the last layer
// thread 1        p0   p1   p2   p3      the layer in front of it
// thread 2             p0   p1   p2
//
// A pixel meets its layers back to front, one step after another, and its state (light and colour
// from behind) waits in workgroup memory in between. The ten sums of a splat stay in the registers of
// its thread, with the pixels in order, and are written once: one barrier per step, no reduction, no
// atomics, and the same bits in every run.

@group(1) @binding(0) var<storage, read> splats: array<vec4u>;
// Slot and splat.
@group(1) @binding(1) var<storage, read> pairs: array<vec2u>;
@group(1) @binding(2) var<storage, read> lists: array<vec2u>;
// The trace of the forward pass.
@group(1) @binding(3) var<storage, read> images: array<f32>;
// Gradient by the colour, and score, of each pixel of the region.
@group(1) @binding(4) var<storage, read> by_pixel: array<vec4f>;
// Ten sums for each slot, zero at first.
@group(1) @binding(5) var<storage, read_write> moments: array<f32>;

const PIXELS: u32 = TILE * TILE;

var<workgroup> light: array<f32, PIXELS>;
// `g .` the light that comes from behind.
var<workgroup> behind: array<f32, PIXELS>;
var<workgroup> given: array<vec4f, PIXELS>;
// Number of entries of the list up to the last blended one.
var<workgroup> last: array<u32, PIXELS>;
var<workgroup> ends: array<u32, WAVE>;

struct Layer {
    mean: vec2f,
    w: vec3f,
    opacity: f32,
    reach: f32,
    colour: vec3f,
    // Its place in the tile's list, counted from 1.
    place: u32,
}

// Moments of `a` over the offset `e`: 1, e1, e2; then e1 e1, e1 e2, e2 e2; then colour and score.
struct Moments {
    low: vec3f,
    high: vec3f,
    seen: vec4f,
}

@compute @workgroup_size(WAVE)
fn backward(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let corner = (frame.first + group.xy) * TILE;
    var most = 0u;
    for (var pixel = local; pixel < PIXELS; pixel += WAVE) {
        start(pixel, corner);
        most = max(most, last[pixel]);
    }
    ends[local] = most;
    for (var width = WAVE / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if local < width {
            ends[local] = max(ends[local], ends[local + width]);
        }
    }
    // A uniform load: barriers follow, so all threads must decide alike. It is a barrier as well, so
    // the pixels of the other threads are there.
    let end = workgroupUniformLoad(&ends[0]);
    let first = lists[group.y * (frame.end.x - frame.first.x) + group.x].x;
    for (var done = 0u; done < end; done += WAVE) {
        let owns = done + local < end;
        var layer: Layer;
        var slot = 0u;
        if owns {
            let pair = pairs[first + end - 1u - done - local];
            slot = pair.x;
            layer = layer_of(pair.y, end - done - local);
        }
        var sums: Moments;
        // The last thread begins one step per thread before it after the first.
        let steps = PIXELS + min(WAVE, end - done) - 1u;
        for (var step = 0u; step < steps; step++) {
            // Before the thread's first pixel, the difference wraps to a large number.
            let pixel = step - local;
            if owns && pixel < PIXELS {
                // Behind the last layer, a pixel has no trace. In front of it, no stop is repeated.
                if layer.place <= last[pixel] {
                    take_away(layer, pixel, vec2f(corner) + 0.5, &sums);
                }
            }
            // The next thread reads what this one left.
            workgroupBarrier();
        }
        if owns {
            keep(slot, sums);
        }
    }
}

// The state of a pixel behind its last layer.
fn start(pixel: u32, corner: vec2u) {
    let place = corner + vec2u(pixel % TILE, pixel / TILE);
    // Outside the image `last` is 0, so no layer counts there.
    light[pixel] = 1.0;
    behind[pixel] = 0.0;
    given[pixel] = vec4f(0.0);
    last[pixel] = 0u;
    if all(place < frame.size) {
        let extent = min(frame.end * TILE, frame.size) - frame.first * TILE;
        let inner = place - frame.first * TILE;
        let at = inner.y * extent.x + inner.x;
        let pixels = extent.x * extent.y;
        let trace = TRACE_AT * pixels + at;
        let rest = images[trace];
        let gradient = by_pixel[at];
        light[pixel] = rest;
        behind[pixel] = rest * dot(gradient.xyz, frame.background.xyz);
        given[pixel] = gradient;
        last[pixel] = u32(images[trace + pixels]);
    }
}

fn layer_of(splat: u32, place: u32) -> Layer {
    let row = splat * SPLAT_ROWS;
    let first = bitcast<vec4f>(splats[row]);
    let second = bitcast<vec4f>(splats[row + 1u]);
    let third = bitcast<vec4f>(splats[row + 2u]);
    return Layer(first.xy, vec3f(first.zw, second.x), second.y, second.z, third.xyz, place);
}

// Takes a layer away from a pixel, and adds what it did there to its sums. The tests are those of
// the forward pass. Where another rounding tips one of them, a layer of the smallest blended opacity
// is taken for one that was skipped, or the reverse: 1/255 of the light at that pixel, for `soft`
// nothing.
fn take_away(layer: Layer, pixel: u32, origin: vec2f, sums: ptr<function, Moments>) {
    let d = origin + vec2f(vec2u(pixel % TILE, pixel / TILE)) - layer.mean;
    let e = vec2f(layer.w.x * d.x + layer.w.y * d.y, layer.w.z * d.y);
    let q = dot(e, e);
    if q > layer.reach {
        return;
    }
    let free = layer.opacity * exp2(-q);
    var alpha = min(free, MAX_ALPHA);
    if alpha < MIN_ALPHA {
        return;
    }
    // A capped opacity is constant.
    var slope = select(0.0, alpha, free < MAX_ALPHA);
    if RULES == SOFT {
        let u = clamp(255.0 * alpha - 0.5, 0.0, 1.0);
        let ramp = u * u * (3.0 - 2.0 * u);
        slope *= ramp + alpha * (6.0 * 255.0) * u * (1.0 - u);
        alpha *= ramp;
    }
    // The light in front of the layer, by division: at most 0.99 of it was taken away.
    let back = 1.0 / (1.0 - alpha);
    let before = light[pixel] * back;
    let weight = before * alpha;
    let gradient = given[pixel];
    let lit = dot(gradient.xyz, layer.colour);
    let a = (before * lit - behind[pixel] * back) * slope;
    light[pixel] = before;
    behind[pixel] += weight * lit;
    // Of `e` and not of `d`: for a needle, moments of the offset in pixels would cancel when they are
    // turned into the gradient of the covariance.
    (*sums).low += a * vec3f(1.0, e);
    (*sums).high += a * vec3f(e.x * e.x, e.x * e.y, e.y * e.y);
    (*sums).seen += weight * gradient;
}

fn keep(slot: u32, sums: Moments) {
    let at = slot * SUMS;
    for (var k = 0u; k < 3u; k++) {
        moments[at + k] = sums.low[k];
        moments[at + 3u + k] = sums.high[k];
    }
    for (var k = 0u; k < 4u; k++) {
        moments[at + 6u + k] = sums.seen[k];
    }
}
