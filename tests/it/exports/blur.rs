//! Blurred pictures of the plane: the mean in linear light of three sharp frames.

use super::plane::{POSES, Plane, stamp_us};
use gs2e_image::{Image, png, srgb};
use serde_json::{Value, json};
use std::fs;
use std::io::BufReader;

/// Number of poses of an exposure.
const EXPOSED: usize = 15;

/// The poses in the middle of the exposures, which have a sharp frame, and the times of the shutter.
pub(super) fn exposures(plane: &Plane) -> Vec<(usize, [i64; 2])> {
    let step = EXPOSED.next_multiple_of(plane.sharp_every);
    let halfway = |pose: usize| i64::midpoint(stamp_us(pose), stamp_us(pose + 1));
    let half = EXPOSED / 2;
    let open = |pose: usize| [halfway(pose - half - 1), halfway(pose + half)];
    (step..POSES - EXPOSED).step_by(step).map(|pose| (pose, open(pose))).collect()
}

/// Writes the pictures, and `transforms.json` with their exposures.
pub(super) fn write(plane: &Plane) {
    fs::create_dir(plane.folder("blur")).unwrap();
    let mut frames: Vec<Value> = Vec::new();
    for (pose, [start, end]) in exposures(plane) {
        let near = [pose - plane.sharp_every, pose, pose + plane.sharp_every];
        let sharp = near.map(|pose| {
            let file = fs::File::open(plane.folder(&format!("sharp/{pose:06}.png"))).unwrap();
            png::read_rgb(BufReader::new(file)).unwrap()
        });
        let pixel = |at: usize| {
            let light = |image: &Image<[u8; 3]>| srgb::decode(f64::from(image.pixels()[at][0]) / 255.0);
            [(srgb::encode(sharp.iter().map(light).sum::<f64>() / 3.0) * 255.0).round() as u8; 3]
        };
        let size = sharp[0].size();
        let name = format!("blur/{pose:06}.png");
        let file = fs::File::create(plane.folder(&name)).unwrap();
        png::write_image(&Image::from_vec(size, (0..size.pixels()).map(pixel).collect()), file).unwrap();
        frames.push(json!({
            "t_us": stamp_us(pose), "blur_file_path": name, "exposure_start_us": start, "exposure_end_us": end,
        }));
    }
    fs::write(plane.folder("transforms.json"), json!({ "frames": frames }).to_string()).unwrap();
}
