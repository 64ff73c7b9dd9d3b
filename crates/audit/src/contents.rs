//! Checks that a scene's files hold what their formats prescribe and what `scene.json` states.

mod events;
mod motion;
mod pictures;

use super::recompose::files_of;
use super::{AuditFault, FaultCode, TrustedTree, claims};
use events::StatedStream;
use gs2e_check::{Finding, Verdict};
use gs2e_recipe::Recipe;
use gs2e_release::layout::CHECKS;
use gs2e_release::products::ReleaseProduct;
use gs2e_release::scene::{SceneRecord, TrajectoryPart, TrajectoryStatistics};
use gs2e_release::{calibration, layout, path_picture, products, published};
use gs2e_tree::{TrajectoryFiles, TreeError, event_file};
use rayon::prelude::*;
use serde_json::Value;
use std::path::PathBuf;

const ABSENT: &str = "the scene needs this file; it is missing or damaged";

/// A trajectory folder under audit.
#[derive(Debug)]
struct TrajectoryFolder<'a> {
    tree: &'a TrustedTree<'a>,
    files: TrajectoryFiles<'a>,
    part: &'a TrajectoryPart,
    /// True if this version of the program wrote the scene.
    is_current: bool,
}

impl TrajectoryFolder<'_> {
    fn path_of(&self, name: &str) -> String {
        self.files.path(name)
    }

    /// Returns true if this file exists and is intact.
    fn has(&self, name: &str) -> bool {
        self.tree.has(&self.path_of(name))
    }

    fn on_disk(&self, name: &str) -> PathBuf {
        self.tree.path_of(&self.path_of(name))
    }

    fn fault(&self, code: FaultCode, name: &str, message: impl Into<String>) -> AuditFault {
        AuditFault::of_file(code, &self.path_of(name), message)
    }
}

/// Audits the contents of a scene's files. An absent file is one fault and is not opened.
pub(super) fn audit_scene(tree: &TrustedTree<'_>, scene: &SceneRecord) -> Vec<AuditFault> {
    let mut faults = photo_faults(tree, scene);
    // A recipe that cannot be read is reported where the scene is composed again.
    let recipe = published::recipe(scene).ok();
    for part in &scene.trajectories {
        let files = match files_of(tree, scene, part) {
            Ok(files) => files,
            Err(TreeError { because, .. }) => {
                let path = format!("{}/{}", scene.id, layout::SCENE);
                faults.push(AuditFault::of_file(FaultCode::Unreadable, &path, because));
                continue;
            }
        };
        let is_current = scene.gs2e_version == env!("CARGO_PKG_VERSION");
        let folder = TrajectoryFolder { tree, files, part, is_current };
        faults.extend(missing_files(&folder, scene));
        let streams = stated_streams(part, recipe.as_ref()).into_par_iter();
        let streams = streams.filter(|stream| folder.has(&stream.name));
        let contents = streams.flat_map(|stream| events::audit_stream(&folder, &stream));
        faults.extend(contents.collect::<Vec<_>>());
        // Absent poses are a fault already, and the other files are compared with the poses.
        if folder.has("poses.txt") {
            faults.extend(motion::audit_motion(&folder));
        }
        faults.extend(read_checks(tree, &folder.path_of(CHECKS)).1);
        faults.extend(pictures::audit_pictures(&folder));
    }
    faults.into_iter().map(|fault| fault.in_scene(&scene.id)).collect()
}

/// The event streams that a trajectory can have, with their sensors by the recipe.
fn stated_streams<'a>(part: &'a TrajectoryPart, recipe: Option<&'a Recipe>) -> Vec<StatedStream<'a>> {
    let sensors = recipe.map(|recipe| recipe.sensors_of(&part.name));
    let find = |name: &str| {
        let mut all = sensors?.iter();
        all.find(|(own, _)| event_file(*own) == name).map(|(_, sensor)| sensor)
    };
    let stated = stream_files(part).into_iter();
    stated.map(|(name, counts)| StatedStream { sensor: find(&name), name, counts }).collect()
}

/// Returns the file name of each event stream that a trajectory can have, with the counts stated of
/// it.
fn stream_files(part: &TrajectoryPart) -> Vec<(String, &TrajectoryStatistics)> {
    if part.sensors.is_empty() {
        return vec![(event_file(None), &part.statistics)];
    }
    part.sensors.iter().map(|(name, sensor)| (event_file(Some(name)), &sensor.statistics)).collect()
}

/// Returns the names of the pictures of a trajectory that the tree must have, by its recipe.
pub(super) fn pictures_wanted(
    tree: &TrustedTree<'_>,
    scene: &SceneRecord,
    part: &TrajectoryPart,
) -> Vec<String> {
    // Withheld pictures are not wanted; `terms` judges whether they may be withheld.
    if scene.licence.withheld { Vec::new() } else { pictures_planned(tree, scene, part) }
}

/// Returns the names of the pictures that are made of a trajectory, by its recipe.
pub(super) fn pictures_planned(
    tree: &TrustedTree<'_>,
    scene: &SceneRecord,
    part: &TrajectoryPart,
) -> Vec<String> {
    // The stated number can be anything, and each pose makes a name. A line of `poses.txt` has at
    // least 16 bytes, so the file bounds the number; a wrong number is another fault.
    let poses = tree.path_of(&format!("{}/{}/poses.txt", scene.id, part.name));
    let lines = std::fs::metadata(poses).map_or(0, |file| file.len() / 16);
    let poses = part.poses.min(usize::try_from(lines).unwrap_or(usize::MAX));
    pictures::wanted_names(poses, &scene.recipe, &|product| asks(scene, part, product))
}

/// Returns true if the recipe of a scene asks for a product of a trajectory.
fn asks(scene: &SceneRecord, part: &TrajectoryPart, product: &ReleaseProduct) -> bool {
    let has = |outputs: Option<&Value>| {
        let mut outputs = outputs.and_then(Value::as_array).into_iter().flatten();
        outputs.any(|output| output == product.name())
    };
    match &part.mounted {
        Some(mounted) => {
            let cameras = scene.recipe.pointer("/rig/cameras").and_then(Value::as_array);
            let mut cameras = cameras.into_iter().flatten();
            has(cameras
                .find(|camera| camera["name"] == *mounted.name)
                .and_then(|camera| camera.get("outputs")))
        }
        // A body has what is measured on its path.
        None => has(scene.recipe.get("outputs")) && (part.cameras.is_empty() || product.output.is_measured()),
    }
}

/// Returns faults for the files that the scene's own description asks for and that are absent.
fn missing_files(folder: &TrajectoryFolder<'_>, scene: &SceneRecord) -> Vec<AuditFault> {
    let mut wanted: Vec<String> = layout::MOTION.map(str::to_owned).to_vec();
    wanted.extend([path_picture::NAME, CHECKS].map(str::to_owned));
    // A body sees nothing.
    wanted.extend(folder.part.cameras.is_empty().then(|| layout::TRANSFORMS.to_owned()));
    wanted.extend(calibration::names(scene, folder.part));
    if asks(scene, folder.part, &products::EVENTS) && !scene.licence.withheld {
        wanted.extend(stream_files(folder.part).into_iter().map(|(name, _)| name));
    }
    wanted.extend(pictures_wanted(folder.tree, scene, folder.part));
    let absent = wanted.iter().filter(|name| !folder.has(name));
    absent.map(|name| folder.fault(FaultCode::SceneIncomplete, name, ABSENT)).collect()
}

/// Reads the findings in a file, if it exists and is intact, with their faults.
fn read_checks(tree: &TrustedTree<'_>, path: &str) -> (Vec<Finding>, Vec<AuditFault>) {
    let mut faults = Vec::new();
    let findings: Vec<Finding> = claims::parse_claims(tree, path, &mut faults).unwrap_or_default();
    let failed = findings.iter().filter(|finding| finding.verdict == Verdict::Fail);
    faults.extend(failed.map(|f| {
        let message = format!("{} failed: {}", f.check, f.because);
        AuditFault::of_file(FaultCode::CheckFailedUnwaived, path, message)
    }));
    (findings, faults)
}

/// Compares the checks of a photographed scene with its description.
fn photo_faults(tree: &TrustedTree<'_>, scene: &SceneRecord) -> Vec<AuditFault> {
    let path = format!("{}/{CHECKS}", scene.id);
    if !tree.has(&path) {
        return match scene.images.first() {
            Some(_) => vec![AuditFault::of_file(FaultCode::SceneIncomplete, &path, ABSENT)],
            None => Vec::new(),
        };
    }
    let (findings, mut faults) = read_checks(tree, &path);
    let mean = |f: &&Finding| f.check == "recon_psnr" && f.subject.statement == "mean";
    let found = findings.iter().find(mean).and_then(|finding| finding.measured);
    let reconstruction = scene.reconstruction.as_ref();
    let stated = reconstruction.and_then(|it| it.psnr.as_ref()).map(|psnr| psnr.mean);
    // Both texts were written from one number, so they must agree to the last bit.
    if found.map(f64::to_bits) != stated.map(f64::to_bits) {
        let [found, stated] = [found, stated].map(|v| v.map_or("none".to_owned(), |v| v.to_string()));
        let message = format!("its mean PSNR is {found}, scene.json says {stated}");
        faults.push(AuditFault::of_file(FaultCode::ClaimsDisagree, &path, message));
    }
    faults
}
