//! Remarks about a capture that do not stop its use.

use gs2e_image::Size;
use std::path::PathBuf;

/// A property of a source that the user should know and that does not stop a build.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SourceWarning {
    /// Lens distortion that renderings do not have.
    #[error(
        "the photos are distorted by up to {most_px:.1} px, but renderings have no distortion: the scene must have been \
         trained on undistorted photos"
    )]
    DistortionIgnored {
        /// Largest displacement, px of the photo.
        most_px: f64,
    },
    /// Views have different cameras.
    #[error(
        "{count} views have a different camera than `{taken}`, whose camera is used; the first is `{other}`"
    )]
    CamerasDiffer {
        /// The view whose camera is used.
        taken: String,
        /// The first differing view.
        other: String,
        /// Number of differing views.
        count: usize,
    },
    /// The binary and the text form of a model have different numbers of records.
    #[error("{binary} holds {found} records, {text} holds {other}: the binary file is used")]
    CountsDiffer {
        /// Binary file.
        binary: PathBuf,
        /// Number of its records.
        found: u64,
        /// Text file.
        text: PathBuf,
        /// Number of its records.
        other: u64,
    },
    /// The model was trained with colour transforms.
    #[error("exposure was trained for {count} images; it is not applied")]
    Exposure {
        /// Number of images whose transform changes colours.
        count: usize,
    },
    /// A rotation matrix deviates from a rotation by more than 1e-6.
    #[error("the rotation of `{image}` is off by {deviation:.1e}; the nearest rotation is used")]
    Projected {
        /// The view.
        image: String,
        /// The deviation, see [`gs2e_num::se3::ScreenedRotation`].
        deviation: f64,
    },
    /// Some photos of registered views are missing.
    #[error("{count} of {of} photos are not in {}; the first is `{first}`", dir.display())]
    PhotosMissing {
        /// The folder of the photos.
        dir: PathBuf,
        /// Number of missing photos.
        count: usize,
        /// Number of all photos.
        of: usize,
        /// The first missing photo.
        first: String,
    },
    /// The source has fewer views than the recipe asks for.
    #[error("found {found} views in the source, wanted {wanted}: all are used")]
    FewViews {
        /// Number of views of the source.
        found: usize,
        /// Number of views that the recipe asks for.
        wanted: u32,
    },
    /// The size of a photo differs from the size of its camera.
    #[error("`{image}` is {photo}, but its camera states {stated}: {action}")]
    PhotoSize {
        /// The view.
        image: String,
        /// Size of the photo.
        photo: Size,
        /// Size of its camera.
        stated: Size,
        /// The program's reaction.
        action: &'static str,
    },
}
