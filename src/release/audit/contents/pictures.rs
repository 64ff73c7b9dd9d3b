//! Sharp and blurred frames, depth and flow: those that the recipe asks for are named; every one decodes, to the size of the
//! camera, and holds what its kind can hold.

use super::{Code, Fault, Folder};
use crate::image::{npy, png};
use crate::sampling::exposure;
use rayon::prelude::*;
use serde_json::Value;
use std::fs::File;
use std::io::BufReader;

/// Folder, and what the names in it end with.
const KINDS: [(&str, &str); 4] = [("sharp", ".png"), ("blur", ".png"), ("depth", ".npy"), ("flow", ".npy")];

/// Names of the pictures that a trajectory of so many poses has by its recipe.
pub(super) fn wanted(poses: usize, recipe: &Value, asked: &dyn Fn(&str) -> bool) -> Vec<String> {
    let number = |place: &str, default: u32| {
        let number = recipe.pointer(place).and_then(Value::as_u64);
        number.map_or(default, |n| u32::try_from(n).unwrap_or(u32::MAX)).max(1)
    };
    let exposed = asked("blur").then(|| number("/blur/frames", exposure::FRAMES));
    let numbers = |kind: &str| match kind {
        "blur" => exposed.map_or(Vec::new(), |frames| exposure::centres(poses, frames)),
        _ => {
            let beside = exposed.filter(|_| kind == "sharp");
            exposure::kept(poses, number(&format!("/{kind}/every"), 1), beside)
        }
    };
    let asked = KINDS.into_iter().filter(|(kind, _)| asked(kind));
    asked
        .flat_map(|(kind, end)| numbers(kind).into_iter().map(move |j| format!("{kind}/{j:06}{end}")))
        .collect()
}

pub(super) fn audit(folder: &Folder<'_>) -> Vec<Fault> {
    let mut found = Vec::new();
    for (kind, end) in KINDS {
        let prefix = folder.path_of(&format!("{kind}/"));
        let paths = folder.tree.intact.keys().filter(|path| path.starts_with(&prefix) && path.ends_with(end));
        found.extend(paths.map(|path| (kind, &path[folder.path.len() + 1..])));
    }
    found.into_par_iter().filter_map(|(kind, name)| picture(folder, kind, name)).collect()
}

fn picture(folder: &Folder<'_>, kind: &str, name: &str) -> Option<Fault> {
    let wanted = folder.camera.size;
    let file = File::open(folder.on_disk(name)).map_err(|e| e.to_string());
    let message = file.and_then(|file| match kind {
        "depth" | "flow" => numbers(kind, folder, BufReader::new(file)),
        _ => png::read_sized(BufReader::new(file), wanted).map(|_| ()).map_err(|e| e.to_string()),
    });
    Some(folder.fault(Code::Unreadable, name, message.err()?))
}

/// Depth lies in front of the camera, and flow is finite, where there is any.
fn numbers(kind: &str, folder: &Folder<'_>, mut file: BufReader<File>) -> Result<(), String> {
    let size = folder.camera.size;
    let mut shape = vec![u64::from(size.height), u64::from(size.width)];
    if kind == "flow" {
        shape.push(2);
    }
    let values = npy::read_values(&shape, &mut file).map_err(|e| e.to_string())?;
    let sound = |v: &f32| v.is_nan() || v.is_finite() && (kind == "flow" || *v > 0.0);
    match values.iter().find(|v| !sound(v)) {
        Some(v) => Err(format!("it holds {v}, which is no {kind}")),
        None => Ok(()),
    }
}
