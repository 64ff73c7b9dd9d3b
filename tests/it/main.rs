//! The integration tests: one binary, one module a feature.

mod event_statistics;
mod tidy;
mod trajectories;
