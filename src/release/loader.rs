//! `gs2e.py`, the loader in every release: one file of plain Python over numpy and h5py.

/// Name of the file.
pub(super) const NAME: &str = "gs2e.py";

/// What it holds.
pub(super) const TEXT: &str = include_str!("loader/gs2e.py");
