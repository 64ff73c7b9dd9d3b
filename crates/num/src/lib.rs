//! Numbers that give the same bits on every machine: units, draws, logarithms, rigid motions.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
//! use gs2e_num::units::Hertz;
//!
//! // Frame 3 at 2400 Hz lies at 3/2400 s.
//! let rate = Hertz("2400".parse()?);
//! assert_eq!(rate.stamp_us(3), 1250);
//!
//! // A draw depends on its address alone, so the order of the pixels does not matter.
//! let draw = |x| Seed(42).draws(SeedCell { x, y: 0, level: 0, index: 0 }, DrawSpace::Shot).uniform();
//! let [first, second] = [0, 1].map(draw);
//! assert_eq!([1, 0].map(draw), [second, first]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod elementary;
pub mod se3;
pub mod seed;
pub mod stats;
pub mod units;
