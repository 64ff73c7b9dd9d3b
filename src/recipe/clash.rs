//! Scenes that would write into each other's folders.

use super::fault::{Fault, shown};
use super::load::Read;
use std::sync::Arc;

/// One fault for each recipe whose folder another one claims too. `read` is sorted by scene id.
pub(super) fn clashes(read: &[Read]) -> Vec<Fault> {
    let mut faults = Vec::new();
    for (i, scene) in read.iter().enumerate() {
        if let Some(other) = read[..i].iter().find(|other| other.id() == scene.id()) {
            let how = if other.recipe.scene == scene.recipe.scene {
                ""
            } else {
                ", in capitals and small letters alike"
            };
            faults.push(scene.fault(other, &format!("is the id of another recipe too{how}")));
        }
        if let Some((other, name)) = read.iter().find_map(|other| Some((other, inside(scene, other)?))) {
            let whose = &other.recipe.scene;
            faults.push(
                scene.fault(other, &format!("lies in the trajectory \"{name}\" of the scene \"{whose}\"")),
            );
        }
    }
    faults
}

/// The trajectory of `other` whose folder `scene` lies in.
fn inside<'a>(scene: &Read, other: &'a Read) -> Option<&'a str> {
    let below = scene.id().strip_prefix(&format!("{}/", other.id()))?.to_owned();
    let first = below.split('/').next().unwrap_or(&below);
    other.recipe.trajectories.iter().map(|t| t.name.as_str()).find(|name| name.to_lowercase() == first)
}

impl Read {
    /// The id as file systems that ignore case see it.
    fn id(&self) -> String {
        self.recipe.scene.to_lowercase()
    }

    fn fault(&self, other: &Self, message: &str) -> Fault {
        let text = &other.texts[other.scene.file as usize];
        let (line, column) = text.position(other.scene.start as usize);
        let help =
            format!("the other one is at {}:{line}:{column}; give one of them another id", shown(&text.path));
        let message = format!("the scene id \"{}\" {message}", self.recipe.scene);
        Fault::new(message, Some(help), Arc::clone(&self.texts[self.scene.file as usize]), Some(self.scene))
    }
}
