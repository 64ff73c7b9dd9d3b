//! Studies: measurements over one scene, beside the building of it; and the table of extremes, over the program itself.

pub mod growth;
pub mod stress;
pub mod thresholds;
pub mod work_precision;
