//! The contents of a release: its records, documents and files in memory.
//!
//! A release is composed as a list of paths and the sources of their bytes. This crate has the
//! manifest, the description of each scene, the dataset card, the datasheet, the catalogue record,
//! the index and the report. `gs2e-audit` judges a written tree, and `gs2e-publish` writes one. Two
//! releases of the same records are equal byte for byte.
//!
//! Scenes come from `gs2e-recipe`, their products from `gs2e-build`, and digests from `gs2e-store`.
//! Terms come from `gs2e-source`, findings from `gs2e-check`, records of trainings from `gs2e-train`, and
//! reports on the datasets of others, which get a page too, from `gs2e-dataset`. The documents describe
//! cameras of `gs2e-scene`, paths of `gs2e-trajectory`, sensors of `gs2e-sensor`, events of `gs2e-event`,
//! images of `gs2e-image`, and how `gs2e-sampling` and `gs2e-render` made frames. Units come from
//! `gs2e-num`; `gs2e-files` opens files and writes HTML. `gs2e-export` makes the exports of a release.
//!
//! # Examples
//!
//! ```
//! use gs2e_release::{checksum, layout};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("abc.txt");
//! std::fs::write(&path, "abc")?;
//! let sums = checksum::sums_text([("abc.txt", checksum::hash_file(&path)?.sha256)].into_iter());
//! // The digest of FIPS 180-2, in the form that `sha256sum --check` reads.
//! assert_eq!(sums, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  abc.txt\n");
//! assert!(layout::top().any(|name| name == checksum::NAME));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

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
