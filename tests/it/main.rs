//! The integration tests: one binary, one module a feature.

#[cfg(test)]
mod support;

#[cfg(test)]
mod render_golden;
mod trajectories;
mod event_statistics;
mod codecs;
