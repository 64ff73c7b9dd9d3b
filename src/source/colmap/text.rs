//! The text form: one line per record, and two lines per image. The second may be empty.

use super::lenses::CameraModel;
use super::{Image, ModelCamera, Observation, Point, pose};
use crate::image::Size;
use crate::source::{Place, SourceError};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

pub(super) fn cameras(path: &Path) -> Result<BTreeMap<u32, ModelCamera>, SourceError> {
    let text = load(path)?;
    let mut cameras = BTreeMap::new();
    for (number, line) in records(&text) {
        let line = Line { path, number, text: line };
        let mut words = line.text.split_whitespace();
        let id: u32 = line.number(words.next(), "a camera id")?;
        let model = CameraModel::named(words.next().unwrap_or_default()).map_err(|e| line.fault(e))?;
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

pub(super) fn images(path: &Path) -> Result<Vec<Image>, SourceError> {
    let text = load(path)?;
    let mut images = Vec::new();
    let mut lines = (1..).zip(text.lines());
    while let Some((number, head)) = lines.find(|(_, line)| is_record(line)) {
        let mut image = image(&Line { path, number, text: head })?;
        if let Some((number, text)) = lines.next() {
            image.observations = observations(&Line { path, number, text })?;
        }
        images.push(image);
    }
    Ok(images)
}

fn image(line: &Line<'_>) -> Result<Image, SourceError> {
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
    let (rotation, translation) = pose(numbers).map_err(|e| line.fault(format!("`{name}`: {e}")))?;
    Ok(Image {
        name,
        camera_id,
        rotation,
        translation,
        observations: Vec::new(),
        place: Place::Line(line.number),
    })
}

fn observations(line: &Line<'_>) -> Result<Vec<Observation>, SourceError> {
    let words: Vec<&str> = line.text.split_whitespace().collect();
    let (triples, []) = words.as_chunks() else {
        return Err(
            line.fault(format!("{} numbers, wanted x, y and point id for each key point", words.len()))
        );
    };
    let read = |[x, y, id]: &[&str; 3]| {
        let xy = [line.number(Some(x), "x")?, line.number(Some(y), "y")?];
        let point = if *id == "-1" { None } else { Some(line.number(Some(id), "a point id")?) };
        Ok(Observation { xy, point })
    };
    triples.iter().map(read).collect()
}

pub(super) fn points(path: &Path) -> Result<BTreeMap<u64, Point>, SourceError> {
    let text = load(path)?;
    let mut points = BTreeMap::new();
    for (number, line) in records(&text) {
        let line = Line { path, number, text: line };
        let mut words = line.text.split_whitespace();
        let id = line.number(words.next(), "a point id")?;
        let mut coordinate = || line.number(words.next(), "x, y, z");
        let xyz = DVec3::new(coordinate()?, coordinate()?, coordinate()?);
        let mut colour = || line.number(words.next(), "red, green, blue from 0 to 255");
        let rgb = [colour()?, colour()?, colour()?];
        let error = line.number(words.next(), "an error after red, green and blue")?;
        points.insert(id, Point { xyz, rgb, error });
    }
    Ok(points)
}

/// Counts the records of a file.
pub(super) fn count(path: &Path, lines_a_record: usize) -> Result<u64, SourceError> {
    let text = load(path)?;
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

fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(text.lines()).filter(|(_, line)| is_record(line))
}

fn load(path: &Path) -> Result<String, SourceError> {
    std::fs::read_to_string(path).map_err(SourceError::io(path))
}

/// A line and its number, from 1.
struct Line<'a> {
    path: &'a Path,
    number: usize,
    text: &'a str,
}

impl Line<'_> {
    fn fault(&self, because: String) -> SourceError {
        SourceError::Content { path: self.path.to_owned(), place: Place::Line(self.number), because }
    }

    fn number<T: FromStr>(&self, word: Option<&str>, wanted: &str) -> Result<T, SourceError> {
        let word = word.unwrap_or_default();
        word.parse().map_err(|_| self.fault(format!("`{word}`, wanted {wanted}")))
    }
}
