//! What several features' tests share.

pub(crate) mod ply;
pub(crate) mod shared;
