//! The layouts, one file each. Relatives share a file.

mod camera_needs;
mod e_nerf;

use super::ExportFormat;

/// All layouts.
pub static FORMATS: [&dyn ExportFormat; 1] = [&e_nerf::ENerf];

/// The layout of this name.
#[must_use]
pub fn format_named(name: &str) -> Option<&'static dyn ExportFormat> {
    FORMATS.into_iter().find(|format| format.name() == name)
}
