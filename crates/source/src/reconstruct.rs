//! Gaussians from photos, trained by an external program: its input, its execution, and the checks
//! of its result.
//!
//! A [`TrainerCommand`] names the program and its arguments. The input is the capture as a COLMAP
//! model with pinhole cameras and undistorted photos, in a separate folder. The program runs
//! without a shell and without standard input, and its output is kept. Its result is read like any
//! scene file, and rejected if it is not a scene.

mod argument;
mod command;
mod layout;
mod trained;

pub use argument::{ArgumentError, ArgumentTemplate};
pub use command::{ArgumentPlaces, ProgramWorkspace, TrainError, TrainedScene, TrainerCommand};
pub use layout::{LAYOUT, LayoutError, find_photo, model_points, photo_memory};
pub use trained::GaussianCount;
