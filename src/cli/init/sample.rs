//! The order in which scenes are sampled. It depends on seed and id alone, so a growing dataset
//! does not change the order of its scenes.

use sha2::{Digest, Sha256};

/// The rank of a scene in the sample: SHA-256 of the seed in decimal digits, a NUL, and the scene's
/// id.
pub(super) fn sample_rank(seed: u64, scene: &str) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(seed.to_string());
    hash.update([0]);
    hash.update(scene);
    hash.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_sha_256() {
        // printf '20250521\0mvimgnet/11/16009258' | sha256sum
        let rank = sample_rank(20_250_521, "mvimgnet/11/16009258");
        let text: String = rank.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(text, "3ec0dd0f9fa7195b6c2f1155ef795d5197e032672b6e9693d772176ac8a85b8c");
    }
}
