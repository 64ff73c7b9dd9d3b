// Passes 2 and 3: stable radix sort of (key, value) by digits of four bits, the lowest first. Each digit: `count` its values
// in every block, scan the counts, `scatter`. Ranks within a block come from one packed counter a thread and digit, so nothing
// depends on the order in which threads run, and no subgroup is needed.

struct Digit {
    // Of the lowest bit.
    shift: u32,
    // Whether pairs are sorted, and not splats.
    of_pairs: u32,
}

@group(1) @binding(0) var<uniform> digit: Digit;
@group(1) @binding(1) var<storage, read> source: array<vec2u>;
@group(1) @binding(2) var<storage, read_write> sorted: array<vec2u>;
@group(1) @binding(3) var<storage, read_write> counts: array<u32>;
@group(1) @binding(4) var<storage, read> totals: array<u32>;

// Entries of a block that one thread has, side by side.
const RUN: u32 = BLOCK / GROUP;
// Two 16-bit counters to a word: a block has at most 4096 entries of a digit.
const WORDS: u32 = DIGITS / 2u;

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
    let first = group.x * BLOCK + local * RUN;
    tally(first, min(first + RUN, length), local);
    for (var width = GROUP / 2u; width > 0u; width /= 2u) {
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
        counters[at] += 1u << (16u * (value % 2u));
        sorted[counts[value * blocks + group.x] + rank] = entry;
    }
}
