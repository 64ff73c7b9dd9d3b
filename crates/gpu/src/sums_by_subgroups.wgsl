// Sums over the threads of a workgroup, by subgroups. No order of the threads within a workgroup is
// assumed, and no width of a subgroup: the threads are numbered by the same sums, and work by that
// number. Every thread of the workgroup must call these functions.

struct Thread {
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(num_subgroups) subgroups: u32,
}

// The sum of the values of the threads before this one, and of all.
struct Sums {
    before: u32,
    all: u32,
}

// The sum of each subgroup. A device whose subgroups can be smaller takes `sums.wgsl`.
var<workgroup> heads: array<u32, GROUP / LEAST_SUBGROUP>;

// Place of the thread in the order of the sums.
fn place_of(thread: Thread) -> u32 {
    return sums_of(1u, thread).before;
}

// True for one thread of each subgroup.
fn is_head() -> bool {
    return subgroupExclusiveAdd(1u) == 0u;
}

// The sum of a value over all threads, which must fit 32 bits.
fn sum_of(value: u32, thread: Thread) -> u32 {
    return sums_of(value, thread).all;
}

// The same up to `MANY`, where it saturates.
fn sum_of_many(value: u32, thread: Thread) -> u32 {
    return sums_of_many(value, thread).all;
}

// The sums of a value in the order of the threads, which must fit 32 bits.
fn sums_of(value: u32, thread: Thread) -> Sums {
    let own = subgroupExclusiveAdd(value);
    let sum = subgroupAdd(value);
    let head = is_head();
    // Another thread may still read the sums of an earlier call.
    workgroupBarrier();
    if head {
        heads[thread.subgroup] = sum;
    }
    workgroupBarrier();
    var before = own;
    var all = 0u;
    for (var k = 0u; k < thread.subgroups; k++) {
        let each = heads[k];
        before += select(0u, each, k < thread.subgroup);
        all += each;
    }
    return Sums(before, all);
}

// The same up to `MANY`, where they saturate: sums of 16 bits each, which 256 threads cannot overflow.
fn sums_of_many(value: u32, thread: Thread) -> Sums {
    let capped = min(value, MANY);
    let low = sums_of(capped & 0xffffu, thread);
    let high = sums_of(capped >> 16u, thread);
    return Sums(joined(high.before, low.before), joined(high.all, low.all));
}

fn joined(high: u32, low: u32) -> u32 {
    let upper = min(high + (low >> 16u), MANY >> 16u);
    return min((upper << 16u) | (low & 0xffffu), MANY);
}
