// Sums over the threads of a block's counters, by workgroup memory alone; `ranks_by_subgroups.wgsl` has
// the same functions for devices with subgroups.

// Sums the counters of all threads. The sum of a word is in the first thread's counter afterwards.
fn add_up_counters(at: u32, thread: Thread) {
    // Tree reduction over the threads. Integer sums are exact, so their order does not matter.
    for (var width = GROUP / 2u; width > 0u; width /= 2u) {
        // Every thread must reach the barrier, so the test for `at` stays inside the loop.
        workgroupBarrier();
        if at < width {
            for (var word = 0u; word < WORDS; word++) {
                counters[word * GROUP + at] += counters[word * GROUP + at + width];
            }
        }
    }
    workgroupBarrier();
}

// Replaces the counters of each thread by the sums over the threads before it.
fn rank_counters(at: u32, thread: Thread) {
    // Inclusive prefix sum over the threads (Hillis and Steele). Read, barrier, add: a thread must
    // not add to a counter that another still has to read.
    var before: array<u32, WORDS>;
    for (var width = 1u; width < GROUP; width *= 2u) {
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            before[word] = 0u;
            if at >= width {
                before[word] = counters[word * GROUP + at - width];
            }
        }
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            counters[word * GROUP + at] += before[word];
        }
    }
    // Shift by one thread: the exclusive sum is the rank of the thread's first entry of each digit.
    workgroupBarrier();
    for (var word = 0u; word < WORDS; word++) {
        before[word] = 0u;
        if at > 0u {
            before[word] = counters[word * GROUP + at - 1u];
        }
    }
    workgroupBarrier();
    for (var word = 0u; word < WORDS; word++) {
        counters[word * GROUP + at] = before[word];
    }
}
