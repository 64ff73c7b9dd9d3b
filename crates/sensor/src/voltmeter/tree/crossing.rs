//! Walkers that cross a cell which is not split: their events, and the voltage at its end.

use super::{ClockCell, LEVELS, RootWalk, STRAIGHT};
use crate::voltmeter::curve::DriftCurve;
use crate::voltmeter::leaf::{ClockLeaf, LeafSpan};
use crate::voltmeter::touch::SpanWalk;
use fearless_simd::{Simd, SimdBase as _, u64x8};
use gs2e_num::elementary::set_lanes;
use gs2e_num::seed::eight::SeedCells;
use gs2e_num::seed::{DrawSpace, SeedCell};
use std::ops::ControlFlow;

impl RootWalk<'_> {
    /// The draws inside a cell that is not split.
    pub(super) fn leaf_cells(&self, node: ClockCell) -> SeedCells {
        let index = node.index(self.window.root());
        SeedCells { seed: self.window.law.seed, space: DrawSpace::Leaf, level: node.level, index }
    }

    /// Moves walkers that may touch a line across the cell, and writes their events.
    pub(super) fn cross_touched<C: DriftCurve>(&mut self, node: ClockCell) -> ControlFlow<()> {
        let cells = self.leaf_cells(node);
        let Self { window, walkers, writer } = self;
        let legs = window.legs.len();
        for touched in &walkers.touched {
            let member = touched.member;
            let seat = walkers.seats[member];
            let [x, y] = [seat & 0xffff, seat >> 16].map(|at| at as u16);
            let SeedCells { seed, space, level, index } = cells;
            let leaf = ClockLeaf {
                barriers: window.law.thresholds.of(writer.first + walkers.pixels[member]),
                variance: 0.0,
                draws: seed.draws(SeedCell { x, y, level, index }, space),
                time: 0.0,
            };
            let mut walk = SpanWalk {
                window,
                pieces: &walkers.pieces[member * legs..][..legs],
                sigma: walkers.sigma[member],
                curvature: walkers.curvature[member],
                leaf,
                visited: [0, 0],
            };
            let mut emit = writer.of(walkers.pixels[member], seat);
            let (x, stacks) = (walkers.voltage[member], &mut walkers.stacks);
            walkers.voltage[member] = walk.cross::<C>(x, touched, node.ends(), stacks, &mut emit)?;
            walkers.leaf_count += walk.visited[0];
            walkers.splits += walk.visited[1];
        }
        ControlFlow::Continue(())
    }

    /// Moves walkers across a leaf, and writes their events.
    #[inline(always)]
    pub(super) fn cross_leaves<S: Simd>(&mut self, simd: S, node: ClockCell) -> ControlFlow<()> {
        let cells = self.leaf_cells(node);
        let Self { window, walkers, writer } = self;
        let law = window.law;
        walkers.leaves.pad();
        walkers.leaf_count += walkers.leaves.len as u64;
        let [begin, end] = node.ends();
        for i in (0..walkers.leaves.len).step_by(8) {
            let list = &walkers.leaves;
            let seats = u64x8::from_fn(simd, |lane| walkers.seats[list.members[i + lane] as usize]);
            // Most walkers need at most four draws here. Eight lanes make them at once; the rare
            // fifth is made alone.
            let [first, second] = [cells.pair(seats, 0), cells.pair(seats, 1)];
            for lane in 0..8.min(list.len - i) {
                let member = list.members[i + lane] as usize;
                let drift = list.to[i + lane] - list.from[i + lane];
                let sigma = walkers.sigma[member];
                let (noise, receptor_variance) = walkers.receptor_in_leaf(member, list, i + lane);
                let draws = [first[0][lane], first[1][lane], second[0][lane], second[1][lane]];
                let draws = cells.go_on(seats[lane], draws);
                let variance = sigma * sigma + receptor_variance;
                let barriers = law.thresholds.of(writer.first + walkers.pixels[member]);
                let mut leaf = ClockLeaf { barriers, variance, draws, time: begin };
                let x = walkers.voltage[member];
                let end_voltage = x + drift + sigma * list.increment[i + lane] + noise;
                let whole = LeafSpan { end: end_voltage, until: end };
                let mut emit = writer.of(walkers.pixels[member], walkers.seats[member]);
                walkers.voltage[member] = leaf.cross(x, whole, &mut walkers.spans, &mut emit)?;
            }
        }
        ControlFlow::Continue(())
    }

    /// The lanes for which a short cell is a leaf because the drift in it is straight.
    #[inline(always)]
    pub(super) fn leaves<C: DriftCurve>(&self, node: ClockCell, members: &[usize; 8], live: u64) -> u64 {
        // A cell of one nanosecond is always a leaf: times are not resolved below it.
        if node.level == LEVELS {
            return live;
        }
        let mut leaf = 0;
        for lane in set_lanes(live) {
            let legs = self.window.legs.len();
            let pieces = &self.walkers.pieces[members[lane] * legs..][..legs];
            leaf |= u64::from(self.window.straying::<C>(pieces, node.ends()) <= STRAIGHT) << lane;
        }
        leaf
    }
}
