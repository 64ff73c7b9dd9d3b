//! Rolling shutter: a vertical line under a pan leans by the closed form, and the setting is part of keys,
//! files and messages.

use crate::support::steps::{recipe, steps};
use crate::support::workspace::Workspace;
use glam::{DQuat, DVec3};
use gs2e_image::{Image, Size, png};
use gs2e_num::se3::Se3;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_sampling::exposure::{DenseView, ExposureCourse};
use gs2e_sampling::rolling::{MISS_PX, RowRoller};
use gs2e_scene::Gaussians;
use gs2e_scene::blobs::{ColourBlob, blob_scene};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use serde_json::{Value, json};
use std::sync::Arc;

/// A white line along y at a depth of 5, far longer than the image is high, 0.02 wide.
fn line() -> Gaussians {
    let deviations = [0.02, 3.0, 0.02];
    blob_scene(&[ColourBlob {
        position: [0.0, 0.0, 5.0],
        deviations,
        opacity: 0.99,
        ..ColourBlob::default()
    }])
}

/// A pan about y at 1 rad/s. A point ahead at the start is at an angle of `-t` in the camera after the time
/// `t`, where
/// 0.5 s is the time of the pose that is looked at.
fn pan(seconds: f64) -> Se3 {
    Se3 { rotation: DQuat::from_rotation_y(seconds - 0.5), translation: DVec3::ZERO }
}

#[test]
fn a_vertical_line_under_a_pan_leans_by_the_closed_form() {
    let size = Size { width: 160, height: 120 };
    let camera = Camera { size, fx: 150.0, fy: 150.0, cx: 80.0, cy: 60.0, lens: None };
    let seconds: Vec<f64> = (0..=100).map(|j| f64::from(j) / 100.0).collect();
    let poses: Vec<Se3> = seconds.iter().map(|t| pan(*t)).collect();
    let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
    let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
    let mut renderer = CpuRenderer::new(Arc::new(line()), style).unwrap();
    let mut images = RenderedImages::default();
    let view = CameraView::at_rest(camera, poses[50]);
    let work = renderer.render(&view, RowRoller::WANT, &mut images).unwrap();
    let mut roller = RowRoller::new(ExposureCourse { camera, poses, seconds }, 40_000).unwrap();
    let view = DenseView { pose: 50, images: &images, work, renderer: &mut renderer };
    let picture: Image<[f32; 3]> = roller.roll(view, &|| true).unwrap();
    // A pan of 150 px/s over 40 ms is 6 px: 60 bands of two rows.
    assert_eq!(roller.most_bands, 60);
    let (mut most, mut ends) = (0.0f64, [0.0; 2]);
    for (row, pixels) in picture.pixels().chunks(size.width as usize).enumerate() {
        let sums = pixels.iter().enumerate().fold([0.0; 2], |[moment, sum], (x, [light, ..])| {
            let light = f64::from(*light);
            [moment + light * (x as f64 + 0.5), sum + light]
        });
        let found = sums[0] / sums[1];
        let time = 0.04 * (row as f64 / 119.0 - 0.5);
        let wanted = 80.0 + 150.0 * libm::tan(-time);
        most = most.max((found - wanted).abs());
        ends[usize::from(row > 0)] = found;
    }
    // The bands, and 0.01 px for the tails that are cut where a layer's opacity falls below 1/255.
    assert!(most <= MISS_PX + 0.01, "{most}");
    let lean = ends[0] - ends[1];
    assert!((lean - 2.0 * 150.0 * libm::tan(0.02)).abs() < 2.0 * MISS_PX + 0.02, "{lean}");
}

fn rolling(readout_us: Value) -> Value {
    let mut value = recipe("tiny");
    value["outputs"] = json!(["events", "sharp", "blur", "depth"]);
    value["blur"] = json!({ "frames": 3 });
    value["sharp"] = json!({ "every": 2 });
    if !readout_us.is_null() {
        value["sharp"]["readout_us"] = readout_us;
    }
    value
}

pub(crate) fn picture(place: &Workspace, name: &str) -> Vec<[u8; 3]> {
    let bytes = std::fs::read(place.path(name)).unwrap();
    png::read_sized(std::io::Cursor::new(bytes), Size { width: 48, height: 32 }).unwrap().into_pixels()
}

#[test]
fn a_release_has_rolling_frames_and_the_same_of_everything_else() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", rolling(Value::Null).to_string());
    place.ok("release --to global");
    place.write("recipes/tiny.yaml", rolling(json!(3000)).to_string());
    let stale: Vec<String> = steps(&place, "recipes")
        .into_iter()
        .filter(|(_, step)| step.action != "keep")
        .map(|(name, _)| name)
        .collect();
    // The check for flashes reads the frames.
    assert_eq!(stale, ["tiny/base/checks", "tiny/base/sharp"]);
    let why = place.ok("why tiny/base/sharp").stdout;
    assert!(why.contains("readout_us"), "{why}");
    let said = place.ok("release --to rolled").stderr;
    assert!(said.contains("before the first pose or after the last"), "{said}");
    place.ok("audit rolled");
    place.ok("check --tree rolled");
    for name in ["events.h5", "blur/000002.png", "depth/000000.npy", "poses.txt"] {
        let bytes = |tree: &str| std::fs::read(place.path(&format!("{tree}/tiny/base/{name}"))).unwrap();
        assert!(bytes("global") == bytes("rolled"), "{name}");
    }
    let frame = |tree: &str| picture(&place, &format!("{tree}/tiny/base/sharp/000006.png"));
    let (global, rolled) = (frame("global"), frame("rolled"));
    let off = |row: usize| -> u32 {
        let row = row * 48..(row + 1) * 48;
        let pairs = global[row.clone()].as_flattened().iter().zip(rolled[row].as_flattened());
        pairs.map(|(a, b)| u32::from(a.abs_diff(*b))).sum()
    };
    let [edges, middle] = [[3, 28], [15, 16]].map(|rows| rows.map(off).iter().sum::<u32>());
    assert!(edges > middle, "the middle is that of the pose: {edges} {middle}");
    let transforms = std::fs::read_to_string(place.path("rolled/tiny/base/transforms.json")).unwrap();
    let transforms: Value = serde_json::from_str(&transforms).unwrap();
    assert_eq!(transforms["readout_us"], 3000);
    let card = std::fs::read_to_string(place.path("rolled/README.md")).unwrap();
    assert!(card.contains("| tiny | 3000 |"), "{card}");
    let report = std::fs::read_to_string(place.path("rolled/report.html")).unwrap();
    assert!(report.contains("rolling shutter of sharp frames: 3000 us"));
    let refused = place.gs2e("export rolled --to mcap --out recording");
    assert!(refused.code != 0 && refused.stderr.contains("shutter"), "{}", refused.stderr);
    place.ok("export rolled --to mcap --out recording --lossy");
}

#[test]
fn readouts_out_of_range_are_refused_by_name() {
    let place = Workspace::new();
    for (readout, because) in [(json!(0), "wanted a whole number from 1"), (json!(2_000_000), "to 1000000")] {
        place.write("tiny.yaml", rolling(readout).to_string());
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        assert!(ended.stderr.contains(because), "{because}: {}", ended.stderr);
    }
}
