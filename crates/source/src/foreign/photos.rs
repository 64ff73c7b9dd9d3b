//! Poses of photos, found by COLMAP (Schoenberger and Frahm, "Structure-from-Motion Revisited", CVPR
//! 2016).
//!
//! Photos of one size, camera and focal length share their intrinsics. Key points are found with
//! COLMAP's SIFT on the CPU, and matched here: exactly, by COLMAP's rule, in any number of threads.
//! COLMAP verifies the pairs and makes the models with one thread. The largest model is kept. With a
//! vocabulary tree, COLMAP matches as well, because only it knows the format of the tree.
//!
//! The same photos give the same bytes with the same version of COLMAP, except with a vocabulary
//! tree: the search trees of COLMAP 3.8 differ from run to run.

use super::colmap_run::{ColmapOptions, colmap_run};
use super::pose_watch::PoseWatch;
use super::{ForeignError, features};
use crate::SourceError;
use crate::colmap::ColmapModel;
use crate::photos::MIN_PHOTOS;
use crate::reconstruct::ProgramWorkspace;
use crate::same_camera::{CameraGroup, camera_groups};
use crate::solving::{PairRule, PoseSolving};
use gs2e_files::programs::EndKind;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A model of some photos.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedPhotos {
    /// Number of given photos.
    pub given: usize,
    /// Number of photos in each model, the largest first. The first model was kept.
    pub models: Vec<usize>,
    /// Mean reprojection error over the points of the kept model, px; `None` without points.
    pub reprojection_px: Option<f64>,
    /// Number of cameras: photos with the same intrinsics share one.
    pub cameras: usize,
}

/// The reason why no poses were found.
#[derive(Debug, thiserror::Error)]
pub enum PoseError {
    /// A program failed, or the work was asked to stop.
    #[error(transparent)]
    Program(#[from] ForeignError),
    /// A photo or a product of COLMAP cannot be read.
    #[error(transparent)]
    Unreadable(#[from] SourceError),
    /// There are too few photos.
    #[error("there are {found} photos, wanted at least {MIN_PHOTOS}")]
    Few {
        /// Number of photos.
        found: usize,
    },
    /// No two photos fit together.
    #[error(
        "COLMAP made no model of {given} photos: no two of them show enough of the same place from different places"
    )]
    NoModel {
        /// Number of photos.
        given: usize,
    },
    /// The largest model is too small.
    #[error(
        "the largest of COLMAP's {models} models has {registered} of {given} photos, wanted at least {wanted}: the photos \
         fall into parts that share too little; add photos between them, or lower `registered`"
    )]
    Parts {
        /// Number of models.
        models: usize,
        /// Number of photos in the largest one.
        registered: usize,
        /// Number of given photos.
        given: usize,
        /// Required number of photos.
        wanted: usize,
    },
    /// COLMAP read a photo in another size.
    #[error(
        "COLMAP's camera of {photo} has other sides than the photo: rotate the photo itself, and remove its EXIF"
    )]
    OtherSize {
        /// The photo.
        photo: String,
    },
}

/// COLMAP's message when the mapper ends with exit code 1 and no model.
const NO_MODEL: &str = "failed to create sparse model";

/// Finds the poses of photos, given by name and path in natural order, and writes the model to the
/// folder `to`: `cameras.bin`, `images.bin` and `points3D.bin`. `report` gets the progress in words.
///
/// # Errors
/// See [`PoseError`].
pub fn solve_photos(
    photos: &[(String, PathBuf)],
    solving: &PoseSolving,
    to: &Path,
    workspace: ProgramWorkspace<'_>,
    report: &(dyn Fn(&str) + Sync),
) -> Result<SolvedPhotos, PoseError> {
    let given = photos.len();
    if given < MIN_PHOTOS {
        return Err(PoseError::Few { found: given });
    }
    let watch = PoseWatch::new(workspace.log, given, report);
    let place = PoseWorkspace::new(photos, workspace, &watch)?;
    let groups = camera_groups(photos)?;
    for (number, group) in groups.iter().enumerate() {
        place.extract(number, group, solving)?;
    }
    let matched = match &solving.vocabulary {
        Some(tree) => place.match_by_tree(tree)?,
        None => place.match_pairs(solving.pairs.unwrap_or_else(|| PairRule::for_count(given)))?,
    };
    if !matched {
        return Err(PoseError::NoModel { given });
    }
    let mut models = place.map(given)?;
    // Models of one size keep COLMAP's order.
    models.sort_by_key(|(images, _)| std::cmp::Reverse(*images));
    let Some((registered, model)) = models.first() else { return Err(PoseError::NoModel { given }) };
    let wanted = wanted_photos(solving.registered, given);
    if *registered < wanted {
        let (models, registered) = (models.len(), *registered);
        return Err(PoseError::Parts { models, registered, given, wanted });
    }
    check_sizes(model, photos, &groups)?;
    let name = |link: &str| original(link, photos).unwrap_or_else(|| link.to_owned());
    model.write_renamed(to, &name)?;
    let reprojection_px = model.reprojection()?.map(|stats| stats.over_points_px);
    let cameras = model.cameras()?.len();
    Ok(SolvedPhotos {
        given,
        models: models.iter().map(|(images, _)| *images).collect(),
        reprojection_px,
        cameras,
    })
}

/// Smallest number of photos that is at least this share.
fn wanted_photos(share: f64, given: usize) -> usize {
    // A share such as 0.9 of 10 photos exceeds 9 by a rounding, which must not ask for 10.
    const SLACK: f64 = 1e-9;
    (0..=given).find(|count| *count as f64 >= share * given as f64 - SLACK).unwrap_or(given)
}

/// Name of a photo for COLMAP: its index in six digits. Its own name may hold a space, which ends a
/// name in COLMAP's lists.
fn link_name(index: usize, path: &Path) -> String {
    // COLMAP reads by content, but lists photos by extension.
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or("jpg");
    format!("{index:06}.{}", extension.to_lowercase())
}

/// The name of the photo with this link.
fn original(link: &str, photos: &[(String, PathBuf)]) -> Option<String> {
    let index: usize = link.split('.').next()?.parse().ok()?;
    photos.get(index).map(|(name, _)| name.clone())
}

/// Checks that COLMAP has read the photos as they are stored, as this program does.
fn check_sizes(
    model: &ColmapModel,
    photos: &[(String, PathBuf)],
    groups: &[CameraGroup],
) -> Result<(), PoseError> {
    let sizes: BTreeMap<usize, _> =
        groups.iter().flat_map(|group| group.photos.iter().map(|i| (*i, group.size))).collect();
    let cameras = model.cameras()?;
    for image in model.images()? {
        let index = image.name.split('.').next().and_then(|index| index.parse::<usize>().ok());
        let stated = cameras.get(&image.camera_id).map(|camera| camera.camera.size);
        if stated != index.and_then(|index| sizes.get(&index)).copied() {
            let photo = original(&image.name, photos).unwrap_or(image.name);
            return Err(PoseError::OtherSize { photo });
        }
    }
    Ok(())
}

/// Working folder of COLMAP: its database, links to the photos, and its models.
struct PoseWorkspace<'a> {
    workspace: ProgramWorkspace<'a>,
    watch: &'a PoseWatch<'a>,
    database: PathBuf,
    images: PathBuf,
    sparse: PathBuf,
    links: Vec<String>,
}

impl<'a> PoseWorkspace<'a> {
    fn new(
        photos: &[(String, PathBuf)],
        workspace: ProgramWorkspace<'a>,
        watch: &'a PoseWatch<'a>,
    ) -> Result<Self, ForeignError> {
        let [images, sparse] = ["images", "sparse"].map(|name| workspace.folder.join(name));
        for folder in [&images, &sparse] {
            std::fs::create_dir(folder).map_err(ForeignError::io_error(folder))?;
        }
        let link = |(index, (_, path)): (usize, &(String, PathBuf))| {
            let name = link_name(index, path);
            // A relative link would be resolved from its own folder.
            let file = std::path::absolute(path).map_err(ForeignError::io_error(path))?;
            std::os::unix::fs::symlink(file, images.join(&name)).map_err(ForeignError::io_error(path))?;
            Ok(name)
        };
        let links = photos.iter().enumerate().map(link).collect::<Result<_, ForeignError>>()?;
        Ok(Self { workspace, watch, database: workspace.folder.join("database.db"), images, sparse, links })
    }

    fn run(&self, command: &str, options: ColmapOptions) -> Result<(), ForeignError> {
        let goes_on = self.watched();
        let workspace = ProgramWorkspace { goes_on: &goes_on, ..self.workspace };
        let ended = colmap_run(command, &self.database, options, workspace).end_well().map(drop);
        self.watch.end();
        ended
    }

    /// The condition to go on, which also looks at the log.
    fn watched(&self) -> impl Fn() -> bool + Sync + use<'a> {
        let (watch, goes_on) = (self.watch, self.workspace.goes_on);
        move || {
            watch.look();
            goes_on()
        }
    }

    /// Finds the key points of the photos of one camera.
    fn extract(&self, number: usize, group: &CameraGroup, solving: &PoseSolving) -> Result<(), ForeignError> {
        let list = self.workspace.folder.join(format!("camera-{number}.txt"));
        let names: String = group.photos.iter().map(|index| format!("{}\n", self.links[*index])).collect();
        std::fs::write(&list, names).map_err(ForeignError::io_error(&list))?;
        // One thread: with several, photos get their ids in the order in which they are finished.
        let options: ColmapOptions = vec![
            ("--image_path", self.images.clone().into()),
            ("--image_list_path", list.into()),
            ("--ImageReader.single_camera", "1".into()),
            ("--ImageReader.camera_model", solving.lens.colmap_name().into()),
            ("--SiftExtraction.use_gpu", "0".into()),
            ("--SiftExtraction.num_threads", "1".into()),
            ("--SiftExtraction.max_num_features", solving.features.to_string().into()),
        ];
        self.run("feature_extractor", options)
    }

    /// Matches key points of pairs, and has COLMAP verify the matches. Returns false if no pair has
    /// a match.
    fn match_pairs(&self, rule: PairRule) -> Result<bool, ForeignError> {
        let described =
            features::read_database(&self.database).map_err(ForeignError::product_error(&self.database))?;
        let pairs = rule.pairs(described.len());
        self.watch.say(&format!("matching {} pairs of photos", pairs.len()));
        let found = features::match_pairs(&described, &pairs, self.workspace.goes_on);
        let (matches, any) = found.ok_or(ForeignError::Stopped)?;
        if any == 0 {
            return Ok(false);
        }
        let list = self.workspace.folder.join("matches.txt");
        std::fs::write(&list, matches).map_err(ForeignError::io_error(&list))?;
        let options: ColmapOptions = vec![
            ("--match_list_path", list.into()),
            ("--match_type", "raw".into()),
            ("--SiftMatching.use_gpu", "0".into()),
            ("--SiftMatching.num_threads", "1".into()),
        ];
        self.run("matches_importer", options).map(|()| true)
    }

    /// Has COLMAP match each photo with the following ones, and with similar ones anywhere.
    fn match_by_tree(&self, tree: &Path) -> Result<bool, ForeignError> {
        let tree = std::path::absolute(tree).map_err(ForeignError::io_error(tree))?;
        let options: ColmapOptions = vec![
            ("--SequentialMatching.loop_detection", "1".into()),
            ("--SequentialMatching.vocab_tree_path", tree.into()),
            ("--SiftMatching.use_gpu", "0".into()),
            ("--SiftMatching.num_threads", "1".into()),
        ];
        self.run("sequential_matcher", options).map(|()| true)
    }

    /// Makes models; returns the number of images of each.
    fn map(&self, given: usize) -> Result<Vec<(usize, ColmapModel)>, PoseError> {
        let options: ColmapOptions = vec![
            ("--image_path", self.images.clone().into()),
            ("--output_path", self.sparse.clone().into()),
            ("--Mapper.num_threads", "1".into()),
            // COLMAP discards models below 10 photos, after the first. They count as parts here.
            ("--Mapper.min_model_size", "3".into()),
        ];
        let goes_on = self.watched();
        let workspace = ProgramWorkspace { goes_on: &goes_on, ..self.workspace };
        let ended = colmap_run("mapper", &self.database, options, workspace).end();
        self.watch.end();
        let ran = match ended? {
            Ok(ran) => ran,
            Err(ran) if ran.says(NO_MODEL) => return Err(PoseError::NoModel { given }),
            Err(ran) => return Err(ran.failed(EndKind::Code(1)).into()),
        };
        // COLMAP numbers its models from 0 without gaps.
        let numbered = (0..).map(|number: u32| self.sparse.join(number.to_string()));
        let folders = numbered.take_while(|folder| folder.is_dir());
        let read = |folder: PathBuf| {
            let model = ColmapModel::find_model(&folder)?;
            Ok((model.images()?.len(), model))
        };
        let models: Result<Vec<_>, SourceError> = folders.map(read).collect();
        models.map_err(|e| ran.failed(EndKind::Product(format!("its model: {e}"))).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wanted_number_is_the_share_rounded_up() {
        let t = |share, given, wanted| assert_eq!(wanted_photos(share, given), wanted, "{share} of {given}");
        t(0.5, 50, 25);
        t(0.5, 5, 3);
        t(0.9, 10, 9);
        t(0.3, 10, 3);
        t(1.0, 7, 7);
        t(0.0, 7, 0);
    }

    #[test]
    fn links_lead_back_to_names() {
        let photos =
            [("a b/1.JPG".to_owned(), PathBuf::from("/x/a b/1.JPG")), ("2.png".into(), "/x/2.png".into())];
        for (index, (name, path)) in photos.iter().enumerate() {
            let link = link_name(index, path);
            assert!(!link.contains(' '));
            assert_eq!(original(&link, &photos).as_ref(), Some(name));
        }
        assert_eq!(link_name(0, &photos[0].1), "000000.jpg");
        assert_eq!(original("000002.png", &photos), None);
        assert_eq!(original("other", &photos), None);
    }
}
