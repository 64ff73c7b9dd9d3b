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
pub static FORMATS: [&ExportFormat; 20] = [
    &e_nerf::FORMAT,
    &event_3dgs::EVENT_3DGS,
    &event_3dgs::COLMAP,
    &eventnerf::EVENTNERF,
    &eventnerf::E_3DGS,
    &robust_e_nerf::ROBUST_E_NERF,
    &robust_e_nerf::DEBLUR_E_NERF,
    &evdeblurnerf::EVDEBLURNERF,
    &evdeblurnerf::LLFF,
    &e2nerf::E2NERF,
    &e2nerf::E2GS,
    &inceventgs::FORMAT,
    &monash_h5::FORMAT,
    &e2vid::TEXT,
    &e2vid::ZIP,
    &evreal::FORMAT,
    &dsec::FORMAT,
    &webdataset::FORMAT,
    &parquet_rows::FORMAT,
    &mcap::FORMAT,
];

/// The layout of this name.
#[must_use]
pub fn format_named(name: &str) -> Option<&'static ExportFormat> {
    FORMATS.into_iter().find(|format| format.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_recipe::EXPORT_FORMATS;

    #[test]
    fn a_release_may_include_every_format() {
        assert_eq!(FORMATS.map(|format| format.name), EXPORT_FORMATS);
    }
}
