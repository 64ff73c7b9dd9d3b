//! Instruction sets: the widest that the machine has, or a narrower one.
//!
//! The raster's arithmetic is written once, over vectors that each instruction set splits into its
//! own. No set fuses a multiplication with an addition, so all sets give the same bits.

use fearless_simd::Level;

/// An instruction set that this machine supports.
#[derive(Debug, Clone, Copy)]
pub struct InstructionSet {
    pub(super) level: Level,
    name: &'static str,
}

impl InstructionSet {
    /// The widest instruction set.
    ///
    /// # Panics
    /// Never: every machine has one.
    #[must_use]
    pub fn widest_set() -> Self {
        *Self::available_sets().last().expect("every machine has a set of instructions")
    }

    /// All instruction sets of this machine, the widest last.
    #[must_use]
    pub fn available_sets() -> Vec<Self> {
        let best = Level::new();
        let mut all = Vec::new();
        // From narrow to wide: `widest_set` takes the last.
        let mut add = |name, level: Option<Level>| all.extend(level.map(|level| Self { level, name }));
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            add("SSE2", best.as_sse2().map(Level::Sse2));
            add("SSE4.2", best.as_sse4_2().map(Level::Sse4_2));
            add("AVX2", best.as_avx2().map(Level::Avx2));
            add("AVX-512", best.as_avx512().map(Level::Avx512));
        }
        #[cfg(target_arch = "aarch64")]
        add("NEON", best.as_neon().map(Level::Neon));
        if all.is_empty() {
            all.push(Self { level: best, name: "the target's own" });
        }
        all
    }

    /// Name of the instruction set.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }
}
