//! The segmentation by moving objects as a picture: a colour for each object.

use super::previews::{PictureRequest, Preview};
use gs2e_build::artifact::OBJECT_PLACES;
use gs2e_image::{Image, png};
use gs2e_scene::motion::read_places;
use std::collections::BTreeMap;
use std::io::Cursor;

/// Colours of the objects by their numbers, which repeat, with their names.
const COLOURS: [([u8; 3], &str); 6] = [
    ([214, 69, 65], "red"),
    ([63, 127, 191], "blue"),
    ([230, 170, 50], "yellow"),
    ([76, 153, 93], "green"),
    ([140, 90, 170], "violet"),
    ([70, 180, 180], "cyan"),
];
/// Colour of what is still.
const STILL: [u8; 3] = [40; 3];

/// The mask nearest to the middle of the trajectory.
pub(crate) fn segmentation_picture(of: PictureRequest<'_>) -> Option<Preview> {
    let (number, path) = of.nearest_file()?;
    let size = of.checked_size()?;
    let mask = png::read_sized(Cursor::new(of.read(path)?), size).ok()?;
    let objects = of.read(&format!("{}/{OBJECT_PLACES}", path.rsplit_once('/')?.0))?;
    let names: BTreeMap<u8, String> =
        read_places(&objects).ok()?.into_iter().map(|line| (line.number, line.name)).collect();
    let colour = |[number, ..]: &[u8; 3]| {
        let index = number.checked_sub(1).map(usize::from);
        index.map_or(STILL, |index| COLOURS[index % COLOURS.len()].0)
    };
    let image = Image::from_vec(size, mask.pixels().iter().map(colour).collect());
    let shown = names.iter().zip(COLOURS).map(|((_, name), (_, colour))| format!("{name} {colour}"));
    let words = format!("objects at {}: {}", of.moment_words(number), shown.collect::<Vec<_>>().join(", "));
    of.show_pixels(&image, words)
}
