//! What a release consists of: its records, documents and files in memory.
//!
//! A release is composed as a list of paths and the sources of their bytes. This crate has the
//! manifest, the description of each scene, the dataset card, the datasheet, the catalogue record,
//! the index and the report. `gs2e-audit` judges a written tree, and `gs2e-publish` writes one. Two
//! releases of the same records are equal byte for byte.

pub mod built;
pub mod calibration;
pub mod card;
pub mod checksum;
pub mod composed;
pub mod croissant;
pub mod datasheet;
pub mod diff;
pub mod facts;
pub mod held_back;
pub mod include;
pub mod index;
pub mod layout;
pub mod left_out;
pub mod loader;
pub mod manifest;
mod markdown;
pub mod path_picture;
pub mod products;
mod provenance;
pub mod published;
pub mod report;
pub mod reuse;
pub mod scene;
pub mod signature;
pub mod split;
pub mod summary;
pub mod top;

pub use built::GatherError;
pub use held_back::HeldBackScene;
pub use manifest::{KeyIngredients, ManifestFile, ManifestScene, ManifestStep, Publisher, ReleaseManifest};
pub use published::recipe as recipe_of_scene;
pub use report::dataset::{CaptionedPicture, compose_dataset_page};
pub use scene::SceneRecord;
pub use split::SplitLeak;

/// Name and version of the program, as written in the files of a release.
pub const TOOL: &str = concat!("gs2e ", env!("CARGO_PKG_VERSION"));
