//! Code shared by the tests of several features.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

pub(crate) mod foreign;
pub(crate) mod given;
pub(crate) mod gpu;
pub(crate) mod steps;
pub(crate) mod workspace;

pub(crate) use gs2e_testing::{absent, golden, repository, shared};
