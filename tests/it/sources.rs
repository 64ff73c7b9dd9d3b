//! Captured datasets as they lie on disk, through the program: trees that the tests make, and COLMAP
//! models in unexpected places.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

pub(crate) mod datasets;
mod model_folders;
