//! Numbers that give the same bits on every machine: units, draws, logarithms, rigid motions.

pub mod elementary;
pub mod se3;
pub mod seed;
pub mod stats;
pub mod units;
