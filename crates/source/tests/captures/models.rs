//! COLMAP models.

use super::{shared, size};
use glam::DVec3;
use gs2e_scene::camera::Camera;
use gs2e_source::kind::CaptureKind;
use gs2e_source::{Capture, CapturedView, DiskCapture, LensModel, UnusedReason, colmap};
use gs2e_testing::planted::{self, Planted, model};
use std::path::Path;

/// Mean distance in pixels between the key points of a model and its points projected through the
/// capture: over points (each point's mean) and over observations. The third value is the number of
/// points.
pub(super) fn reprojection(dir: &Path) -> (f64, f64, usize) {
    let model = colmap::ColmapModel::find_model(dir).unwrap();
    let (capture, _) = colmap::read_capture(dir).unwrap();
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
        let (capture, warnings) = colmap::read_capture(&dir).unwrap();
        assert_eq!((capture.views.len(), warnings), (views, vec![]));
        let (px, over_observations, points) = reprojection(&dir);
        // COLMAP prints its own figures with two digits.
        assert_eq!(points, wanted_points);
        assert!(
            (px - wanted_px).abs() < 0.005,
            "{name}: {px} px over points, {over_observations} over observations"
        );
        assert!(capture.views.iter().all(|v| v.sha256.is_some()), "every photo is there");
        // Both were taken through a real lens: the user must be warned that trajectories omit it.
        let message = capture.distortion().expect("a bent lens is message").to_string();
        assert!(message.contains("distorted by up to"), "{message}");
        let straight = CapturedView { lens: LensModel::Pinhole, ..capture.views[0].clone() };
        assert_eq!(Capture::from(vec![straight]).distortion(), None);
    }
}

#[test]
fn the_text_form_agrees_with_the_binary_form() {
    let dir = tempfile::tempdir().unwrap();
    let (binary, text) = (dir.path().join("binary"), dir.path().join("text"));
    model().write_binary(&binary);
    model().write_text(&text);
    assert_eq!(colmap::read_capture(&binary).unwrap(), colmap::read_capture(&text).unwrap());
    let (binary, text) =
        (colmap::ColmapModel::find_model(&binary).unwrap(), colmap::ColmapModel::find_model(&text).unwrap());
    assert_eq!(binary.points().unwrap(), text.points().unwrap());
    let seen = |model: &colmap::ColmapModel| -> Vec<Vec<colmap::KeyPoint>> {
        model.images().unwrap().into_iter().map(|image| image.observations).collect()
    };
    assert_eq!(seen(&binary), seen(&text));
    assert_eq!(seen(&binary).iter().map(Vec::len).collect::<Vec<_>>(), [2, 0, 1, 2]);
}

#[test]
fn real_models_cut_short_are_refused() {
    let Some(whole) = shared("captures/castle/sparse/0") else { return };
    let dir = tempfile::tempdir().unwrap();
    for name in ["cameras.bin", "points3D.bin"] {
        std::fs::copy(whole.join(name), dir.path().join(name)).unwrap();
    }
    let images = std::fs::read(whole.join("images.bin")).unwrap();
    for part in 0..60 {
        std::fs::write(dir.path().join("images.bin"), &images[..images.len() * part / 60]).unwrap();
        assert!(colmap::read_capture(dir.path()).is_err(), "{part} of 60 parts");
    }
}

#[test]
fn a_planted_model_is_read_as_planted() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let (capture, warnings) = colmap::read_capture(dir.path()).unwrap();
    assert_eq!(warnings, vec![]);
    let names: Vec<&str> = capture.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["1.jpg", "9.jpg", "10.jpg", "left side/a b.jpg"]);

    // "9.jpg" is turned by 90 degrees about y: x_cam = z + 1, y_cam = y + 2, z_cam = -x + 3. The
    // world point with zero camera coordinates is (3, -2, -1), and the camera looks along the
    // world's -x.
    let view = &capture.views[1];
    assert!((view.world_from_camera.translation - DVec3::new(3.0, -2.0, -1.0)).length() < 1e-15);
    assert!((view.world_from_camera.rotation * DVec3::Z - DVec3::NEG_X).length() < 1e-15);
    assert_eq!(view.lens, LensModel::SimpleRadial { k1: -0.01 });
    assert_eq!(
        view.camera,
        Camera { size: size(640, 360), fx: 500.5, fy: 500.5, cx: 320.0, cy: 180.0, lens: None }
    );
    assert!(capture.views.iter().all(|v| v.world_from_camera.rotation.w >= 0.0));
    // 500.5 and 500 differ by less than a pixel; cy differs by 1 px, which is still allowed.
    assert_eq!(capture.camera().unwrap().1, None);
}

#[test]
fn models_are_found_in_their_usual_folders() {
    let dir = tempfile::tempdir().unwrap();
    let find = |root: &Path| {
        colmap::read_capture(root).map(|(capture, _)| capture.views.len()).map_err(|e| e.to_string())
    };
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
    let (capture, _) = colmap::read_capture(dir.path()).unwrap();
    let hashes: Vec<Option<&str>> =
        capture.views.iter().map(|v| v.sha256.as_deref().map(|h| &h[..8])).collect();
    // SHA-256 of the empty input, and FIPS 180-2's of "abc".
    assert_eq!(hashes, [None, Some("e3b0c442"), None, Some("ba7816bf")]);
    let files = DiskCapture::all_views(CaptureKind::Colmap, dir.path().to_owned()).files().unwrap();
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(
        names,
        [
            "cameras.bin",
            "images.bin",
            "points3D.bin",
            "images/9.jpg",
            "images/left side/a b.jpg",
            "images/9_bg_removed.png"
        ]
    );
    let [unused] = &capture.unused[..] else { panic!("{:?}", capture.unused) };
    assert_eq!((unused.name.as_str(), unused.why), ("9_bg_removed.png", UnusedReason::NotRegistered));
    assert!(files.iter().all(|(_, path)| path.is_file()));
}

#[test]
fn both_forms_together_are_compared() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let mut other = model();
    other.images.pop();
    other.write_text(dir.path());
    let (capture, warnings) = colmap::read_capture(dir.path()).unwrap();
    assert_eq!((capture.views.len(), warnings.len()), (4, 1));
    let message = warnings[0].to_string();
    assert!(
        message.contains("images.bin holds 4 records") && message.contains("images.txt holds 3"),
        "{message}"
    );
}

#[test]
fn models_cut_short_are_refused_with_their_place() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let find = || colmap::ColmapModel::find_model(dir.path()).unwrap();
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

/// Changes a model and reads it in both forms. Both errors must hold these words and the form's
/// place.
fn refused(change: impl Fn(&mut Planted), words: &str, binary_place: &str, text_place: &str) {
    let mut changed = model();
    change(&mut changed);
    let forms =
        [(Planted::write_binary as fn(&Planted, &Path), binary_place), (Planted::write_text, text_place)];
    for (write, place) in forms {
        let dir = tempfile::tempdir().unwrap();
        write(&changed, dir.path());
        let error = colmap::read_capture(dir.path()).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains(place), "`{words}` and `{place}`: {error}");
    }
}

#[test]
fn faults_of_a_model_are_named_with_their_place() {
    // Binary cameras begin at bytes 8 and 64, images at 8 and 135; the text files begin with two
    // comments and one.
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
    image(|i| i.camera = 8, "`9.jpg` uses camera 8, which the model does not have");
    image(|i| i.name = "10.jpg".to_owned(), "the image name `10.jpg` is already used by");
    refused(
        |m| m.images[1].name.clear(),
        "an image without a name",
        "image 2 of 4 at byte 199",
        "images.txt: line 4",
    );
    refused(|m| m.images.clear(), "it contains no view", "images.bin", "images.txt");
}

#[test]
fn a_nearly_orthonormal_rotation_is_accepted_with_a_warning() {
    let dir = tempfile::tempdir().unwrap();
    let mut rounded = model();
    rounded.images[1].q = rounded.images[1].q.map(|v| v * 0.99999);
    rounded.write_text(dir.path());
    let (capture, warnings) = colmap::read_capture(dir.path()).unwrap();
    assert!(
        warnings.len() == 1 && warnings[0].to_string().contains("`9.jpg` is off by 2.0e-5"),
        "{warnings:?}"
    );
    assert!((capture.views[1].world_from_camera.rotation.length() - 1.0).abs() < 1e-15);
}

#[test]
fn impossible_counts_take_no_memory() {
    let dir = tempfile::tempdir().unwrap();
    model().write_binary(dir.path());
    let mut images = model().binary()[1].clone();
    images[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    std::fs::write(dir.path().join("images.bin"), images).unwrap();
    let error = colmap::read_capture(dir.path()).unwrap_err().to_string();
    assert!(error.contains("the head at byte 0: a count of 18446744073709551615, but the rest"), "{error}");
}
