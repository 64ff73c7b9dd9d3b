//! The integration tests: one binary, one module a feature.

mod codecs;
mod event_statistics;
mod tidy;
mod trajectories;
#[cfg(test)]
mod support;

#[cfg(test)]
mod render_golden;
