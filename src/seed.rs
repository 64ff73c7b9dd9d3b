//! Randomness as a pure function of what is drawn for: no generator in the program has a hidden position.

pub mod normal;
pub mod philox;

use serde::{Deserialize, Serialize};

/// The seed of one random stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Seed(pub u64);

/// What a stream is drawn for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Choice of key frames of a novel trajectory.
    Keyframes,
    /// Choice of curve of a novel trajectory.
    Curve,
    /// Noise of the sensor.
    Sensor,
}

impl Purpose {
    /// The name that enters the derivation.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Keyframes => "keyframes",
            Self::Curve => "curve",
            Self::Sensor => "sensor",
        }
    }
}

impl Seed {
    /// The seed of a stream: the first 64 bits (little endian) of BLAKE3 over the recipe's seed and the
    /// length-prefixed names, so that adding a trajectory changes no other trajectory's draws.
    #[must_use]
    pub fn derive(recipe_seed: u64, scene: &str, trajectory: &str, purpose: Purpose) -> Self {
        let mut hasher = blake3::Hasher::new_derive_key("gs2e 2026 stream seed v1");
        hasher.update(&recipe_seed.to_le_bytes());
        for name in [scene, trajectory, purpose.name()] {
            hasher.update(&(name.len() as u64).to_le_bytes());
            hasher.update(name.as_bytes());
        }
        let mut first = [0; 8];
        first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
        Self(u64::from_le_bytes(first))
    }
}

/// What the draws of one sequence are for; sequences of different purpose never meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Space {
    /// Increments of the Brownian tree.
    Tree = 0,
    /// What happens inside a leaf of the clock.
    Leaf = 1,
}

/// One sensor pixel in one cell of the dyadic clock: where a sequence of draws belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Column on the sensor (not in a crop).
    pub x: u16,
    /// Row on the sensor.
    pub y: u16,
    /// Halvings of the root cell, at most 127.
    pub level: u8,
    /// Number of the cell among those of its level, from 0, below 2^56.
    pub index: u64,
}

impl Seed {
    /// The draws of one cell, from number 0.
    #[must_use]
    pub fn draws(self, cell: Cell, space: Space) -> Draws {
        Draws { key: self.key(), counter: counter(cell, space), block: [0; 4], next: 0 }
    }

    /// Draw `number` of a cell as a standard normal deviate; `number` 0 and 1 cost one block each.
    #[must_use]
    pub fn normal(self, cell: Cell, space: Space, number: u32) -> f64 {
        let mut at = counter(cell, space);
        at[3] = number / 2;
        normal::quantile(uniform(half(philox::block(at, self.key()), number)))
    }

    #[expect(clippy::cast_possible_truncation, reason = "the two halves of the seed")]
    fn key(self) -> [u32; 2] {
        [self.0 as u32, (self.0 >> 32) as u32]
    }
}

/// Counter of a cell's first block. The fields fill it without overlap: x, y (16 bits each), index (56), level (7),
/// space (1), and 32 bits that number the blocks.
#[expect(clippy::cast_possible_truncation, reason = "the two halves of the index")]
fn counter(cell: Cell, space: Space) -> [u32; 4] {
    debug_assert!(cell.index < 1 << 56 && cell.level < 128, "{cell:?} fits its fields");
    let tag = u32::from(cell.level) << 1 | space as u32;
    [u32::from(cell.y) << 16 | u32::from(cell.x), cell.index as u32, tag << 24 | (cell.index >> 32) as u32, 0]
}

/// Draw `number` lies in the first or the second half of its block.
fn half(block: [u32; 4], number: u32) -> u64 {
    let at = 2 * (number % 2) as usize;
    u64::from(block[at + 1]) << 32 | u64::from(block[at])
}

/// The upper 52 bits as a number strictly between 0 and 1: with 53 bits the largest would round to 1.
fn uniform(bits: u64) -> f64 {
    const STEP: f64 = 1.0 / (1u64 << 52) as f64;
    ((bits >> 12) as f64 + 0.5) * STEP
}

/// The draws of one cell in order.
#[derive(Debug, Clone)]
pub struct Draws {
    key: [u32; 2],
    counter: [u32; 4],
    block: [u32; 4],
    next: u32,
}

impl Draws {
    /// The next draw as a number strictly between 0 and 1.
    pub fn uniform(&mut self) -> f64 {
        if self.next.is_multiple_of(2) {
            self.block = philox::block(self.counter, self.key);
            self.counter[3] = self.counter[3].wrapping_add(1);
        }
        let bits = half(self.block, self.next);
        self.next = self.next.wrapping_add(1);
        uniform(bits)
    }

    /// The next draw as a standard normal deviate.
    pub fn normal(&mut self) -> f64 {
        normal::quantile(self.uniform())
    }
}
