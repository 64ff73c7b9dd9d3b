//! Studies: measurements on one scene, in addition to its build, and of one sensor; and the stress
//! table, which tests the program itself.
//!
//! It calls `gs2e-sensor`, `gs2e-sampling`, `gs2e-render` and `gs2e-trajectory` directly, on scenes of
//! `gs2e-scene`, such as that of `gs2e-demo`. Events, images and rotations are those of `gs2e-event`,
//! `gs2e-image` and `gs2e-num`. Only the program uses it.
//!
//! # Examples
//!
//! ```
//! use glam::DVec3;
//! use gs2e_lab::stress::trajectory::turns_case;
//! use gs2e_num::se3::rotation::log_vector;
//!
//! // Rotations from none to a half turn, made from known vectors.
//! assert!(turns_case(log_vector).holds());
//! // The case finds a function that takes every rotation for none.
//! assert!(!turns_case(|_| DVec3::ZERO).holds());
//! ```

pub mod real;
pub mod sensor;
pub mod stress;
pub mod thresholds;
pub mod work_precision;
