//! The files of a release, and the step's output that each of them is. A file of any other name has
//! no place in the tree.

use super::products::{self, FOLDERS};
use super::{checksum, croissant, datasheet, index, loader, manifest, report, reuse, signature};
use gs2e_build::artifact::EventStream;
use gs2e_check as check;
use gs2e_store::record::StoredOutput;
use gs2e_tree::event_file;
use std::collections::BTreeMap;

/// Name of the card.
pub(super) const CARD: &str = "README.md";
/// The folder of licence texts.
const LICENCES: &str = "LICENSES/";

/// Description of a scene, in its folder.
pub const SCENE: &str = "scene.json";
/// Findings, in a scene's folder and in a trajectory's.
pub const CHECKS: &str = "checks.json";
/// Photos, renderings and differences of held-out views, in a scene's folder; an output of the step
/// `fidelity`.
pub(super) const HELD_OUT: &str = gs2e_build::artifact::HELD_OUT_PICTURE;
/// The step that makes it.
const COMPARING: &str = "fidelity";
/// The folder of exports, in a trajectory's folder: one folder per format.
pub(super) const EXPORTS: &str = "exports/";
/// Poses and camera in nerfstudio's form.
pub const TRANSFORMS: &str = "transforms.json";

/// Files that the step of a path makes.
pub const MOTION: [&str; 4] = ["poses.txt", "speed.json", "timestamps_us.txt", "trajectory.svg"];

/// Files at the top of every release, but for the texts of licences.
const TOP: [&str; 10] = [
    CARD,
    datasheet::NAME,
    reuse::NAME,
    loader::NAME,
    croissant::NAME,
    index::NAME,
    report::NAME,
    manifest::NAME,
    checksum::NAME,
    checksum::B3_NAME,
];

/// The path of a licence's text.
pub fn licence_text(id: &str) -> String {
    format!("{LICENCES}{id}.txt")
}

/// The id of the licence whose text has this path.
pub fn licence_id(path: &str) -> Option<&str> {
    path.strip_prefix(LICENCES)?.strip_suffix(".txt").filter(|id| !id.contains('/'))
}

/// Returns true if a release may have a file of this path outside its scenes.
pub fn is_top(path: &str) -> bool {
    TOP.contains(&path) || licence_id(path).is_some() || path == signature::NAME
}

/// The files that every release has at its top, but for the texts of licences.
pub fn top() -> impl Iterator<Item = &'static str> {
    TOP.into_iter()
}

/// The files in a trajectory's folder that steps made, by name, with the outputs that they are.
/// `outputs` gives the outputs of a step of the trajectory; `streams` are the names of its event
/// streams.
pub fn made<'o>(
    outputs: impl Fn(&str) -> &'o [StoredOutput],
    streams: &[Option<&str>],
) -> BTreeMap<String, &'o StoredOutput> {
    let mut files = BTreeMap::new();
    // The store keeps other outputs of these steps to itself.
    files.extend(
        outputs("trajectory")
            .iter()
            .filter(|o| MOTION.contains(&o.name.as_str()))
            .map(|o| (o.name.clone(), o)),
    );
    for name in streams {
        let stored =
            outputs(products::EVENTS.name()).iter().filter(|o| o.name == EventStream::stored_name(*name));
        files.extend(stored.map(|o| (event_file(*name), o)));
    }
    for product in FOLDERS {
        let own = outputs(product.name()).iter().filter(|o| product.form.holds(&o.name));
        files.extend(own.map(|o| (format!("{}/{}", product.name(), o.name), o)));
    }
    let seen = outputs("checks").iter().filter(|o| is_picture_of_check(&o.name, streams));
    files.extend(seen.map(|o| (format!("checks/{}", o.name), o)));
    files
}

/// The files in a scene's own folder that steps made, by name. `outputs` gives the outputs of a step
/// of the scene.
pub fn made_of_scene<'o>(
    outputs: impl Fn(&str) -> &'o [StoredOutput],
) -> Option<(&'static str, &'o StoredOutput)> {
    outputs(COMPARING).iter().find(|output| output.name == HELD_OUT).map(|output| (HELD_OUT, output))
}

/// Returns true if a file of the scene `id` belongs to an export.
pub fn is_export(id: &str, path: &str) -> bool {
    // After the scene comes the trajectory, and after that of a body, the camera.
    let below = |path: &'_ str| path.split_once('/').map(|(_, path)| path.to_owned());
    let within = path.strip_prefix(id).and_then(|path| path.strip_prefix('/'));
    let Some(path) = within.and_then(below) else { return false };
    path.starts_with(EXPORTS) || below(&path).is_some_and(|path| path.starts_with(EXPORTS))
}

/// Returns true if a file is `<check>.png`, or `<sensor>.<check>.png` of one of several streams.
fn is_picture_of_check(name: &str, streams: &[Option<&str>]) -> bool {
    let Some(stem) = name.strip_suffix(".png") else { return false };
    // Names of sensors can have dots, so the check is not simply the part after the last dot.
    let of = |sensor: &Option<&str>| match sensor {
        None => Some(stem),
        Some(sensor) => stem.strip_prefix(sensor)?.strip_prefix('.'),
    };
    streams.iter().filter_map(of).any(|check| check::NAMES.contains(&check))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_release_has_files_of_known_names_alone() {
        for path in ["gs2e.py", "README.md", "SHA256SUMS", "LICENSES/MIT.txt"] {
            assert!(is_top(path), "{path}");
        }
        for path in
            ["numpy.py", "setup.py", ".git/config", "LICENSES/a/MIT.txt", "LICENSES/MIT.py", "readme.md"]
        {
            assert!(!is_top(path), "{path}");
        }
        let [one, two] = [&[None][..], &[Some("fine"), Some("a.b")]];
        for (name, streams, wanted) in [
            ("motion.png", one, true),
            ("fine.motion.png", one, false),
            ("fine.motion.png", two, true),
            ("a.b.motion.png", two, true),
            ("motion.png", two, false),
            ("virus.png", one, false),
            ("motion.py", one, false),
        ] {
            assert_eq!(is_picture_of_check(name, streams), wanted, "{name} {streams:?}");
        }
    }
}
