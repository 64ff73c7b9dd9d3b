// Sums over the threads of a workgroup, by workgroup memory alone; `sums_by_subgroups.wgsl` has the same
// functions for devices with subgroups. Integer sums are exact, so both give the same bits.

struct Thread {
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_index) local: u32,
}

// The sum of the values of the threads before this one, and of all.
struct Sums {
    before: u32,
    all: u32,
}

var<workgroup> partial: array<u32, GROUP>;

// Place of the thread in the order of the sums.
fn place_of(thread: Thread) -> u32 {
    return thread.local;
}

// The sum of a value over all threads, which must fit 32 bits.
fn sum_of(value: u32, thread: Thread) -> u32 {
    return sum_of_many(value, thread);
}

// The same up to `MANY`, where it saturates.
fn sum_of_many(value: u32, thread: Thread) -> u32 {
    let local = thread.local;
    // Another thread may still read the sums of an earlier call.
    workgroupBarrier();
    partial[local] = value;
    for (var width = GROUP / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if local < width {
            partial[local] = sum_up_to_many(partial[local], partial[local + width]);
        }
    }
    workgroupBarrier();
    return partial[0];
}

// The sums of a value in the order of the threads, which must fit 32 bits.
fn sums_of(value: u32, thread: Thread) -> Sums {
    return sums_of_many(value, thread);
}

// The same up to `MANY`, where they saturate.
fn sums_of_many(value: u32, thread: Thread) -> Sums {
    let local = thread.local;
    workgroupBarrier();
    partial[local] = value;
    for (var width = 1u; width < GROUP; width *= 2u) {
        // Read, barrier, add: another thread may still have to read the old value.
        workgroupBarrier();
        var before = 0u;
        if local >= width {
            before = partial[local - width];
        }
        workgroupBarrier();
        partial[local] = sum_up_to_many(partial[local], before);
    }
    workgroupBarrier();
    var before = 0u;
    if local > 0u {
        before = partial[local - 1u];
    }
    return Sums(before, partial[GROUP - 1u]);
}
