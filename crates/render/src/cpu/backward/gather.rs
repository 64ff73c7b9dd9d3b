//! The sums of each splat over its tiles, in order of tiles.
//!
//! A tile writes the moments of its own list, so no two tasks write to one place, and nothing is
//! atomic. Here each task adds the moments of its own range of splats and passes over the others,
//! so the order of every sum is that of the tiles, whatever the number of threads.

use super::raster::SplatMoments;
use crate::cpu::bin::TileLists;
use rayon::prelude::*;

/// Adds the moments of the lists' entries to `sums`, which has one place per splat. `pairs` holds
/// the entries of the band's tiles, one tile after the other.
pub(super) fn add_by_splat(lists: &TileLists, pairs: &[SplatMoments], sums: &mut [SplatMoments]) {
    let part = sums.len().div_ceil(rayon::current_num_threads()).max(1);
    sums.par_chunks_mut(part).enumerate().for_each(|(k, sums)| {
        let first = k * part;
        let mut pairs = pairs;
        for run in lists.band().flat_map(|tile| lists.of(tile)) {
            let (own, rest) = pairs.split_at(run.len());
            pairs = rest;
            for (&place, moments) in run.iter().zip(own) {
                // A place below `first` wraps to a large number and is in no part.
                if let Some(sum) = sums.get_mut((place as usize).wrapping_sub(first)) {
                    *sum += moments;
                }
            }
        }
    });
}
