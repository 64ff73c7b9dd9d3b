//! nerfstudio's `transforms.json`.

use super::{shared, size};
use glam::{DQuat, DVec3};
use gs2e_scene::camera::Camera;
use gs2e_source::kind::CaptureKind;
use gs2e_source::{Capture, CapturedView, DiskCapture, LensModel, SourceError, colmap, nerfstudio};
use gs2e_testing::planted::model;
use serde_json::{Value, json};

#[test]
fn transforms_are_read() {
    let Some(file) = shared("scenes/playbot.transforms.json") else { return };
    let (capture, warnings) = nerfstudio::read_capture(&file).unwrap();
    assert_eq!((capture.views.len(), warnings), (30, vec![]));
    assert!(capture.views.iter().all(|v| v.lens == LensModel::Pinhole && v.sha256.is_none()));
    let (camera, warning) = Capture::camera(&capture).unwrap();
    assert_eq!((camera.fx, camera.cx, camera.cy, warning), (1_483.637_806_505_496_2, 960.0, 540.0, None));
}

/// The capture as nerfstudio's exporter would write it: camera to world, y up and z back.
fn exported(capture: &Capture) -> Value {
    let frame = |view: &CapturedView| {
        let (r, c) = (view.world_from_camera.rotation_matrix(), view.world_from_camera.translation);
        let row = |i: usize| json!([r.x_axis[i], -r.y_axis[i], -r.z_axis[i], c[i]]);
        let (camera, k) = (&view.camera, view.lens.coefficients());
        json!({ "file_path": view.name, "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            "w": camera.size.width, "h": camera.size.height, "fl_x": camera.fx, "fl_y": camera.fy,
            "cx": camera.cx, "cy": camera.cy, "k1": k[0], "k2": k[1], "p1": k[2], "p2": k[3] })
    };
    json!({ "camera_model": "OPENCV", "frames": capture.views.iter().map(frame).collect::<Vec<_>>() })
}

fn read_transforms(document: &Value) -> Result<(Capture, Vec<String>), SourceError> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("transforms.json"), document.to_string()).unwrap();
    let (capture, warnings) = nerfstudio::read_capture(dir.path())?;
    Ok((capture, warnings.iter().map(ToString::to_string).collect()))
}

#[test]
fn a_model_and_its_export_are_the_same_capture() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let (original, _) = colmap::read_capture(dir.path()).unwrap();
    let (read, warnings) = read_transforms(&exported(&original)).unwrap();
    assert!(warnings.is_empty() && read.views.len() == original.views.len());
    for (a, b) in original.views.iter().zip(&read.views) {
        assert_eq!((&a.name, a.camera, a.lens.coefficients()), (&b.name, b.camera, b.lens.coefficients()));
        // A quaternion's conversion through a matrix costs a few roundings of numbers up to 1.
        let turn = a.world_from_camera.rotation - b.world_from_camera.rotation;
        assert!(turn.length() < 2e-15, "{}: {turn}", a.name);
        assert_eq!(a.world_from_camera.translation, b.world_from_camera.translation);
    }
}

/// One frame, at rest, of a camera that is fully stated at the top.
fn one_frame() -> Value {
    json!({ "w": 800, "h": 600, "fl_x": 500.0, "fl_y": 501.0, "cx": 400.0, "cy": 300.0,
        "frames": [{ "file_path": "images/1.jpg",
            "transform_matrix": [[1, 0, 0, 1.5], [0, 1, 0, 2.5], [0, 0, 1, 3.5], [0, 0, 0, 1]] }] })
}

/// `one_frame` with this change merged into it; null removes a key.
fn one_frame_with(change: &Value) -> Value {
    let mut document = one_frame();
    for (key, value) in change.as_object().unwrap() {
        document[key] = value.clone();
    }
    document
}

#[test]
fn a_camera_follows_the_conventions() {
    let t = |change: Value, wanted: [f64; 4]| {
        let (capture, warnings) = read_transforms(&one_frame_with(&change)).unwrap();
        let c = capture.views[0].camera;
        let found = [c.fx, c.fy, c.cx, c.cy];
        let near = found.iter().zip(&wanted).all(|(f, w)| (f - w).abs() < 1e-12 * w.abs());
        assert!(near && warnings.is_empty(), "{change}: {found:?}");
    };
    t(json!({}), [500.0, 501.0, 400.0, 300.0]);
    t(json!({ "w": 800.0, "camera_model": "PINHOLE", "k1": 0.0 }), [500.0, 501.0, 400.0, 300.0]);
    t(json!({ "pixel_center": 0 }), [500.0, 501.0, 400.5, 300.5]);
    t(json!({ "pixel_center": 0.5 }), [500.0, 501.0, 400.0, 300.0]);
    // 90 degrees over 800 px: f = 400 / tan 45.
    let blender = json!({ "fl_x": null, "fl_y": null, "cx": null, "cy": null,
        "camera_angle_x": std::f64::consts::FRAC_PI_2 });
    t(blender, [400.0, 400.0, 400.0, 300.0]);
    let mut own = one_frame();
    own["frames"][0]["fl_x"] = json!(777.0);
    t(json!({ "frames": own["frames"] }), [777.0, 501.0, 400.0, 300.0]);
}

#[test]
fn an_opengl_camera_at_rest_looks_along_minus_z() {
    let (capture, _) = read_transforms(&one_frame()).unwrap();
    let pose = capture.views[0].world_from_camera;
    assert_eq!(pose.translation, DVec3::new(1.5, 2.5, 3.5));
    // Half a turn about x: z forward becomes -z, y down becomes -y.
    assert!((pose.rotation - DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0)).length() < 1e-15, "{}", pose.rotation);
}

#[test]
fn a_lens_is_read_if_there_is_one() {
    let lens =
        |change: Value| read_transforms(&one_frame_with(&change)).map(|(c, _)| c.views[0].lens.clone());
    assert_eq!(lens(json!({ "k1": 0, "p2": 0.0 })).unwrap(), LensModel::Pinhole);
    assert_eq!(lens(json!({ "k1": 0.1, "p2": 0.4 })).unwrap(), LensModel::OpenCv { k: [0.1, 0.0, 0.0, 0.4] });
    let full = LensModel::FullOpenCv { k: [0.1, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0] };
    assert_eq!(lens(json!({ "k1": 0.1, "k3": 0.3 })).unwrap(), full);
}

/// The head of a PNG, which is enough for its size.
fn png_head(width: u32, height: u32) -> Vec<u8> {
    let mut head = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    head.extend([width.to_be_bytes(), height.to_be_bytes()].concat());
    head.extend([8, 2, 0, 0, 0, 0, 0, 0, 0]);
    head
}

#[test]
fn a_camera_is_scaled_to_its_photo() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("images")).unwrap();
    let read = |document: &Value, width, height| {
        std::fs::write(dir.path().join("transforms.json"), document.to_string()).unwrap();
        // A photo named jpg that is a PNG: only the content counts.
        std::fs::write(dir.path().join("images/1.jpg"), png_head(width, height)).unwrap();
        nerfstudio::read_capture(dir.path()).map_err(|e| e.to_string())
    };
    let (capture, warnings) = read(&one_frame(), 400, 300).unwrap();
    let halved = Camera { size: size(400, 300), fx: 250.0, fy: 250.5, cx: 200.0, cy: 150.0, lens: None };
    assert_eq!(capture.views[0].camera, halved);
    assert!(warnings[0].to_string().contains("is 400x300, but its camera states 800x600"), "{warnings:?}");
    assert!(capture.views[0].sha256.is_some());

    let error = read(&one_frame(), 400, 290).unwrap_err();
    assert!(error.contains("`frames[0]`: the photo is 400x290, but the camera states 800x600"), "{error}");
    let (capture, _) = read(&one_frame_with(&json!({ "w": null, "h": null })), 640, 480).unwrap();
    assert_eq!(capture.views[0].camera.size, size(640, 480));
    let file = dir.path().join("transforms.json");
    let files = DiskCapture::all_views(CaptureKind::Nerfstudio, file).files().unwrap();
    assert_eq!(files.iter().map(|f| f.0.as_str()).collect::<Vec<_>>(), ["transforms.json", "images/1.jpg"]);
}

#[test]
fn faults_of_a_transforms_file_are_named_with_their_place() {
    let t = |change: Value, words: &str| {
        let error = read_transforms(&one_frame_with(&change)).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("transforms.json: ") && error.contains(words), "`{words}`: {error}");
    };
    let framed = |key: &str, value: Value| {
        let mut frames = one_frame()["frames"].clone();
        frames[0][key] = value;
        json!({ "frames": frames })
    };
    t(json!({ "frames": null }), "`frames`: it is missing");
    t(json!({ "frames": 3 }), "`frames`: 3, wanted a list");
    t(json!({ "frames": [] }), "it contains no view");
    t(framed("file_path", Value::Null), "`frames[0].file_path`: it is missing");
    t(framed("transform_matrix", Value::Null), "`frames[0].transform_matrix`: it is missing");
    t(framed("transform_matrix", json!([[1, 2]])), "`frames[0].transform_matrix`: [[1,2]], wanted 4 rows");
    let row = json!([1, 0, 0, 0]);
    t(
        framed("transform_matrix", json!([row, row, row, "x"])),
        "`frames[0].transform_matrix[3]`: \"x\", wanted a list",
    );
    let mirror = json!([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    t(framed("transform_matrix", mirror), "`frames[0].transform_matrix`: a rotation contains a reflection");
    let scaled = json!([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]);
    t(framed("transform_matrix", scaled), "`frames[0].transform_matrix`: a rotation is not orthonormal");
    let projective = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]);
    t(framed("transform_matrix", projective), "`frames[0].transform_matrix`: its last row");
    t(json!({ "fl_x": null }), "`fl_x`: it is missing, wanted a focal length");
    t(json!({ "fl_y": null }), "`fl_y`: it is missing, wanted a number, because `fl_x` is present");
    t(json!({ "cx": null }), "`cx`: it is missing");
    t(json!({ "w": null, "h": null }), "`w`: it is missing, wanted the image size in `w` and `h`");
    t(json!({ "h": null }), "wanted the image size in `w` and `h`");
    t(json!({ "w": 0.5 }), "`w`: 0.5, wanted a whole number");
    t(json!({ "fl_x": 0 }), "`frames[0]`: the focal length is 0");
    t(json!({ "fl_x": "500" }), "`fl_x`: \"500\", wanted a number");
    t(json!({ "pixel_center": 0.25 }), "`pixel_center`: 0.25, wanted 0 or 0.5");
    t(json!({ "camera_model": "OPENCV_FISHEYE" }), "`camera_model`: the camera model `OPENCV_FISHEYE`");
    t(json!({ "k4": 0.1 }), "`k4`: 0.1, wanted 0");
    let frame = &one_frame()["frames"][0];
    t(
        json!({ "frames": [frame, frame] }),
        "`frames[1]`: the image name `images/1.jpg` is already used by `frames[0]`",
    );

    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("transforms.json");
    std::fs::write(&file, "{\n \"w\": NaN }").unwrap();
    let error = nerfstudio::read_capture(&file).unwrap_err().to_string();
    assert!(error.contains("transforms.json: line 2: "), "{error}");
    assert!(
        nerfstudio::read_capture(&dir.path().join("gone.json"))
            .unwrap_err()
            .to_string()
            .contains("gone.json")
    );
}

#[test]
fn the_photos_of_a_foreign_file_may_be_fewer_than_its_frames() {
    let Some(file) = shared("captures/fox/transforms.json") else { return };
    let (capture, _) = nerfstudio::read_capture(&file).unwrap();
    let photographed = capture.views.iter().filter(|v| v.sha256.is_some()).count();
    assert_eq!((capture.views.len(), photographed), (67, 50));
    assert!(capture.views.iter().all(|v| matches!(v.lens, LensModel::OpenCv { .. })));
}
