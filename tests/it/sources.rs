//! Captured datasets as they lie on disk: the real ones under `../shared`, and small ones with every known defect.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod planted;

use glam::{DQuat, DVec3};
use gs2e::source::{Capture, Lens, SourceError, View, colmap, nerfstudio};
use planted::{Planted, model};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A path below `../shared`, or `None`, said on stderr.
#[expect(clippy::print_stderr, reason = "a test that is not run says so")]
fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(path);
    if path.exists() {
        return Some(path);
    }
    eprintln!("not run: ../shared is absent");
    None
}

/// Mean distance in pixels between the key points of a model and its points seen through the capture: over points (of
/// each point's mean) and over observations; and the number of points.
fn reprojection(dir: &Path) -> (f64, f64, usize) {
    let model = colmap::Model::find(dir).unwrap();
    let (capture, _) = colmap::read(dir).unwrap();
    let points = model.points().unwrap();
    let mut of_point = std::collections::BTreeMap::<u64, Vec<f64>>::new();
    for image in model.images().unwrap() {
        let view = capture.views.iter().find(|v| v.name == image.name).unwrap();
        let camera_from_world = view.world_from_camera.inverse();
        for key_point in &image.observations {
            let Some(id) = key_point.point else { continue };
            let p = camera_from_world.rotation * points[&id].xyz + camera_from_world.translation;
            let [x, y] = view.lens.distort([p.x / p.z, p.y / p.z]);
            let (u, v) = (view.camera.fx * x + view.camera.cx, view.camera.fy * y + view.camera.cy);
            of_point.entry(id).or_default().push((u - key_point.xy[0]).hypot(v - key_point.xy[1]));
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let means: Vec<f64> = of_point.values().map(|errors| mean(errors)).collect();
    (mean(&means), mean(&of_point.values().flatten().copied().collect::<Vec<_>>()), points.len())
}

#[test]
fn colmaps_points_fall_on_its_key_points() {
    for (name, views, wanted_points, wanted_px) in [("fox", 50, 6_836, 1.09), ("castle", 11, 3_822, 0.75)] {
        let Some(dir) = shared(&format!("captures/{name}")) else { return };
        let (capture, warnings) = colmap::read(&dir).unwrap();
        assert_eq!((capture.views.len(), warnings), (views, vec![]));
        let (px, over_observations, points) = reprojection(&dir);
        // COLMAP's own figures are printed to two digits.
        assert_eq!(points, wanted_points);
        assert!(
            (px - wanted_px).abs() < 0.005,
            "{name}: {px} px over points, {over_observations} over observations"
        );
        assert!(capture.views.iter().all(|v| v.sha256.is_some()), "every photo is there");
    }
}

/// What a model says must not depend on its form.
fn content(dir: &Path) -> (Vec<View>, Vec<Vec<colmap::Observation>>, Vec<(u64, colmap::Point)>) {
    let model = colmap::Model::find(dir).unwrap();
    let observations = model.images().unwrap().into_iter().map(|image| image.observations).collect();
    (colmap::read(dir).unwrap().0.views, observations, model.points().unwrap().into_iter().collect())
}

#[test]
fn the_text_form_says_what_the_binary_form_says() {
    let dir = tempfile::tempdir().unwrap();
    let (binary, text) = (dir.path().join("binary"), dir.path().join("text"));
    model().write_binary(&binary);
    model().write_text(&text);
    assert_eq!(content(&binary), content(&text));
}

#[test]
fn real_models_cut_short_are_refused() {
    let Some(whole) = shared("captures/castle/sparse/0") else { return };
    let dir = tempfile::tempdir().unwrap();
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        std::fs::copy(whole.join(name), dir.path().join(name)).unwrap();
    }
    let images = std::fs::read(whole.join("images.bin")).unwrap();
    for part in 0..60 {
        std::fs::write(dir.path().join("images.bin"), &images[..images.len() * part / 60]).unwrap();
        assert!(colmap::read(dir.path()).is_err(), "{part} of 60 parts");
    }
}

#[test]
fn a_planted_model_is_read_as_planted() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let (capture, warnings) = colmap::read(dir.path()).unwrap();
    assert_eq!(warnings, vec![]);
    let names: Vec<&str> = capture.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["1.jpg", "9.jpg", "10.jpg", "left side/a b.jpg"]);

    // "9.jpg" is turned by 90 degrees about y: x_cam = z + 1, y_cam = y + 2, z_cam = -x + 3. The world point whose
    // camera coordinates are zero is (3, -2, -1), and the camera looks along the world's -x.
    let view = &capture.views[1];
    assert!((view.world_from_camera.translation - DVec3::new(3.0, -2.0, -1.0)).length() < 1e-15);
    assert!((view.world_from_camera.rotation * DVec3::Z - DVec3::NEG_X).length() < 1e-15);
    assert_eq!(view.lens, Lens::SimpleRadial { k1: -0.01 });
    let camera = view.camera;
    assert_eq!([camera.fx, camera.fy, camera.cx, camera.cy], [500.5, 500.5, 320.0, 180.0]);
    assert!(capture.views.iter().all(|v| v.world_from_camera.rotation.w >= 0.0));
    // 500.5 against 500 is less than a pixel apart, but cy is 1 px apart and not more.
    assert_eq!(capture.camera().1, None);
}

#[test]
fn models_are_found_where_people_keep_them() {
    let dir = tempfile::tempdir().unwrap();
    let find =
        |root: &Path| colmap::read(root).map(|(capture, _)| capture.views.len()).map_err(|e| e.to_string());
    for place in ["", "sparse/0", "sparse", "colmap/sparse/0", "a/b/c/sparse/0"] {
        let root = dir.path().join("root");
        model().write_text(&root.join(place));
        assert_eq!(find(&root), Ok(4), "{place}");
        std::fs::remove_dir_all(&root).unwrap();
    }
    model().write_binary(&dir.path().join("a/b/c/d/sparse/0"));
    assert!(find(dir.path()).unwrap_err().contains("no COLMAP model was found"));
    model().write_binary(&dir.path().join("a/sparse/0"));
    model().write_binary(&dir.path().join("b/sparse/0"));
    let two = find(dir.path()).unwrap_err();
    assert!(
        two.contains("two COLMAP models") && two.contains("a/sparse/0") && two.contains("b/sparse/0"),
        "{two}"
    );
    assert!(find(&dir.path().join("gone")).unwrap_err().contains("gone"));
}

#[test]
fn photos_are_hashed_and_listed_where_they_are() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(&dir.path().join("sparse/0"));
    std::fs::create_dir_all(dir.path().join("images/left side")).unwrap();
    std::fs::write(dir.path().join("images/left side/a b.jpg"), "abc").unwrap();
    std::fs::write(dir.path().join("images/9.jpg"), "").unwrap();
    std::fs::write(dir.path().join("images/9_bg_removed.png"), "no view is named so").unwrap();
    let (capture, _) = colmap::read(dir.path()).unwrap();
    let hashes: Vec<Option<&str>> =
        capture.views.iter().map(|v| v.sha256.as_deref().map(|h| &h[..8])).collect();
    // SHA-256 of nothing, and FIPS 180-2's of "abc".
    assert_eq!(hashes, [None, Some("e3b0c442"), None, Some("ba7816bf")]);
    let files = colmap::files(dir.path()).unwrap();
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(
        names,
        ["cameras.bin", "images.bin", "points3D.bin", "images/9.jpg", "images/left side/a b.jpg"]
    );
    assert!(files.iter().all(|(_, path)| path.is_file()));
}

#[test]
fn both_forms_together_are_compared() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let mut other = model();
    other.images.pop();
    other.write_text(dir.path());
    let (capture, warnings) = colmap::read(dir.path()).unwrap();
    assert_eq!((capture.views.len(), warnings.len()), (4, 1));
    let told = warnings[0].to_string();
    assert!(told.contains("images.bin holds 4 records") && told.contains("images.txt 3"), "{told}");
}

#[test]
fn models_cut_short_are_refused_with_their_place() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let find = || colmap::Model::find(dir.path()).unwrap();
    for (stem, whole) in ["cameras", "images", "points3D"].iter().zip(model().binary()) {
        let file = dir.path().join(stem).with_extension("bin");
        for cut in (0..whole.len()).step_by(7).chain([whole.len() - 1]) {
            std::fs::write(&file, &whole[..cut]).unwrap();
            let read = [find().cameras().err(), find().images().err(), find().points().err()];
            let errors: Vec<String> = read.into_iter().flatten().map(|e| e.to_string()).collect();
            let [error] = errors.as_slice() else { panic!("{stem}, {cut} bytes: {errors:?}") };
            assert!(error.contains(&format!("{stem}.bin")) && error.contains("at byte"), "{cut}: {error}");
        }
        std::fs::write(&file, [whole.as_slice(), b"more"].concat()).unwrap();
        let read = [find().cameras().err(), find().images().err(), find().points().err()];
        let errors: Vec<String> = read.into_iter().flatten().map(|e| e.to_string()).collect();
        assert!(errors.len() == 1 && errors[0].contains("4 bytes follow the last"), "{errors:?}");
        std::fs::write(&file, &whole).unwrap();
    }
}

/// Reads a model after a change of it, in both forms, and wants these words in both errors, and each form's place.
fn refused(change: impl Fn(&mut Planted), words: &str, binary_place: &str, text_place: &str) {
    let mut changed = model();
    change(&mut changed);
    let forms =
        [(Planted::write_binary as fn(&Planted, &Path), binary_place), (Planted::write_text, text_place)];
    for (write, place) in forms {
        let dir = tempfile::tempdir().unwrap();
        write(&changed, dir.path());
        let error = colmap::read(dir.path()).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains(place), "`{words}` and `{place}`: {error}");
    }
}

#[test]
fn what_is_wrong_in_a_model_is_named_with_its_place() {
    // Binary cameras begin at bytes 8 and 64, images at 8 and 135; the text files begin with two and one comments.
    let camera = |change: fn(&mut planted::Camera), words: &str| {
        let (binary, text) = ("cameras.bin: camera 2 of 2 at byte 64", "cameras.txt: line 4");
        refused(|m| change(&mut m.cameras[1]), words, binary, text);
    };
    let fisheye = |c: &mut planted::Camera| {
        c.model = (5, "OPENCV_FISHEYE");
        c.parameters = vec![500.0; 8];
    };
    camera(
        fisheye,
        "camera model OPENCV_FISHEYE is not supported; undistort the photos with `colmap image_undistorter`",
    );
    camera(|c| c.model = (77, "77"), "camera model 77 is unknown");
    camera(|c| c.parameters[1] = 0.0, "the focal length is 0, wanted a positive number");
    camera(|c| c.parameters[0] = -500.0, "the focal length is -500");
    camera(|c| c.parameters[1] = f64::NAN, "the focal length is NaN");
    camera(|c| c.parameters[3] = f64::INFINITY, "a camera parameter is inf");
    camera(|c| c.size = [0, 360], "the image size is 0x360");
    camera(|c| c.size = [640, 200_000], "the image size is 640x200000");
    camera(|c| c.id = 7, "camera 7 was already listed");

    let image = |change: fn(&mut planted::Image), words: &str| {
        let (binary, text) = ("images.bin: image 2 of 4 at byte 135", "images.txt: line 4");
        refused(|m| change(&mut m.images[1]), words, binary, text);
    };
    image(|i| i.q[2] = f64::NAN, "`9.jpg`: a rotation holds a number that is not finite");
    image(|i| i.q = [1.0, 1.0, 0.0, 0.0], "`9.jpg`: a rotation is not orthonormal");
    image(|i| i.q = [0.0; 4], "`9.jpg`: a rotation is not orthonormal");
    image(|i| i.t[0] = f64::NEG_INFINITY, "`9.jpg`: the translation is [-inf, 2, 3]");
    image(|i| i.camera = 8, "`9.jpg` was taken with camera 8, which is not there");
    image(|i| i.name = "10.jpg".to_owned(), "the image name `10.jpg` is already used by");
    refused(
        |m| m.images[1].name.clear(),
        "an image without a name",
        "image 2 of 4 at byte 199",
        "images.txt: line 4",
    );
    refused(|m| m.images.clear(), "it holds no view", "images.bin", "images.txt");
}

#[test]
fn a_rotation_nearly_one_is_taken_and_told() {
    let dir = tempfile::tempdir().unwrap();
    let mut rounded = model();
    rounded.images[1].q = [0.7071, 0.0, 0.7071, 0.0];
    rounded.write_text(dir.path());
    let (capture, warnings) = colmap::read(dir.path()).unwrap();
    assert!(warnings.len() == 1 && warnings[0].to_string().contains("`9.jpg` is off by 1"), "{warnings:?}");
    assert!((capture.views[1].world_from_camera.rotation.length() - 1.0).abs() < 1e-15);
}

#[test]
fn impossible_counts_take_no_memory() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let mut images = model().binary()[1].clone();
    images[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    std::fs::write(dir.path().join("images.bin"), images).unwrap();
    let error = colmap::read(dir.path()).unwrap_err().to_string();
    assert!(error.contains("the head at byte 0: a count of 18446744073709551615, but the rest"), "{error}");
}

#[test]
fn transforms_are_read() {
    let Some(file) = shared("scenes/playbot.transforms.json") else { return };
    let (capture, warnings) = nerfstudio::read(&file).unwrap();
    assert_eq!((capture.views.len(), warnings), (30, vec![]));
    assert!(capture.views.iter().all(|v| v.lens == Lens::Pinhole && v.sha256.is_none()));
    let (camera, warning) = Capture::camera(&capture);
    assert_eq!((camera.fx, camera.cx, camera.cy, warning), (1_483.637_806_505_496_2, 960.0, 540.0, None));
}

/// The capture as nerfstudio's exporter would write it: camera to world, y up and z back.
fn exported(capture: &Capture) -> Value {
    let frame = |view: &View| {
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
    let (capture, warnings) = nerfstudio::read(dir.path())?;
    Ok((capture, warnings.iter().map(ToString::to_string).collect()))
}

#[test]
fn a_model_and_its_export_are_the_same_capture() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let (original, _) = colmap::read(dir.path()).unwrap();
    let (read, warnings) = read_transforms(&exported(&original)).unwrap();
    assert!(warnings.is_empty() && read.views.len() == original.views.len());
    for (a, b) in original.views.iter().zip(&read.views) {
        assert_eq!((&a.name, a.camera, a.lens.coefficients()), (&b.name, b.camera, b.lens.coefficients()));
        // A quaternion's way through a matrix costs a few roundings of numbers up to 1.
        let turn = a.world_from_camera.rotation - b.world_from_camera.rotation;
        assert!(turn.length() < 2e-15, "{}: {turn}", a.name);
        assert_eq!(a.world_from_camera.translation, b.world_from_camera.translation);
    }
}

/// One frame, at rest, of a camera that is all stated at the top.
fn one_frame() -> Value {
    json!({ "w": 800, "h": 600, "fl_x": 500.0, "fl_y": 501.0, "cx": 400.0, "cy": 300.0,
        "frames": [{ "file_path": "images/1.jpg",
            "transform_matrix": [[1, 0, 0, 1.5], [0, 1, 0, 2.5], [0, 0, 1, 3.5], [0, 0, 0, 1]] }] })
}

/// `one_frame` with this merged into it; null removes a key.
fn one_frame_with(change: &Value) -> Value {
    let mut document = one_frame();
    for (key, value) in change.as_object().unwrap() {
        document[key] = value.clone();
    }
    document
}

#[test]
fn a_camera_is_what_the_conventions_say() {
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
fn a_lens_is_read_as_far_as_there_is_one() {
    let lens =
        |change: Value| read_transforms(&one_frame_with(&change)).map(|(c, _)| c.views[0].lens.clone());
    assert_eq!(lens(json!({ "k1": 0, "p2": 0.0 })).unwrap(), Lens::Pinhole);
    assert_eq!(lens(json!({ "k1": 0.1, "p2": 0.4 })).unwrap(), Lens::OpenCv { k: [0.1, 0.0, 0.0, 0.4] });
    let full = Lens::FullOpenCv { k: [0.1, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0] };
    assert_eq!(lens(json!({ "k1": 0.1, "k3": 0.3 })).unwrap(), full);
}

/// A PNG's head, which is all that its size needs.
fn png_head(width: u32, height: u32) -> Vec<u8> {
    let mut head = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    head.extend([width.to_be_bytes(), height.to_be_bytes()].concat());
    head.extend([8, 2, 0, 0, 0, 0, 0, 0, 0]);
    head
}

#[test]
fn a_camera_is_scaled_to_the_photo_it_stands_for() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("images")).unwrap();
    let read = |document: &Value, width, height| {
        std::fs::write(dir.path().join("transforms.json"), document.to_string()).unwrap();
        // A photo named jpg that is a PNG: what counts is the content.
        std::fs::write(dir.path().join("images/1.jpg"), png_head(width, height)).unwrap();
        nerfstudio::read(dir.path()).map_err(|e| e.to_string())
    };
    let (capture, warnings) = read(&one_frame(), 400, 300).unwrap();
    let c = capture.views[0].camera;
    assert_eq!([c.fx, c.fy, c.cx, c.cy], [250.0, 250.5, 200.0, 150.0]);
    assert!(warnings[0].to_string().contains("is 400x300, its camera says 800x600"), "{warnings:?}");
    assert!(capture.views[0].sha256.is_some());

    let error = read(&one_frame(), 400, 290).unwrap_err();
    assert!(error.contains("`frames[0]`: the photo is 400x290, the camera says 800x600"), "{error}");
    let (capture, _) = read(&one_frame_with(&json!({ "w": null, "h": null })), 640, 480).unwrap();
    assert_eq!(capture.views[0].camera.size.to_string(), "640x480");
    let files = nerfstudio::files(&dir.path().join("transforms.json")).unwrap();
    assert_eq!(files.iter().map(|f| f.0.as_str()).collect::<Vec<_>>(), ["transforms.json", "images/1.jpg"]);
}

#[test]
fn what_is_wrong_in_a_transforms_file_is_named_with_its_place() {
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
    t(json!({ "frames": [] }), "it holds no view");
    t(framed("file_path", Value::Null), "`frames[0].file_path`: it is missing");
    t(framed("transform_matrix", Value::Null), "`frames[0].transform_matrix`: it is missing");
    t(framed("transform_matrix", json!([[1, 2]])), "`frames[0].transform_matrix`: [[1,2]], wanted 4 rows");
    let row = json!([1, 0, 0, 0]);
    t(
        framed("transform_matrix", json!([row, row, row, "x"])),
        "`frames[0].transform_matrix[3]`: \"x\", wanted a list",
    );
    let mirror = json!([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    t(framed("transform_matrix", mirror), "`frames[0].transform_matrix`: a rotation mirrors");
    let scaled = json!([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]);
    t(framed("transform_matrix", scaled), "`frames[0].transform_matrix`: a rotation is not orthonormal");
    let projective = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]);
    t(framed("transform_matrix", projective), "`frames[0].transform_matrix`: its last row");
    t(json!({ "fl_x": null }), "`fl_x`: it is missing, wanted a focal length");
    t(json!({ "fl_y": null }), "`fl_y`: it is missing, wanted a number, as `fl_x` is there");
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
    let error = nerfstudio::read(&file).unwrap_err().to_string();
    assert!(error.contains("transforms.json: line 2: "), "{error}");
    assert!(nerfstudio::read(&dir.path().join("gone.json")).unwrap_err().to_string().contains("gone.json"));
}

#[test]
fn the_photos_of_a_foreign_file_may_be_fewer_than_its_frames() {
    let Some(file) = shared("captures/fox/transforms.json") else { return };
    let (capture, _) = nerfstudio::read(&file).unwrap();
    let photographed = capture.views.iter().filter(|v| v.sha256.is_some()).count();
    assert_eq!((capture.views.len(), photographed), (67, 50));
    assert!(capture.views.iter().all(|v| matches!(v.lens, Lens::OpenCv { .. })));
}
