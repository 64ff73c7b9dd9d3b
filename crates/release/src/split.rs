//! Splits of scenes. The split of a scene follows from its own description alone, so an audit can
//! compute it again. Common material of two splits is found as well.

use super::checksum;
use super::scene::{SceneRecord, SplitPart};
use gs2e_recipe::{SplitPlan, SplitUnit};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// Deals a scene into a split by a rule.
pub fn split_part(scene: &SceneRecord, splits: &SplitPlan) -> SplitPart {
    let group = split_key(scene, splits.by);
    SplitPart { name: splits.of(&group).to_owned(), group }
}

/// The key that keeps scenes together: the recipe's group if the unit is an object; else the
/// upstream's id of the capture; else the photos of the source, used or not; else the Gaussians;
/// else the scene's own id.
fn split_key(scene: &SceneRecord, by: SplitUnit) -> String {
    let group = scene.recipe.get("group").and_then(serde_json::Value::as_str);
    if let (SplitUnit::Object, Some(group)) = (by, group) {
        return format!("group/{group}");
    }
    // With the kind, because two datasets may use the same id.
    if let Some(id) = &scene.source.upstream_id {
        return format!("{}/{id}", scene.source.kind);
    }
    // Sorted, so that the order and the names of the photos do not matter.
    let photos: BTreeSet<&str> = split_photos(scene).collect();
    if !photos.is_empty() {
        let photos: Vec<&str> = photos.into_iter().collect();
        return format!("photos/{}", checksum::sha256_hex(photos.join("\n").as_bytes()));
    }
    match scene_digest(scene) {
        Some(sha256) => format!("gaussians/{sha256}"),
        None => format!("scene/{}", scene.id),
    }
}

fn split_photos(scene: &SceneRecord) -> impl Iterator<Item = &str> {
    scene.images.iter().filter_map(|image| image.sha256.as_deref())
}

fn scene_digest(scene: &SceneRecord) -> Option<&str> {
    scene.reconstruction.as_ref().map(|made| made.scene_sha256.as_str())
}

/// Material that two splits have in common.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SplitLeak {
    /// The scenes, with their splits: the first scene of each split that has the material.
    pub scenes: [(String, String); 2],
    /// Kind and value of the material.
    pub what: String,
}

impl fmt::Display for SplitLeak {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [(a, of_a), (b, of_b)] = &self.scenes;
        write!(f, "{} is in {a} ({of_a}) and in {b} ({of_b})", self.what)
    }
}

/// Finds material that scenes of two splits have in common: a group, a photo by its SHA-256, or the
/// Gaussians. Two scenes give at most one leak of each kind.
pub fn find_leaks(scenes: &[SceneRecord]) -> Vec<SplitLeak> {
    // The first scene of each split that has the material.
    let mut holders: BTreeMap<(&str, &str), BTreeMap<&str, &str>> = BTreeMap::new();
    for (scene, part) in scenes.iter().filter_map(|scene| Some((scene, scene.split.as_ref()?))) {
        let group = [("the group", part.group.as_str())];
        let gaussians = scene_digest(scene).map(|sha256| ("the Gaussians", sha256));
        let photos = split_photos(scene).map(|sha256| ("the photo with SHA-256", sha256));
        for thing in group.into_iter().chain(gaussians).chain(photos) {
            holders.entry(thing).or_default().entry(&part.name).or_insert(&scene.id);
        }
    }
    let mut reported = BTreeSet::new();
    let mut leaks = Vec::new();
    for ((kind, value), of) in holders {
        let mut of = of.into_iter();
        let Some((first_split, first)) = of.next() else { continue };
        // Two scenes of one capture share hundreds of photos; the first one is enough.
        for (split, scene) in
            of.filter(|(_, scene)| reported.insert((kind, first, *scene))).collect::<Vec<_>>()
        {
            let scenes =
                [(first, first_split), (scene, split)].map(|(id, of)| (id.to_owned(), of.to_owned()));
            leaks.push(SplitLeak { scenes, what: format!("{kind} {value}") });
        }
    }
    leaks
}
