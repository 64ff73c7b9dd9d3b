//! What is timed.

use crate::measure::Workload;

/// The parts that can be named on the command line.
pub(crate) const PARTS: [&str; 0] = [];

/// The workloads of the wanted parts.
pub(crate) fn all(_wanted: &dyn Fn(&str) -> bool) -> Vec<Workload> {
    Vec::new()
}
