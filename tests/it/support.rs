//! Code shared by the tests of several features.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

pub(crate) mod absent;
pub(crate) mod gaussians;
pub(crate) mod given;
pub(crate) mod golden;
pub(crate) mod gpu;
pub(crate) mod ply;
pub(crate) mod repository;
pub(crate) mod shared;
pub(crate) mod steps;
pub(crate) mod workspace;
