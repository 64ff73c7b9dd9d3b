//! What several features' tests share.

pub(crate) mod given;
pub(crate) mod ply;
pub(crate) mod shared;
pub(crate) mod workspace;
