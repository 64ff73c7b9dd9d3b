//! Lists of the walkers that reach a cell of the dyadic tree, eight per vector.

use fearless_simd::{Simd, SimdBase as _, SimdMask as _, f64x8, mask64x8, u64x8};
use gs2e_num::elementary::{load_eight, store_eight};

/// Walkers that reach one cell. The arrays are longer than `len`, up to a multiple of 8, so that
/// whole vectors can be loaded; the entries after `len` are padding.
#[derive(Debug, Default)]
pub(super) struct CellList {
    pub(super) len: usize,
    pub(super) members: Vec<u64>,
    /// Increment of the Brownian motion over the cell, before it is scaled by sigma.
    pub(super) increment: Vec<f64>,
    /// Drift at the cell's start.
    pub(super) from: Vec<f64>,
    /// Drift at the cell's end.
    pub(super) to: Vec<f64>,
    /// Increment over the first half. Filled by the split.
    pub(super) half: Vec<f64>,
    /// Drift in the cell's middle. Filled by the split.
    pub(super) middle: Vec<f64>,
    /// The photoreceptor's noise. Without it, its arrays stay empty.
    pub(super) receptor: ReceptorEnds,
}

/// The photoreceptor's noise at the ends of a cell, and in its middle once it is split.
#[derive(Debug, Default)]
pub(super) struct ReceptorEnds {
    from: Vec<f64>,
    to: Vec<f64>,
    pub(super) middle: Vec<f64>,
}

impl CellList {
    /// Makes room for eight more entries.
    #[inline(always)]
    pub(super) fn reserve(&mut self) {
        // `extend` stores a full vector of eight and then counts only the selected lanes.
        if self.len + 8 > self.members.len() {
            let longer = (2 * self.len + 64).next_multiple_of(8);
            self.members.resize(longer, 0);
            for values in
                [&mut self.increment, &mut self.from, &mut self.to, &mut self.half, &mut self.middle]
            {
                values.resize(longer, 0.0);
            }
        }
    }

    #[inline(always)]
    pub(super) fn push(
        &mut self,
        member: u64,
        increment: f64,
        [from, to]: [f64; 2],
        receptor: Option<[f64; 2]>,
    ) {
        self.reserve();
        let i = self.len;
        (self.members[i], self.increment[i], self.from[i], self.to[i]) = (member, increment, from, to);
        if let Some([from, to]) = receptor {
            self.receptor.reserve(self.members.len());
            (self.receptor.from[i], self.receptor.to[i]) = (from, to);
        }
        self.len = i + 1;
    }

    /// Adds the lanes whose bit is set in `which`.
    #[inline(always)]
    pub(super) fn extend<S: Simd>(
        &mut self,
        which: u64,
        members: u64x8<S>,
        [increment, from, to]: [f64x8<S>; 3],
        receptor: Option<[f64x8<S>; 2]>,
    ) {
        self.reserve();
        let simd = members.simd;
        let mask = mask64x8::from_bitmask(simd, which);
        simd.compress_u64x8(members, mask).store_slice(&mut self.members[self.len..self.len + 8]);
        store_eight(simd.compress_f64x8(increment, mask), &mut self.increment, self.len);
        store_eight(simd.compress_f64x8(from, mask), &mut self.from, self.len);
        store_eight(simd.compress_f64x8(to, mask), &mut self.to, self.len);
        if let Some([from, to]) = receptor {
            self.receptor.reserve(self.members.len());
            store_eight(simd.compress_f64x8(from, mask), &mut self.receptor.from, self.len);
            store_eight(simd.compress_f64x8(to, mask), &mut self.receptor.to, self.len);
        }
        self.len += which.count_ones() as usize;
    }

    /// Fills the padding with valid members.
    pub(super) fn pad(&mut self) {
        // Padding is used as an index when whole vectors are gathered. Its results are masked out
        // later.
        for i in self.len..self.len.next_multiple_of(8) {
            self.members[i] = self.members[0];
        }
    }

    pub(super) fn whole(&self) -> CellCrowd<'_> {
        let Self { len, members, increment, from, to, receptor, .. } = self;
        CellCrowd { len: *len, members, increment, from, to, receptor: [&receptor.from, &receptor.to] }
    }

    /// The walkers in the first half of the cell. Call it after the split.
    pub(super) fn first_half(&self) -> CellCrowd<'_> {
        let receptor = [&self.receptor.from[..], &self.receptor.middle];
        CellCrowd { increment: &self.half, to: &self.middle, receptor, ..self.whole() }
    }

    /// The walkers in the second half of the cell. Call it after the split, which stores the second
    /// half's increment in the place of the whole cell's.
    pub(super) fn second_half(&self) -> CellCrowd<'_> {
        let receptor = [&self.receptor.middle[..], &self.receptor.to];
        CellCrowd { from: &self.middle, receptor, ..self.whole() }
    }
}

impl ReceptorEnds {
    /// Change over the cell of one entry; `None` without this noise.
    #[inline(always)]
    pub(super) fn change(&self, at: usize) -> Option<f64> {
        Some(self.to.get(at)? - self.from[at])
    }

    /// Makes room for `longer` entries, as the list has.
    #[inline(always)]
    fn reserve(&mut self, longer: usize) {
        if longer > self.from.len() {
            for values in [&mut self.from, &mut self.to, &mut self.middle] {
                values.resize(longer, 0.0);
            }
        }
    }
}

/// A borrowed list at the start of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellCrowd<'a> {
    pub(super) len: usize,
    pub(super) members: &'a [u64],
    pub(super) increment: &'a [f64],
    pub(super) from: &'a [f64],
    pub(super) to: &'a [f64],
    /// The photoreceptor's noise at both ends; empty without it.
    pub(super) receptor: [&'a [f64]; 2],
}

impl CellCrowd<'_> {
    /// The photoreceptor's noise of eight walkers at both ends.
    #[inline(always)]
    pub(super) fn receptor_ends<S: Simd>(&self, simd: S, i: usize) -> Option<[f64x8<S>; 2]> {
        let [from, to] = self.receptor;
        (!from.is_empty()).then(|| [load_eight(simd, from, i), load_eight(simd, to, i)])
    }
}
