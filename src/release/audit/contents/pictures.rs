//! Sharp and blurred frames, depth and flow. Those that the recipe asks for are named. Every
//! picture decodes to the size of the camera and holds values that its kind can have.

use super::{AuditFault, FaultCode, TrajectoryFolder};
use crate::files::{self, LinkRule};
use crate::image::{Image, Size, npy, png};
use crate::release::layout::PICTURES;
use crate::sampling::exposure;
use rayon::prelude::*;
use serde_json::Value;
use std::io::Cursor;

/// Returns the names of the pictures that a trajectory of `poses` poses has by its recipe.
pub(super) fn wanted_names(poses: usize, recipe: &Value, asked: &dyn Fn(&str) -> bool) -> Vec<String> {
    let number = |place: &str, default: u32| {
        let number = recipe.pointer(place).and_then(Value::as_u64);
        // The recipe is plain JSON here, and a step of 0 would panic.
        number.map_or(default, |n| u32::try_from(n).unwrap_or(u32::MAX)).max(1)
    };
    let exposed = asked("blur").then(|| number("/blur/frames", exposure::FRAMES));
    let numbers = |kind: &str| match kind {
        "blur" => exposed.map_or(Vec::new(), |frames| exposure::exposure_centres(poses, frames)),
        _ => {
            // The pose in the middle of each exposure keeps its sharp frame, whatever `every` says.
            let beside = exposed.filter(|_| kind == "sharp");
            exposure::kept_poses(poses, number(&format!("/{kind}/every"), 1), beside)
        }
    };
    let asked = PICTURES.into_iter().filter(|(kind, _)| asked(kind));
    asked
        .flat_map(|(kind, end)| numbers(kind).into_iter().map(move |j| format!("{kind}/{j:06}{end}")))
        .collect()
}

pub(super) fn audit_pictures(folder: &TrajectoryFolder<'_>) -> Vec<AuditFault> {
    let mut found = Vec::new();
    for (kind, end) in PICTURES.into_iter().chain([("checks", ".png")]) {
        let prefix = folder.path_of(&format!("{kind}/"));
        let paths = folder.tree.below(&prefix).filter(|path| path.ends_with(end));
        found.extend(paths.map(|path| (kind, path[folder.path.len() + 1..].to_owned())));
    }
    found.into_par_iter().filter_map(|(kind, name)| picture_fault(folder, kind, &name)).collect()
}

fn picture_fault(folder: &TrajectoryFolder<'_>, kind: &str, name: &str) -> Option<AuditFault> {
    let bytes = match files::read_with(&folder.on_disk(name), LinkRule::Refuse, files::MAX_DOCUMENT) {
        Ok(bytes) => bytes,
        Err(e) => return Some(folder.fault(FaultCode::Unreadable, name, e.to_string())),
    };
    let size = folder.camera.size;
    let again = match kind {
        "depth" | "flow" => check_numbers(kind, size, &bytes),
        // Only pictures of checks may have another size than the camera.
        "checks" => {
            png::read_rgb(Cursor::new(&bytes)).map(|image| written(&image)).map_err(|e| e.to_string())
        }
        _ => {
            png::read_sized(Cursor::new(&bytes), size).map(|image| written(&image)).map_err(|e| e.to_string())
        }
    };
    match again {
        // A decoder skips what it does not need, so the picture is written again: with equal bytes
        // the file holds nothing else.
        Ok(again) if again == bytes => None,
        Ok(_) => Some(folder.fault(
            FaultCode::NotComposed,
            name,
            "it holds more than its picture, or another encoding: this program writes different bytes for the same picture",
        )),
        Err(message) => Some(folder.fault(FaultCode::Unreadable, name, message)),
    }
}

/// The PNG file of an image.
fn written(image: &Image<[u8; 3]>) -> Vec<u8> {
    let mut bytes = Vec::new();
    png::write_image(image, &mut bytes).expect("a Vec takes any bytes");
    bytes
}

/// Decodes an array and returns its file as this program writes it. Depth must be positive and flow
/// finite. NaN marks a pixel without a value.
fn check_numbers(kind: &str, size: Size, mut bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut shape = vec![u64::from(size.height), u64::from(size.width)];
    if kind == "flow" {
        shape.push(2);
    }
    let values = npy::read_values(&shape, &mut bytes).map_err(|e| e.to_string())?;
    let sound = |v: &f32| v.is_nan() || v.is_finite() && (kind == "flow" || *v > 0.0);
    if let Some(v) = values.iter().find(|v| !sound(v)) {
        return Err(format!("it holds {v}, which is not a valid {kind}"));
    }
    let mut again = Vec::new();
    npy::write_values(&shape, &values, &mut again).expect("a Vec takes any bytes");
    Ok(again)
}
