// Sums over the threads of a block's counters, by subgroups.

// The sums of each subgroup, word by word.
var<workgroup> word_heads: array<u32, WORDS * GROUP / LEAST_SUBGROUP>;

// Sums the counters of all threads. The sum of a word is in the first thread's counter afterwards.
fn add_up_counters(at: u32, thread: Thread) {
    let head = is_head();
    for (var word = 0u; word < WORDS; word++) {
        let sum = subgroupAdd(counters[word * GROUP + at]);
        if head {
            word_heads[thread.subgroup * WORDS + word] = sum;
        }
    }
    workgroupBarrier();
    if at < WORDS {
        var sum = 0u;
        for (var k = 0u; k < thread.subgroups; k++) {
            sum += word_heads[k * WORDS + at];
        }
        counters[at * GROUP] = sum;
    }
    workgroupBarrier();
}

// Replaces the counters of each thread by the sums over the threads before it.
fn rank_counters(at: u32, thread: Thread) {
    let head = is_head();
    var before: array<u32, WORDS>;
    for (var word = 0u; word < WORDS; word++) {
        let own = counters[word * GROUP + at];
        before[word] = subgroupExclusiveAdd(own);
        let sum = subgroupAdd(own);
        if head {
            word_heads[thread.subgroup * WORDS + word] = sum;
        }
    }
    workgroupBarrier();
    // One thread a word: the sums of the subgroups before each.
    if at < WORDS {
        var sum = 0u;
        for (var k = 0u; k < thread.subgroups; k++) {
            let each = word_heads[k * WORDS + at];
            word_heads[k * WORDS + at] = sum;
            sum += each;
        }
    }
    workgroupBarrier();
    // The counters of a thread are its own, so no barrier follows.
    for (var word = 0u; word < WORDS; word++) {
        counters[word * GROUP + at] = before[word] + word_heads[thread.subgroup * WORDS + word];
    }
}
