//! Rigs: places and products of each camera, motion between the poses, disparity by projections of this test,
//! and calibration by OpenCV.

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of small pictures")]

use crate::release::small::reseal;
use crate::support::absent::absent;
use crate::support::workspace::{Workspace, tree};
use glam::{DMat3, DQuat, DVec3};
use gs2e_audit::audit_release;
use gs2e_image::npy;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::{exp_vector, log_vector};
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::mount::CameraMount;
use gs2e_trajectory::sampled::SampledPath;
use serde_json::Value;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

/// A rig on the tiny scene: a camera at the body, one that is turned and has other intrinsics and a lens, and
/// one for frames with a fisheye.
const RIG: &str = "\
version: 1
scene: tiny
seed: 7
source: { procedural: { kind: still-life, gaussians: 1500, views: 6, arc: 6, seed: 1 } }
camera: { width: 64, height: 48, fx: 62, fy: 60, cx: 31, cy: 25 }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"0.25*sin(t) + 1.1\" }
sampling: { rate: 2400, between: linear }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }
rig:
  cameras:
    - { name: left }
    - name: right
      extrinsic: { position: [0.12, 0.01, -0.02], rotation: [0.02, -0.04, 0.03, 0.998549] }
      camera: { width: 64, height: 48, fx: 60, fy: 61, cx: 33, cy: 23, lens: { opencv: [-0.05, 0.01, 0.001, -0.0005] } }
    - name: frames
      extrinsic:
        camera_from_body: [[1, 0, 0, -0.05], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
      camera: { width: 32, height: 24, fx: 30, lens: { fisheye: [0.02, -0.01, 0.002, -0.0005] } }
      outputs: [sharp]
  stereo: [[left, right]]
outputs: [events, sharp, depth, disparity, imu]
scale: { metres_per_unit: 0.5 }
licence: { expression: CC0-1.0, holder: Nobody }
";

/// The release of [`RIG`], made once and never changed.
fn released() -> &'static Workspace {
    static RELEASED: OnceLock<Workspace> = OnceLock::new();
    RELEASED.get_or_init(|| Workspace::released(RIG, "--copy"))
}

fn poses(place: &Workspace, folder: &str) -> Trajectory {
    let file = File::open(place.path(&format!("tree/tiny/{folder}/poses.txt"))).unwrap();
    Trajectory::read_poses(BufReader::new(file)).unwrap()
}

/// The numbers of an array.
fn array(path: &Path, shape: &[u64]) -> Vec<f32> {
    npy::read_values(shape, &mut BufReader::new(File::open(path).unwrap())).unwrap()
}

#[test]
fn each_camera_has_its_files() {
    let place = released();
    place.ok("audit tree");
    place.ok("check --tree tree");
    let files = tree(&place.path("tree/tiny"));
    let has = |name: &str| files.contains_key(name);
    for name in [
        "base/poses.txt",
        "base/imu/imu.csv",
        "base/calibration/camchain.yaml",
        "base/calibration/cam_to_cam.yaml",
        "base/calibration/left_rectify_map.npy",
        "base/calibration/right_remap.npy",
        "base/left/events.h5",
        "base/left/transforms.json",
        "base/left/disparity/000000.npy",
        "base/right/events.h5",
        "base/right/depth/000003.npy",
        "base/right/checks.json",
        "base/frames/sharp/000011.png",
    ] {
        assert!(has(name), "{name}");
    }
    for name in [
        "base/events.h5",
        "base/transforms.json",
        "base/left/imu/imu.csv",
        "base/right/disparity/000000.npy",
        "base/frames/events.h5",
        "base/frames/depth/000000.npy",
        "base/calibration/frames_remap.npy",
    ] {
        assert!(!has(name), "{name}");
    }
    // The second camera sees other events.
    assert_ne!(files["base/left/events.h5"], files["base/right/events.h5"]);
    // The texts of the release say what moves.
    let sheet = std::fs::read_to_string(place.path("tree/DATASHEET.md")).unwrap();
    assert!(sheet.contains("Camera trajectories through static scenes"), "{sheet}");
    assert!(sheet.contains("Scenes are static, and rigs of cameras move through them"), "{sheet}");
}

#[test]
fn each_camera_is_at_its_place() {
    let place = released();
    // By matrices, in which the pose of a camera is that of the body times the place on the body.
    let body = poses(place, "base");
    let q = DQuat::from_xyzw(0.02, -0.04, 0.03, 0.998549).normalize();
    let places = [
        ("left", DMat3::IDENTITY, DVec3::ZERO),
        ("right", DMat3::from_quat(q), DVec3::new(0.12, 0.01, -0.02)),
        ("frames", DMat3::IDENTITY, DVec3::new(0.05, 0.0, 0.0)),
    ];
    for (name, rotation, position) in places {
        let camera = poses(place, &format!("base/{name}"));
        assert_eq!(camera.stamps_us, body.stamps_us);
        for (pose, own) in body.world_from_camera.iter().zip(&camera.world_from_camera) {
            let turned = pose.rotation_matrix() * rotation;
            let centre = pose.rotation_matrix() * position + pose.translation;
            assert!(
                (own.rotation_matrix() - turned).to_cols_array().iter().all(|v| v.abs() < 1e-15),
                "{name}"
            );
            assert!((own.translation - centre).length() < 1e-15, "{name}");
        }
    }
    let scene = place.json("tree/tiny/scene.json");
    let parts = scene["trajectories"].as_array().unwrap();
    let names: Vec<&str> = parts.iter().map(|part| part["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["base", "base/left", "base/right", "base/frames"]);
    assert_eq!(parts[3]["mounted"]["camera"]["width"], 32);
    assert_eq!(parts[3]["mounted"]["camera_from_body"][0][3], -0.05);
    // Its noise has another seed.
    let seeds: Vec<&Value> = [1, 2].map(|i| &parts[i]["sensor"]["seed"]).to_vec();
    assert_ne!(seeds[0], seeds[1]);
}

/// Two cameras at the same place with the same intrinsics see the same frames, and their noise differs.
#[test]
fn noise_differs_where_nothing_else_does() {
    let place = Workspace::new();
    let twins = "rig: { cameras: [{ name: a }, { name: b }] }\noutputs: [events, sharp]\n";
    let (head, _) = RIG.split_once("rig:\n").unwrap();
    place.write("tiny.yaml", format!("{head}{twins}licence: {{ expression: CC0-1.0, holder: Nobody }}\n"));
    place.ok("release --to tree tiny.yaml");
    let files = tree(&place.path("tree/tiny/base"));
    assert_eq!(files["a/sharp/000005.png"], files["b/sharp/000005.png"]);
    assert_ne!(files["a/events.h5"], files["b/events.h5"]);
}

/// Velocity between the poses: that of the spline through the poses of a camera, the lever arm on the spline
/// of the body, and differences of its own poses.
#[test]
fn velocities_of_a_camera_are_those_of_its_lever_arm_and_of_its_differences() {
    let mount = CameraMount {
        position: DVec3::new(0.3, -0.2, 0.4),
        rotation: exp_vector(DVec3::new(0.1, 0.4, -0.2)),
    };
    let body = |t: f64| Se3 {
        rotation: exp_vector(DVec3::new(0.0, 0.0, 2.0 * t))
            * exp_vector(DVec3::new(0.8 * libm::sin(3.0 * t), 0.0, 0.0)),
        translation: DVec3::new(libm::sin(2.0 * t), libm::cos(5.0 * t), 0.3 * libm::sin(4.0 * t)),
    };
    let worst = |n: u32| {
        let times: Vec<f64> = (0..=n).map(|j| f64::from(j) / f64::from(n)).collect();
        let on_body: Vec<Se3> = times.iter().map(|t| body(*t)).collect();
        let trajectory =
            Trajectory { world_from_camera: on_body.clone(), stamps_us: (0..=i64::from(n)).collect() };
        let camera = trajectory.of_mounted(&mount).world_from_camera;
        let carried = SampledPath::with_end_rates(&on_body, times.clone()).unwrap();
        let path = SampledPath::with_end_rates(&camera, times).unwrap();
        (1..40).fold([0.0f64; 2], |[lever, own], k| {
            let t = f64::from(k) / 41.0;
            let (pose, velocity) = path.at(t);
            // v + R (w x t), in the axes of the camera.
            let of_body = carried.motion(t);
            let place = of_body.pose.rotation * of_body.angular.cross(mount.position) + of_body.velocity;
            let found = pose.rotation * velocity.linear;
            // Central differences of the path itself: their error is h^2/6 of third derivatives below 1e3.
            let h = 1e-5;
            let (before, after) = (path.at(t - h).0, path.at(t + h).0);
            let slope = (after.translation - before.translation) / (2.0 * h);
            let turn = log_vector(before.rotation.conjugate() * after.rotation) / (2.0 * h);
            let own_error = (found - slope).length().max((velocity.angular - turn).length());
            [lever.max((found - place).length()), own.max(own_error)]
        })
    };
    let (coarse, fine) = (worst(50), worst(100));
    assert!(coarse[1] < 1e-6 && fine[1] < 1e-6, "{coarse:?} {fine:?}");
    // The slope of a cubic spline is of the third order at least.
    let order = libm::log2(coarse[0] / fine[0]);
    assert!(order > 2.7 && fine[0] < 1e-3, "{order} {coarse:?} {fine:?}");
}

/// A speed in pixels is that of the first camera of the rig, whose lever arm adds to the motion of the body.
#[test]
fn a_speed_in_pixels_is_that_of_the_first_camera() {
    let place = Workspace::new();
    let (head, _) = RIG.split_once("rig:\n").unwrap();
    let head =
        head.replace("function: \"0.25*sin(t) + 1.1\"", "flow: { px_s: 300 }").replace(", factor: 2", "");
    let rig = "rig:\n  cameras:\n    - { name: arm, extrinsic: { position: [0.6, -0.3, 0.4] } }\n    - { name: body }\n";
    let rest = "outputs: [flow]\nlicence: { expression: CC0-1.0, holder: Nobody }\n";
    place.write("tiny.yaml", format!("{head}{rig}{rest}"));
    place.ok("release --copy --to tree tiny.yaml");
    let mean_speed = |camera: &str| {
        let folder = place.path(&format!("tree/tiny/base/{camera}/flow"));
        let mut files: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        let medians = files.iter().map(|file| {
            let flow = array(file, &[48, 64, 2]);
            let pixels = flow.as_chunks::<2>().0.iter().filter(|[x, _]| !x.is_nan());
            let mut speeds: Vec<f64> =
                pixels.map(|[x, y]| libm::hypot(f64::from(*x), f64::from(*y))).collect();
            speeds.sort_by(f64::total_cmp);
            speeds[speeds.len() / 2]
        });
        let medians: Vec<f64> = medians.collect();
        assert!(medians.len() >= 5, "{}", medians.len());
        medians.iter().sum::<f64>() / medians.len() as f64
    };
    let (arm, body) = (mean_speed("arm"), mean_speed("body"));
    println!("{arm:.1} px/s with the lever arm, {body:.1} without");
    // Poses are equally far in time, so their mean is the mean over the trajectory but for its ends.
    assert!((arm / 300.0 - 1.0).abs() < 0.02, "{arm}");
    assert!((body - arm).abs() > 0.03 * 300.0, "the lever arm matters: {body}");
}

/// A camera of this test, in the pixels of `scene.json`, with k1, k2, p1, p2 of its lens.
struct StatedCamera {
    f: [f64; 2],
    c: [f64; 2],
    k: [f64; 4],
}

impl StatedCamera {
    fn of(part: &Value) -> Self {
        let number = |key: &str| part[key].as_f64().unwrap();
        let k = |i: usize| part["lens"]["opencv"][i].as_f64().unwrap_or(0.0);
        Self { f: [number("fx"), number("fy")], c: [number("cx"), number("cy")], k: [0, 1, 2, 3].map(k) }
    }

    /// The ray of a pixel of a camera without a lens.
    fn ray(&self, x: f64, y: f64) -> DVec3 {
        assert!(self.k.iter().all(|k| k.abs() == 0.0));
        DVec3::new((x - self.c[0]) / self.f[0], (y - self.c[1]) / self.f[1], 1.0)
    }

    fn project(&self, p: DVec3) -> [f64; 2] {
        let (x, y, [k1, k2, p1, p2]) = (p.x / p.z, p.y / p.z, self.k);
        let r2 = x * x + y * y;
        let gain = 1.0 + k1 * r2 + k2 * r2 * r2;
        let seen = [
            x * gain + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * gain + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        [0, 1].map(|k| self.f[k] * seen[k] + self.c[k])
    }
}

/// Bilinear value of a map at a place in its pixels, with the centre of the first pixel at (0, 0).
fn sampled(map: &[f32], channels: usize, channel: usize, [x, y]: [f64; 2]) -> Option<f64> {
    let [left, top] = [x, y].map(f64::floor);
    if left < 0.0 || top < 0.0 || left >= 63.0 || top >= 47.0 {
        return None;
    }
    let at = |i: usize, j: usize| f64::from(map[(j * 64 + i) * channels + channel]);
    let (i, j, a, b) = (left as usize, top as usize, x - left, y - top);
    let rows = [0, 1].map(|down| at(i, j + down) * (1.0 - a) + at(i + 1, j + down) * a);
    Some(rows[0] * (1.0 - b) + rows[1] * b)
}

/// A pixel of the left camera with its depth is a point. The right camera sees it, and the maps of both
/// cameras take both places to one row, as far apart as the written disparity.
#[test]
fn the_rectified_pair_reprojects_within_a_twentieth_of_a_pixel() {
    let place = released();
    let scene = place.json("tree/tiny/scene.json");
    let part = |i: usize| StatedCamera::of(&scene["trajectories"][i]["mounted"]["camera"]);
    let (left, right) = (part(1), part(2));
    let maps = ["left", "right"].map(|name| {
        array(&place.path(&format!("tree/tiny/base/calibration/{name}_rectify_map.npy")), &[48, 64, 2])
    });
    let [at_left, at_right] =
        ["base/left", "base/right"].map(|folder| poses(place, folder).world_from_camera);
    let (mut apart, mut rows, mut seen_again, mut near) = (Vec::new(), Vec::new(), 0, 0);
    for pose in [0, 5, 11] {
        let of = |camera: &str, kind: &str| {
            array(&place.path(&format!("tree/tiny/base/{camera}/{kind}/{pose:06}.npy")), &[48, 64])
        };
        let (depth, other, disparity) = (of("left", "depth"), of("right", "depth"), of("left", "disparity"));
        assert!(depth.iter().zip(&disparity).all(|(z, d)| z.is_nan() == d.is_nan()));
        let opaque = (0..48 * 64).filter(|i| !depth[*i].is_nan());
        for i in opaque {
            let (x, y) = (f64::from((i % 64) as u32) + 0.5, f64::from((i / 64) as u32) + 0.5);
            let world =
                at_left[pose].rotation * (left.ray(x, y) * f64::from(depth[i])) + at_left[pose].translation;
            let back = at_right[pose].inverse();
            let point = back.rotation * world + back.translation;
            let there = right.project(point).map(|v| v - 0.5);
            let [own, second] = [0, 1].map(|channel| f64::from(maps[0][2 * i + channel]));
            let (Some(column), Some(row)) = (sampled(&maps[1], 2, 0, there), sampled(&maps[1], 2, 1, there))
            else {
                continue;
            };
            apart.push((own - column - f64::from(disparity[i])).abs());
            rows.push((second - row).abs());
            // Where the right camera sees no nearer surface, its depth is that of the point.
            let found = sampled(&other, 1, 0, there).filter(|z| z.is_finite());
            if let Some(found) = found {
                seen_again += 1;
                near += usize::from((found / point.z - 1.0).abs() < 0.05);
            }
        }
    }
    let at = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() * 99 / 100]
    };
    assert!(apart.len() > 1000, "{}", apart.len());
    let (apart, rows) = (at(&mut apart), at(&mut rows));
    println!(
        "99 %: disparity within {apart:.2e} px, rows within {rows:.2e} px; {near} of {seen_again} depths agree"
    );
    // Maps of 32 bits, read between pixels of a homography: its second differences are below 1e-2.
    assert!(apart < 0.05 && rows < 0.05, "{apart} {rows}");
    // Edges of splats are soft, and what is occluded differs.
    assert!(near * 10 > seen_again * 8, "{near} of {seen_again}");
}

const CV2: &str = r#"
import sys, yaml, numpy as np, cv2, json
folder, scene = sys.argv[1], json.load(open(sys.argv[2]))
dsec = yaml.safe_load(open(folder + "/cam_to_cam.yaml"))
kalibr = yaml.safe_load(open(folder + "/camchain.yaml"))
def matrix(fx, fy, cx, cy):
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
K = [matrix(*dsec["intrinsics"][f"cam{k}"]["camera_matrix"]) for k in (0, 1)]
size = tuple(dsec["intrinsics"]["cam0"]["resolution"])
motion = np.array(dsec["extrinsics"]["T_10"])
assert np.abs(motion - np.array(kalibr["cam1"]["T_cn_cnm1"])).max() < 1e-15
for k, name in enumerate(["left", "right", "frames"]):
    part = next(p for p in scene["trajectories"] if p["name"] == "base/" + name)["mounted"]
    assert np.array_equal(kalibr[f"cam{k}"]["T_cam_imu"], part["camera_from_body"])
    c = part["camera"]
    assert kalibr[f"cam{k}"]["intrinsics"] == [c["fx"], c["fy"], c["cx"] - 0.5, c["cy"] - 0.5]
    assert kalibr[f"cam{k}"]["resolution"] == [c["width"], c["height"]]
D = [np.array(dsec["intrinsics"][f"cam{k}"]["distortion_coeffs"]) for k in (0, 1)]
assert D[0].tolist() == [0, 0, 0, 0] and D[1].tolist() == [-0.05, 0.01, 0.001, -0.0005]
models = [dsec["intrinsics"][f"cam{k}"]["distortion_model"] for k in (0, 1, 2)]
assert models == ["radtan", "radtan", "equidistant"], models
assert dsec["intrinsics"]["cam2"]["distortion_coeffs"] == [0.02, -0.01, 0.002, -0.0005]
for k in (0, 1, 2):
    assert all(kalibr[f"cam{k}"][key] == dsec["intrinsics"][f"cam{k}"][key] for key in ("distortion_model", "distortion_coeffs"))
    assert dsec["intrinsics"].get(f"camRect{k}", {}).get("distortion_coeffs", [0] * 4) == [0] * 4
R1, R2, P1, P2, Q, *_ = cv2.stereoRectify(
    K[0], D[0], K[1], D[1], size, motion[:3, :3].copy(), motion[:3, 3:].copy(), flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1)
rotations = [np.array(dsec["extrinsics"][f"R_rect{k}"]) for k in (0, 1)]
rect = [matrix(*dsec["intrinsics"][f"camRect{k}"]["camera_matrix"]) for k in (0, 1)]
ours = np.array(dsec["disparity_to_depth"]["cams_01"])
off = [np.abs(rotations[0] - R1).max(), np.abs(rotations[1] - R2).max(), np.abs(rect[0] - P1[:, :3]).max() / P1[0, 0],
       np.abs(rect[1] - P2[:, :3]).max() / P2[0, 0], (np.abs(ours - Q) / np.maximum(np.abs(Q), 1)).max()]
print("rotations, camera matrices and Q differ by", off)
assert max(off) < 1e-6, off
for k, name in enumerate(["left", "right"]):
    remap = np.load(f"{folder}/{name}_remap.npy")
    x, y = cv2.initUndistortRectifyMap(K[k], D[k], rotations[k], rect[k], size, cv2.CV_32FC1)
    # Both have 32 bits, whose last one is 8e-6 px at 64 px.
    off = np.abs(remap - np.stack([x, y], -1)).max()
    assert off < 1e-5, off
    grid = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1).reshape(-1, 1, 2).astype(np.float64)
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    if hasattr(cv2, "undistortPointsIter"):
        forward = cv2.undistortPointsIter(grid, K[k], D[k], rotations[k], rect[k], until)
    else:
        forward = cv2.undistortPoints(grid, K[k], D[k], R=rotations[k], P=rect[k], criteria=until)
    forward = forward.reshape(size[1], size[0], 2)
    off = np.abs(np.load(f"{folder}/{name}_rectify_map.npy") - forward).max()
    assert off < 1e-5, off
"#;

#[test]
fn opencv_rectifies_alike() {
    let ready = Command::new("python3").args(["-c", "import cv2, numpy, yaml"]).output();
    if !ready.is_ok_and(|ended| ended.status.success()) {
        return absent("REQUIRE_READERS", "python3 with numpy, yaml and cv2 is absent");
    }
    let place = released();
    let (folder, scene) = (place.path("tree/tiny/base/calibration"), place.path("tree/tiny/scene.json"));
    let mut command = Command::new("python3");
    let ended = command.args(["-c", CV2]).arg(folder).arg(scene).output().unwrap();
    println!("{}", String::from_utf8_lossy(&ended.stdout));
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
}

/// Calibration and poses follow from the recipe and from the path of the body, whatever the sums say.
#[test]
fn an_audit_composes_calibration_and_poses_again() {
    let copy = tempfile::tempdir().unwrap();
    let folder = copy.path();
    for (name, bytes) in tree(&released().path("tree")) {
        let target = folder.join(name);
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::write(target, bytes).unwrap();
    }
    let found = |damage: &dyn Fn()| -> Vec<String> {
        damage();
        reseal(folder);
        let faults = audit_release(folder).unwrap().faults;
        faults.into_iter().filter(|f| f.code.name() == "not-composed").filter_map(|f| f.file).collect()
    };
    let edit = |name: &str, from: &str, to: &str| {
        let path = folder.join(name);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{name}: {text}");
        std::fs::write(path, text.replacen(from, to, 1)).unwrap();
    };
    let kalibr = "tiny/base/calibration/camchain.yaml";
    let damage = || edit(kalibr, "resolution: [64, 48]", "resolution: [64, 49]");
    assert!(found(&damage).contains(&kalibr.to_owned()));
    edit(kalibr, "resolution: [64, 49]", "resolution: [64, 48]");
    let poses = "tiny/base/right/poses.txt";
    // By the last bit of one number, which everything else in the tree follows.
    let moved = || {
        let mut path =
            Trajectory::read_poses(BufReader::new(File::open(folder.join(poses)).unwrap())).unwrap();
        let x = &mut path.world_from_camera[3].translation.x;
        *x = f64::from_bits(x.to_bits() + 1);
        path.write_poses(File::create(folder.join(poses)).unwrap()).unwrap();
    };
    assert!(found(&moved).contains(&poses.to_owned()));
}

/// The loader reads bodies and cameras.
#[test]
fn the_loader_reads_a_rig() {
    let place = released();
    crate::loader::ask(&place.path("tree"), &["rig", place.path("tree/tiny").to_str().unwrap()]);
}

/// Each fault ends with its place, what was found and what is wanted.
#[test]
fn faulty_rigs_are_named() {
    let t = |from: &str, to: &str, said: &[&str]| {
        assert!(RIG.contains(from), "{from}");
        let place = Workspace::new();
        place.write("tiny.yaml", RIG.replacen(from, to, 1));
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{to}: {}", ended.stderr);
        for part in said {
            assert!(ended.stderr.contains(part), "{to}: nothing of `{part}` in {}", ended.stderr);
        }
    };
    t("0.03, 0.998549]", "0.03, 0.9]", &["tiny.yaml:17:", "not orthonormal", "wanted at most"]);
    t("[[1, 0, 0, -0.05]", "[[-1, 0, 0, -0.05]", &["reflection", "wanted 1"]);
    t("[0, 0, 0, 1]]", "[0, 0, 1, 1]]", &["last row", "wanted [0, 0, 0, 1]"]);
    t("name: frames", "name: depth", &["\"depth\"", "a file of the release"]);
    t("name: frames", "name: LEFT", &["the name of an earlier camera"]);
    t("outputs: [sharp]", "outputs: [flow]", &["names flow", "does not ask for"]);
    t("outputs: [sharp]", "outputs: [imu]", &["names imu", "belongs to the body"]);
    t("outputs: [sharp]", "outputs: [disparity]", &["first camera of a stereo pair"]);
    t("[[left, right]]", "[[left, middle]]", &["unknown camera", "middle"]);
    t("[[left, right]]", "[[left, left]]", &["in a pair already"]);
    t("[[left, right]]", "[[left, frames]]", &["wanted one size"]);
    t("  stereo: [[left, right]]\n", "", &["disparity needs a pair", "rig.stereo"]);
    t("position: [0.12, 0.01, -0.02]", "position: [0, 0, 0]", &["wanted a baseline"]);
    t("    - { name: left }\n", "    - { name: left, extrinsic: { position: [1, 2] } }\n", &["position"]);
}

/// The full form of a recipe is its own full form, and a camera's numbers keep their bits.
#[test]
fn the_full_form_is_a_recipe() {
    let place = released();
    let recipe = place.json("tree/tiny/scene.json")["recipe"].clone();
    place.write("again.yaml", recipe.to_string());
    assert_eq!(place.stale("again.yaml"), [""; 0]);
}
