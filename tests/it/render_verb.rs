//! `gs2e render`: one view of the user's own scene, through the binary.

mod goldens;
mod gpu;
mod mistakes;

use crate::support::workspace::Workspace;
use gs2e_image::{png, to_byte};
use gs2e_scene::blobs::{ColourBlob, blob_scene};
use gs2e_scene::{Gaussians, ply, splat};
use serde_json::{Value, json};
use std::fs;
use std::io::Cursor;

const WIDTH: usize = 101;
const HEIGHT: usize = 81;
const FOCAL: f64 = 100.0;
const DEPTH: f64 = 4.0;
const COLOUR: [f64; 3] = [1.6, 0.3, 0.0];
const BACKGROUND: [f64; 3] = [0.2, 0.4, 0.75];
/// The background in 32 bits.
const BEHIND: [f32; 3] = [0.2, 0.4, 0.75];
/// Opacity of the planted Gaussian.
const OPACITY: f64 = 0.8;
/// Variance of the planted Gaussian on the image: a deviation of 0.4 at depth 4 is 10 px, and both
/// variances are dilated by 0.3.
const VARIANCE: f64 = 100.3;

/// World to camera, as in [`camera`]: `(z + 1, y + 2, 3 - x)`.
const ROTATION: [[i32; 3]; 3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]];
const TRANSLATION: [i32; 3] = [1, 2, 3];
/// The point that [`ROTATION`] and [`TRANSLATION`] put on the optical axis at [`DEPTH`].
const POSITION: [f32; 3] = [-1.0, -2.0, -1.0];

/// A round Gaussian that the camera sees in the middle of the picture.
fn planted() -> ColourBlob {
    ColourBlob {
        position: POSITION,
        deviations: [0.4; 3],
        opacity: OPACITY,
        colour: COLOUR,
        ..ColourBlob::default()
    }
}

fn camera() -> Value {
    json!({ "W": WIDTH, "H": HEIGHT, "fx": FOCAL, "fy": FOCAL, "cx": 50.5, "cy": 40.5,
        "R": ROTATION, "t": TRANSLATION })
}

/// The view of [`camera`] and an empty one, as a `transforms.json`: camera to world, y up and z
/// back.
fn transforms() -> Value {
    // The inverse of `R` and `t`, with the second and third column negated: centre `(3, -2, -1)`.
    let seeing = json!([[0, 0, 1, 3], [0, -1, 0, -2], [1, 0, 0, -1], [0, 0, 0, 1]]);
    let away = json!([[1, 0, 0, 0], [0, -1, 0, 900], [0, 0, -1, 0], [0, 0, 0, 1]]);
    json!({ "w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": 50.5, "cy": 40.5, "frames": [
        { "file_path": "view 10.jpg", "transform_matrix": seeing },
        { "file_path": "view 9.jpg", "transform_matrix": away },
    ] })
}

/// A `.ply` as other programs write it: without the note on earlier screening, which the reader
/// would trust.
fn ply_bytes(scene: &Gaussians) -> Vec<u8> {
    const NOTE: &[u8] = b"gs2e screening";
    let mut bytes = Vec::new();
    ply::write_ply(scene, &mut bytes).unwrap();
    let note = bytes.windows(NOTE.len()).position(|part| part == NOTE).unwrap();
    bytes[note..note + 4].copy_from_slice(b"note");
    bytes
}

/// The planted scene and its views.
fn workspace() -> Workspace {
    let place = Workspace::new();
    place.write("one.ply", ply_bytes(&blob_scene(&[planted()])));
    place.write("camera.json", camera().to_string());
    place.write("capture/transforms.json", transforms().to_string());
    place
}

const RIGHT: &str = "render --scene one.ply --view camera.json --background 0.2,0.4,0.75 --out new.npy";

/// An array of a `.npy`, and its shape.
fn npy(bytes: &[u8]) -> (Vec<u64>, Vec<f32>) {
    let file = npyz::NpyFile::new(bytes).unwrap();
    assert_eq!((file.order(), file.dtype().descr().as_str()), (npyz::Order::C, "'<f4'"));
    (file.shape().to_vec(), file.into_vec().unwrap())
}

/// The array in `new.npy` after a run of the verb with additional arguments.
fn array(place: &Workspace, args: &str) -> (Vec<u64>, Vec<f32>) {
    place.ok(&format!("{RIGHT} {args}"));
    npy(&fs::read(place.path("new.npy")).unwrap())
}

/// Offset from the middle of the picture to the middle of a pixel.
fn from_middle(i: usize) -> [f64; 2] {
    [(i % WIDTH) as f64 - 50.0, (i / WIDTH) as f64 - 40.0]
}

/// Opacity at a pixel, with profile and cut.
fn alpha(i: usize) -> f64 {
    let [dx, dy] = from_middle(i);
    let alpha = OPACITY * (-(dx * dx + dy * dy) / (2.0 * VARIANCE)).exp();
    if alpha < 1.0 / 255.0 { 0.0 } else { alpha }
}

fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.299 * r + 0.587 * g + 0.114 * b
}

fn mixed(alpha: f64) -> [f64; 3] {
    [0, 1, 2].map(|c| alpha * COLOUR[c] + (1.0 - alpha) * BACKGROUND[c])
}

/// The camera's velocity in the tests of rates. A point moves by `-v - w x X` in the camera.
const VELOCITY: &str = "--velocity 0.6,-0.3,0,0.2,0.7,-0.5";
const LINEAR: [f64; 3] = [0.6, -0.3, 0.0];
const ANGULAR: [f64; 3] = [0.2, 0.7, -0.5];

/// Rate of a point in camera axes.
fn rate_of([x, y, z]: [f64; 3]) -> [f64; 3] {
    let [wx, wy, wz] = ANGULAR;
    let turned = [wy * z - wz * y, wz * x - wx * z, wx * y - wy * x];
    [0, 1, 2].map(|k| -LINEAR[k] - turned[k])
}

/// Rate of luminance: a round Gaussian on the axis that moves across it keeps its shape to first
/// order.
fn luminance_rate(i: usize) -> f64 {
    let [dx, dy] = from_middle(i);
    let [vx, vy, _] = rate_of([0.0, 0.0, DEPTH]).map(|v| v * FOCAL / DEPTH);
    alpha(i) * (dx * vx + dy * vy) / VARIANCE * (luminance(COLOUR) - luminance(BACKGROUND))
}

/// Image velocity of a pixel's point, by a central difference over 2e-4 s of the point's straight
/// motion.
fn flow(i: usize) -> [f64; 2] {
    let [dx, dy] = from_middle(i);
    let point = [dx * DEPTH / FOCAL, dy * DEPTH / FOCAL, DEPTH];
    let rate = rate_of(point);
    let after = |s: f64| {
        let [x, y, z] = [0, 1, 2].map(|k| point[k] + s * rate[k]);
        [FOCAL * x / z, FOCAL * y / z]
    };
    let [a, b] = [after(-1e-4), after(1e-4)];
    [(b[0] - a[0]) / 2e-4, (b[1] - a[1]) / 2e-4]
}

/// Compares both back ends with closed forms, in every channel and at every pixel.
#[test]
fn the_planted_gaussian_has_its_closed_form_in_every_channel() {
    let place = workspace();
    // Opacity carries a few roundings of 6e-8 on an exponent of at most 5.3; a colour of up to 1.6
    // carries equally many. Depth adds two of 2e-7. A rate is up to 4 1/s times the same. Flow is
    // up to 200 px/s, including the depth's rounding, and the difference's own error is 1e-8 of the
    // rate's cube.
    let t = |channel: &str, last: Option<u64>, limit: f64, wanted: &dyn Fn(usize) -> Vec<f64>| {
        for backend in ["cpu", "reference"] {
            let velocity = if ["flow", "luminance-rate"].contains(&channel) { VELOCITY } else { "" };
            let (shape, values) =
                array(&place, &format!("--channel {channel} --backend {backend} {velocity} --rules exact"));
            let expected: Vec<u64> = [HEIGHT as u64, WIDTH as u64].into_iter().chain(last).collect();
            assert_eq!(shape, expected, "{channel}");
            let wanted: Vec<f64> = (0..WIDTH * HEIGHT).flat_map(wanted).collect();
            assert_eq!(values.len(), wanted.len());
            for (i, (found, wanted)) in values.iter().zip(&wanted).enumerate() {
                let apart = (f64::from(*found) - wanted).abs();
                let fine = apart <= limit || found.is_nan() && wanted.is_nan();
                assert!(fine, "{channel} by {backend}, value {i}: {found}, wanted {wanted}");
            }
        }
    };
    // No pixel's opacity is within 1e-4 of one half, so that both sides define depth at the same
    // pixels.
    assert!((0..WIDTH * HEIGHT).all(|i| (alpha(i) - 0.5).abs() > 1e-4));
    let seen = |i: usize, value: f64| if alpha(i) < 0.5 { f64::NAN } else { value };
    t("rgb", Some(3), 2e-6, &|i| mixed(alpha(i)).to_vec());
    t("alpha", None, 1e-6, &|i| vec![alpha(i)]);
    t("luminance", None, 2e-6, &|i| vec![luminance(mixed(alpha(i)))]);
    t("depth", None, 2e-6, &|i| vec![seen(i, DEPTH)]);
    t("luminance-rate", None, 2e-5, &|i| vec![luminance_rate(i)]);
    t("flow", Some(2), 1e-4, &|i| flow(i).map(|v| seen(i, v)).to_vec());
}

/// Without further options: colour by the published rules over black, not antialiased.
#[test]
fn absent_options_have_the_usual_values() {
    let place = workspace();
    place.ok("render --scene one.ply --view camera.json --out usual.npy");
    let spelled = "--rules official --channel rgb --background 0,0,0 --backend auto --index 0";
    place.ok(&format!("render --scene one.ply --view camera.json {spelled} --out spelled.npy"));
    let read = |name: &str| fs::read(place.path(name)).unwrap();
    assert!(read("usual.npy") == read("spelled.npy"));
    let (shape, values) = npy(&read("usual.npy"));
    assert_eq!(shape, [HEIGHT as u64, WIDTH as u64, 3]);
    let middle = 3 * (40 * WIDTH + 50);
    for (c, found) in values[middle..middle + 3].iter().enumerate() {
        assert!((f64::from(*found) - OPACITY * COLOUR[c]).abs() < 2e-6, "{found}");
    }
}

/// A compensated opacity is weaker by the square root of the determinants' ratio.
#[test]
fn the_antialiased_rule_is_the_files_or_forced() {
    let place = workspace();
    let small = ColourBlob { deviations: [0.02; 3], ..planted() };
    let variance = 0.25;
    let weak = OPACITY * variance / (variance + 0.3);
    for (says, forced, wanted) in [
        (None, false, OPACITY),
        (None, true, weak),
        (Some(true), false, weak),
        (Some(false), false, OPACITY),
        (Some(false), true, weak),
    ] {
        place.write("one.ply", ply_bytes(&Gaussians { antialiased: says, ..blob_scene(&[small]) }));
        let option = if forced { "--antialiased" } else { "" };
        let (_, values) = array(&place, &format!("--channel alpha {option}"));
        let found = f64::from(values[40 * WIDTH + 50]);
        assert!((found - wanted).abs() < 1e-6, "{says:?} {forced}: {found}, wanted {wanted}");
    }
}

/// A layer of one grey step is cut by the other rules and halved by the soft rules, whose ramp is
/// centred there.
#[test]
fn every_rule_can_be_selected() {
    let place = workspace();
    let faint = 1.0 / 255.0;
    let above = ColourBlob { opacity: faint * 1.001, ..planted() };
    place.write("one.ply", ply_bytes(&blob_scene(&[above])));
    for (rules, wanted) in [("official", faint), ("exact", faint), ("gsplat", faint), ("soft", faint / 2.0)] {
        let (_, values) = array(&place, &format!("--channel alpha --rules {rules}"));
        let found = f64::from(values[40 * WIDTH + 50]);
        // A thousandth more opacity, and a thousandth of 1.5 steps of the ramp.
        assert!((found - wanted).abs() < 3e-3 * faint, "{rules}: {found}, wanted {wanted}");
    }
}

#[test]
fn pictures_of_bytes_are_the_numbers_clipped() {
    let place = workspace();
    for (channel, colour_type) in [("rgb", 2), ("alpha", 0), ("luminance", 0)] {
        let (shape, values) = array(&place, &format!("--channel {channel}"));
        place.ok(&RIGHT.replace("new.npy", &format!("new.PNG --channel {channel}")));
        let file = fs::read(place.path("new.PNG")).unwrap();
        // Byte 25 of the header is the colour type: 2 is colour, 0 grey.
        assert_eq!(file[25], colour_type, "{channel}");
        let image = png::read_rgb(Cursor::new(&file)).unwrap();
        let wanted: Vec<u8> = match shape.len() {
            3 => values.iter().copied().map(to_byte).collect(),
            _ => values.iter().flat_map(|v| [to_byte(*v); 3]).collect(),
        };
        assert!(image.pixels().as_flattened() == wanted, "{channel}");
        // Checks the rule itself, on 1.36, 0.32 and 0.15 in the middle, and on the background.
        if channel == "rgb" {
            let middle = image.pixels()[40 * WIDTH + 50];
            assert_eq!(middle, [255, 82, 38]);
            assert_eq!(image.pixels()[0], [51, 102, 191]);
        }
    }
}

/// A view is the same in every file format; views of a capture are counted in natural order from 0.
#[test]
fn views_are_found_in_files_and_folders() {
    let place = workspace();
    place.write("transforms_train.json", transforms().to_string());
    let wanted = array(&place, "").1;
    for view in ["capture", "capture/transforms.json", "transforms_train.json"] {
        let args = RIGHT.replace("camera.json", view);
        let ended = place.ok(&format!("{args} --index 1"));
        assert!(ended.stderr.contains("\nrgb of view 10.jpg, 101x81: rendered by cpu/"), "{}", ended.stderr);
        let found = npy(&fs::read(place.path("new.npy")).unwrap()).1;
        // Poses pass through a quaternion, with roundings of 1e-15 px, which change 32 bits of a
        // colour by a rounding at most.
        assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{view}");
        // Index 0 is the default. `view 9` comes before `view 10`, and looks elsewhere.
        let ended = place.ok(&args);
        assert!(ended.stderr.contains("warning: no Gaussian is in the picture"), "{}", ended.stderr);
        let found = npy(&fs::read(place.path("new.npy")).unwrap()).1;
        assert!(
            found.as_chunks().0.iter().all(|c: &[f32; 3]| c.map(f32::to_bits) == BEHIND.map(f32::to_bits))
        );
    }
}

#[test]
fn equal_pictures_are_equal_bytes() {
    let place = workspace();
    let file = |args: &str| {
        place.ok(&format!("{RIGHT} {args}"));
        fs::read(place.path("new.npy")).unwrap()
    };
    let first = file("");
    assert!(first == file("-j 1") && first == file("-j 3 --backend cpu --json -q"));
    // Output to stdout is the same file and nothing else.
    let output = place.command(&RIGHT.replace("new.npy", "-")).output().unwrap();
    assert!(output.status.success() && output.stdout == first);
}

#[test]
fn the_drawing_is_reported_to_users() {
    let place = workspace();
    // One behind the camera; one outside the picture; two not finite; one half as deep as it is
    // far.
    let blobs = [
        planted(),
        ColourBlob { position: [9.0, -2.0, -1.0], ..planted() },
        ColourBlob { position: [-1.0, 500.0, -1.0], ..planted() },
        ColourBlob { deviations: [2.0, 2.0, 2.0], ..planted() },
    ];
    let mut spoilt = blob_scene(&[&blobs[..], &[planted(), planted()]].concat());
    spoilt.positions[4][0] = f32::NAN;
    spoilt.rotations[5] = [0.0; 4];
    place.write("one.ply", ply_bytes(&spoilt));
    let message = place.ok(RIGHT).stderr;
    for part in [
        "rgb of camera.json, 101x81: rendered by cpu/",
        " s; read in ",
        "3 of 5 Gaussians drawn, ",
        " splat-tile pairs, ",
        " blended per pixel\n",
        "warning: 1 of 6 Gaussians in the file hold a NaN or an infinity and are left out",
        "warning: 1 of 6 rotations in the file are zero: the identity is used",
        "warning: 1 of 3 Gaussians drawn (33.3 %) extend so far in depth, relative to their distance",
    ] {
        assert!(message.contains(part), "`{part}` is not in\n{message}");
    }
    let quiet = place.ok(&format!("{RIGHT} -q"));
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), ("", ""));
    // A velocity that does not affect the picture is reported, and changes nothing.
    let before = fs::read(place.path("new.npy")).unwrap();
    let message = place.ok(&format!("{RIGHT} {VELOCITY}")).stderr;
    assert!(message.contains("warning: rgb does not depend on --velocity"), "{message}");
    assert!(fs::read(place.path("new.npy")).unwrap() == before);
    let message = place.ok(&format!("{RIGHT} --backend reference")).stderr;
    assert!(message.contains("by reference/") && !message.contains("splat-tile pairs"), "{message}");
}

#[test]
fn an_inexact_view_is_reported() {
    let place = workspace();
    let mut bent = transforms();
    bent["k1"] = json!(0.1);
    bent["frames"][0]["transform_matrix"][1][1] = json!(-1.0001);
    place.write("bent.json", bent.to_string());
    let message = |index: usize| {
        let args = RIGHT.replace("camera.json", "bent.json");
        place.ok(&format!("{args} --index {index}")).stderr
    };
    let projected = "warning: the rotation of `view 10.jpg` is off by";
    assert!(message(1).contains(projected) && !message(0).contains(projected));
    assert!(message(0).contains("warning: the photos are distorted by up to"));
}

#[test]
fn programs_get_one_object() {
    let place = workspace();
    let ended = place.ok(&format!("{RIGHT} --json -q"));
    assert_eq!((ended.stdout.lines().count(), ended.stderr.as_str()), (1, ""));
    let mut found: Value = serde_json::from_str(&ended.stdout).unwrap();
    let seconds = found["seconds"].take();
    assert!(["read", "render"].iter().all(|part| seconds[part].as_f64().unwrap() > 0.0));
    assert!(found["backend"].take().as_str().unwrap().starts_with("cpu/"));
    // 31 px around (50.5, 40.5) reach columns 1 to 5 and rows 0 to 4 of tiles; a corner may be out
    // of reach.
    let pairs = found["work"]["tile_pairs"].take().as_u64().unwrap();
    assert!((21..=25).contains(&pairs), "{pairs}");
    // Every pixel within the disc of opacity 1/255 blends the one layer.
    let blended = (0..WIDTH * HEIGHT).filter(|i| alpha(*i) > 0.0).count();
    let wanted = json!({
        "file": "new.npy", "channel": "rgb", "view": "camera.json", "width": WIDTH, "height": HEIGHT,
        "backend": null, "seconds": null, "warnings": [],
        "style": { "rules": "official", "order": "depth", "antialiased": false, "background": BEHIND },
        "work": { "gaussians": 1, "unseen": 0, "behind": 0, "degenerate": 0, "outside": 0, "zero_harmonics": 0,
            "tile_pairs": null, "hidden": 0, "blended": blended, "stopped": 0, "affine_doubtful": 0,
            "affine_invalid": 0 },
        "screening": { "read": 1, "non_finite": 0, "zero_quaternions": 0 },
    });
    assert_eq!(found, wanted);
}

#[test]
fn the_other_formats_of_scenes_are_read() {
    let place = workspace();
    // .splat: position, scales, RGBA, and the quaternion, in bytes (antimatter15/splat).
    let mut row: Vec<u8> = POSITION.iter().chain(&[0.4_f32; 3]).flat_map(|v| v.to_le_bytes()).collect();
    row.extend([255, 0, 51, 204, 255, 128, 128, 128]);
    assert_eq!(splat::read_splat(&row).unwrap().len(), 1);
    place.write("one.splat", row);
    place.ok(&RIGHT.replace("one.ply", "one.splat"));
    let values = npy(&fs::read(place.path("new.npy")).unwrap()).1;
    let middle = 3 * (40 * WIDTH + 50);
    for (c, wanted) in [1.0, 0.0, 0.2].into_iter().enumerate() {
        let wanted = 0.8 * wanted + 0.2 * BACKGROUND[c];
        assert!((f64::from(values[middle + c]) - wanted).abs() < 2e-6, "{c}: {}", values[middle + c]);
    }
}
