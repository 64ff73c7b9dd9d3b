//! The integration tests: one binary, one module a feature.

#[cfg(test)]
mod support;

#[cfg(test)]
mod render_golden;
mod codecs;
mod event_statistics;
mod render_golden;
mod support;
mod tidy;
mod trajectories;
mod event_statistics;
mod codecs;
