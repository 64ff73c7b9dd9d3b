//! Detection of scenes that would write into each other's folders.

use super::fault::{RecipeFault, displayed_path};
use super::load::ReadRecipe;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Returns one fault for each recipe whose folder is also claimed by another recipe. Ids are
/// compared without case, as some file systems do.
pub(super) fn find_clashes(read: &[ReadRecipe]) -> Vec<RecipeFault> {
    let mut scenes: BTreeMap<String, Vec<&ReadRecipe>> = BTreeMap::new();
    let mut faults = Vec::new();
    for scene in read {
        let same = scenes.entry(scene.recipe.scene.to_lowercase()).or_default();
        if let Some(other) = same.first() {
            let equal = other.recipe.scene == scene.recipe.scene;
            let how = if equal { "" } else { ", ignoring case" };
            faults.push(scene.fault(other, &format!("is also the id of another recipe{how}")));
        }
        // Kept although it clashes, because the next check needs every scene.
        same.push(scene);
    }
    // A second loop, because a scene may lie in a trajectory of any other scene.
    for scene in read {
        if let Some((other, name)) = containing_trajectory(scene, &scenes) {
            let whose = &other.recipe.scene;
            faults.push(
                scene.fault(other, &format!("lies in the trajectory \"{name}\" of the scene \"{whose}\"")),
            );
        }
    }
    faults
}

/// Returns the trajectory of another scene that contains the folder of `scene`.
fn containing_trajectory<'a>(
    scene: &ReadRecipe,
    scenes: &BTreeMap<String, Vec<&'a ReadRecipe>>,
) -> Option<(&'a ReadRecipe, &'a str)> {
    let id = scene.recipe.scene.to_lowercase();
    // Only where the path breaks: the scene `lab2` does not lie in the scene `lab`.
    id.match_indices('/').find_map(|(at, _)| {
        let next = id[at + 1..].split('/').next()?;
        scenes.get(&id[..at])?.iter().find_map(|other| {
            let trajectory = other.recipe.trajectories.iter().find(|t| t.name.to_lowercase() == next)?;
            Some((*other, trajectory.name.as_str()))
        })
    })
}

impl ReadRecipe {
    fn fault(&self, other: &Self, message: &str) -> RecipeFault {
        let text = &other.texts[other.scene.file as usize];
        let (line, column) = text.position(other.scene.start as usize);
        let help = format!(
            "the other one is at {}:{line}:{column}; change one of the ids",
            displayed_path(&text.path)
        );
        let message = format!("the scene id \"{}\" {message}", self.recipe.scene);
        RecipeFault::new(
            message,
            Some(help),
            Arc::clone(&self.texts[self.scene.file as usize]),
            Some(self.scene),
        )
    }
}
