//! `ms_to_idx`, built while the events pass.

/// How much of the index is settled.
#[derive(Debug, Default)]
pub(super) struct MsIndex {
    len: u64,
}

impl MsIndex {
    /// How many entries, all equal to its number, an event at `t_us` settles: those of the milliseconds up to its own
    /// that no earlier event settled.
    pub(super) fn settle(&mut self, t_us: u32) -> u64 {
        self.grow_to(u64::from(t_us) / 1000 + 1)
    }

    /// How many entries, all equal to the number of events, complete the index of a stream that ends at `end_us`.
    pub(super) fn complete(&mut self, end_us: u32) -> u64 {
        self.grow_to(u64::from(end_us) / 1000 + 2)
    }

    fn grow_to(&mut self, len: u64) -> u64 {
        let more = len.saturating_sub(self.len);
        self.len += more;
        more
    }
}
