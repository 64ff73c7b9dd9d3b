//! Studies: measurements over one scene, beside the building of it.

pub mod fit;
pub mod thresholds;
pub mod work_precision;
