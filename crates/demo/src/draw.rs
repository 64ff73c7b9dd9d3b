//! The still life's randomness: numbered streams of draws.

use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A stream of draws: ChaCha with 12 rounds, keyed by the seed. The stream number is the purpose.
#[derive(Debug)]
pub(super) struct SceneDraws(ChaCha12Rng);

impl SceneDraws {
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        let mut rng = ChaCha12Rng::from_seed(key);
        rng.set_stream(stream);
        Self(rng)
    }

    /// Uniform over `low..high`.
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * unit_interval(self.0.next_u64())
    }

    /// A sum of four uniform draws: bell-shaped, with standard deviation `deviation`, and never
    /// beyond 3.5 of it.
    pub(super) fn bell(&mut self, deviation: f64) -> f64 {
        let sum: f64 = (0..4).map(|_| self.uniform(-1.0, 1.0)).sum();
        // The variance of each draw is 1/3.
        deviation * sum * (3.0_f64 / 4.0).sqrt()
    }
}

/// The high 53 bits as a number from 0 to 1, without 1.
pub(super) fn unit_interval(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
}
