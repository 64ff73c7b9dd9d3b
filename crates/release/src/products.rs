//! The catalogue of a release's files: one row per product of a trajectory, and one per other file.
//!
//! Card, datasheet, Croissant file, index, report and audit read these rows, so a new output is one
//! row of `outputs`.

mod outputs;
mod plain;

pub use outputs::{BLUR, EVENTS, FOLDERS, SHARP};
pub(super) use plain::{CALIBRATION, CHECKS, EXPORTS, PATH, SCENE, SCENE_FILES, TOP};

use super::report::{PictureRequest, Preview};
use gs2e_recipe::OutputKind;
use gs2e_sampling::exposure;
use gs2e_trajectory::imu;

/// A product of a trajectory.
#[derive(Debug)]
pub struct ReleaseProduct {
    /// The output of recipes. Its name is that of the step, and of the folder.
    pub output: OutputKind,
    /// Form of its files, which the audit reads.
    pub form: ProductForm,
    /// Rows on its files, for card and Croissant file.
    pub(super) files: &'static [FileRow],
    /// Words for several of its files, after a number.
    pub(super) noun: &'static str,
    /// The product as the datasheet names it.
    pub(super) instance: &'static str,
    /// Content of its files as the datasheet states it.
    pub(super) content: &'static str,
    /// Lines of Python that load it.
    pub(super) loading: &'static [&'static str],
    /// Its value of `data_type` among the attributes of a scene.
    pub(super) data_type: Option<&'static str>,
    /// Its picture in the report, where the report shows one per trajectory.
    pub(super) picture: Option<PictureMaker>,
}

/// Makes the picture of a product for the report.
pub(super) type PictureMaker = fn(PictureRequest<'_>) -> Option<Preview>;

/// Form of a product's files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProductForm {
    /// Events in HDF5, one file per sensor.
    Streams,
    /// Pictures in 8-bit sRGB, PNG, one file per pose of the row.
    Colours(PictureNumbers),
    /// Arrays of float32, `.npy`, one file per pose of the row. NaN marks a pixel without a value.
    Numbers {
        /// Numbers per pixel.
        channels: u64,
        /// True if they are positive.
        positive: bool,
        /// The poses that have a file.
        poses: PictureNumbers,
    },
    /// Pictures of 8-bit grey, PNG, one file per pose of the row.
    Greys {
        /// The poses that have a file.
        poses: PictureNumbers,
        /// A file beside them.
        beside: Option<&'static str>,
    },
    /// Inertial data, with the names of [`imu::files`].
    Samples,
}

/// The poses that have a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureNumbers {
    /// The poses in the middle of the exposures.
    Exposed,
    /// Every n-th pose.
    Spaced,
    /// Every n-th pose, and those in the middle of the exposures.
    SpacedAndExposed,
}

/// Files of one name or pattern.
#[derive(Debug)]
pub(super) struct FileRow {
    /// Name in the card; several names are separated by `, `.
    pub(super) name: &'static str,
    /// Description in the card.
    pub(super) content: &'static str,
    /// Set of files in the Croissant file.
    pub(super) set: Option<FileSet>,
    /// Condition under which the card lists them.
    pub(super) presence: FilePresence,
    /// Permission to redistribute them.
    pub(super) class: LicenceClass,
}

/// A set of files of the Croissant file. A release lists the sets that are not empty.
#[derive(Debug)]
pub(super) struct FileSet {
    pub(super) id: &'static str,
    pub(super) media: &'static str,
    pub(super) glob: &'static str,
    pub(super) description: &'static str,
}

/// Condition under which the card lists a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FilePresence {
    /// The release has the product, or the file is no product's.
    Always,
    /// The release has events.
    WithStreams,
    /// A trajectory has several sensors.
    WithSeveralSensors,
    /// A scene has photos of held-out views.
    WithHeldOut,
    /// A scene has a rig.
    WithRig,
    /// A rig has a stereo pair.
    WithStereo,
    /// The release includes exports.
    WithExports,
}

/// Permission to redistribute a file of a scene whose upstream forbids redistribution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LicenceClass {
    /// It shows nothing of the scene, and may always be passed on.
    Metadata,
    /// It shows the scene.
    Material,
    /// It is a file of the whole release.
    Release,
}

/// All products: the event streams, then those with a folder.
pub(super) fn products() -> impl Iterator<Item = &'static ReleaseProduct> {
    [&EVENTS].into_iter().chain(FOLDERS)
}

/// Returns true if a file of a scene's folder shows nothing of the scene.
pub fn is_metadata(path: &str) -> bool {
    let last = |path: &'static str| path.rsplit('/').next().unwrap_or(path);
    let rows = SCENE.iter().chain(&PATH).chain(&CALIBRATION).chain(&CHECKS);
    // By the last name alone: the names of rows begin with placeholders for scene and trajectory.
    let metadata = rows.filter(|row| row.class == LicenceClass::Metadata);
    let mut names = metadata.flat_map(|row| row.name.split(", ")).map(last);
    names.any(|name| path.rsplit('/').next() == Some(name))
}

impl ReleaseProduct {
    /// Name of the step and of the folder.
    pub fn name(&self) -> &'static str {
        self.output.name()
    }

    /// Returns true if a file of a scene, by its path, is in the folder of this product.
    pub(super) fn owns(&self, path: &str) -> bool {
        self.form.holds(path) && path.rsplit('/').nth(1) == Some(self.name())
    }

    /// Names of its files of a trajectory with this number of poses, but for event streams. `every` is the
    /// spacing of pictures, and `exposed` the number of frames per exposure, if there are exposures.
    pub fn file_names(&self, poses: usize, every: u32, exposed: Option<u32>) -> Vec<String> {
        let numbers = match self.form {
            ProductForm::Streams => return Vec::new(),
            ProductForm::Samples => {
                let names = [imu::files::SAMPLES, imu::files::STATES, imu::files::SENSOR];
                return names.map(|name| format!("{}/{name}", self.name())).to_vec();
            }
            ProductForm::Colours(numbers)
            | ProductForm::Greys { poses: numbers, .. }
            | ProductForm::Numbers { poses: numbers, .. } => numbers,
        };
        let kept = match numbers {
            PictureNumbers::Exposed => {
                exposed.map_or(Vec::new(), |frames| exposure::exposure_centres(poses, frames))
            }
            PictureNumbers::Spaced => exposure::kept_poses(poses, every, None),
            PictureNumbers::SpacedAndExposed => exposure::kept_poses(poses, every, exposed),
        };
        let (folder, end) = (self.name(), self.form.extensions()[0]);
        let beside = match self.form {
            ProductForm::Greys { beside, .. } => beside.map(|name| format!("{folder}/{name}")),
            _ => None,
        };
        kept.into_iter().map(|pose| format!("{folder}/{pose:06}{end}")).chain(beside).collect()
    }
}

impl ProductForm {
    /// Ends of the names of its files.
    pub fn extensions(self) -> &'static [&'static str] {
        match self {
            Self::Streams => &[".h5"],
            Self::Colours(_) => &[".png"],
            Self::Numbers { .. } => &[".npy"],
            Self::Greys { .. } => &[".png", ".csv"],
            Self::Samples => &[".csv", ".yaml"],
        }
    }

    /// Returns true if a file of this name can be one of its files.
    pub(super) fn holds(self, name: &str) -> bool {
        self.extensions().iter().any(|end| name.ends_with(end))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_output_has_a_row() {
        let rows: Vec<OutputKind> = products().map(|product| product.output).collect();
        assert_eq!(rows, OutputKind::ALL);
        for product in products() {
            for row in product.files {
                assert_eq!(row.class, LicenceClass::Material, "{}", row.name);
                assert!(row.name.contains(product.name()), "{}", row.name);
                assert!(row.name.split(", ").all(|name| product.form.holds(name)), "{}", row.name);
            }
        }
    }

    #[test]
    fn files_that_show_nothing_of_a_scene_are_known() {
        for path in [
            "a/b/base/poses.txt",
            "scene.json",
            "a/checks.json",
            "a/base/trajectory.png",
            "a/base/calibration/camchain.yaml",
        ] {
            assert!(is_metadata(path), "{path}");
        }
        for path in ["base/events.h5", "base/sharp/000000.png", "base/checks/motion.png", "README.md"] {
            assert!(!is_metadata(path), "{path}");
        }
    }
}
