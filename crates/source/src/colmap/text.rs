//! The text form: one line per record, and two lines per image. The second may be empty.

use super::lenses::CameraModel;
use super::{ColmapImage, ColmapPoint, KeyPoint, ModelCamera, image_pose};
use crate::{SourceError, SourcePlace};
use glam::DVec3;
use gs2e_files as files;
use gs2e_files::budget::ByteBudget;
use gs2e_image::Size;
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

pub(super) fn read_cameras(path: &Path) -> Result<BTreeMap<u32, ModelCamera>, SourceError> {
    let text = load_text(path)?;
    let mut cameras = BTreeMap::new();
    for (number, line) in record_lines(&text) {
        let line = TextLine { path, number, text: line };
        let mut words = line.text.split_whitespace();
        let id: u32 = line.number(words.next(), "a camera id")?;
        let model = CameraModel::from_name(words.next().unwrap_or_default()).map_err(|e| line.fault(e))?;
        let size = Size {
            width: line.number(words.next(), "a width")?,
            height: line.number(words.next(), "a height")?,
        };
        let parameters =
            words.map(|w| line.number(Some(w), "a parameter")).collect::<Result<Vec<f64>, _>>()?;
        if parameters.len() != model.parameters {
            let (found, wanted) = (parameters.len(), model.parameters);
            return Err(line.fault(format!("{found} parameters of a {} camera, wanted {wanted}", model.name)));
        }
        let camera = model.camera(size, &parameters).map_err(|e| line.fault(e))?;
        if cameras.insert(id, camera).is_some() {
            return Err(line.fault(format!("camera {id} was already listed")));
        }
    }
    Ok(cameras)
}

pub(super) fn read_images(path: &Path) -> Result<Vec<ColmapImage>, SourceError> {
    let text = load_text(path)?;
    let mut images = Vec::new();
    let mut budget = ByteBudget::of(text.len());
    let mut lines = (1..).zip(text.lines());
    while let Some((number, head)) = lines.find(|(_, line)| is_record(line)) {
        let mut image = read_image(&TextLine { path, number, text: head })?;
        // The second line belongs to the image even if it is empty.
        if let Some((number, text)) = lines.next() {
            image.observations = read_observations(&TextLine { path, number, text }, &mut budget)?;
        }
        images.push(image);
    }
    Ok(images)
}

fn read_image(line: &TextLine<'_>) -> Result<ColmapImage, SourceError> {
    // A name may contain spaces. It is the rest of the line after the ninth number.
    let mut rest = line.text.trim_start();
    let mut word = || {
        let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
        rest = after.trim_start();
        Some(word)
    };
    let _: u32 = line.number(word(), "an image id")?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = line.number(word(), "a pose of seven numbers")?;
    }
    let camera_id = line.number(word(), "a camera id")?;
    let name = rest.trim_end().to_owned();
    if name.is_empty() {
        return Err(line.fault("an image without a name".to_owned()));
    }
    let (rotation, translation) = image_pose(numbers).map_err(|e| line.fault(format!("`{name}`: {e}")))?;
    Ok(ColmapImage {
        name,
        camera_id,
        rotation,
        translation,
        observations: Vec::new(),
        place: SourcePlace::Line(line.number),
    })
}

fn read_observations(line: &TextLine<'_>, budget: &mut ByteBudget) -> Result<Vec<KeyPoint>, SourceError> {
    // Counted first, because the memory must be granted before it is allocated.
    let count = line.text.split_whitespace().count();
    if !count.is_multiple_of(3) {
        return Err(line.fault(format!("{count} numbers, wanted x, y and point id for each key point")));
    }
    let taken = budget.take(count / 3, size_of::<KeyPoint>());
    taken.map_err(|e| line.fault(format!("key points that take {e}")))?;
    let mut observations = Vec::with_capacity(count / 3);
    let mut words = line.text.split_whitespace();
    while let Some(x) = words.next() {
        let xy = [line.number(Some(x), "x")?, line.number(words.next(), "y")?];
        let id = words.next();
        // COLMAP writes -1 for a key point without a triangulated point.
        let point = if id == Some("-1") { None } else { Some(line.number(id, "a point id")?) };
        observations.push(KeyPoint { xy, point });
    }
    Ok(observations)
}

pub(super) fn read_points(path: &Path) -> Result<BTreeMap<u64, ColmapPoint>, SourceError> {
    let text = load_text(path)?;
    let mut points = BTreeMap::new();
    for (number, line) in record_lines(&text) {
        let line = TextLine { path, number, text: line };
        let mut words = line.text.split_whitespace();
        let id = line.number(words.next(), "a point id")?;
        let mut coordinate = || line.number(words.next(), "x, y, z");
        let xyz = DVec3::new(coordinate()?, coordinate()?, coordinate()?);
        let mut colour = || line.number(words.next(), "red, green, blue from 0 to 255");
        let rgb = [colour()?, colour()?, colour()?];
        let error = line.number(words.next(), "an error after red, green and blue")?;
        points.insert(id, ColmapPoint { xyz, rgb, error });
    }
    Ok(points)
}

/// Counts the records of a file.
pub(super) fn count_records(path: &Path, lines_a_record: usize) -> Result<u64, SourceError> {
    let text = load_text(path)?;
    let mut lines = text.lines();
    let mut count = 0;
    while lines.any(is_record) {
        count += 1;
        // Skips the other lines of the record.
        lines.by_ref().take(lines_a_record - 1).for_each(drop);
    }
    Ok(count)
}

fn is_record(line: &str) -> bool {
    !line.trim().is_empty() && !line.starts_with('#')
}

fn record_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(text.lines()).filter(|(_, line)| is_record(line))
}

fn load_text(path: &Path) -> Result<String, SourceError> {
    files::read_text(path, files::MAX_MODEL).map_err(SourceError::io_error(path))
}

/// A line and its number, from 1.
struct TextLine<'a> {
    path: &'a Path,
    number: usize,
    text: &'a str,
}

impl TextLine<'_> {
    fn fault(&self, because: String) -> SourceError {
        SourceError::Content { path: self.path.to_owned(), place: SourcePlace::Line(self.number), because }
    }

    fn number<T: FromStr>(&self, word: Option<&str>, wanted: &str) -> Result<T, SourceError> {
        let word = word.unwrap_or_default();
        word.parse().map_err(|_| self.fault(format!("`{word}`, wanted {wanted}")))
    }
}
