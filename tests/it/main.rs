//! The integration tests: one binary, one module a feature.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod audit;
mod bad_input;
mod behaviour;
mod checks;
mod cli;
mod codecs;
mod cutoff;
mod determinism;
mod diff;
mod event_statistics;
mod gc;
mod glance;
mod golden_digests;
mod interruption;
mod keys;
mod locks;
mod manifest;
mod memory;
mod messages;
mod progress;
mod real;
mod recipes;
mod release;
mod render_golden;
mod render_rules;
mod render_same_bytes;
mod scenes;
mod sources;
mod staleness;
mod store;
mod support;
mod tidy;
mod trajectories;
mod tree;
mod why;
