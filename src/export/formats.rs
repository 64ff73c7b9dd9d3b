//! The layouts, one file each. Relatives share a file.

mod camera_needs;
mod e_nerf;
mod event_3dgs;
mod eventnerf;
mod mcap;
mod parquet_rows;
mod robust_e_nerf;
mod webdataset;
mod windows;

use super::ExportFormat;

/// All layouts.
pub static FORMATS: [&dyn ExportFormat; 10] = [
    &e_nerf::ENerf,
    &event_3dgs::Event3dgs,
    &event_3dgs::Colmap,
    &eventnerf::EventNerf,
    &eventnerf::E3dgs,
    &robust_e_nerf::RobustENerf,
    &robust_e_nerf::DeblurENerf,
    &webdataset::WebDataset,
    &parquet_rows::ParquetRows,
    &mcap::Mcap,
];

/// The layout of this name.
#[must_use]
pub fn format_named(name: &str) -> Option<&'static dyn ExportFormat> {
    FORMATS.into_iter().find(|format| format.name() == name)
}
