//! Studies: measurements over one scene, beside the building of it.

pub mod thresholds;
