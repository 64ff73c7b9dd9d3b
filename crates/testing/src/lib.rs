//! Helpers that the tests of several crates share. They hold no type of another crate, so that the
//! crates under test can use them too.

pub mod absent;
pub mod golden;
pub mod planted;
pub mod ply;
pub mod repository;
pub mod rival;
pub mod shared;

/// A lens of each model and number of coefficients, as recipes write them.
pub const LENSES: [&str; 4] = [
    "opencv:0.1,-0.05,0.002,-0.003",
    "opencv:-0.3,0.1,0.001,0.0005,-0.01",
    "opencv:0.2,-0.1,0.003,-0.002,0.05,0.11,-0.07,0.02",
    "fisheye:0.01,-0.02,0.003,0.001",
];
