//! The layouts, one file each. Relatives share a file.

mod camera_needs;
mod dsec;
mod e2nerf;
mod e2vid;
mod e_nerf;
mod evdeblurnerf;
mod event_3dgs;
mod eventnerf;
mod evreal;
mod inceventgs;
mod marks;
mod mcap;
mod monash_h5;
mod parquet_rows;
mod robust_e_nerf;
mod webdataset;
mod windows;

use super::ExportFormat;

/// All layouts.
pub static FORMATS: [&dyn ExportFormat; 20] = [
    &e_nerf::ENerf,
    &event_3dgs::Event3dgs,
    &event_3dgs::Colmap,
    &eventnerf::EventNerf,
    &eventnerf::E3dgs,
    &robust_e_nerf::RobustENerf,
    &robust_e_nerf::DeblurENerf,
    &evdeblurnerf::EvDeblurNerf,
    &evdeblurnerf::Llff,
    &e2nerf::E2Nerf,
    &e2nerf::E2gs,
    &inceventgs::IncEventGs,
    &monash_h5::MonashH5,
    &e2vid::TEXT,
    &e2vid::ZIP,
    &evreal::Evreal,
    &dsec::Dsec,
    &webdataset::WebDataset,
    &parquet_rows::ParquetRows,
    &mcap::Mcap,
];

/// The layout of this name.
#[must_use]
pub fn format_named(name: &str) -> Option<&'static dyn ExportFormat> {
    FORMATS.into_iter().find(|format| format.name() == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_recipe::EXPORT_FORMATS;

    #[test]
    fn a_release_may_include_every_format() {
        assert_eq!(FORMATS.map(ExportFormat::name), EXPORT_FORMATS);
    }
}
