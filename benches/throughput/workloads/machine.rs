//! Limits of one core of this machine. `docs/performance.md` compares the raster and the sensor with them.

use super::amount;
use crate::measure::{Workload, timed};
use fearless_simd::{Level, Simd, SimdBase as _, dispatch};

/// Number of values of the array that is copied: 256 MB, more than any cache.
const VALUES: usize = 1 << 26;
/// Number of independent sums: enough to hide the latency of a multiplication and an addition.
const SUMS: usize = 12;
const ROUNDS: usize = 1 << 22;

pub(super) fn workloads() -> Vec<Workload> {
    vec![copy(), arithmetic()]
}

fn copy() -> Workload {
    let from = vec![1.0_f32; VALUES];
    let mut to = vec![0.0_f32; VALUES];
    let run = move || {
        timed(|| {
            to.copy_from_slice(&from);
            std::hint::black_box(&to);
            // Each value is read once and written once.
            vec![amount(2 * 4 * VALUES, "Mbyte")]
        })
    };
    let what = format!("copy of {} MB, bytes read and written, one core", (4 * VALUES) >> 20);
    Workload { part: "machine", what, rival: false, run: Box::new(run) }
}

fn arithmetic() -> Workload {
    let level = Level::new();
    let run = move || {
        timed(|| {
            let lanes = dispatch!(level, simd => multiply_and_add(simd));
            vec![amount(2 * SUMS * lanes * ROUNDS, "Mflop")]
        })
    };
    let what = "32-bit multiplications and additions, not fused, in registers, one core".to_owned();
    Workload { part: "machine", what, rival: false, run: Box::new(run) }
}

/// Returns the number of lanes of a vector.
#[inline(always)]
fn multiply_and_add<S: Simd>(simd: S) -> usize {
    let factor = S::f32s::splat(simd, std::hint::black_box(0.999_9));
    let added = S::f32s::splat(simd, std::hint::black_box(1e-4));
    let mut sums = [S::f32s::splat(simd, 1.0); SUMS];
    for _ in 0..ROUNDS {
        for sum in &mut sums {
            *sum = *sum * factor + added;
        }
    }
    std::hint::black_box(sums.map(|sum| sum.as_slice()[0]));
    S::f32s::LEN
}
