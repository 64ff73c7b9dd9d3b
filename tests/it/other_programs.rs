//! Trajectories compared with other programs: COLMAP, which finds poses again in real renderings,
//! and OpenCV and h5py, which read the released files. If one is absent, a message goes to stderr;
//! with `REQUIRE_COLMAP=1` or `REQUIRE_OPENCV=1` that is a failure.

use crate::support::absent::absent;
use crate::support::foreign::{colmap_is_there, programs};
use crate::support::shared;
use crate::support::steps::recipe;
use crate::support::workspace::Workspace;
use glam::{DQuat, DVec3};
use gs2e_image::{Size, png};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene as scene;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use gs2e_source as source;
use gs2e_source::foreign::colmap::{ColmapPoses, ColmapRegistration};
use gs2e_source::foreign::opencv::{OpencvGeometry, ReleasedPoses};
use gs2e_source::foreign::{TrajectoryPicture, colmap, opencv, versions};
use gs2e_source::reconstruct::ProgramWorkspace;
use gs2e_trajectory::Trajectory;
use serde_json::{Value, json};
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Returns true if Python has OpenCV and h5py.
fn python_is_there() -> bool {
    let programs = programs();
    let there =
        versions::python(&programs).is_ok_and(|p| p.numpy.is_some() && p.cv2.is_some() && p.h5py.is_some());
    if !there {
        absent("REQUIRE_OPENCV", &versions::packages(&programs));
    }
    there
}

/// A camera that moves past a real scene, with one picture per pose.
struct Filmed {
    folder: tempfile::TempDir,
    camera: Camera,
    trajectory: Trajectory,
    pictures: Vec<TrajectoryPicture>,
}

impl Filmed {
    /// The first `count` views of the small scene, 6 degrees apart.
    fn views(count: usize) -> Option<Self> {
        let [file, views] = ["playbot_lod3.ply", "playbot.transforms.json"]
            .map(|name| shared::path(&format!("data/scenes/{name}")));
        let (capture, _) = source::nerfstudio::read_capture(&views?).unwrap();
        let gaussians = Arc::new(scene::read_file(&file?).unwrap());
        let style = RenderStyle {
            rules: RenderRules::Official,
            order: LayerOrder::Depth,
            antialiased: false,
            background: [0.0; 3],
        };
        let mut renderer = CpuRenderer::new(gaussians, style).unwrap();
        let camera = capture.views[0].camera.resized(Size { width: 640, height: 360 });
        let poses: Vec<Se3> = capture.views.iter().take(count).map(|view| view.world_from_camera).collect();
        let folder = tempfile::tempdir().unwrap();
        let mut picture = |(pose, at): (usize, &Se3)| {
            let mut rendered = RenderedImages::default();
            let want = ChannelSet { rgb: true, ..ChannelSet::default() };
            renderer.render(&CameraView::at_rest(camera, *at), want, &mut rendered).unwrap();
            let file = folder.path().join(format!("picture {pose}"));
            png::write_image(&png::to_bytes(&rendered.rgb.unwrap()), File::create(&file).unwrap()).unwrap();
            TrajectoryPicture { pose, file }
        };
        let pictures = poses.iter().enumerate().map(&mut picture).collect();
        let stamps_us = (0..).map(|j| 1000 * j).take(poses.len()).collect();
        Some(Self {
            camera,
            trajectory: Trajectory { world_from_camera: poses, stamps_us },
            pictures,
            folder,
        })
    }

    /// Runs `ask` in a new working folder; `name` must be unused.
    fn in_workspace<T>(&self, name: &str, ask: impl FnOnce(ProgramWorkspace<'_>) -> T) -> T {
        let folder = self.folder.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        let (log, programs) = (folder.join("log"), programs());
        ask(ProgramWorkspace { folder: &folder, log: &log, goes_on: &|| true, programs: &programs })
    }

    /// The trajectory, with a change applied to each pose.
    fn with(&self, change: impl Fn(usize, Se3) -> Se3) -> Trajectory {
        let mut trajectory = self.trajectory.clone();
        for (j, pose) in trajectory.world_from_camera.iter_mut().enumerate() {
            *pose = change(j, *pose);
        }
        trajectory
    }

    /// OpenCV's measurements of another trajectory's released files.
    fn seen(&self, name: &str, released: &ReleasedPoses, pictures: &[TrajectoryPicture]) -> OpencvGeometry {
        let (camera, trajectory) = (&self.camera, &self.trajectory);
        self.in_workspace(name, |workspace| {
            opencv::measure_released(released, camera, trajectory, pictures, workspace)
        })
        .unwrap()
        .unwrap()
    }
}

fn median(registration: &ColmapRegistration) -> f64 {
    gs2e_num::stats::upper_median(registration.poses.iter().map(|p| p.rotation_deg).collect()).unwrap()
}

fn worst(registration: &ColmapRegistration) -> (usize, f64) {
    let worst = registration.poses.iter().max_by(|a, b| a.rotation_deg.total_cmp(&b.rotation_deg)).unwrap();
    (worst.pose, worst.rotation_deg)
}

/// A planted change of the pose with this number.
type Change = Box<dyn Fn(usize, Se3) -> Se3>;

/// Turns a pose into OpenGL's axes, where OpenCV's are expected.
fn opengl(pose: Se3) -> Se3 {
    Se3 { rotation: pose.rotation * DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0), ..pose }
}

#[test]
fn colmap_finds_the_poses_of_real_pictures_and_the_wrong_pose() {
    let Some(filmed) = Filmed::views(10).filter(|_| colmap_is_there()) else { return };
    let found: ColmapPoses = filmed
        .in_workspace("a", |workspace| colmap::register_pictures(&filmed.pictures, &filmed.camera, workspace))
        .unwrap()
        .unwrap();
    let against = |trajectory: &Trajectory| found.clone().against(&trajectory.world_from_camera);
    let sound = against(&filmed.trajectory);
    let farthest = sound.poses.iter().map(|p| p.translation).fold(0.0, f64::max);
    eprintln!(
        "median {:.4}, worst {:.4} degrees; {farthest:.5} of the path",
        median(&sound),
        worst(&sound).1
    );
    assert_eq!(sound.poses.len(), filmed.pictures.len());
    assert!(median(&sound) < 0.1 && worst(&sound).1 < 0.5 && farthest < 0.01, "{sound:?}");

    for wrong in [0, 4, 9] {
        let turned = filmed.with(|j, pose| {
            let turn =
                if j == wrong { exp_vector(DVec3::new(0.6, -0.8, 0.0) * DEGREE) } else { DQuat::IDENTITY };
            Se3 { rotation: pose.rotation * turn, ..pose }
        });
        let (pose, degrees) = worst(&against(&turned));
        assert!(pose == wrong && (0.5..1.5).contains(&degrees), "{pose} by {degrees}");
    }
    for planted in [filmed.with(|_, pose| opengl(pose)), filmed.with(|_, pose| pose.inverse())] {
        assert!(median(&against(&planted)) > 1.0);
    }
}

#[test]
fn equal_pictures_are_found_at_equal_places_by_colmap() {
    let Some(filmed) = Filmed::views(4).filter(|_| colmap_is_there()) else { return };
    let find = |name| {
        filmed.in_workspace(name, |workspace| {
            colmap::register_pictures(&filmed.pictures, &filmed.camera, workspace)
        })
    };
    let [one, other] = ["a", "b"].map(|name| find(name).unwrap().unwrap());
    assert_eq!(one, other);
    // Two pictures are too few, and an empty picture cannot be registered.
    let few = &filmed.pictures[..2];
    let found = filmed
        .in_workspace("c", |workspace| colmap::register_pictures(few, &filmed.camera, workspace))
        .unwrap();
    assert_eq!(found.unwrap_err(), "there are 2 pictures, 3 are the fewest");
    let blank: Vec<TrajectoryPicture> =
        (0..4).map(|pose| TrajectoryPicture { pose, file: filmed.folder.path().join("blank") }).collect();
    let grey = gs2e_image::Image::filled(filmed.camera.size, [90u8; 3]);
    png::write_image(&grey, File::create(&blank[0].file).unwrap()).unwrap();
    let found = filmed
        .in_workspace("d", |workspace| colmap::register_pictures(&blank, &filmed.camera, workspace))
        .unwrap();
    assert!(found.as_ref().unwrap_err().ends_with("finds no key points shared by two pictures"), "{found:?}");
}

#[test]
fn a_failed_program_is_reported_with_its_output() {
    let Some(filmed) = Filmed::views(3).filter(|_| colmap_is_there() && python_is_there()) else { return };
    let broken: Vec<TrajectoryPicture> = filmed
        .pictures
        .iter()
        .map(|p| TrajectoryPicture { file: filmed.folder.path().join("none"), ..*p })
        .collect();
    std::fs::write(filmed.folder.path().join("none"), "no picture").unwrap();
    let released = ReleasedPoses::from_trajectory(&filmed.camera, &filmed.trajectory, &filmed.pictures);
    let (camera, trajectory) = (&filmed.camera, &filmed.trajectory);
    let error = filmed
        .in_workspace("b", |workspace| {
            opencv::measure_released(&released, camera, trajectory, &broken, workspace)
        })
        .unwrap_err();
    assert_eq!(error.to_string(), "run python3: it ended with exit code 1");
    let gs2e_source::foreign::ForeignError::Failed(failed) = error else { panic!("{error}") };
    assert!(failed.last.iter().any(|line| line.contains("OpenCV cannot read")), "{:?}", failed.last);
}

#[test]
fn opencv_agrees_with_the_renderer_and_finds_wrong_files() {
    let Some(filmed) = Filmed::views(12).filter(|_| python_is_there()) else { return };
    let Filmed { camera, trajectory, pictures, .. } = &filmed;
    let sound = filmed.seen("sound", &ReleasedPoses::from_trajectory(camera, trajectory, pictures), pictures);
    eprintln!("{sound:?}");
    for seen in [sound.poses_txt, sound.transforms_json] {
        assert!(seen.px < 1e-6 && seen.points == 12 * 75, "{seen:?}");
    }
    assert!(sound.pairs.len() >= 8);
    let half = |value: fn(&opencv::RelativeMotion) -> f64| {
        gs2e_num::stats::upper_median(sound.pairs.iter().map(value).collect()).unwrap()
    };
    assert!(half(|m| m.rotation_deg) < 0.5 && half(|m| m.direction_deg) < 10.0, "{:?}", sound.pairs);

    let turned = exp_vector(DVec3::Y * DEGREE);
    let planted: [(&str, Change); 4] = [
        ("opengl", Box::new(|_, pose| opengl(pose))),
        ("inverse", Box::new(|_, pose| pose.inverse())),
        (
            "one by a degree",
            Box::new(move |j, p| if j == 5 { Se3 { rotation: p.rotation * turned, ..p } } else { p }),
        ),
        ("shift", Box::new(|_, p| Se3 { translation: p.translation + DVec3::X * 1e-4, ..p })),
    ];
    for (name, change) in planted {
        // The renderer's poses stay unchanged: only the files are wrong.
        let seen =
            filmed.seen(name, &ReleasedPoses::from_trajectory(camera, &filmed.with(change), pictures), &[]);
        for file in [seen.poses_txt, seen.transforms_json] {
            assert!(file.px > 1e-3, "{name}: {file:?}");
        }
    }
    let other = Camera { cx: camera.cx + 0.5, ..*camera };
    let seen = filmed.seen("centre", &ReleasedPoses::from_trajectory(&other, trajectory, pictures), &[]);
    assert!((seen.transforms_json.px - 0.5).abs() < 1e-6, "{seen:?}");
}

#[test]
fn motions_that_pictures_do_not_show_are_found_by_opencv() {
    let Some(filmed) = Filmed::views(8).filter(|_| python_is_there()) else { return };
    // Every second pose is turned, so each motion is wrong by 2 degrees.
    let turn = exp_vector(DVec3::Y * 2.0 * DEGREE);
    let planted = filmed.with(|j, p| if j % 2 == 1 { Se3 { rotation: p.rotation * turn, ..p } } else { p });
    let released = ReleasedPoses::from_trajectory(&filmed.camera, &planted, &filmed.pictures);
    let seen = filmed.seen("a", &released, &filmed.pictures);
    let half = gs2e_num::stats::upper_median(seen.pairs.iter().map(|m| m.rotation_deg).collect()).unwrap();
    assert!(seen.pairs.len() >= 3 && half > 1.0, "{:?}", seen.pairs);
}

/// Exit code of `gs2e check`, and its records of the checks that run other programs.
fn asked(place: &Workspace, more: &str, path: Option<&Path>) -> (i32, Vec<Value>) {
    let mut command = place.command(&format!("check --json --recipes recipe.yaml {more}"));
    if let Some(path) = path {
        command.env("PATH", path);
    }
    let ended = command.output().unwrap();
    let text = String::from_utf8(ended.stdout).unwrap();
    let all = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let named =
        |f: &Value| ["pose_colmap", "pose_opencv", "readback"].iter().any(|name| f["check"] == **name);
    (ended.status.code().unwrap(), all.filter(named).collect())
}

#[test]
fn no_program_runs_without_a_request_in_the_recipe() {
    let place = Workspace::new();
    place.write("recipe.yaml", recipe("plain").to_string());
    assert!(!place.build("recipe.yaml").contains(&"plain/base/foreign".to_owned()));
    let (code, found) = asked(&place, "", None);
    assert_eq!((code, found.len()), (0, 3));
    for finding in &found {
        let name = finding["check"].as_str().unwrap();
        let because = format!("the recipe does not request it; `checks: {{ {name}: {{}} }}` does");
        assert_eq!((&finding["verdict"], &finding["because"]), (&"not-run".into(), &because.into()));
    }
    assert_eq!(asked(&place, "--require readback", None).0, 3);
}

#[test]
fn absent_programs_are_reported_and_run_once_installed() {
    let place = Workspace::new();
    let mut value = recipe("asks");
    value["outputs"] = json!(["events", "sharp"]);
    value["checks"] = json!({ "pose_colmap": {}, "pose_opencv": {}, "readback": {} });
    place.write("recipe.yaml", value.to_string());
    let nothing = tempfile::tempdir().unwrap();
    let without = |arguments: &str| {
        let output = place.command(arguments).env("PATH", nothing.path()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    without("build recipe.yaml");
    let (code, found) = asked(&place, "", Some(nothing.path()));
    let seen: Vec<&str> = found.iter().map(|f| f["because"].as_str().unwrap()).collect();
    let [colmap, python] = ["colmap", "python3"].map(|name| format!("there is no program `{name}`"));
    assert_eq!((code, seen), (0, vec![python.as_str(), &colmap, &python]));
    assert_eq!(asked(&place, "--require pose_colmap", Some(nothing.path())).0, 3);
    let again: Vec<Value> = serde_json::from_str(&without("plan --json recipe.yaml")).unwrap();
    assert!(again.iter().all(|step| step["action"] == "keep"), "{again:?}");

    if !python_is_there() {
        return;
    }
    assert_eq!(place.stale("recipe.yaml"), ["asks/base/foreign", "asks/base/checks"]);
    place.ok("build recipe.yaml");
    let (_, found) = asked(&place, "", None);
    let part = |part: &str| {
        let ends = |f: &&Value| f["subject"].as_str().unwrap().ends_with(part);
        found.iter().find(ends).unwrap_or_else(|| panic!("{part}: {found:?}"))
    };
    for sound in ["#events", "#index", "#pictures", "#projection"] {
        assert_eq!(part(sound)["verdict"], "pass", "{}", part(sound));
    }
    assert!(part("#projection")["measured"].as_f64().unwrap() < 1e-6);
    assert_eq!(place.build("recipe.yaml"), [""; 0], "what was asked is up to date");
    place.ok("build --recheck 100% recipe.yaml");
}

/// Runs a real scene through the whole program.
#[test]
fn a_real_trajectory_agrees_with_colmap_and_opencv() {
    let (Some(scene), Some(views)) =
        (shared::path("data/scenes/playbot_lod3.ply"), shared::path("data/scenes/playbot.transforms.json"))
    else {
        return;
    };
    if !colmap_is_there() || !python_is_there() {
        return;
    }
    let mut value = recipe("playbot");
    value["source"] = json!({ "nerfstudio": { "path": views } });
    value["reconstruct"] = json!({ "given": { "path": scene } });
    value["camera"] = json!({ "width": 640, "height": 360 });
    value["licence"] = json!({ "expression": "CC-BY-4.0", "holder": "Stephane Agullo" });
    value["outputs"] = json!(["sharp"]);
    value["sharp"] = json!({ "every": 2 });
    value["checks"] = json!({ "pose_colmap": { "frames": 16 }, "pose_opencv": {}, "readback": {} });
    let place = Workspace::new();
    place.write("recipe.yaml", value.to_string());
    place.ok("build recipe.yaml");
    let (code, found) = asked(&place, "", None);
    found.iter().for_each(|f| eprintln!("{} {} {}", f["verdict"], f["subject"], f["because"]));
    assert_eq!(code, 0);
    let passed: Vec<&str> = found
        .iter()
        .filter(|f| f["verdict"] == "pass")
        .map(|f| f["subject"].as_str().unwrap().trim_start_matches("playbot/base#"))
        .collect();
    let wanted = [
        "pictures",
        "registered",
        "rotation",
        "rotation-worst",
        "translation",
        "projection",
        "relative-rotation",
        "relative-direction",
    ];
    assert_eq!(passed, wanted, "{found:#?}");
    // A new limit judges the old answer again and runs no program.
    value["checks"]["pose_colmap"] = json!({ "frames": 16, "max_deg": 1e-6 });
    place.write("recipe.yaml", value.to_string());
    assert_eq!(place.build("recipe.yaml"), ["playbot/base/checks"]);
    assert_eq!(asked(&place, "", None).0, 3);
}
