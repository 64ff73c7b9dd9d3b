//! Gaussians from photos, trained by a program of somebody else's: what it is given, how it is run, and what it has to bring.
//!
//! A [`Command`] says which program and with which arguments. It is given the capture as a COLMAP model with pinhole
//! cameras, its photos undistorted, in a folder of its own; it runs without a shell and without input, and what it says is
//! kept. What it makes is read as any scene file is, and refused where it is none.

mod argument;
mod command;
mod layout;
mod trained;

pub use argument::{Argument, ArgumentError};
pub use command::{Command, Desk, Places, TrainError, Trained};
pub use layout::{LAYOUT, LayoutError, memory};
pub use trained::Count;
