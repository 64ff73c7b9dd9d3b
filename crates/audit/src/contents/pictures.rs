//! Sharp and blurred frames, depth, flow, segmentations and inertial data. Those that the recipe asks for are
//! named. Every picture decodes to the size of the camera and holds values that its kind can have.

use super::{AuditFault, FaultCode, TrajectoryFolder};
use gs2e_build::artifact::OBJECT_PLACES;
use gs2e_image::{Image, Size, npy, png};
use gs2e_release::products::{BLUR, FOLDERS, ProductForm, ReleaseProduct};
use gs2e_sampling::exposure;
use gs2e_scene::motion;
use gs2e_trajectory::imu;
use rayon::prelude::*;
use serde_json::Value;
use std::io::Cursor;

/// Returns the names of the pictures that a trajectory of `poses` poses has by its recipe.
pub(super) fn wanted_names(
    poses: usize,
    recipe: &Value,
    asked: &dyn Fn(&ReleaseProduct) -> bool,
) -> Vec<String> {
    let number = |place: &str, default: u32| {
        let number = recipe.pointer(place).and_then(Value::as_u64);
        // The recipe is plain JSON here, and a step of 0 would panic.
        number.map_or(default, |n| u32::try_from(n).unwrap_or(u32::MAX)).max(1)
    };
    let exposed = asked(&BLUR).then(|| number(&format!("/{}/frames", BLUR.name()), exposure::FRAMES));
    let every = |product: &ReleaseProduct| number(&format!("/{}/every", product.name()), 1);
    let asked = FOLDERS.into_iter().filter(|product| asked(product));
    asked.flat_map(|product| product.file_names(poses, every(product), exposed)).collect()
}

pub(super) fn audit_pictures(folder: &TrajectoryFolder<'_>) -> Vec<AuditFault> {
    let products = FOLDERS.map(|product| (product.name(), product.form.extensions(), Some(product)));
    let mut found = Vec::new();
    for (kind, ends, product) in products.into_iter().chain([("checks", &[".png"][..], None)]) {
        let prefix = folder.path_of(&format!("{kind}/"));
        let has_end = |path: &str| ends.iter().any(|end| path.ends_with(end));
        let open = |path: &&str| has_end(path) && !folder.tree.composed.contains(*path);
        let paths = folder.tree.below(&prefix).filter(open);
        let below = folder.path_of("").len();
        found.extend(paths.map(|path| (product, path[below..].to_owned())));
    }
    found.into_par_iter().filter_map(|(product, name)| picture_fault(folder, product, &name)).collect()
}

/// Returns the fault of a picture, if it has one. Pictures of checks are of no product.
fn picture_fault(
    folder: &TrajectoryFolder<'_>,
    product: Option<&ReleaseProduct>,
    name: &str,
) -> Option<AuditFault> {
    // The audit composes inertial data of this version.
    if folder.is_current && product.is_some_and(|product| product.form == ProductForm::Samples) {
        return None;
    }
    let bytes = match folder.files.read(name) {
        Ok(bytes) => bytes,
        Err(e) => return Some(folder.fault(FaultCode::Unreadable, name, e.because)),
    };
    let size = folder.files.camera.size;
    let same = |rewritten: Result<Vec<u8>, String>| rewritten.map(|rewritten| rewritten == bytes);
    let is_same = match product.map(|product| (product.name(), product.form)) {
        Some((kind, ProductForm::Numbers { channels, positive, .. })) => {
            same(check_numbers(kind, size, channels, positive, &bytes))
        }
        Some((_, ProductForm::Greys { .. })) if name.ends_with(OBJECT_PLACES) => motion::is_canonical(&bytes),
        Some((_, ProductForm::Greys { .. })) => same(check_greys(size, &bytes)),
        // The text on the sensor has the form of the version that wrote it.
        Some((_, ProductForm::Samples)) if name.ends_with(imu::files::SENSOR) => Ok(true),
        Some((_, ProductForm::Samples)) => imu::files::is_canonical(&bytes),
        Some(_) => {
            let image = png::read_sized(Cursor::new(&bytes), size);
            same(image.map(|image| written(&image)).map_err(|e| e.to_string()))
        }
        // Only pictures of checks may have another size than the camera.
        None => {
            let image = png::read_rgb(Cursor::new(&bytes));
            same(image.map(|image| written(&image)).map_err(|e| e.to_string()))
        }
    };
    match is_same {
        // A decoder skips what it does not need, so the picture is written again: with equal bytes
        // the file holds nothing else.
        Ok(true) => None,
        Ok(false) => Some(folder.fault(
            FaultCode::NotComposed,
            name,
            "it holds more than its picture, or another encoding: this program writes different bytes for the same picture",
        )),
        Err(message) => Some(folder.fault(FaultCode::Unreadable, name, message)),
    }
}

/// Decodes a picture of 8-bit grey and returns its file as this program writes it.
fn check_greys(size: Size, bytes: &[u8]) -> Result<Vec<u8>, String> {
    let image = png::read_sized(Cursor::new(bytes), size).map_err(|e| e.to_string())?;
    let greys = Image::from_vec(size, image.pixels().iter().map(|[grey, ..]| *grey).collect());
    let mut rewritten = Vec::new();
    png::write_image(&greys, &mut rewritten).expect("a Vec takes any bytes");
    Ok(rewritten)
}

/// The PNG file of an image.
fn written(image: &Image<[u8; 3]>) -> Vec<u8> {
    let mut bytes = Vec::new();
    png::write_image(image, &mut bytes).expect("a Vec takes any bytes");
    bytes
}

/// Decodes an array and returns its file as this program writes it. Values must be finite, and those
/// of some products positive. NaN marks a pixel without a value.
fn check_numbers(
    kind: &str,
    size: Size,
    channels: u64,
    positive: bool,
    mut bytes: &[u8],
) -> Result<Vec<u8>, String> {
    let mut shape = vec![u64::from(size.height), u64::from(size.width)];
    if channels > 1 {
        shape.push(channels);
    }
    let values = npy::read_values(&shape, &mut bytes).map_err(|e| e.to_string())?;
    let sound = |v: &f32| v.is_nan() || v.is_finite() && (!positive || *v > 0.0);
    if let Some(v) = values.iter().find(|v| !sound(v)) {
        return Err(format!("it holds {v}, which is not a valid {kind}"));
    }
    let mut rewritten = Vec::new();
    npy::write_values(&shape, &values, &mut rewritten).expect("a Vec takes any bytes");
    Ok(rewritten)
}
