//! The timed work: one file per part. Inputs are made before the clock runs, and input files are in
//! memory by then.

mod audit;
mod event;
mod hash;
mod machine;
mod render;
mod scene;
mod sensor;
mod trajectory;

use crate::measure::{Amount, Workload};
use std::path::{Path, PathBuf};

/// The parts that can be named on the command line.
pub(crate) const PARTS: [&str; 8] =
    ["machine", "scene", "trajectory", "render", "sensor", "event", "hash", "audit"];

/// The workloads of the wanted parts.
pub(crate) fn all(wanted: &dyn Fn(&str) -> bool) -> Vec<Workload> {
    let makers: [fn() -> Vec<Workload>; 8] = [
        machine::workloads,
        scene::workloads,
        trajectory::workloads,
        render::workloads,
        sensor::workloads,
        event::workloads,
        hash::workloads,
        audit::workloads,
    ];
    PARTS.iter().zip(makers).filter(|(part, _)| wanted(part)).flat_map(|(_, maker)| maker()).collect()
}

/// A real scene of the optional test data. If it is absent, prints a message to stderr and returns
/// `None`.
fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/scenes").join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("left out: {name}, since ../shared is absent");
    None
}

fn amount(count: usize, unit: &'static str) -> Amount {
    let scale = if unit.starts_with('M') { 1e-6 } else { 1.0 };
    Amount { count: count as f64 * scale, unit }
}
