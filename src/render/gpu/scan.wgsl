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

var<workgroup> partial: array<u32, GROUP>;

// Computes the exclusive sums of `count` entries, starting from `start`. Returns the total.
fn scan(count: u32, start: u32, local: u32) -> u32 {
    var carry = start;
    for (var base = 0u; base < count; base += GROUP * RUN) {
        let first = base + local * RUN;
        let end = min(first + RUN, count);
        var own = 0u;
        for (var i = first; i < end; i++) {
            own = sum_up_to_many(own, sums[i]);
        }
        partial[local] = own;
        for (var width = 1u; width < GROUP; width *= 2u) {
            workgroupBarrier();
            var before = 0u;
            if local >= width {
                before = partial[local - width];
            }
            workgroupBarrier();
            partial[local] = sum_up_to_many(partial[local], before);
        }
        workgroupBarrier();
        var sum = carry;
        if local > 0u {
            sum = sum_up_to_many(carry, partial[local - 1u]);
        }
        for (var i = first; i < end; i++) {
            let entry = sums[i];
            sums[i] = sum;
            sum = sum_up_to_many(sum, entry);
        }
        carry = sum_up_to_many(carry, partial[GROUP - 1u]);
        // The next round writes `partial` again.
        workgroupBarrier();
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
fn scan_splats(@builtin(local_invocation_index) local: u32) {
    let sum = scan(part.groups, totals[SPLATS], local);
    // Every thread must have read the old total before it is replaced.
    storageBarrier();
    workgroupBarrier();
    if local == 0u {
        totals[SPLATS] = sum;
        let count = within(sum, frame.splat_room);
        ask_for(BY_SPLATS, (count + GROUP - 1u) / GROUP);
        ask_for(BY_SPLAT_BLOCKS, (count + BLOCK - 1u) / BLOCK);
    }
}

// The pairs of all splats.
@compute @workgroup_size(GROUP)
fn scan_pairs(@builtin(local_invocation_index) local: u32) {
    let splats = within(totals[SPLATS], frame.splat_room);
    let sum = scan((splats + GROUP - 1u) / GROUP, 0u, local);
    if local == 0u {
        totals[PAIRS] = sum;
        let count = within(sum, frame.pair_room);
        ask_for(BY_PAIR_BLOCKS, (count + BLOCK - 1u) / BLOCK);
        // If the pairs exceed their capacity, `emit` must not run: it would write past the buffer.
        ask_for(BY_LISTED_SPLATS, select(0u, (splats + GROUP - 1u) / GROUP, count > 0u));
    }
}

// The counts of each digit in a pass of the sort, digit by digit and block by block.
@compute @workgroup_size(GROUP)
fn scan_splat_digits(@builtin(local_invocation_index) local: u32) {
    let blocks = (within(totals[SPLATS], frame.splat_room) + BLOCK - 1u) / BLOCK;
    _ = scan(DIGITS * blocks, 0u, local);
}

@compute @workgroup_size(GROUP)
fn scan_pair_digits(@builtin(local_invocation_index) local: u32) {
    let blocks = (within(totals[PAIRS], frame.pair_room) + BLOCK - 1u) / BLOCK;
    _ = scan(DIGITS * blocks, 0u, local);
}
