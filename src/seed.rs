//! Randomness as a pure function of what is drawn for: no generator in the program has a hidden position.

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
