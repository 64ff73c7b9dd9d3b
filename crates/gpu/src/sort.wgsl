// Passes 2 and 3: a stable radix sort of (key, value) pairs by digits of four bits, lowest digit
// first.
//
// blocks       block 0          block 1          block 2
// threads      |r0|r1|r2|...|   |r0|r1|r2|...|   |r0|r1|r2|...|   each thread owns a run
// count        per block: number of entries with digit 0, 1, ... 15
// scan         counts ordered by (digit, block): the exclusive sum is the first place of each
// scatter      place = start of (digit, block) + entries of that digit before it in the block
//
// A sort by depth is part of the image: equal depths must keep their order, and two runs must give
// the same bytes. Atomics would rank entries in the order in which threads happen to run. Instead,
// each thread counts its own run in order, and a prefix sum over the threads of the block gives
// every entry its rank. The sums over the threads are in `ranks.wgsl` and `ranks_by_subgroups.wgsl`.
// They are of integers, so the result does not depend on the subgroups of the device.

struct Digit {
    // Number of the digit's lowest bit in the key.
    shift: u32,
    // 1 if the pairs of tile and splat are sorted, 0 if the splats are.
    of_pairs: u32,
}

@group(1) @binding(0) var<uniform> digit: Digit;
@group(1) @binding(1) var<storage, read> source: array<vec2u>;
@group(1) @binding(2) var<storage, read_write> sorted: array<vec2u>;
@group(1) @binding(3) var<storage, read_write> counts: array<u32>;
@group(1) @binding(4) var<storage, read> totals: array<u32>;

// Number of neighbouring entries of a block that one thread owns.
const RUN: u32 = BLOCK / GROUP;
// Two 16-bit counters share a word, which halves the workgroup memory. They cannot overflow into
// each other: a block has at most 4096 entries.
const WORDS: u32 = DIGITS / 2u;

// Laid out word by word and not thread by thread, so that neighbouring threads touch neighbouring
// banks.
var<workgroup> counters: array<u32, GROUP * WORDS>;

fn length_of() -> u32 {
    if digit.of_pairs == 1u {
        return within(totals[PAIRS], frame.pair_room);
    }
    return within(totals[SPLATS], frame.splat_room);
}

fn digit_of(key: u32) -> u32 {
    return (key >> digit.shift) & (DIGITS - 1u);
}

// Counts the digits of the thread's run, in order.
fn tally(first: u32, end: u32, at: u32) {
    for (var word = 0u; word < WORDS; word++) {
        counters[word * GROUP + at] = 0u;
    }
    for (var i = first; i < end; i++) {
        let value = digit_of(source[i].x);
        counters[(value / 2u) * GROUP + at] += 1u << (16u * (value % 2u));
    }
}

@compute @workgroup_size(GROUP)
fn count(thread: Thread) {
    let length = length_of();
    let place = place_of(thread);
    // Runs of neighbouring entries, and not every 256th entry: the order of threads is then the
    // order of entries.
    let first = thread.group.x * BLOCK + place * RUN;
    tally(first, min(first + RUN, length), place);
    add_up_counters(place, thread);
    if place < DIGITS {
        let blocks = (length + BLOCK - 1u) / BLOCK;
        let both = counters[(place / 2u) * GROUP];
        // Digit first, block second: the scan over this order gives the place of each (digit,
        // block).
        counts[place * blocks + thread.group.x] = (both >> (16u * (place % 2u))) & 0xffffu;
    }
}

@compute @workgroup_size(GROUP)
fn scatter(thread: Thread) {
    let length = length_of();
    let place = place_of(thread);
    let blocks = (length + BLOCK - 1u) / BLOCK;
    let first = thread.group.x * BLOCK + place * RUN;
    let end = min(first + RUN, length);
    tally(first, end, place);
    rank_counters(place, thread);
    for (var i = first; i < end; i++) {
        let entry = source[i];
        let value = digit_of(entry.x);
        let at = (value / 2u) * GROUP + place;
        let rank = (counters[at] >> (16u * (value % 2u))) & 0xffffu;
        // The counter goes on from the rank, so entries of one digit keep their order: the sort is
        // stable.
        counters[at] += 1u << (16u * (value % 2u));
        sorted[counts[value * blocks + thread.group.x] + rank] = entry;
    }
}
