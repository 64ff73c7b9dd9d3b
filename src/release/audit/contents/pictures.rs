//! Sharp frames: every one decodes, to the size of the camera.

use super::{Code, Fault, Folder};
use crate::image::png;
use rayon::prelude::*;
use std::fs::File;
use std::io::BufReader;

pub(super) fn audit(folder: &Folder<'_>) -> Vec<Fault> {
    let prefix = folder.path_of("sharp/");
    let names: Vec<&str> = folder
        .tree
        .intact
        .keys()
        .filter(|path| path.starts_with(&prefix) && path.ends_with(".png"))
        .map(|path| &path[folder.path.len() + 1..])
        .collect();
    names.into_par_iter().filter_map(|name| picture(folder, name)).collect()
}

fn picture(folder: &Folder<'_>, name: &str) -> Option<Fault> {
    let wanted = folder.camera.size;
    let file = File::open(folder.on_disk(name));
    let message = match file.map(|file| png::read(BufReader::new(file))) {
        Ok(Ok(image)) if image.size() == wanted => return None,
        Ok(Ok(image)) => format!("it is {}, the camera is {wanted}", image.size()),
        Ok(Err(e)) => e.to_string(),
        Err(e) => e.to_string(),
    };
    Some(folder.fault(Code::Unreadable, name, message))
}
