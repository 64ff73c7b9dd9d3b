// Backward pass 2: adds the sums of each splat over its tiles. Its slots are neighbours, in order of
// the tiles, so one thread adds each sum in that order: the same bits in every run, with no atomics.

// First slot and number of slots of each splat.
@group(1) @binding(0) var<storage, read> ranges: array<vec2u>;
@group(1) @binding(1) var<storage, read> moments: array<f32>;
@group(1) @binding(2) var<storage, read> totals: array<u32>;
// Ten sums for each splat.
@group(1) @binding(3) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(GROUP)
fn gather(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let end = SUMS * within(totals[SPLATS], frame.splat_room);
    // A thread per sum and not per splat: neighbouring threads read neighbouring words. The dispatch
    // has a thread per splat, so each takes ten sums, a workgroup's width apart.
    for (var k = 0u; k < SUMS; k++) {
        let i = (group.x * SUMS + k) * GROUP + local;
        if i < end {
            let range = ranges[i / SUMS];
            var sum = 0.0;
            for (var slot = range.x; slot < range.x + range.y; slot++) {
                sum += moments[slot * SUMS + i % SUMS];
            }
            sums[i] = sum;
        }
    }
}
