//! Depth images of a dataset: grey PNGs of 16 bits with a stated scale, or `.npy` and `.npz` with
//! metres.

use gs2e_files as files;
use gs2e_image::{Image, Size, npy, png};
use std::io::{BufReader, Read as _};
use std::path::Path;
use zip::ZipArchive;

/// Extensions of depth images.
pub const EXTENSIONS: [&str; 3] = ["png", "npy", "npz"];

/// Reads depth along the optical axis. `per_unit` is the number of steps of a PNG per unit of length,
/// such as 1,000 for millimetres and poses in metres. Numbers that are 0, negative or not finite mark
/// pixels without depth, and become NaN.
///
/// # Errors
/// The file cannot be read, has another form or size, or is a PNG without a stated scale. The text is
/// the reason.
pub(crate) fn read_depth(path: &Path, size: Size, per_unit: Option<f64>) -> Result<Image<f32>, String> {
    let extension = path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase());
    let mut image = match extension.as_str() {
        "png" => of_png(path, size, per_unit)?,
        "npz" => of_archive(path, size)?,
        _ => {
            let file = files::open_at_most(path, files::MAX_PICTURE).map_err(|e| e.to_string())?;
            let values = npy::read_floats(&shape(size), &mut BufReader::new(file));
            Image::from_vec(size, values.map_err(|e| e.to_string())?)
        }
    };
    for depth in image.pixels_mut() {
        if !(*depth > 0.0 && depth.is_finite()) {
            *depth = f32::NAN;
        }
    }
    Ok(image)
}

fn shape(size: Size) -> [u64; 2] {
    [size.height.into(), size.width.into()]
}

fn of_png(path: &Path, size: Size, per_unit: Option<f64>) -> Result<Image<f32>, String> {
    let per_unit =
        per_unit.ok_or("a PNG states no unit: --depth-scale gives its steps per unit of length")?;
    let file = files::open_at_most(path, files::MAX_PICTURE).map_err(|e| e.to_string())?;
    let steps = png::read_wide(BufReader::new(file), Some(size)).map_err(|e| e.to_string())?;
    #[expect(clippy::cast_possible_truncation, reason = "depth has 32 bits")]
    let depth = |step: &u16| (f64::from(*step) / per_unit) as f32;
    Ok(Image::from_vec(size, steps.pixels().iter().map(depth).collect()))
}

/// The array `depth` of an archive, or its only array.
fn of_archive(path: &Path, size: Size) -> Result<Image<f32>, String> {
    let file = files::open_at_most(path, files::MAX_PICTURE).map_err(|e| e.to_string())?;
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| e.to_string())?;
    let index = match archive.index_for_name("depth.npy") {
        Some(index) => index,
        None if archive.len() == 1 => 0,
        None => return Err(format!("{} arrays and none is `depth`", archive.len())),
    };
    let entry = archive.by_index(index).map_err(|e| e.to_string())?;
    // The reader takes as many numbers as the size asks for, whatever the archive expands to.
    let mut limited = entry.take(files::MAX_PICTURE);
    let values = npy::read_floats(&shape(size), &mut limited).map_err(|e| e.to_string())?;
    Ok(Image::from_vec(size, values))
}
