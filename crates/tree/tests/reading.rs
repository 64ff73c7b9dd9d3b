//! Releases made by hand: what is read from them, and what is refused.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

use gs2e_scene::camera::Camera;
use gs2e_tree::{Exposure, ListedFile, ListedFiles, PictureKind, Release, ReleaseFiles, TrajectoryFiles};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;

const POSES: &str =
    "0 0 0 0 0 0 0 1\n1000 1 0 0 0 0 0 1\n2000 2 0 0 0 0 0 1\n3000 3 0 0 0 0 0 1\n4000 4 0 0 0 0 0 1\n";
const CAMERA: &str = r#"{ "width": 4, "height": 3, "fx": 4, "fy": 4, "cx": 2, "cy": 1.5 }"#;

/// A release of one scene with one trajectory, which has a blurred picture at pose 2.
fn release(exposure_us: [i64; 2]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("lab/base");
    fs::create_dir_all(base.join("blur")).unwrap();
    let scene = format!(
        r#"{{ "id": "lab", "recipe": {{}}, "camera": {CAMERA},
             "trajectories": [{{ "name": "base", "sensors": {{ "fine": {{}}, "coarse": {{}} }} }}] }}"#
    );
    let [start, end] = exposure_us;
    let transforms = format!(
        r#"{{ "frames": [{{ "t_us": 0 }}, {{ "t_us": 2000, "blur_file_path": "blur/000002.png",
             "exposure_start_us": {start}, "exposure_end_us": {end} }}] }}"#
    );
    fs::write(folder.path().join("manifest.json"), r#"{ "format": 1, "scenes": [{ "id": "lab" }] }"#)
        .unwrap();
    fs::write(folder.path().join("lab/scene.json"), scene).unwrap();
    fs::write(base.join("poses.txt"), POSES).unwrap();
    fs::write(base.join("transforms.json"), transforms).unwrap();
    fs::write(base.join("blur/000002.png"), "no picture").unwrap();
    folder
}

fn base(folder: &Path) -> TrajectoryFiles<'static> {
    let release = Release::open(folder).unwrap();
    let scene = release.scene("lab").unwrap();
    release.trajectory(&scene, &scene.trajectories[0]).unwrap()
}

#[test]
fn descriptions_lead_to_the_files() {
    let folder = release([1500, 2500]);
    let release = Release::open(folder.path()).unwrap();
    assert_eq!(release.scene_ids().collect::<Vec<_>>(), ["lab"]);
    let scene = release.scene("lab").unwrap();
    let streams: Vec<Option<&str>> = scene.trajectories[0].streams().collect();
    assert_eq!(streams, [Some("coarse"), Some("fine")]);
    let base = base(folder.path());
    let poses = base.poses().unwrap();
    assert_eq!(poses.stamps_us.len(), 5);
    assert_eq!(base.poses_with(PictureKind::Blur, 0..5).unwrap(), [2]);
    assert_eq!(base.poses_with(PictureKind::Sharp, 0..5).unwrap(), [0; 0]);
    assert_eq!(base.exposures(&poses.stamps_us).unwrap(), [Exposure { pose: 2, open_us: [1500, 2500] }]);
    assert_eq!(base.inertial().unwrap(), []);
    let error = base.colours(PictureKind::Blur, 2).unwrap_err();
    assert_eq!(error.path, folder.path().join("lab/base/blur/000002.png"));
}

#[test]
fn an_exposure_lies_around_its_pose_and_within_the_poses() {
    for exposure_us in [[2500, 3500], [2500, 1500], [-1, 2500], [1500, 4001]] {
        let folder = release(exposure_us);
        let error = base(folder.path()).exposures(&[0, 1000, 2000, 3000, 4000]).unwrap_err().to_string();
        assert!(error.contains("transforms.json: a blurred picture has no pose"), "{exposure_us:?}: {error}");
    }
}

#[test]
fn what_is_no_release_is_refused() {
    let folder = release([1500, 2500]);
    let refused = |path: &Path, wanted: &str| {
        let error = Release::open(path).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    };
    refused(&folder.path().join("lab"), "found a folder without manifest.json, wanted a release folder");
    refused(&folder.path().join("manifest.json"), "found a file, wanted");
    refused(&folder.path().join("nothing"), "found nothing, wanted");
    fs::write(folder.path().join("manifest.json"), r#"{ "format": 2 }"#).unwrap();
    refused(folder.path(), "manifest.json: found format 2, wanted format 1");
}

#[test]
fn nothing_outside_of_the_folder_is_opened() {
    let folder = release([1500, 2500]);
    let outside = tempfile::NamedTempFile::new().unwrap();
    fs::write(outside.path(), POSES).unwrap();
    let poses = folder.path().join("lab/base/poses.txt");
    fs::remove_file(&poses).unwrap();
    std::os::unix::fs::symlink(outside.path(), &poses).unwrap();
    let base = base(folder.path());
    assert!(base.poses().unwrap_err().because.contains("link"), "{:?}", base.poses());
    assert!(base.has("poses.txt").is_err());
    assert!(base.read("../../../poses.txt").is_err());
}

#[test]
fn files_that_lie_elsewhere_are_read_in_the_same_way() {
    let folder = release([1500, 2500]);
    let stored = ListedFile::Stored(folder.path().join("lab/base/poses.txt"));
    let listed = BTreeMap::from([
        ("lab/base/poses.txt".to_owned(), stored),
        ("lab/base/speed.json".to_owned(), ListedFile::Bytes(b"{}".to_vec())),
    ]);
    let files: Arc<dyn ReleaseFiles> = Arc::new(ListedFiles(listed));
    assert!(files.place("lab/base/speed.json").is_err(), "it is in memory");
    let scene = Release::open(folder.path()).unwrap().scene("lab").unwrap();
    let camera = scene.camera.camera();
    let trajectory = TrajectoryFiles::new(Arc::clone(&files), "lab", "base", camera).unwrap();
    assert_eq!(trajectory.poses().unwrap(), base(folder.path()).poses().unwrap());
    assert!(!trajectory.has("transforms.json").unwrap());
    assert!(trajectory.speeds().unwrap_err().to_string().starts_with("lab/base/speed.json: "));
    let large = Camera { size: gs2e_image::Size { width: 1 << 20, height: 1 << 20 }, ..camera };
    let error = TrajectoryFiles::new(files, "lab", "base", large).unwrap_err();
    assert_eq!(error.path, Path::new("lab/scene.json"));
}
