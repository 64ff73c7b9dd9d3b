//! The integration tests: one binary, one module a feature.

mod render_golden;
mod render_rules;
mod render_same_bytes;
mod support;
