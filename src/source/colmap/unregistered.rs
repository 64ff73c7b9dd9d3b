//! The photos of a folder that a model has no pose for.

use super::Image;
use std::collections::BTreeSet;
use std::path::Path;
use walkdir::WalkDir;

/// Endings of the names of photos.
const ENDINGS: [&str; 7] = ["jpg", "jpeg", "png", "webp", "tif", "tiff", "bmp"];

/// What tools leave beside the photos of MVImgNet, and are none.
const LEFTOVERS: &str = "_bg_removed.png";

/// Their names below `folder`, `/` between folders, sorted.
pub(super) fn unregistered(folder: &Path, images: &[Image]) -> Vec<String> {
    let registered: BTreeSet<&str> = images.iter().map(|image| image.name.as_str()).collect();
    let is_photo = |name: &str| {
        let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
        ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)) && !name.ends_with(LEFTOVERS)
    };
    let entries = WalkDir::new(folder).into_iter().filter_map(Result::ok);
    let files = entries.filter(|entry| entry.path().is_file());
    let name = |entry: walkdir::DirEntry| {
        let parts = entry.path().strip_prefix(folder).ok()?.iter().map(|part| part.to_str());
        Some(parts.collect::<Option<Vec<_>>>()?.join("/"))
    };
    let mut names: Vec<String> = files.filter_map(name).collect();
    names.retain(|name| is_photo(name) && !registered.contains(name.as_str()));
    names.sort();
    names
}
