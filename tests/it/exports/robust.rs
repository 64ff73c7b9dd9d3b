//! Robust e-NeRF and Deblur e-NeRF.

use super::TestExport;
use super::arrays::{entry, read_npz};
use super::plane::{self, EPS, POSES, THRESHOLD};
use super::steps::{Path, ReadEvent, residual};
use glam::{DQuat, DVec3};

fn path(exported: &TestExport) -> Path {
    let poses = exported.path("camera_poses.npz");
    let centres = read_npz::<f32>(&poses, "T_wc_position");
    let turns = read_npz::<f32>(&poses, "T_wc_orientation");
    let times = read_npz::<i64>(&poses, "T_wc_timestamp");
    assert_eq!((&centres.shape[..], &turns.shape[..]), (&[POSES as u64, 3][..], &[POSES as u64, 4][..]));
    let centre = |row: &[f32; 3]| DVec3::from_array(row.map(f64::from));
    let turn = |row: &[f32; 4]| DQuat::from_array(row.map(f64::from)).normalize();
    Path {
        times: times.values.iter().map(|t| *t as f64).collect(),
        centres: centres.values.as_chunks().0.iter().map(centre).collect(),
        turns: turns.values.as_chunks().0.iter().map(turn).collect(),
    }
}

fn events(exported: &TestExport) -> Vec<ReadEvent> {
    let file = exported.path("raw_events.npz");
    let places = read_npz::<u16>(&file, "position");
    let times = read_npz::<i64>(&file, "timestamp");
    let signs = read_npz::<bool>(&file, "polarity");
    assert_eq!(places.shape, [times.values.len() as u64, 2]);
    assert!(times.values.is_sorted());
    let places = places.values.as_chunks::<2>().0.iter();
    places
        .zip(times.values.iter().zip(&signs.values))
        .map(|([x, y], (t, on))| ReadEvent { x: *x, y: *y, t: *t as f64, sign: if *on { 1.0 } else { -1.0 } })
        .collect()
}

#[test]
fn steps_along_its_rays_are_thresholds() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "robust-e-nerf", &[]);
    assert_eq!(exported.losses("approximate"), Vec::<String>::new());
    let calibration = exported.path("camera_calibration.npz");
    let k = read_npz::<f32>(&calibration, "intrinsics");
    assert_eq!(k.shape, [3, 3]);
    let [fx, cx, fy, cy] = [0, 2, 4, 5].map(|at| f64::from(k.values[at]));
    let (events, path) = (events(&exported), path(&exported));
    assert_eq!(events.len(), plane.events);
    let last = *path.times.last().unwrap();
    assert!(events.iter().all(|event| (0.0..=last).contains(&event.t)));
    // Its pixel centres are at integers.
    let ray = |x: u16, y: u16| DVec3::new((f64::from(x) - cx) / fx, (f64::from(y) - cy) / fy, 1.0);
    let residual = residual(&events, &path, ray);
    eprintln!("robust-e-nerf: {residual:.6} thresholds");
    assert!(residual < 2e-4, "{residual}");
    for name in ["pos_contrast_threshold", "neg_contrast_threshold"] {
        let found = f64::from(read_npz::<f32>(&calibration, name).values[0]);
        // The factor of equal formulas is 1 up to the step of its differences.
        assert!((found - THRESHOLD).abs() < 1e-6, "{name}: {found}");
    }
    let offset = exported.json("config.json")["model.min_modeled_intensity"].as_f64().unwrap();
    // A logarithm and an exponential of numbers near 0.001: a few roundings.
    assert!((offset - EPS).abs() < 1e-15, "{offset}");
}

/// `numpy.load` knows a text by its type; scalars have no axis.
#[test]
fn texts_and_scalars_have_the_types_of_its_converter() {
    let exported = TestExport::of(plane::centred(), "robust-e-nerf", &[]);
    let kind = |file: &str, name: &str| {
        let bytes = entry(&exported.path(file), name);
        let text = String::from_utf8_lossy(&bytes[10..128]).into_owned();
        (bytes.len() - 128, text)
    };
    let (bytes, header) = kind("renderer_params.npz", "interm_color_space");
    assert!(header.contains("'<U7'") && header.contains("'shape': ()") && bytes == 28, "{header}");
    let (_, header) = kind("camera_calibration.npz", "img_width");
    assert!(header.contains("'<u2'") && header.contains("'shape': ()"), "{header}");
    let (bytes, header) = kind("camera_calibration.npz", "distortion_params");
    assert!(header.contains("'shape': (0,)") && bytes == 0, "{header}");
}

#[test]
fn views_are_held_out_with_opengl_axes() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "robust-e-nerf", &["--test-every", "4"]);
    let [train, test] = ["train", "test"].map(|set| exported.json(&format!("views/transforms_{set}.json")));
    let count = POSES.div_ceil(plane.sharp_every);
    let held_out = count.div_ceil(4);
    assert_eq!(test["frames"].as_array().unwrap().len(), held_out);
    assert_eq!(train["frames"].as_array().unwrap().len(), count - held_out);
    // The second held-out view is the fifth frame. Its third column looks back.
    let matrix: [[f64; 4]; 4] =
        serde_json::from_value(test["frames"][1]["transform_matrix"].clone()).unwrap();
    let wanted = plane::pose(plane::stamp_us(4 * plane.sharp_every) as f64 * 1e-6);
    let [x, y, z] = [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z].map(|axis| wanted.rotation * axis);
    for (row, axis) in matrix[..3].iter().zip(0..) {
        for (found, wanted) in row.iter().zip([x[axis], y[axis], z[axis], wanted.translation[axis]]) {
            // Poses in text have 17 digits; sums of products of numbers up to 2 lose a few bits.
            assert!((found - wanted).abs() < 1e-14, "{found} {wanted}");
        }
    }
}

#[test]
fn deblur_e_nerf_adds_a_circuit_and_says_that_it_is_ideal() {
    let exported = TestExport::of(plane::centred(), "deblur-e-nerf", &["--lossy"]);
    assert_eq!(exported.losses("approximate"), ["sensor.circuit"]);
    let gain = read_npz::<f32>(&exported.path("camera_calibration.npz"), "closed_loop_gain");
    assert_eq!((gain.shape.len(), gain.values[0]), (0, 1.0 / 0.7));
}

#[test]
fn views_of_another_trajectory_are_held_out() {
    let plane = plane::centred();
    let exported = TestExport::of(plane, "robust-e-nerf", &["--test-from", "other"]);
    let count = |set: &str| {
        let listed = exported.json(&format!("views/transforms_{set}.json"));
        let pictures = exported.list(&format!("views/{set}")).len();
        (listed["frames"].as_array().unwrap().len(), pictures)
    };
    let frames = POSES.div_ceil(plane.sharp_every);
    assert_eq!(count("train"), (frames, frames));
    let other = std::fs::read_dir(plane.release().join("plane/other/sharp")).unwrap().count();
    assert_eq!(count("test"), (other, other));
    assert_eq!(exported.json("export.json")["selection"]["test"]["from"], "other");
}
