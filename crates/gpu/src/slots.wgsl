// The slots of the gradients. Each pair of tile and splat has one slot, which its tile fills, and the
// slots of a splat are neighbours, in order of its tiles.
//
// emitted    slot:  0        1        2        3        4
//                   A t0     A t1     B t1     B t2     C t1        range of A: 0, 2
// sorted     t0: (0 A)   t1: (1 A) (2 B) (4 C)   t2: (3 B)
//
// A pair's slot is the place where `emit` wrote it. The slot rides through the sort by tile as the
// value of the pair, and the splat is looked up behind it. So no second sort, by splat, is needed to
// find the sums of a splat again.

@group(1) @binding(0) var<storage, read> order: array<vec2u>;
// Number of pairs of each splat of the order.
@group(1) @binding(1) var<storage, read> touched: array<u32>;
// First pair of each workgroup of splats.
@group(1) @binding(2) var<storage, read> sums: array<u32>;
@group(1) @binding(3) var<storage, read> totals: array<u32>;
@group(1) @binding(4) var<storage, read_write> pairs: array<vec2u>;
// The splat of each slot.
@group(1) @binding(5) var<storage, read_write> owners: array<u32>;
// First slot and number of slots of each splat.
@group(1) @binding(6) var<storage, read_write> ranges: array<vec2u>;

// Before the sort: replaces the splat of each pair by the pair's slot.
@compute @workgroup_size(GROUP)
fn number(thread: Thread) {
    let i = thread.group.x * GROUP + place_of(thread);
    let exists = i < within(totals[SPLATS], frame.splat_room);
    var count = 0u;
    if exists {
        count = touched[i];
    }
    let before = sums_of(count, thread).before;
    if !exists {
        return;
    }
    let splat = order[i].y;
    let first = sums[thread.group.x] + before;
    ranges[splat] = vec2u(first, count);
    for (var slot = first; slot < first + count; slot++) {
        // Empty pairs get a slot as well. No tile lists them, so it stays zero.
        owners[slot] = splat;
        pairs[slot].y = slot;
    }
}

// After the sort, when the tiles have their lists: pairs become slot and splat, so that the raster
// pass reads the splat where it always does.
@compute @workgroup_size(GROUP)
fn name(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let count = within(totals[PAIRS], frame.pair_room);
    let end = min((group.x + 1u) * BLOCK, count);
    for (var i = group.x * BLOCK + local; i < end; i += GROUP) {
        let slot = pairs[i].y;
        pairs[i] = vec2u(slot, owners[slot]);
    }
}
