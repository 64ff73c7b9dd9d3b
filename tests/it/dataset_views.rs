//! `gs2e check --events` with frames, poses, camera and depth: a release of this program in the files of
//! a stranger, sound and with planted faults.

use crate::planted_geometry::{POSES, release};
use crate::support::workspace::Workspace;
use glam::{DMat3, DQuat};
use gs2e_num::se3::{OPENCV_FROM_OPENGL, Se3};
use gs2e_trajectory::Trajectory;
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Steps of the depth PNGs per scene unit: 0.1 mm, if a unit is a metre.
const STEPS: f64 = 10_000.0;
const SIZE: [u32; 2] = [80, 60];

fn place_of_release() -> std::path::PathBuf {
    release().join("lab/base")
}

fn poses() -> Trajectory {
    let bytes = fs::read(place_of_release().join("poses.txt")).unwrap();
    Trajectory::read_poses(bytes.as_slice()).unwrap()
}

/// Depth of a pose, from the end of its `.npy`.
fn depths(pose: usize) -> Vec<f32> {
    let bytes = fs::read(place_of_release().join(format!("depth/{pose:06}.npy"))).unwrap();
    let head = bytes.len() - 4 * (SIZE[0] * SIZE[1]) as usize;
    bytes[head..].as_chunks().0.iter().map(|number| f32::from_le_bytes(*number)).collect()
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "16 bits hold 6.5 units")]
fn write_depth_png(path: &Path, depths: &[f32]) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), SIZE[0], SIZE[1]);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let step = |depth: &f32| (STEPS * f64::from(*depth)).round() as u16;
    let bytes: Vec<u8> = depths.iter().flat_map(|depth| step(depth).to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
}

/// The files of a stranger: times in seconds, poses between the frames, and other names.
fn stranger(change: impl Fn(usize, &Se3) -> Se3, frame_of: impl Fn(usize) -> usize) -> Workspace {
    let (place, trajectory, source) = (Workspace::new(), poses(), place_of_release());
    for folder in ["images", "depths"] {
        fs::create_dir(place.path(folder)).unwrap();
    }
    fs::copy(source.join("events.h5"), place.path("events.h5")).unwrap();
    let (mut stamps, mut lines) = (String::new(), "# t x y z qx qy qz qw\n".to_owned());
    for (pose, t_us) in trajectory.stamps_us.iter().enumerate() {
        let frame = source.join(format!("sharp/{:06}.png", frame_of(pose)));
        fs::copy(frame, place.path(&format!("images/frame{pose}.png"))).unwrap();
        write_depth_png(&place.path(&format!("depths/frame{pose}.png")), &depths(pose));
        let t = *t_us as f64 * 1e-6;
        writeln!(stamps, "{t:.6}").unwrap();
        let Se3 { rotation: q, translation: p } = change(pose, &trajectory.world_from_camera[pose]);
        writeln!(lines, "{t:.6} {} {} {} {} {} {} {}", p.x, p.y, p.z, q.x, q.y, q.z, q.w).unwrap();
    }
    place.write("stamps.txt", stamps);
    place.write("poses.txt", lines);
    fs::copy(source.join("transforms.json"), place.path("transforms.json")).unwrap();
    let camera: Value =
        serde_json::from_str(&fs::read_to_string(place.path("transforms.json")).unwrap()).unwrap();
    let [fx, fy, cx, cy] = ["fl_x", "fl_y", "cx", "cy"].map(|key| camera[key].as_f64().unwrap());
    place.write("camera.txt", format!("{fx} {fy} {cx} {cy}\n"));
    place.write(
        "cameras.txt",
        format!("# Camera list\n1 PINHOLE {} {} {fx} {fy} {cx} {cy}\n", SIZE[0], SIZE[1]),
    );
    place
}

const FILES: &str = "check --events events.h5 --frames images --stamps stamps.txt --poses poses.txt --json";

/// The findings on geometry: `check#part`, verdict and reason.
fn geometry(place: &Workspace, args: &str) -> Vec<[String; 3]> {
    let ended = place.gs2e(&format!("{FILES} {args}"));
    assert!(!ended.stdout.is_empty(), "{}", ended.stderr);
    let text = |finding: &Value, key: &str| finding[key].as_str().unwrap().to_owned();
    let findings = ended.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let wanted = ["photometric", "depth_consistency", "motion"];
    let of_geometry = findings.filter(|finding| wanted.contains(&finding["check"].as_str().unwrap()));
    of_geometry
        .map(|finding| {
            let part = text(&finding, "subject").replace("events.h5", "");
            [
                format!("{}{part}", text(&finding, "check")),
                text(&finding, "verdict"),
                text(&finding, "because"),
            ]
        })
        .collect()
}

fn failures(findings: &[[String; 3]]) -> Vec<&str> {
    findings.iter().filter(|[_, verdict, _]| verdict == "fail").map(|[name, ..]| name.as_str()).collect()
}

#[test]
fn a_sound_set_passes_with_each_form_of_camera_and_depth() {
    let place = stranger(|_, pose| *pose, |j| j);
    let source = place_of_release().join("depth");
    let source = source.to_string_lossy();
    for args in [
        format!("--camera transforms.json --depth depths --depth-scale {STEPS}"),
        format!("--camera camera.txt --depth depths --depth-scale {STEPS}"),
        format!("--camera cameras.txt --depth {source}"),
    ] {
        let findings = geometry(&place, &args);
        let passed: Vec<&str> = findings
            .iter()
            .filter(|[name, verdict, _]| {
                verdict == "pass" && name != "motion#median" && name != "motion#windows"
            })
            .map(|[name, ..]| name.as_str())
            .collect();
        let wanted = [
            "photometric#motion",
            "photometric#frames",
            "photometric#order",
            "depth_consistency#motion",
            "depth_consistency#frames",
        ];
        assert_eq!(passed, wanted, "{args}: {findings:#?}");
        assert!(findings.iter().any(|[name, ..]| name.starts_with("motion")), "{findings:#?}");
        assert_eq!(failures(&findings), [""; 0], "{args}: {findings:#?}");
    }
}

#[test]
fn usual_mistakes_of_a_stranger_are_found_and_named() {
    let flip = DQuat::from_mat3(&DMat3::from_diagonal(OPENCV_FROM_OPENGL));
    let opengl = move |_: usize, pose: &Se3| Se3 { rotation: pose.rotation * flip, ..*pose };
    let right = format!("--camera camera.txt --depth depths --depth-scale {STEPS}");
    let doubled = format!("--camera camera.txt --depth depths --depth-scale {}", 2.0 * STEPS);
    let reversed = |j: usize| POSES - 1 - j;
    let sets: [(&str, Workspace, &str, &str); 4] = [
        ("OpenGL axes", stranger(opengl, |j| j), &right, "camera axes of OpenGL"),
        ("inverted poses", stranger(|_, pose| pose.inverse(), |j| j), &right, "inverted"),
        ("frames in reverse order", stranger(|_, pose| *pose, reversed), &right, ""),
        ("depth in another unit", stranger(|_, pose| *pose, |j| j), &doubled, "depths 2.00 times"),
    ];
    for (name, place, args, reading) in sets {
        let findings = geometry(&place, args);
        assert!(failures(&findings).contains(&"photometric#motion"), "{name}: {findings:#?}");
        let because = &findings.iter().find(|[name, ..]| name == "photometric#motion").unwrap()[2];
        assert!(because.contains(reading), "{name}: {because}");
    }
}

#[test]
fn incomplete_or_ambiguous_inputs_are_refused_with_help() {
    let place = stranger(|_, pose| *pose, |j| j);
    let refused = |args: &str, code: i32, wanted: &str| {
        let ended = place.gs2e(&format!("{} {args}", FILES.trim_end_matches(" --json")));
        assert!(
            ended.code == code && ended.stderr.contains(wanted),
            "{args}: {} {}",
            ended.code,
            ended.stderr
        );
    };
    refused("--depth depths", 2, "--camera");
    refused("--camera camera.txt --depth depths", 1, "--depth-scale");
    refused("--camera camera.txt --depth depths --depth-scale 0", 2, "above 0");
    fs::remove_file(place.path("depths/frame3.png")).unwrap();
    fs::rename(place.path("depths/frame4.png"), place.path("depths/other.png")).unwrap();
    refused("--camera camera.txt --depth depths --depth-scale 1000", 2, "29 depth images for 30 frames");
    place.write("camera.txt", "80 80 40 30 0.1 0 0 0 0\n");
    refused("--camera camera.txt --depth depths --depth-scale 1000", 1, "distortion");
}
