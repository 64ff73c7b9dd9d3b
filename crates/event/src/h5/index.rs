//! `ms_to_idx`, built while the events pass.

/// State of the index: the number of settled entries.
#[derive(Debug, Default)]
pub(super) struct MsIndex {
    len: u64,
}

impl MsIndex {
    /// Number of entries, all equal to its index, that an event at `t_us` settles: those of the
    /// milliseconds up to its own that no earlier event settled.
    pub(super) fn settle(&mut self, t_us: u32) -> u64 {
        self.grow_to(u64::from(t_us) / 1000 + 1)
    }

    /// Number of entries, all equal to the number of events, that complete the index of a stream
    /// that ends at `end_us`.
    pub(super) fn complete(&mut self, end_us: u32) -> u64 {
        // One entry more than an event settles: it ends the part of the last millisecond.
        self.grow_to(u64::from(end_us) / 1000 + 2)
    }

    fn grow_to(&mut self, len: u64) -> u64 {
        let more = len.saturating_sub(self.len);
        self.len += more;
        more
    }
}
