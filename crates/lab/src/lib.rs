//! Studies: measurements on one scene, in addition to its build, and of one sensor; and the stress
//! table, which tests the program itself.

pub mod growth;
pub mod real;
pub mod sensor;
pub mod stress;
pub mod thresholds;
pub mod work_precision;
