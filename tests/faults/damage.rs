//! Damage to files, as bit rot and faulty tools cause it.

use crate::random::Random;
use std::fs::{self, File, Permissions};
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::path::Path;

/// One flipped bit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Flip {
    pub(crate) byte: u64,
    pub(crate) bit: u32,
}

impl Flip {
    /// Picks any bit of a file of `bytes` bytes.
    pub(crate) fn any(bytes: u64, random: &mut Random) -> Self {
        let byte = random.below(usize::try_from(bytes).unwrap()) as u64;
        Self { byte, bit: u32::try_from(random.below(8)).unwrap() }
    }

    /// Flips the bit in memory.
    pub(crate) fn in_bytes(self, bytes: &mut [u8]) {
        bytes[usize::try_from(self.byte).unwrap()] ^= 1 << self.bit;
    }

    /// Flips the bit in a file, which keeps its size, mode and mtime.
    pub(crate) fn in_file(self, path: &Path) {
        let before = fs::metadata(path).unwrap();
        fs::set_permissions(path, Permissions::from_mode(0o644)).unwrap();
        let file = File::options().read(true).write(true).open(path).unwrap();
        let mut byte = [0];
        file.read_exact_at(&mut byte, self.byte).unwrap();
        byte[0] ^= 1 << self.bit;
        file.write_all_at(&byte, self.byte).unwrap();
        file.set_modified(before.modified().unwrap()).unwrap();
        fs::set_permissions(path, before.permissions()).unwrap();
    }
}
