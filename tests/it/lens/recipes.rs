//! Lenses of recipes: files, flow and frames of a release, and faulty lenses.

use super::{CAMERA, RADIAL, differences, project, radial, ray_of};
use crate::support::workspace::Workspace;
use glam::DVec3;
use gs2e_image::{npy, png};
use gs2e_source::LensModel;
use gs2e_source::undistort::undistort_photo;
use gs2e_trajectory::Trajectory;
use std::fs::{self, File};
use std::io::{BufReader, Cursor};
use std::sync::OnceLock;

/// A recipe whose camera has the lens of [`radial`].
const RECIPE: &str = "\
version: 1
scene: tiny
seed: 7
source: { procedural: { kind: still-life, gaussians: 1500, views: 6, arc: 6, seed: 1 } }
camera: { width: 320, height: 240, fx: 200, fy: 210, cx: 163, cy: 118, lens: { opencv: [-0.28, 0.09, 0.001, -0.0015, -0.012] } }
trajectories:
  - name: base
    refine: { window: 2, factor: 2, curve: cubic }
    speed: { function: \"1.1\" }
sampling: { rate: 400, between: linear }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }
outputs: [events, sharp, depth, flow]
licence: { expression: CC0-1.0, holder: Nobody }
";

/// The release of [`RECIPE`], made once and never changed.
fn released() -> &'static Workspace {
    static RELEASED: OnceLock<Workspace> = OnceLock::new();
    RELEASED.get_or_init(|| Workspace::released(RECIPE, "--copy"))
}

#[test]
fn files_of_a_release_name_the_lens() {
    let place = released();
    place.ok("audit tree");
    place.ok("check --tree tree");
    let transforms = place.json("tree/tiny/base/transforms.json");
    assert_eq!(transforms["camera_model"], "OPENCV");
    for (name, k) in ["k1", "k2", "p1", "p2", "k3"].iter().zip(RADIAL) {
        assert_eq!(transforms[name], k, "{name}");
    }
    assert_eq!(place.json("tree/tiny/scene.json")["camera"]["lens"]["opencv"][4], RADIAL[4]);

    let said = fs::read_to_string(place.path("tree/README.md")).unwrap();
    assert!(said.contains("| tiny |  | opencv:-0.28,"), "{said}");
    assert!(fs::read_to_string(place.path("tree/report.html")).unwrap().contains(", lens opencv:-0.28,"));
    crate::loader::ask(&place.path("tree"), &["lens", place.path("tree/tiny").to_str().unwrap()]);

    // The key of a product has the lens; a layout whose loader assumes a pinhole is refused.
    place.write("changed/tiny.yaml", RECIPE.replace("-0.012]", "-0.011]"));
    assert!(place.stale("changed/tiny.yaml").iter().any(|step| step.ends_with("base/events")));
    let refused = place.gs2e("export --to e2nerf --out out tree");
    assert!(refused.code != 0 && refused.stderr.contains("assumes a pinhole"), "{}", refused.stderr);
}

/// The velocity of a pixel is that of its point, by depth, poses and the model of this test.
#[test]
fn the_flow_of_a_release_is_that_of_its_depths_and_poses() {
    let place = released();
    let poses = File::open(place.path("tree/tiny/base/poses.txt")).unwrap();
    let poses = Trajectory::read_poses(BufReader::new(poses)).unwrap();
    let array = |kind: &str, pose: usize, shape: &[u64]| -> Vec<f32> {
        let file = File::open(place.path(&format!("tree/tiny/base/{kind}/{pose:06}.npy"))).unwrap();
        npy::read_values(shape, &mut BufReader::new(file)).unwrap()
    };
    let pose = poses.stamps_us.len() / 2;
    let (depth, flow) = (array("depth", pose, &[240, 320]), array("flow", pose, &[240, 320, 2]));
    let (mut worst, mut fastest, mut count) = (0.0f64, 0.0f64, 0);
    for i in (0..depth.len()).step_by(61).filter(|i| !depth[*i].is_nan()) {
        let place = [i % 320, i / 320].map(|k| k as f64 + 0.5);
        let ([x, y], _) = ray_of(radial, place);
        let own = &poses.world_from_camera[pose];
        let world = own.rotation * (DVec3::new(x, y, 1.0) * f64::from(depth[i])) + own.translation;
        let at = |pose: usize| {
            let back = poses.world_from_camera[pose].inverse();
            project(radial, back.rotation * world + back.translation)
        };
        // Central differences over two steps and over one, from which the error of second order is taken out.
        let difference = |k: usize, axis: usize| {
            let seconds = (poses.stamps_us[pose + k] - poses.stamps_us[pose - k]) as f64 * 1e-6;
            (at(pose + k)[axis] - at(pose - k)[axis]) / seconds
        };
        for axis in [0, 1] {
            let wanted = (4.0 * difference(1, axis) - difference(2, axis)) / 3.0;
            worst = worst.max((wanted - f64::from(flow[2 * i + axis])).abs());
            fastest = fastest.max(wanted.abs());
            count += 1;
        }
    }
    println!("{count} components of the flow, up to {fastest:.0} px/s: within {worst:.2e} px/s");
    assert!(count > 500, "{count}");
    // The path is a cubic between its nodes, so differences over 10 ms keep an error of the third order
    // there.
    assert!(worst < 1e-3 * fastest, "{worst} of {fastest}");
}

/// An undistorted frame is the frame of the pinhole camera.
#[test]
fn frames_of_a_release_are_bent() {
    let (bent, straight) = (released(), Workspace::new());
    let pinhole = RECIPE.replace(", lens: { opencv: [-0.28, 0.09, 0.001, -0.0015, -0.012] }", "");
    straight.write("tiny.yaml", pinhole.replace("[events, sharp, depth, flow]", "[sharp]"));
    straight.ok("release --copy --to tree tiny.yaml");
    let picture = |place: &Workspace| {
        let file = fs::read(place.path("tree/tiny/base/sharp/000003.png")).unwrap();
        png::read_rgb(Cursor::new(file)).unwrap()
    };
    let (bent, straight) = (picture(bent), picture(&straight));
    let [k1, k2, p1, p2, k3] = RADIAL;
    let model = LensModel::FullOpenCv { k: [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0] };
    let undone = undistort_photo(&bent, &CAMERA, &model);
    let (apart, _) = differences(straight.pixels(), bent.pixels());
    let (mean, _) = differences(straight.pixels(), undone.pixels());
    // Splats of a few pixels have edges that both resamplings soften.
    assert!(mean < 2.0 && apart > 8.0 * mean, "{mean} {apart}");
}

#[test]
fn faulty_lenses_of_recipes_are_named() {
    let t = |lens: &str, said: &[&str]| {
        let place = Workspace::new();
        place.write("tiny.yaml", RECIPE.replace("{ opencv: [-0.28, 0.09, 0.001, -0.0015, -0.012] }", lens));
        let ended = place.gs2e("plan tiny.yaml");
        assert_eq!(ended.code, 2, "{lens}: {}", ended.stderr);
        for part in said {
            assert!(ended.stderr.contains(part), "{lens}: nothing of `{part}` in {}", ended.stderr);
        }
    };
    t("{ opencv: [1, 2, 3] }", &["tiny.yaml:5:", "found 3 numbers", "4, 5 or 8"]);
    t("{ fisheye: [0, 0, 0, 0, 0] }", &["found 5 numbers", "wanted 4"]);
    t("{ fisheye: [0, 0, 0, .inf] }", &["fisheye[3]", "wanted a finite number"]);
    t("{ thin: [0, 0, 0, 0] }", &["thin", "opencv"]);
    t("{ opencv: [-0.9, 0, 0, 0] }", &["shows no ray at pixel (0, 0)"]);
}
