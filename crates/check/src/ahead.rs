//! Loads ahead of their use.
//!
//! The events of a stream are in the order of time, so each meets another pixel, and its loads miss the
//! caches. Between the loads of two events are branches that depend on them: the processor waits for one
//! event after the other. Loaded ahead, without a branch in between, the values of many events arrive
//! together.

/// Events whose values are loaded at once: more than the loads that a core keeps in flight.
pub(super) const AHEAD: usize = 32;

/// Loads all values, so that they are in the cache.
pub(super) fn load_ahead(values: impl Iterator<Item = u64>) {
    // Any cheap function of all values does. The compiler must not drop what is not used.
    std::hint::black_box(values.fold(0, |all, value| all ^ value));
}
