//! The exact law inside one root cell of the dyadic clock, for the pixels of a band.
//!
//! Time is cut into root cells of 2^20 ns. A cell can be halved twenty times, down to one
//! nanosecond:
//!
//! ```text
//! level 0   |-------------------------------- root, 2^20 ns --------------------------------|
//! level 1   |----------------- first half ------------------|--------- second half ---------|
//! level 2   |---------- crossed ------------|---- split ----|
//! level 3                                   |--leaf-|-leaf--|
//! ```
//!
//! The noise of a pixel is a Brownian motion, and its values are known at the ends of a cell. The
//! value in the middle, given both ends, is normal around their mean (Lévy's construction), so a
//! cell is split by one normal draw. Each draw is a pure function of the seed, the pixel and the
//! cell. Frames, neighbours and threads therefore cannot change it.
//!
//! A cell ends in one of three ways. If no barrier is within reach, the voltage moves to its end in one step
//! ([`RootWalk::visit`]). If the drift in the cell is straight enough, the cell is a leaf, and the first
//! passages of the Brownian bridge are drawn exactly ([`super::leaf`]). Otherwise the cell is split, and its
//! halves follow in order of time ([`RootWalk::halve`]). With the photoreceptor's noise, one number may say
//! that no barrier is touched, or where a line in front of one is ([`super::touch`]).
//!
//! Pixels descend together. All walkers that reach a cell share its times, so eight of them do the
//! same arithmetic at once, and a cell's own cost (its legs, its index, the call) is spread over
//! the whole list. The lists of one level are reused by every cell of that level: the walk is depth
//! first, so at most one cell per level is open.

#![expect(clippy::cast_possible_truncation, reason = "walkers of a band are counted in few bits")]

mod crossing;

use super::bridge::WideBarriers;
use super::cell_list::{CellCrowd, CellList};
use super::curve::DriftCurve;
use super::leaf::LeafSpan;
use super::receptor;
use super::thresholds::PixelThresholds;
use super::touch::{BarrierLines, ReceptorCell, SpanStacks, TouchedCell, WideCell, WideShape, motion_reach};
use super::window::TimeStep;
use super::writer::BandWriter;
use fearless_simd::{Simd, SimdBase as _, f64x8, u64x8};
use gs2e_num::elementary::{exp_eight, load_eight, mask_bits, set_lanes, store_eight};
use gs2e_num::seed::eight::SeedCells;
use gs2e_num::seed::{DrawSpace, eight};
use std::ops::{ControlFlow, Range};

/// Halvings of a root cell down to one nanosecond.
pub(super) const LEVELS: u8 = 20;
/// Length of a root cell, ns.
pub(super) const ROOT: i64 = 1 << LEVELS;
/// Its standard deviation of Brownian motion, `sqrt(2^20 ns)`.
pub(super) const ROOT_DEVIATION: f64 = 1024.0;
/// Longest leaf, ns.
pub(super) const LEAF: u32 = 1 << 13;
/// Maximum distance of the drift in a leaf from its chord, in thresholds.
pub(super) const STRAIGHT: f64 = 1e-6;

/// Pixels that must descend into a root cell, as a structure of arrays, with the working lists of
/// the descent.
#[derive(Debug, Default)]
pub(super) struct Walkers {
    /// Pixel in the band.
    pixels: Vec<usize>,
    /// Pixel on the sensor, `y << 16 | x`.
    seats: Vec<u64>,
    /// Current voltage, in thresholds.
    voltage: Vec<f64>,
    /// Noise per square root of a nanosecond.
    sigma: Vec<f64>,
    /// Bound on the second derivative of the drift.
    curvature: Vec<f64>,
    /// `theta` and standard deviation of the photoreceptor's noise; empty without it.
    receptor: [Vec<f64>; 2],
    /// For each walker and leg: the drift from the window's start to the leg's earlier frame, then
    /// the leg's curve.
    pieces: Vec<[f64; 5]>,
    /// One list per level of the clock, and one for the root.
    lists: Vec<CellList>,
    /// Walkers for which the current cell is a leaf.
    leaves: CellList,
    /// Walkers that may touch a line in the current cell; empty without the photoreceptor's noise.
    touched: Vec<TouchedCell>,
    /// Stack of the leaf's spans, kept here so that its memory is reused.
    spans: Vec<LeafSpan>,
    stacks: SpanStacks,
    /// Number of leaves visited.
    pub(super) leaf_count: u64,
    /// Number of cells split.
    pub(super) splits: u64,
}

/// A pixel at the start of a window that may touch a barrier.
#[derive(Debug, Clone, Copy)]
pub(super) struct Walker {
    pub(super) pixel: usize,
    pub(super) seat: u64,
    pub(super) voltage: f64,
    pub(super) sigma: f64,
    pub(super) curvature: f64,
    /// Increment of the Brownian motion over the root cell.
    pub(super) increment: f64,
    /// Drift over the window, in thresholds.
    pub(super) drift: f64,
    /// The photoreceptor's noise, if there is any.
    pub(super) receptor: Option<ReceptorCell>,
}

impl Walkers {
    pub(super) fn clear(&mut self) {
        self.pixels.clear();
        self.seats.clear();
        self.voltage.clear();
        self.sigma.clear();
        self.curvature.clear();
        self.receptor.iter_mut().for_each(Vec::clear);
        self.pieces.clear();
        self.touched.clear();
        // Levels 0 to LEVELS, and one more list that holds the root's walkers while level 0 is
        // filled.
        self.lists.resize_with(usize::from(LEVELS) + 2, CellList::default);
        self.lists[0].len = 0;
    }

    pub(super) fn len(&self) -> usize {
        self.pixels.len()
    }

    #[inline(always)]
    pub(super) fn push(&mut self, walker: Walker, pieces: impl Iterator<Item = [f64; 5]>) {
        let Walker { increment, drift, receptor, .. } = walker;
        let ends = receptor.map(|receptor| receptor.ends);
        self.lists[0].push(self.pixels.len() as u64, increment, [0.0, drift], ends);
        self.add(walker, pieces);
    }

    /// Adds a walker that may touch one of these lines in its root cell. `known` are the upper bits of the
    /// number that decides.
    #[inline(always)]
    pub(super) fn push_touched(
        &mut self,
        walker: Walker,
        lines: BarrierLines,
        known: f64,
        pieces: impl Iterator<Item = [f64; 5]>,
    ) {
        let Walker { increment, drift, receptor, .. } = walker;
        if let Some(cell) = receptor {
            let (member, drift) = (self.pixels.len(), [0.0, drift]);
            let number = [known, receptor::SPARE_UNIT];
            self.touched.push(TouchedCell { member, lines, cell, number, increment, drift });
        }
        self.add(walker, pieces);
    }

    #[inline(always)]
    fn add(&mut self, walker: Walker, pieces: impl Iterator<Item = [f64; 5]>) {
        let Walker { pixel, seat, voltage, sigma, curvature, receptor, .. } = walker;
        if let Some(ReceptorCell { rate, deviation, .. }) = receptor {
            self.receptor[0].push(rate);
            self.receptor[1].push(deviation);
        }
        self.pixels.push(pixel);
        self.seats.push(seat);
        self.voltage.push(voltage);
        self.sigma.push(sigma);
        self.curvature.push(curvature);
        self.pieces.extend(pieces);
    }

    /// The pieces of eight walkers for one leg.
    #[inline(always)]
    fn pieces<S: Simd>(&self, simd: S, members: &[usize; 8], [leg, legs]: [usize; 2]) -> [f64x8<S>; 5] {
        let mut eight = [[0.0; 8]; 5];
        for (lane, member) in members.iter().enumerate() {
            // Walkers are rows of `legs` pieces: a walker's own pieces lie next to each other.
            let piece = &self.pieces[member * legs + leg];
            for (to, from) in eight.iter_mut().zip(piece) {
                to[lane] = *from;
            }
        }
        let [a, b, c, d, e] = &eight;
        [
            f64x8::from_slice(simd, a),
            f64x8::from_slice(simd, b),
            f64x8::from_slice(simd, c),
            f64x8::from_slice(simd, d),
            f64x8::from_slice(simd, e),
        ]
    }

    /// `theta` and standard deviation of eight walkers.
    #[inline(always)]
    fn receptor_of<S: Simd>(&self, simd: S, members: &[usize; 8]) -> [f64x8<S>; 2] {
        let [rates, deviations] = &self.receptor;
        [gather_eight(simd, rates, members), gather_eight(simd, deviations, members)]
    }

    /// Change of the photoreceptor's noise over a leaf, and its variance per ns; 0 without it.
    #[inline(always)]
    fn receptor_in_leaf(&self, member: usize, leaves: &CellList, at: usize) -> (f64, f64) {
        let [rates, deviations] = &self.receptor;
        match (leaves.receptor.change(at), rates.get(member)) {
            (Some(change), Some(rate)) => (change, rate * deviations[member] * deviations[member] * 2.0),
            _ => (0.0, 0.0),
        }
    }

    /// Draws the second normal deviate of a block for the members of a list. The first belongs to the end of
    /// a root cell.
    #[inline(always)]
    fn draw<S: Simd>(&self, simd: S, cells: SeedCells, block: u32, members: &[u64], to: &mut [f64]) {
        for i in (0..members.len()).step_by(8) {
            let places = places_of(members, i);
            let seats = u64x8::from_fn(simd, |lane| self.seats[places[lane]]);
            let [_, draw] = cells.pair(seats, block);
            store_eight(eight::uniform_eight(draw), to, i);
        }
        eight::normal_deviates(simd, &mut to[..members.len()]);
    }

    /// Draws both normal deviates of the block of the photoreceptor's noise: that of the Brownian motion, and
    /// its own.
    #[inline(always)]
    fn draw_both<S: Simd>(
        &self,
        simd: S,
        cells: SeedCells,
        members: &[u64],
        [motion, noise]: [&mut [f64]; 2],
    ) {
        for i in (0..members.len()).step_by(8) {
            let places = places_of(members, i);
            let seats = u64x8::from_fn(simd, |lane| self.seats[places[lane]]);
            let [first, second] = cells.pair(seats, receptor::BLOCK);
            store_eight(eight::uniform_eight(first), motion, i);
            store_eight(eight::uniform_eight(second), noise, i);
        }
        eight::normal_deviates(simd, &mut motion[..members.len()]);
        eight::normal_deviates(simd, &mut noise[..members.len()]);
    }

    /// Each walker's pixel and its present voltage.
    pub(super) fn settled(&self) -> impl Iterator<Item = (usize, f64)> {
        self.pixels.iter().copied().zip(self.voltage.iter().copied())
    }
}

/// One cell of the dyadic clock.
#[derive(Debug, Clone, Copy)]
struct ClockCell {
    level: u8,
    /// Start of the cell, ns since the root's start.
    start: u32,
}

impl ClockCell {
    fn length(self) -> u32 {
        1 << (LEVELS - self.level)
    }

    /// Start and end of the cell, ns since the root's start.
    fn ends(self) -> [f64; 2] {
        [self.start.into(), (self.start + self.length()).into()]
    }

    fn halves(self) -> [Self; 2] {
        let level = self.level + 1;
        [Self { level, ..self }, Self { level, start: self.start + self.length() / 2 }]
    }

    /// Number of the cell among all cells of its level since the first stamp: the cell's part of a
    /// draw's key.
    fn index(self, root: u64) -> u64 {
        // Every level counts its cells from the first stamp, so a root's number is shifted by the
        // level.
        root << self.level | u64::from(self.start >> (LEVELS - self.level))
    }
}

/// Eight members of a list, as indices into the arrays of [`Walkers`].
#[inline(always)]
fn places_of(members: &[u64], i: usize) -> [usize; 8] {
    let eight = &members[i..i + 8];
    std::array::from_fn(|lane| eight[lane] as usize)
}

/// The values at eight places.
#[inline(always)]
fn gather_eight<S: Simd>(simd: S, values: &[f64], places: &[usize; 8]) -> f64x8<S> {
    f64x8::from_fn(simd, |lane| values[places[lane]])
}

/// Eight walkers with the photoreceptor's noise in a cell.
struct AskedEight<S: Simd> {
    members: [usize; 8],
    increment: f64x8<S>,
    /// Drift at both ends.
    drift: [f64x8<S>; 2],
    receptor: Option<[f64x8<S>; 2]>,
    voltage: [f64x8<S>; 2],
    straying: f64x8<S>,
    sigma: f64x8<S>,
    barriers: WideBarriers<S>,
}

/// The descent of a band's walkers through one root cell.
#[derive(Debug)]
pub(super) struct RootWalk<'a> {
    pub(super) window: &'a TimeStep<'a>,
    pub(super) walkers: &'a mut Walkers,
    pub(super) writer: BandWriter<'a>,
}

impl RootWalk<'_> {
    /// Moves all walkers to the end of the root cell. Breaks where the step has failed.
    pub(super) fn cross<C: DriftCurve, S: Simd>(&mut self, simd: S) -> ControlFlow<()> {
        // The root's walkers are read while `visit` fills list 0 with the survivors: they move to
        // their own list.
        let root = ClockCell { level: 0, start: 0 };
        let mut all = std::mem::take(&mut self.walkers.lists[usize::from(LEVELS) + 1]);
        std::mem::swap(&mut all, &mut self.walkers.lists[0]);
        all.pad();
        let mut done = self.cross_touched::<C>(root);
        if done.is_continue() {
            done = self.enter::<C, S>(simd, root, &all.whole());
        }
        self.walkers.lists[usize::from(LEVELS) + 1] = all;
        done
    }

    /// Moves walkers to the end of a cell.
    fn enter<C: DriftCurve, S: Simd>(
        &mut self,
        simd: S,
        node: ClockCell,
        crowd: &CellCrowd<'_>,
    ) -> ControlFlow<()> {
        // The recursion itself stays outside `vectorize`: an inlined closure cannot contain a call
        // to itself.
        simd.vectorize(
            #[inline(always)]
            || {
                self.visit::<C, S>(simd, node, crowd);
                self.cross_leaves(simd, node)
            },
        )?;
        self.cross_touched::<C>(node)?;
        self.halve::<C, S>(simd, node)
    }

    /// Splits a cell for the walkers on its level's list, and moves them across both halves in
    /// order of time.
    fn halve<C: DriftCurve, S: Simd>(&mut self, simd: S, node: ClockCell) -> ControlFlow<()> {
        let level = usize::from(node.level);
        if self.walkers.lists[level].len == 0 {
            return ControlFlow::Continue(());
        }
        // Both halves read this list, and they fill the lists of deeper levels only.
        let mut list = std::mem::take(&mut self.walkers.lists[level]);
        list.pad();
        self.walkers.splits += list.len as u64;
        simd.vectorize(
            #[inline(always)]
            || self.split::<C, S>(simd, node, &mut list),
        );
        let [first, second] = node.halves();
        let done = self.enter::<C, S>(simd, first, &list.first_half());
        // The second half begins with the voltages that the first has left.
        let done = if done.is_break() { done } else { self.enter::<C, S>(simd, second, &list.second_half()) };
        self.walkers.lists[level] = list;
        done
    }

    /// Draws the middle of the cell: between known ends, a Brownian motion is normal around their
    /// mean, with a quarter of the cell's length as its variance.
    #[inline(always)]
    fn split<C: DriftCurve, S: Simd>(&self, simd: S, node: ClockCell, list: &mut CellList) {
        let Self { window, walkers, .. } = self;
        let law = window.law;
        let end = list.len.next_multiple_of(8);
        self.draw_middles(simd, node, list);
        // Two passes over the list: `normal_deviates` runs faster over one long array than eight at
        // a time.
        // The variance in the middle is a quarter of the cell's length: `sqrt(length / 4)`.
        let deviation = 0.5 * f64::from(node.length()).sqrt();
        let middle = f64::from(node.start + node.length() / 2);
        let at = window.leg_at(middle);
        let since = middle - window.legs[at].stamp;
        for i in (0..end).step_by(8) {
            let members = places_of(&list.members, i);
            let [start, curve @ ..] = walkers.pieces(simd, &members, [at, window.legs.len()]);
            store_eight(start + C::rise(&law.process, &curve, since), &mut list.middle, i);
            let half =
                load_eight(simd, &list.increment, i) * 0.5 + load_eight(simd, &list.half, i) * deviation;
            store_eight(half, &mut list.half, i);
            // The rest, so that both halves add up to the cell: its end stays where it was before
            // the split.
            store_eight(load_eight(simd, &list.increment, i) - half, &mut list.increment, i);
            if let Some(ends) = list.whole().receptor_ends(simd, i) {
                let normal = load_eight(simd, &list.receptor.middle, i);
                let length = f64::from(node.length());
                let middle = receptor::middle(walkers.receptor_of(simd, &members), ends, length, normal);
                store_eight(middle, &mut list.receptor.middle, i);
            }
        }
    }

    /// Draws the normal deviates of the middle of a cell.
    #[inline(always)]
    fn draw_middles<S: Simd>(&self, simd: S, node: ClockCell, list: &mut CellList) {
        let Self { window, walkers, .. } = self;
        let law = window.law;
        let (space, level, index) = (DrawSpace::Tree, node.level, node.index(window.root()));
        let cells = SeedCells { seed: law.seed, space, level, index };
        let end = list.len.next_multiple_of(8);
        let (members, noise) = (&list.members[..end], &mut list.receptor.middle);
        match (law.process.is_brownian(), law.receptor.is_some()) {
            (true, true) => walkers.draw_both(simd, cells, members, [&mut list.half, noise]),
            (true, false) => walkers.draw(simd, cells, 0, members, &mut list.half),
            (false, with_receptor) => {
                if with_receptor {
                    walkers.draw(simd, cells, receptor::BLOCK, members, noise);
                }
                list.half[..end].fill(0.0);
            }
        }
    }

    /// Moves each walker to the end of the cell if no barrier is within its reach. The others are
    /// put on the list of leaves or on the list of the cells to split.
    #[inline(always)]
    fn visit<C: DriftCurve, S: Simd>(&mut self, simd: S, node: ClockCell, crowd: &CellCrowd<'_>) {
        let level = usize::from(node.level);
        let mut next = std::mem::take(&mut self.walkers.lists[level]);
        let mut leaves = std::mem::take(&mut self.walkers.leaves);
        // The list of this level is free: its cell before this one has been walked to the end.
        (next.len, leaves.len) = (0, 0);
        let mut touched = std::mem::take(&mut self.walkers.touched);
        touched.clear();
        let length = f64::from(node.length());
        let knots = self.knots(node);
        for i in (0..crowd.len).step_by(8) {
            let members = places_of(crowd.members, i);
            // Functions and not closures, which may be compiled without the instruction set in use.
            let increment = load_eight(simd, crowd.increment, i);
            let [from, to] = [load_eight(simd, crowd.from, i), load_eight(simd, crowd.to, i)];
            let x = gather_eight(simd, &self.walkers.voltage, &members);
            let sigma = gather_eight(simd, &self.walkers.sigma, &members);
            let curvature = gather_eight(simd, &self.walkers.curvature, &members);
            let mut straying = curvature * (length * length * 0.125);
            if !knots.is_empty() {
                straying += self.knots_of(node, &members, [from, to], knots.clone());
            }
            let mut y = x + (to - from) + sigma * increment;
            let (mut variance, mut reach) = (sigma * sigma, straying);
            let mut short = u64::MAX;
            let receptor = crowd.receptor_ends(simd, i);
            if let Some(ends) = receptor {
                let [rate, deviation] = self.walkers.receptor_of(simd, &members);
                y += ends[1] - ends[0];
                variance += rate * deviation * deviation * 2.0;
                reach += receptor::bow(rate, ends, length);
                short = mask_bits((rate * length).simd_le(receptor::SHORT));
            }
            let barriers = self.barriers(simd, &members);
            let mut live = mask_bits(barriers.reached([x, y], variance * length, reach));
            // The last eight may end with padding, which moves no voltage and joins no list.
            let known = u64::MAX >> (64 - 8.min(crowd.len - i));
            let mut open = 0;
            // The root cell has been asked before the walk.
            if node.level > 0 && live & known != 0 && receptor.is_some() {
                let (drift, voltage) = ([from, to], [x, y]);
                let cell =
                    AskedEight { members, increment, drift, receptor, voltage, straying, sigma, barriers };
                let decided;
                [decided, open] = self.ask(node, &cell, live & known, &mut touched);
                live &= !decided;
            }
            for lane in set_lanes(!live & !open & known) {
                self.walkers.voltage[members[lane]] = y[lane];
            }
            let mut leaf = 0;
            if node.length() <= LEAF {
                // A parabola with this curvature differs from its chord by `straying`, and no curve
                // here by more than 2.03 times that. So this bound decides most lanes without the
                // exact distance, which costs an exponential each.
                let sure = if knots.is_empty() { mask_bits((straying * 2.1).simd_le(STRAIGHT)) } else { 0 };
                leaf = live & known & sure;
                leaf |= self.leaves::<C>(node, &members, live & known & !sure);
                // A cell of one nanosecond is short for every bandwidth that is allowed.
                leaf &= short;
            }
            let all = u64x8::from_slice(simd, &crowd.members[i..i + 8]);
            leaves.extend(leaf, all, [increment, from, to], receptor);
            next.extend(live & known & !leaf, all, [increment, from, to], receptor);
        }
        self.walkers.lists[level] = next;
        self.walkers.leaves = leaves;
        self.walkers.touched = touched;
    }

    /// Asks whether walkers touch a line in their cell. Returns the bits of those that the answer decides,
    /// and of those of them that may touch one, which are put on the list.
    #[inline(always)]
    fn ask<S: Simd>(
        &self,
        node: ClockCell,
        eight: &AskedEight<S>,
        live: u64,
        touched: &mut Vec<TouchedCell>,
    ) -> [u64; 2] {
        let AskedEight { members, increment, drift, receptor, voltage, straying, sigma, barriers } = *eight;
        let Some(ends) = receptor else { return [0, 0] };
        let (simd, length) = (increment.simd, f64::from(node.length()));
        let [rate, deviation] = self.walkers.receptor_of(simd, &members);
        let shape = WideShape::new(exp_eight(rate * -length));
        let motion = sigma * motion_reach(length);
        let lines = WideCell { shape, deviation, ends, voltage, straying, motion }.lines(barriers);
        let decided = lines.decided & live;
        if decided == 0 {
            return [0, 0];
        }
        let seats = u64x8::from_fn(simd, |lane| self.walkers.seats[members[lane]]);
        let [number, _] = self.leaf_cells(node).pair(seats, 0);
        let open = decided & mask_bits(eight::uniform_eight(number).simd_lt(lines.bound()));
        for lane in set_lanes(open) {
            let ends = [ends[0][lane], ends[1][lane]];
            touched.push(TouchedCell {
                member: members[lane],
                lines: lines.of(lane),
                cell: ReceptorCell { rate: rate[lane], deviation: deviation[lane], ends },
                number: [0.0, 1.0],
                increment: increment[lane],
                drift: [drift[0][lane], drift[1][lane]],
            });
        }
        [decided, open]
    }

    /// The barriers of eight walkers.
    #[inline(always)]
    fn barriers<S: Simd>(&self, simd: S, members: &[usize; 8]) -> WideBarriers<S> {
        let Self { window, walkers, writer } = self;
        match &window.law.thresholds {
            PixelThresholds::Equal(barriers) => WideBarriers::splat(simd, *barriers),
            PixelThresholds::Unequal([up, down]) => {
                let mut pixels = [0; 8];
                for (pixel, member) in pixels.iter_mut().zip(members) {
                    *pixel = writer.first + walkers.pixels[*member];
                }
                WideBarriers { up: gather_eight(simd, up, &pixels), down: gather_eight(simd, down, &pixels) }
            }
        }
    }

    /// The legs of the window that begin strictly inside the cell: the drift may bend at their
    /// stamps.
    fn knots(&self, node: ClockCell) -> Range<usize> {
        let [a, b] = node.ends();
        let before = |t: f64| self.window.legs.partition_point(|leg| leg.stamp < t);
        // `next_up` makes the first comparison `<=`: a stamp at the cell's start is not inside.
        before(a.next_up())..before(b)
    }

    /// The largest distance of the drift from its chord at the stamps inside the cell.
    #[inline(always)]
    fn knots_of<S: Simd>(
        &self,
        node: ClockCell,
        members: &[usize; 8],
        [from, to]: [f64x8<S>; 2],
        knots: Range<usize>,
    ) -> f64x8<S> {
        let Self { window, walkers, .. } = self;
        let simd = from.simd;
        let slope = (to - from) * (1.0 / f64::from(node.length()));
        let legs = window.legs.len();
        let mut farthest = f64x8::splat(simd, 0.0);
        // A loop: a closure given to `fold` would not be compiled for the instruction set in use.
        for leg in knots {
            let at = f64x8::from_fn(simd, |lane| walkers.pieces[members[lane] * legs + leg][0]);
            let since = window.legs[leg].stamp - f64::from(node.start);
            farthest = farthest.max((at - from - slope * since).abs());
        }
        farthest
    }
}
