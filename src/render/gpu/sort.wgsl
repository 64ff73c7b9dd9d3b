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
// every entry its rank. No subgroup operation is used. The result therefore does not depend on the
// subgroup width of the device, and devices without subgroups run it too.

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
fn tally(first: u32, end: u32, local: u32) {
    for (var word = 0u; word < WORDS; word++) {
        counters[word * GROUP + local] = 0u;
    }
    for (var i = first; i < end; i++) {
        let value = digit_of(source[i].x);
        counters[(value / 2u) * GROUP + local] += 1u << (16u * (value % 2u));
    }
}

@compute @workgroup_size(GROUP)
fn count(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let length = length_of();
    // Runs of neighbouring entries, and not every 256th entry: the order of threads is then the
    // order of entries.
    let first = group.x * BLOCK + local * RUN;
    tally(first, min(first + RUN, length), local);
    // Tree reduction over the threads. Integer sums are exact, so their order does not matter.
    for (var width = GROUP / 2u; width > 0u; width /= 2u) {
        // Every thread must reach the barrier, so the test for `local` stays inside the loop.
        workgroupBarrier();
        if local < width {
            for (var word = 0u; word < WORDS; word++) {
                counters[word * GROUP + local] += counters[word * GROUP + local + width];
            }
        }
    }
    workgroupBarrier();
    if local < DIGITS {
        let blocks = (length + BLOCK - 1u) / BLOCK;
        let both = counters[(local / 2u) * GROUP];
        // Digit first, block second: the scan over this order gives the place of each (digit,
        // block).
        counts[local * blocks + group.x] = (both >> (16u * (local % 2u))) & 0xffffu;
    }
}

@compute @workgroup_size(GROUP)
fn scatter(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let length = length_of();
    let blocks = (length + BLOCK - 1u) / BLOCK;
    let first = group.x * BLOCK + local * RUN;
    let end = min(first + RUN, length);
    tally(first, end, local);
    // Inclusive prefix sum over the threads (Hillis and Steele). Read, barrier, add: a thread must
    // not add to a counter that another still has to read.
    var before: array<u32, WORDS>;
    for (var width = 1u; width < GROUP; width *= 2u) {
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            before[word] = 0u;
            if local >= width {
                before[word] = counters[word * GROUP + local - width];
            }
        }
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            counters[word * GROUP + local] += before[word];
        }
    }
    // Shift by one thread: the exclusive sum is the rank of the thread's first entry of each digit.
    workgroupBarrier();
    for (var word = 0u; word < WORDS; word++) {
        before[word] = 0u;
        if local > 0u {
            before[word] = counters[word * GROUP + local - 1u];
        }
    }
    workgroupBarrier();
    for (var word = 0u; word < WORDS; word++) {
        counters[word * GROUP + local] = before[word];
    }
    for (var i = first; i < end; i++) {
        let entry = source[i];
        let value = digit_of(entry.x);
        let at = (value / 2u) * GROUP + local;
        let rank = (counters[at] >> (16u * (value % 2u))) & 0xffffu;
        // The counter goes on from the rank, so entries of one digit keep their order: the sort is
        // stable.
        counters[at] += 1u << (16u * (value % 2u));
        sorted[counts[value * blocks + group.x] + rank] = entry;
    }
}
