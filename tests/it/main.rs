//! The integration tests: one binary, one module a feature.

mod codecs;
mod event_statistics;
mod manifest;
mod recipes;
mod render_golden;
mod scenes;
mod sources;
mod store;
mod support;
mod tidy;
mod trajectories;
