//! The build engine: steps, their plan and their execution.

pub mod artifact;
pub mod cluster;
pub mod plan;
pub mod run;
pub mod stage;
