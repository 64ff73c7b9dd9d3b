//! Randomness as a pure function of purpose and place: no generator in the program has a hidden
//! position.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::seed::{DrawSpace, Seed, SeedCell, StreamPurpose};
//!
//! // Each trajectory has a seed of its own.
//! let seed = Seed::for_stream(1, "garden", "orbit", StreamPurpose::Sensor);
//! assert_ne!(seed, Seed::for_stream(1, "garden", "dolly", StreamPurpose::Sensor));
//!
//! // A draw is found by its address, without the draws before it.
//! let cell = SeedCell { x: 3, y: 5, level: 0, index: 0 };
//! let mut draws = seed.draws(cell, DrawSpace::Mismatch);
//! let in_order = [draws.normal(), draws.normal()];
//! assert_eq!(in_order[1], seed.normal(cell, DrawSpace::Mismatch, 1));
//! ```

pub mod eight;
pub mod ks;
pub mod normal;
pub mod philox;
pub mod range;
pub mod split_mix;

use serde::{Deserialize, Serialize};

/// The seed of one random stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Seed(pub u64);

/// The purpose of a random stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamPurpose {
    /// Choice of key frames of a novel trajectory.
    Keyframes,
    /// Choice of curve of a novel trajectory.
    Curve,
    /// Noise of the sensor.
    Sensor,
    /// Noise of the inertial sensor.
    Imu,
}

impl StreamPurpose {
    /// The name that enters the derivation of the seed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Keyframes => "keyframes",
            Self::Curve => "curve",
            Self::Sensor => "sensor",
            Self::Imu => "imu",
        }
    }
}

impl Seed {
    /// The seed of a stream: the first 64 bits (little endian) of BLAKE3 over the recipe's seed and
    /// the length-prefixed names. Adding a trajectory therefore changes no other trajectory's
    /// draws.
    #[must_use]
    pub fn for_stream(recipe_seed: u64, scene: &str, trajectory: &str, purpose: StreamPurpose) -> Self {
        Self::for_names(recipe_seed, &[scene, trajectory, purpose.name()])
    }

    /// The seed of the draw of one number of a sensor, by the names of the trajectory and of the
    /// sensor (empty if the recipe has one sensor) and the path of the number, such as
    /// `v2e.threshold.on`. Another trajectory, sensor or number changes no draw.
    #[must_use]
    pub fn for_parameter(recipe_seed: u64, scene: &str, trajectory: &str, sensor: &str, path: &str) -> Self {
        Self::for_names(recipe_seed, &[scene, trajectory, "parameter", sensor, path])
    }

    fn for_names(recipe_seed: u64, names: &[&str]) -> Self {
        // A key of its own, so that no other hash of the program can give the same bits.
        let mut hasher = blake3::Hasher::new_derive_key("gs2e 2026 stream seed v1");
        hasher.update(&recipe_seed.to_le_bytes());
        // Names with their lengths: `ab` and an empty name must differ from `a` and `b`.
        for name in names {
            hasher.update(&(name.len() as u64).to_le_bytes());
            hasher.update(name.as_bytes());
        }
        let mut first = [0; 8];
        first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
        Self(u64::from_le_bytes(first))
    }
}

/// The purpose of a sequence of draws. Sequences of different purpose never share a draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrawSpace {
    /// Increments of the Brownian tree.
    Tree,
    /// Draws inside a leaf of the clock.
    Leaf,
    /// The state before the first frame. Its cell has level 0 and index 0.
    Initial,
    /// Choices that do not belong to a pixel. Their cell is at pixel 0, 0 and level 0; its index
    /// numbers the choices.
    Choice,
    /// Draws of a frame-to-frame law between two frames. The index is that of the earlier frame.
    Pair,
    /// Mismatch of a pixel. Level 0; the index is that of a frame if the mismatch is drawn per
    /// frame.
    Mismatch,
    /// Jitter of a pixel's leak between two frames. Level 0; the index is that of the earlier
    /// frame.
    Leak,
    /// Shot noise. Level 0; the index counts the pixel's shots.
    Shot,
    /// Own events of hot pixels. Level 0; index 0 decides whether the pixel is hot, the others
    /// count its events.
    Hot,
    /// Delays of events. Level 0; the index counts the pixel's events.
    Latency,
}

/// One sensor pixel in one cell of the dyadic clock: the address of a sequence of draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SeedCell {
    /// Column on the sensor, not in a crop.
    pub x: u16,
    /// Row on the sensor.
    pub y: u16,
    /// Number of halvings of the root cell, at most 63 (20 for a nanosecond).
    pub level: u8,
    /// Index of the cell within its level, from 0, below 2^56.
    pub index: u64,
}

impl Seed {
    /// The draws of one cell, from index 0.
    #[must_use]
    #[inline]
    pub fn draws(self, cell: SeedCell, space: DrawSpace) -> CellDraws {
        CellDraws {
            key: self.key(),
            counter: block_counter(cell, space),
            first: [0; 4],
            known: 0,
            block: [0; 4],
            next: 0,
        }
    }

    /// Draw `number` of a cell as a standard normal deviate. Draws 0 and 1 cost one block each.
    #[must_use]
    pub fn normal(self, cell: SeedCell, space: DrawSpace, number: u32) -> f64 {
        let mut at = block_counter(cell, space);
        at[3] = number / 2;
        normal::normal_quantile(to_uniform(half_block(philox::philox_block(at, self.key()), number)))
    }

    #[expect(clippy::cast_possible_truncation, reason = "the two halves of the seed")]
    fn key(self) -> [u32; 2] {
        [self.0 as u32, (self.0 >> 32) as u32]
    }
}

/// Counter of a cell's first block. The fields do not overlap: x and y (16 bits each), index (56),
/// level and space (8), and 32 bits that number the blocks.
#[expect(clippy::cast_possible_truncation, reason = "the two halves of the index")]
fn block_counter(cell: SeedCell, space: DrawSpace) -> [u32; 4] {
    debug_assert!(cell.index < 1 << 56 && cell.level < 64, "{cell:?} fits its fields");
    let third = space_tag(cell.level, space) << 24 | (cell.index >> 32) as u32;
    [u32::from(cell.y) << 16 | u32::from(cell.x), cell.index as u32, third, 0]
}

/// Level and purpose.
fn space_tag(level: u8, space: DrawSpace) -> u32 {
    match space {
        DrawSpace::Tree => u32::from(level) << 1,
        // Levels below 64 take the tags up to 127. The other purposes count down from 255.
        DrawSpace::Leaf => u32::from(level) << 1 | 1,
        DrawSpace::Initial => 0xff,
        DrawSpace::Choice => 0xfe,
        DrawSpace::Pair => 0xfd,
        DrawSpace::Mismatch => 0xfc,
        DrawSpace::Leak => 0xfb,
        DrawSpace::Shot => 0xfa,
        DrawSpace::Hot => 0xf9,
        DrawSpace::Latency => 0xf8,
    }
}

/// Draw `number` is in the first or the second half of its block.
fn half_block(block: [u32; 4], number: u32) -> u64 {
    // The low word comes first.
    let at = 2 * (number % 2) as usize;
    u64::from(block[at + 1]) << 32 | u64::from(block[at])
}

/// The upper 52 bits as a number strictly between 0 and 1. With 53 bits, the largest value would
/// round to 1.
fn to_uniform(bits: u64) -> f64 {
    // The added half keeps 0 out: its quantile and its logarithm are infinite.
    ((bits >> 12) as f64 + 0.5) * STEP
}

const STEP: f64 = 1.0 / (1u64 << 52) as f64;

/// The draws of one cell in order.
#[derive(Debug, Clone)]
pub struct CellDraws {
    key: [u32; 2],
    counter: [u32; 4],
    /// The first draws, if they were computed in advance, and their number.
    first: [u64; 4],
    known: u32,
    block: [u32; 4],
    next: u32,
}

impl CellDraws {
    /// The next draw as a number strictly between 0 and 1.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        to_uniform(self.bits())
    }

    /// A number below `count`, each equally likely: the upper half of a product, drawn again if the
    /// lower half shows that the number would be drawn once too often (Lemire 2019, "Fast random
    /// integer generation in an interval").
    ///
    /// # Panics
    /// `count` is 0.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "halves of a product, of which the upper is below `count`"
    )]
    pub fn index(&mut self, count: usize) -> usize {
        let count = count as u64;
        // 2^64 modulo `count`. The products with a lower half below it are those that come too
        // often.
        let excess = count.wrapping_neg() % count;
        loop {
            let product = u128::from(self.bits()) * u128::from(count);
            if product as u64 >= excess {
                return (product >> 64) as usize;
            }
        }
    }

    #[inline]
    fn bits(&mut self) -> u64 {
        if self.next < self.known {
            self.next += 1;
            return self.first[self.next as usize - 1];
        }
        // A block serves two draws. The first after the known ones is even, so it makes its block.
        if self.next.is_multiple_of(2) {
            self.counter[3] = self.next / 2;
            self.block = philox::philox_block(self.counter, self.key);
        }
        let bits = half_block(self.block, self.next);
        self.next = self.next.wrapping_add(1);
        bits
    }

    /// The next draw as a standard normal deviate.
    pub fn normal(&mut self) -> f64 {
        normal::normal_quantile(self.uniform())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELL: SeedCell = SeedCell { x: 3, y: 5, level: 2, index: 7 };
    const OFF_THE_CLOCK: [DrawSpace; 8] = [
        DrawSpace::Initial,
        DrawSpace::Choice,
        DrawSpace::Pair,
        DrawSpace::Mismatch,
        DrawSpace::Leak,
        DrawSpace::Shot,
        DrawSpace::Hot,
        DrawSpace::Latency,
    ];

    #[test]
    fn purposes_and_names_lead_to_different_streams() {
        let seeds = [
            Seed::for_stream(1, "a", "b", StreamPurpose::Sensor),
            Seed::for_stream(2, "a", "b", StreamPurpose::Sensor),
            Seed::for_stream(1, "ab", "", StreamPurpose::Sensor),
            Seed::for_stream(1, "a", "b", StreamPurpose::Curve),
        ];
        for (i, a) in seeds.iter().enumerate() {
            assert!(seeds[..i].iter().all(|b| a != b));
        }
    }

    #[test]
    fn draws_by_number_are_draws_in_order() {
        for space in [DrawSpace::Tree, DrawSpace::Leaf].into_iter().chain(OFF_THE_CLOCK) {
            let mut draws = Seed(9).draws(CELL, space);
            for number in 0..9 {
                let in_order = draws.normal();
                assert_eq!(in_order.to_bits(), Seed(9).normal(CELL, space, number).to_bits());
            }
        }
    }

    #[test]
    fn every_field_of_a_cell_moves_the_counter() {
        let cells = [
            CELL,
            SeedCell { x: 4, ..CELL },
            SeedCell { y: 4, ..CELL },
            SeedCell { level: 3, ..CELL },
            SeedCell { index: 8, ..CELL },
            SeedCell { index: 7 + (1 << 32), ..CELL },
        ];
        let in_clock =
            cells.iter().flat_map(|&cell| [DrawSpace::Tree, DrawSpace::Leaf].map(|s| block_counter(cell, s)));
        let counters: Vec<_> = in_clock.chain(OFF_THE_CLOCK.map(|s| block_counter(CELL, s))).collect();
        for (i, a) in counters.iter().enumerate() {
            assert!(counters[..i].iter().all(|b| a != b), "{i}");
        }
    }

    /// Draw 0 of neighbouring pixels, of neighbouring cells, and the draws of one cell.
    fn sequences() -> [Vec<f64>; 3] {
        let seed = Seed(20_250_521);
        let first = |cell| seed.draws(cell, DrawSpace::Tree).uniform();
        let mut leaf = seed.draws(CELL, DrawSpace::Leaf);
        [
            (0..250).flat_map(|y| (0..200).map(move |x| first(SeedCell { x, y, ..CELL }))).collect(),
            (0..50_000).map(|index| first(SeedCell { index, ..CELL })).collect(),
            (0..50_000).map(|_| leaf.uniform()).collect(),
        ]
    }

    #[test]
    fn draws_are_uniform_and_independent_of_their_neighbours() {
        for (i, sequence) in sequences().into_iter().enumerate() {
            let n = sequence.len() as f64;
            let product: f64 = sequence.windows(2).map(|w| (w[0] - 0.5) * (w[1] - 0.5)).sum();
            // Each product has mean 0 and variance 1/144.
            let z = 12.0 * product / n.sqrt();
            let ks = ks::scaled_distance(sequence, |u| u);
            println!("sequence {i}: KS {ks:.3} (alpha 1e-6: 2.69), serial z {z:.3}");
            assert!(ks < 2.69 && z.abs() < 5.0);
        }
    }

    /// Numbers below three quarters of 2^64 reveal a draw without rejection: with a remainder of 64
    /// bits, the lowest third is twice as likely; with a product, every third number is.
    #[test]
    fn numbers_below_a_count_are_all_as_likely() {
        const N: usize = 60_000;
        // Limits of chi-square with 6 and 2 degrees of freedom at alpha 1e-4 over the three.
        let t = |count: usize, limit: f64, bins: usize, bin: fn(usize) -> usize| {
            let mut draws = Seed(77).draws(CELL, DrawSpace::Choice);
            let mut found = vec![0.0; bins];
            (0..N).for_each(|_| found[bin(draws.index(count))] += 1.0);
            let expected = N as f64 / bins as f64;
            let statistic: f64 = found.iter().map(|f| (f - expected) * (f - expected) / expected).sum();
            println!("below {count}: chi-square {statistic:.2} (limit {limit})");
            assert!(statistic < limit, "{found:?}");
        };
        t(7, 30.37, 7, |k| k);
        t(3 << 62, 20.61, 3, |k| k >> 62);
        t(3 << 62, 20.61, 3, |k| k % 3);
        assert_eq!(Seed(1).draws(CELL, DrawSpace::Choice).index(1), 0);
    }

    #[test]
    fn normal_draws_have_the_normal_distribution() {
        for (i, sequence) in sequences().into_iter().enumerate() {
            let sample: Vec<f64> = sequence.into_iter().map(normal::normal_quantile).collect();
            let n = sample.len() as f64;
            let moment = |k| sample.iter().map(|z| z.powi(k)).sum::<f64>() / n;
            // Variances of z, z^2, z^3, z^4: 1, 2, 15, 96.
            let scores = [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)]
                .map(|(k, mean, variance): (i32, f64, f64)| (moment(k) - mean) / (variance / n).sqrt());
            let ks = ks::scaled_distance(sample.clone(), |z| 0.5 * libm::erfc(-z / std::f64::consts::SQRT_2));
            println!("sequence {i}: KS {ks:.3} (alpha 1e-6: 2.69), moments' z {scores:.2?}");
            assert!(ks < 2.69 && scores.iter().all(|z| z.abs() < 5.0));
        }
    }

    /// The first draws are part of the law: changing them changes every released stream.
    #[test]
    fn first_draws_are_frozen() {
        let first = |mut draw: Box<dyn FnMut() -> f64>| std::array::from_fn::<f64, 16, _>(|_| draw());
        let draws = |space| Seed(1).draws(CELL, space);
        let [mut tree, mut normal] = [draws(DrawSpace::Tree), draws(DrawSpace::Tree)];
        let [mut leaf, mut initial] = [draws(DrawSpace::Leaf), draws(DrawSpace::Initial)];
        let t = |found: [f64; 16], frozen: [f64; 16]| {
            assert!(found.iter().zip(frozen).all(|(a, b)| a.to_bits() == b.to_bits()), "{found:?}");
        };
        t(first(Box::new(move || tree.uniform())), TREE);
        t(first(Box::new(move || leaf.uniform())), LEAF);
        t(first(Box::new(move || initial.uniform())), INITIAL);
        t(first(Box::new(move || normal.normal())), NORMAL);
    }

    const TREE: [f64; 16] = [
        0.8233909402643173,
        0.2775608847685481,
        0.17766775104962196,
        0.6066204010085753,
        0.12328413177224273,
        0.347867924798397,
        0.20172928938055013,
        0.46790940550956994,
        0.9765074226336871,
        0.04640306274072359,
        0.2563770295860509,
        0.7169348468995941,
        0.8056975057228976,
        0.6778007276732708,
        0.29085423877525163,
        0.26299190123224403,
    ];
    const LEAF: [f64; 16] = [
        0.6141100531790257,
        0.4854734810480247,
        0.6839546758272993,
        0.2931709029185289,
        0.4711979649332515,
        0.8837835054011735,
        0.257500259872368,
        0.016658370587956495,
        0.8080334436387783,
        0.20188920163550417,
        0.08292952535315268,
        0.6726649763407312,
        0.3040809499888325,
        0.8922337133721535,
        0.6339970411311219,
        0.2027105738385645,
    ];
    const INITIAL: [f64; 16] = [
        0.35282531159904174,
        0.0003035811815127465,
        0.8686858054763692,
        0.9039248626843223,
        0.9979942445155731,
        0.03672434182333262,
        0.05012577750321945,
        0.9820360057710688,
        0.8932721244350522,
        0.06677700256323649,
        0.9615268741136115,
        0.9807068524082244,
        0.5560128268590606,
        0.8041115030504095,
        0.9517302276280851,
        0.14775661906474935,
    ];
    const NORMAL: [f64; 16] = [
        0.9283652853320666,
        -0.5901027436535768,
        -0.924289703648967,
        0.27052134494347757,
        -1.158725082224226,
        -0.3910830492779878,
        -0.8354603211832559,
        -0.08052613497751288,
        1.9864339979014312,
        -1.6807775776407339,
        -0.6545553816205596,
        0.5737598728040255,
        0.8621499843742708,
        0.4615576860147873,
        -0.5508908831219026,
        -0.6341486701369182,
    ];
}
