// Exclusive sums of the counts of a pass's workgroups, computed by one workgroup that runs along
// them.

@group(1) @binding(0) var<storage, read_write> sums: array<u32>;
@group(1) @binding(1) var<storage, read_write> totals: array<u32>;
// Sizes of the dispatches that the device computes: x, y, z each.
@group(1) @binding(2) var<storage, read_write> groups: array<u32>;
@group(1) @binding(3) var<uniform> part: Part;

struct Part {
    count: u32,
    groups: u32,
}

// Number of entries that a thread adds at a time.
const RUN: u32 = 16u;

// Computes the exclusive sums of `count` entries, starting from `start`. Returns the total.
fn scan(count: u32, start: u32, thread: Thread) -> u32 {
    let place = place_of(thread);
    var carry = start;
    for (var base = 0u; base < count; base += GROUP * RUN) {
        let first = base + place * RUN;
        let end = min(first + RUN, count);
        var own = 0u;
        for (var i = first; i < end; i++) {
            own = sum_up_to_many(own, sums[i]);
        }
        let found = sums_of_many(own, thread);
        var sum = sum_up_to_many(carry, found.before);
        for (var i = first; i < end; i++) {
            let entry = sums[i];
            sums[i] = sum;
            sum = sum_up_to_many(sum, entry);
        }
        carry = sum_up_to_many(carry, found.all);
    }
    return carry;
}

fn ask_for(dispatch: u32, count: u32) {
    groups[3u * dispatch] = count;
    groups[3u * dispatch + 1u] = 1u;
    groups[3u * dispatch + 2u] = 1u;
}

// The splats of one part of the scene, after those of the earlier parts.
@compute @workgroup_size(GROUP)
fn scan_splats(thread: Thread) {
    let sum = scan(part.groups, totals[SPLATS], thread);
    // Every thread must have read the old total before it is replaced.
    storageBarrier();
    workgroupBarrier();
    if thread.local == 0u {
        totals[SPLATS] = sum;
        let count = within(sum, frame.splat_room);
        ask_for(BY_SPLATS, (count + GROUP - 1u) / GROUP);
        ask_for(BY_SPLAT_BLOCKS, (count + BLOCK - 1u) / BLOCK);
    }
}

// The pairs of all splats.
@compute @workgroup_size(GROUP)
fn scan_pairs(thread: Thread) {
    let splats = within(totals[SPLATS], frame.splat_room);
    let sum = scan((splats + GROUP - 1u) / GROUP, 0u, thread);
    if thread.local == 0u {
        totals[PAIRS] = sum;
        let count = within(sum, frame.pair_room);
        ask_for(BY_PAIR_BLOCKS, (count + BLOCK - 1u) / BLOCK);
        // If the pairs exceed their capacity, `emit` must not run: it would write past the buffer.
        ask_for(BY_LISTED_SPLATS, select(0u, (splats + GROUP - 1u) / GROUP, count > 0u));
    }
}

// The counts of each digit in a pass of the sort, digit by digit and block by block.
@compute @workgroup_size(GROUP)
fn scan_splat_digits(thread: Thread) {
    let blocks = (within(totals[SPLATS], frame.splat_room) + BLOCK - 1u) / BLOCK;
    _ = scan(DIGITS * blocks, 0u, thread);
}

@compute @workgroup_size(GROUP)
fn scan_pair_digits(thread: Thread) {
    let blocks = (within(totals[PAIRS], frame.pair_room) + BLOCK - 1u) / BLOCK;
    _ = scan(DIGITS * blocks, 0u, thread);
}
