//! Intrinsics of a camera from the files that datasets have: nerfstudio's `transforms.json`, COLMAP's
//! `cameras.txt`, or a text with `fx fy cx cy`, as one line or as `name: value` lines.
//!
//! Pixel centres lie at half-integers, as in [`gs2e_scene::camera`]. The geometric passes model no lens: a
//! camera with distortion is refused.

use gs2e_image::Size;
use gs2e_scene::camera::Camera;
use serde_json::Value;

/// Names of the four numbers, with those of `transforms.json`.
const NAMES: [[&str; 2]; 4] = [["fx", "fl_x"], ["fy", "fl_y"], ["cx", "cx"], ["cy", "cy"]];
/// Names of the coefficients of a lens.
const LENS: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];
const WANTED: &str = "wanted a transforms.json, a cameras.txt of COLMAP, or `fx fy cx cy`";
const DISTORTED: &str =
    "the lens has distortion, which the checks do not model: undistort frames, depth and events first";

/// Reads the camera of pictures of `size`.
///
/// # Errors
/// The text has none of the forms, the lens has distortion, or the pictures have another size. The
/// text is the reason.
pub fn parse_camera(text: &str, size: Size) -> Result<Camera, String> {
    let camera = if text.trim_start().starts_with('{') { of_transforms(text)? } else { of_text(text)? };
    let CameraNumbers { intrinsics: [fx, fy, cx, cy], stated } = camera;
    if let Some(stated) = stated.filter(|stated| *stated != size) {
        return Err(format!("it is the camera of pictures of {stated}, and the frames are {size}"));
    }
    if ![fx, fy, cx, cy].iter().all(|v| v.is_finite()) || fx <= 0.0 || fy <= 0.0 {
        return Err(format!("the intrinsics are {fx} {fy} {cx} {cy}, wanted focal lengths above 0"));
    }
    Ok(Camera { size, fx, fy, cx, cy, lens: None })
}

/// Intrinsics in the order of [`NAMES`], and the size of the pictures if the file states it.
struct CameraNumbers {
    intrinsics: [f64; 4],
    stated: Option<Size>,
}

fn of_transforms(text: &str) -> Result<CameraNumbers, String> {
    let json: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
    // Intrinsics are at the top, or in each frame.
    let first = &json["frames"][0];
    let number = |key: &str| json[key].as_f64().or_else(|| first[key].as_f64());
    if LENS.iter().any(|key| number(key).is_some_and(|v| v != 0.0)) {
        return Err(DISTORTED.to_owned());
    }
    let named = |[_, key]: [&str; 2]| number(key).ok_or_else(|| format!("`{key}` is missing"));
    let [fx, fy, cx, cy] = NAMES.map(named);
    // One focal length stands for both.
    let (fx, fy) = (fx?, number("fl_y").or_else(|| number("fl_x")).map_or(fy, Ok)?);
    // Such a file has the centre of the first pixel at 0, and cameras here have it at a half.
    let shift = if number("pixel_center") == Some(0.0) { 0.5 } else { 0.0 };
    Ok(CameraNumbers {
        intrinsics: [fx, fy, cx? + shift, cy? + shift],
        stated: stated_size(number("w"), number("h")),
    })
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a side of a picture; more saturates"
)]
fn stated_size(width: Option<f64>, height: Option<f64>) -> Option<Size> {
    let (width, height) = (width? as u32, height? as u32);
    Some(Size { width, height })
}

fn of_text(text: &str) -> Result<CameraNumbers, String> {
    let lines: Vec<&str> = text
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with(['#', '%']))
        .collect();
    if let Some(model) = lines.iter().find_map(|line| of_colmap(line)) {
        return model;
    }
    if let Some(numbers) = lines.iter().find_map(|line| numbers_of(line)) {
        return of_line(&numbers);
    }
    let named = |name: &str| {
        lines.iter().find_map(|line| {
            let (key, value) = line.split_once([':', '=', ' '])?;
            let value = value.trim_matches([' ', '\t', ':', '=']);
            (key.trim() == name).then(|| value.parse::<f64>().ok())?
        })
    };
    if LENS.iter().any(|key| named(key).is_some_and(|v| v != 0.0)) {
        return Err(DISTORTED.to_owned());
    }
    let [fx, fy, cx, cy] = NAMES.map(|[own, other]| named(own).or_else(|| named(other)));
    match (fx, fy.or(fx), cx, cy) {
        (Some(fx), Some(fy), Some(cx), Some(cy)) => Ok(CameraNumbers {
            intrinsics: [fx, fy, cx, cy],
            stated: stated_size(
                named("width").or_else(|| named("w")),
                named("height").or_else(|| named("h")),
            ),
        }),
        _ => Err(WANTED.to_owned()),
    }
}

/// The numbers of a line that has nothing else, and at least four.
fn numbers_of(line: &str) -> Option<Vec<f64>> {
    let words = line.split([' ', '\t', ',']).filter(|word| !word.is_empty());
    let numbers: Vec<f64> = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
    (numbers.len() >= 4).then_some(numbers)
}

/// `fx fy cx cy`, and the coefficients of a lens, which must be 0.
fn of_line(numbers: &[f64]) -> Result<CameraNumbers, String> {
    let &[fx, fy, cx, cy, ref lens @ ..] = numbers else { return Err(WANTED.to_owned()) };
    if lens.iter().any(|v| *v != 0.0) {
        return Err(DISTORTED.to_owned());
    }
    Ok(CameraNumbers { intrinsics: [fx, fy, cx, cy], stated: None })
}

/// `ID MODEL WIDTH HEIGHT PARAMETERS` of COLMAP; `None` for a line of another form.
fn of_colmap(line: &str) -> Option<Result<CameraNumbers, String>> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [_, model, width, height, parameters @ ..] = words.as_slice() else { return None };
    let (width, height) = (width.parse().ok()?, height.parse().ok()?);
    let numbers: Vec<f64> = parameters.iter().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let (focal, lens) = match *model {
        "PINHOLE" | "OPENCV" | "FULL_OPENCV" => (2, 4),
        "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" => (1, 3),
        _ if model.parse::<f64>().is_ok() => return None,
        _ => return Some(Err(format!("the camera model {model} is not supported"))),
    };
    let (Some(own), Some(lens)) = (numbers.get(..lens), numbers.get(lens..)) else {
        return Some(Err(format!("{} parameters are too few for the camera model {model}", numbers.len())));
    };
    if lens.iter().any(|v| *v != 0.0) {
        return Some(Err(DISTORTED.to_owned()));
    }
    let intrinsics = [own[0], own[focal - 1], own[focal], own[focal + 1]];
    Some(Ok(CameraNumbers { intrinsics, stated: Some(Size { width, height }) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 240, height: 180 };

    #[test]
    fn each_form_gives_the_same_camera() {
        let wanted = Camera { size: SIZE, fx: 200.5, fy: 201.0, cx: 120.0, cy: 90.5, lens: None };
        for text in [
            "200.5 201 120 90.5\n",
            "# fx fy cx cy k1 k2 p1 p2 k3\n200.5, 201, 120, 90.5, 0, 0, 0, 0, 0",
            "fx: 200.5\nfy: 201\ncx: 120\ncy: 90.5\nwidth: 240\nheight: 180\n",
            "fx 200.5\nfy 201\ncx 120\ncy 90.5\n",
            "# Camera list\n1 PINHOLE 240 180 200.5 201 120 90.5\n",
            "3 OPENCV 240 180 200.5 201 120 90.5 0 0 0 0\n",
            r#"{"fl_x": 200.5, "fl_y": 201, "cx": 120, "cy": 90.5, "w": 240, "h": 180, "k1": 0.0}"#,
            r#"{"frames": [{"fl_x": 200.5, "fl_y": 201, "cx": 120, "cy": 90.5}]}"#,
            r#"{"fl_x": 200.5, "fl_y": 201, "cx": 119.5, "cy": 90, "pixel_center": 0}"#,
        ] {
            assert_eq!(parse_camera(text, SIZE), Ok(wanted), "{text}");
        }
        let one = Ok(Camera { fy: 200.5, ..wanted });
        assert_eq!(parse_camera("1 SIMPLE_PINHOLE 240 180 200.5 120 90.5", SIZE), one);
    }

    #[test]
    fn other_texts_are_refused_with_a_reason() {
        for (text, wanted) in [
            ("200 200 120 90 0.1", "distortion"),
            ("1 SIMPLE_RADIAL 240 180 200 120 90 0.01", "distortion"),
            ("1 PINHOLE 640 480 200 200 120 90", "640x480"),
            ("1 FOV 240 180 200 200 120 90 0.9", "FOV"),
            ("0 200 120 90", "above 0"),
            ("a camera", "wanted a transforms.json"),
            ("{}", "fl_x"),
            ("{", "EOF"),
            ("", "wanted a transforms.json"),
        ] {
            let because = parse_camera(text, SIZE).unwrap_err();
            assert!(because.contains(wanted), "{text}: {because}");
        }
    }
}
