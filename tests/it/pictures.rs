//! Blurred frames, depth and flow of a release, compared with independent answers: frames of the
//! render verb with the formulas of sRGB, and projections of points from consecutive poses.

use crate::release::small::{copy, edit, gs2e, read, release, reseal};
use crate::support::workspace::{TINY, Workspace};
use gs2e_image::png;
use gs2e_scene::blobs::{ColourBlob, blob_scene};
use gs2e_scene::ply;
use serde_json::{Value, json};
use std::fs;
use std::io::Cursor;
use std::path::Path;

const BASE: &str = "small/one/base";

fn json_of(folder: &Path, path: &str) -> Value {
    serde_json::from_slice(&fs::read(folder.join(path)).unwrap()).unwrap()
}

fn array(path: &Path) -> (Vec<u64>, Vec<f32>) {
    let file = npyz::NpyFile::new(Cursor::new(fs::read(path).unwrap())).unwrap();
    (file.shape().to_vec(), file.into_vec().unwrap())
}

#[test]
fn a_release_states_its_pictures() {
    let scene = json_of(release(), "small/one/scene.json");
    assert_eq!(scene["attributes"]["data_type"], json!(["sharp", "blurry"]));
    assert_eq!(scene["trajectories"][0]["blur"], json!({ "frames": 15, "stride": 15, "subframes": 1 }));
    assert_eq!(scene["recipe"]["blur"], json!({ "frames": 15, "subframes": "auto" }));
    let below = |kind: &str| {
        let files = read(&release().join(BASE).join(kind));
        files.into_keys().collect::<Vec<_>>()
    };
    assert_eq!(below("blur"), ["000008.png"]);
    assert_eq!(below("depth"), ["000000.npy", "000012.npy"]);
    assert_eq!(below("flow"), ["000000.npy", "000012.npy"]);
    let frames = json_of(release(), &format!("{BASE}/transforms.json"))["frames"].clone();
    let blurred: Vec<&Value> =
        frames.as_array().unwrap().iter().filter(|f| f.get("blur_file_path").is_some()).collect();
    let [frame] = blurred[..] else { panic!("{blurred:?}") };
    assert_eq!(
        (&frame["file_path"], &frame["blur_file_path"]),
        (&json!("sharp/000008.png"), &json!("blur/000008.png"))
    );
    // 15 frames of 1/2400 s around 8/2400 s.
    assert_eq!((&frame["exposure_start_us"], &frame["exposure_end_us"]), (&json!(208), &json!(6458)));
    let card = fs::read_to_string(release().join("README.md")).unwrap();
    assert!(card.contains("sharp frames, 3 blurred frames, 5 depth images, 5 flow images"), "{card}");
}

/// IEC 61966-2-1.
fn light(v: f64) -> f64 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn display(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// Writes the scene of a recipe as a `.ply`.
fn scene_ply(place: &Workspace, recipe: &str) {
    let steps: Vec<Value> = serde_json::from_str(&place.ok(&format!("plan --json {recipe}")).stdout).unwrap();
    let outputs =
        steps.iter().find(|step| step["step"] == "reconstruct").unwrap()["outputs"].as_array().unwrap();
    let ply = outputs.iter().find(|output| output["role"] == "scene.ply").unwrap();
    place.write("scene.ply", fs::read(place.path(ply["path"].as_str().unwrap())).unwrap());
}

/// Compares every blurred frame with the mean of the frames that the render verb makes at the poses
/// of its exposure.
#[test]
fn a_blurred_frame_is_the_mean_of_the_dense_ones() {
    let place = Workspace::new();
    place.write("tiny.yaml", TINY.replace("[events, sharp]", "[sharp, blur]\nblur: { frames: 3 }"));
    place.ok("release --copy --to out tiny.yaml");
    scene_ply(&place, "tiny.yaml");
    let frames = json_of(&place.path("out"), "tiny/base/transforms.json")["frames"].as_array().unwrap().len();
    assert_eq!(frames, 12);
    let picture = |j: usize| -> Vec<f64> {
        let view = "out/tiny/base/transforms.json";
        place.ok(&format!(
            "render -q --scene scene.ply --view {view} --index {j} --backend cpu --out frame.npy"
        ));
        array(&place.path("frame.npy")).1.into_iter().map(|v| light(f64::from(v))).collect()
    };
    for centre in [2, 5, 8] {
        let [a, b, c] = [centre - 1, centre, centre + 1].map(picture);
        let found = fs::read(place.path(&format!("out/tiny/base/blur/{centre:06}.png"))).unwrap();
        let found = png::read_rgb(Cursor::new(found)).unwrap();
        let mut others = 0;
        for (i, byte) in found.pixels().as_flattened().iter().enumerate() {
            let wanted = 255.0 * display((a[i] + b[i] + c[i]) / 3.0);
            // Half a level, and the rounding of 32-bit colours.
            assert!((f64::from(*byte) - wanted).abs() < 0.5001, "{centre}, {i}: {byte}, wanted {wanted}");
            others += usize::from(a[i].to_bits() != b[i].to_bits());
        }
        assert!(others > 1000, "things moved: {others}");
    }
    assert!(!place.path("out/tiny/base/blur/000011.png").exists(), "it would end behind the last pose");
}

/// A small light that a camera passes at 6 px per frame leaves a streak that is even along its
/// length. The three dense frames alone would show three lights.
#[test]
fn a_light_that_passes_leaves_a_streak() {
    let place = Workspace::new();
    let frame = |i: u32| {
        let x = 0.4 * f64::from(i) - 2.2;
        json!({ "file_path": format!("{i}.png"), "transform_matrix": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]] })
    };
    let frames: Vec<Value> = (0..12).map(frame).collect();
    let camera = json!({ "w": 96, "h": 9, "fl_x": 60, "fl_y": 60, "cx": 48, "cy": 4.5, "frames": frames });
    place.write("transforms.json", camera.to_string());
    let lamp = ColourBlob {
        position: [0.0; 3],
        deviations: [0.05; 3],
        opacity: 0.9,
        colour: [1.0; 3],
        ..ColourBlob::default()
    };
    let mut ply_bytes = Vec::new();
    ply::write_ply(&blob_scene(&[lamp]), &mut ply_bytes).unwrap();
    place.write("scene.ply", ply_bytes);
    let recipe = |name: &str, subframes: &str| {
        format!(
            "version: 1\nscene: {name}\nsource: {{ nerfstudio: {{ path: transforms.json }} }}\n\
             reconstruct: {{ given: {{ path: scene.ply }} }}\n\
             trajectories: [{{ name: base, refine: {{ window: 0, factor: 1 }} }}]\n\
             outputs: [blur]\nblur: {{ frames: 3, subframes: {subframes} }}\n"
        )
    };
    place.write("auto.yaml", recipe("auto", "auto"));
    place.write("literal.yaml", recipe("literal", "literal"));
    place.ok("release --copy --to out auto.yaml literal.yaml");
    let blur = |scene: &str| {
        json_of(&place.path("out"), &format!("{scene}/scene.json"))["trajectories"][0]["blur"].clone()
    };
    // The smallest odd number that is not below 6.
    assert_eq!(blur("auto"), json!({ "frames": 3, "stride": 3, "subframes": 7 }));
    assert_eq!(blur("literal"), json!({ "frames": 3, "stride": 3, "subframes": 1 }));
    // Without sharp frames all poses are listed, and some have a blurred one.
    let frames = json_of(&place.path("out"), "auto/base/transforms.json")["frames"].clone();
    let has = |key: &str| frames.as_array().unwrap().iter().filter(|frame| frame.get(key).is_some()).count();
    assert_eq!((has("t_us"), has("blur_file_path"), has("file_path")), (12, 3, 0));
    // At pose 5 the camera is at -0.30 by the default speed, so the light is at 48 + 4.5 px; the
    // streak extends 9 px to either side.
    let streak = |scene: &str| -> Vec<f64> {
        let bytes = fs::read(place.path(&format!("out/{scene}/base/blur/000005.png"))).unwrap();
        let image = png::read_rgb(Cursor::new(bytes)).unwrap();
        let row = &image.pixels()[4 * 96..5 * 96];
        (46..59).map(|x| light(f64::from(row[x][0]) / 255.0)).collect()
    };
    let evenness = |streak: Vec<f64>| {
        let most = streak.iter().copied().fold(0.0, f64::max);
        streak.iter().copied().fold(f64::INFINITY, f64::min) / most
    };
    let [even, ghosts] = ["auto", "literal"].map(|scene| evenness(streak(scene)));
    eprintln!("darkest over brightest of a streak: {even:.3}, of the dense frames alone {ghosts:.3}");
    assert!(even > 0.9 && ghosts < 0.1, "{even}, {ghosts}");
}

/// The mean of encoded values: the sharp frames have 8 bits, so their mean is known to half a step,
/// and the blurred picture is rounded by half a step too.
#[test]
fn a_blurred_frame_may_be_the_mean_of_encoded_values() {
    let place = Workspace::new();
    let recipe = |scene: &str, mean: &str| {
        let blur =
            format!("outputs: [events, sharp, blur]\nblur: {{ frames: 3, subframes: literal{mean} }}\n");
        TINY.replace("scene: tiny", &format!("scene: {scene}")).replace("outputs: [events, sharp]\n", &blur)
    };
    place.write("recipes/encoded.yaml", recipe("encoded", ", mean: encoded"));
    place.write("recipes/light.yaml", recipe("light", ""));
    place.ok("release -q --copy --to out");
    let out = place.path("out");
    let part = |scene: &str| json_of(&out, &format!("{scene}/scene.json"))["trajectories"][0]["blur"].clone();
    assert_eq!(part("encoded"), json!({ "frames": 3, "stride": 3, "subframes": 1, "mean": "encoded" }));
    assert_eq!(part("light"), json!({ "frames": 3, "stride": 3, "subframes": 1 }));
    let picture = |path: &str| png::read_rgb(Cursor::new(fs::read(out.join(path)).unwrap())).unwrap();
    let values = |path: &str| picture(path).pixels().as_flattened().to_vec();
    let sharp = [1, 2, 3].map(|pose| values(&format!("encoded/base/sharp/{pose:06}.png")));
    let blurred = values("encoded/base/blur/000002.png");
    let worst = (0..blurred.len()).map(|i| {
        let mean = sharp.iter().map(|frame| f64::from(frame[i])).sum::<f64>() / 3.0;
        (mean - f64::from(blurred[i])).abs()
    });
    assert!(worst.fold(0.0, f64::max) <= 1.0);
    assert!(blurred != values("light/base/blur/000002.png"));
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.contains("are means of encoded values, not of linear light: encoded."), "{card}");
    let checked = place.gs2e("check --tree out");
    assert_eq!(checked.code, 0, "{}{}", checked.stdout, checked.stderr);
    // The loader's mean of five encoded pictures is met.
    let export = |scene: &str, format: &str| {
        place.gs2e(&format!("export out --scene {scene} --to {format} --out {scene}-{format}")).stderr
    };
    let losses = |scene: &str| export(scene, "e2nerf").contains("blur.light");
    assert_eq!(["encoded", "light"].map(losses), [false, true]);
}

/// Camera to world as released: `t_us tx ty tz qx qy qz qw`.
fn poses(path: &Path) -> Vec<[f64; 8]> {
    let text = fs::read_to_string(path).unwrap();
    let row =
        |line: &str| line.split(' ').map(|v| v.parse().unwrap()).collect::<Vec<f64>>().try_into().unwrap();
    text.lines().map(row).collect()
}

fn turn(pose: &[f64; 8]) -> glam::DQuat {
    glam::DQuat::from_xyzw(pose[4], pose[5], pose[6], pose[7])
}

fn centre(pose: &[f64; 8]) -> glam::DVec3 {
    glam::DVec3::new(pose[1], pose[2], pose[3])
}

/// The point at a pixel's depth is projected into the two poses before and the two after. Their
/// difference of fourth order in time is the flow, except for `h^4/30` of its fourth derivative,
/// and except where the path is only twice differentiable.
#[test]
fn flow_is_the_motion_of_points_between_poses() {
    let base = release().join(BASE);
    let poses = poses(&base.join("poses.txt"));
    let file = json_of(&base, "transforms.json");
    let [fx, fy, cx, cy] = ["fl_x", "fl_y", "cx", "cy"].map(|key| file[key].as_f64().unwrap());
    let j = 12;
    let (shape, depth) = array(&base.join(format!("depth/{j:06}.npy")));
    assert_eq!(shape, [48, 64]);
    let (shape, flow) = array(&base.join(format!("flow/{j:06}.npy")));
    assert_eq!(shape, [48, 64, 2]);
    let seen = |world: glam::DVec3, pose: &[f64; 8]| {
        let p = turn(pose).inverse() * (world - centre(pose));
        [fx * p.x / p.z + cx, fy * p.y / p.z + cy]
    };
    let (mut worst, mut fastest, mut count) = (0.0_f64, 0.0_f64, 0);
    for (i, z) in depth.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
        let (x, y, z) = ((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5, f64::from(*z));
        let camera = glam::DVec3::new((x - cx) / fx * z, (y - cy) / fy * z, z);
        let world = turn(&poses[j]) * camera + centre(&poses[j]);
        let near = [j - 2, j - 1, j + 1, j + 2].map(|k| seen(world, &poses[k]));
        for axis in 0..2 {
            let [a, b, c, d] = near.map(|at| at[axis]);
            let wanted = (8.0 * (c - b) - (d - a)) / 12.0 * 2400.0;
            worst = worst.max((f64::from(flow[2 * i + axis]) - wanted).abs());
            fastest = fastest.max(wanted.abs());
        }
        count += 1;
    }
    eprintln!("{count} pixels, at most {fastest:.1} px/s, off by {worst:.4} px/s at most");
    assert!(count > 1000 && fastest > 100.0, "{count} pixels, {fastest} px/s");
    assert!(worst < 1e-4 * fastest, "{worst} of {fastest} px/s");
}

/// The audit finds missing pictures that the recipe asks for, and reads the pictures that are
/// there.
#[test]
fn pictures_are_audited() {
    let t = |change: &dyn Fn(&Path), code: &str, words: &str| {
        let folder = copy();
        change(&folder.path().join(BASE));
        reseal(folder.path());
        let output = gs2e(folder.path(), &["audit", "--json", "."]);
        assert_eq!(output.status.code(), Some(3), "{words}");
        let message = String::from_utf8(output.stdout).unwrap();
        assert!(message.contains(code) && message.contains(words), "{code}, {words}: {message}");
    };
    for name in ["blur/000008.png", "depth/000012.npy", "flow/000000.npy"] {
        t(&|base| fs::remove_file(base.join(name)).unwrap(), "scene-incomplete", name);
    }
    let put = |name: &'static str, at: usize, value: f32| {
        move |base: &Path| {
            let mut bytes = fs::read(base.join(name)).unwrap();
            bytes[128 + 4 * at..][..4].copy_from_slice(&value.to_le_bytes());
            fs::write(base.join(name), bytes).unwrap();
        }
    };
    t(&put("depth/000012.npy", 5, -1.0), "unreadable", "-1, which is not a valid depth");
    t(&put("flow/000012.npy", 5, f32::INFINITY), "unreadable", "inf, which is not a valid flow");
    let shape = |base: &Path| {
        fs::copy(base.join("depth/000012.npy"), base.join("flow/000012.npy")).unwrap();
    };
    t(&shape, "unreadable", "wanted [48, 64, 2]");
    let timed = |base: &Path| {
        edit(base, "transforms.json", |file| {
            let frames = file["frames"].as_array_mut().unwrap();
            let blurred = frames.iter_mut().find(|frame| frame.get("blur_file_path").is_some()).unwrap();
            blurred["exposure_end_us"] = json!(6875);
        });
    };
    t(&timed, "claims-disagree", "exposure");
    // This number of names would not fit into any memory.
    let poses = |base: &Path| {
        edit(base.parent().unwrap(), "scene.json", |file| {
            file["trajectories"][0]["poses"] = json!(1_000_000_000_000_000_u64);
        });
    };
    t(&poses, "claims-disagree", "scene.json says 1000000000000000 until");
}

/// A camera so fast that pictures lie between the poses, from where other Gaussians are visible.
#[test]
fn threads_and_omissions_change_no_byte() {
    let place = Workspace::new();
    let quick = TINY
        .replace("arc: 6", "arc: 60")
        .replace("[events, sharp]", "[blur, depth, flow]\nblur: { frames: 3 }");
    place.write("tiny.yaml", quick);
    place.ok("release --copy --store one --to one-out -j 1 tiny.yaml");
    place.ok("release --copy --store two --to two-out -j 3 --no-omit tiny.yaml");
    let blur = json_of(&place.path("one-out"), "tiny/scene.json")["trajectories"][0]["blur"].clone();
    assert!(blur["subframes"].as_u64().unwrap() > 1, "{blur}");
    for (kind, count) in [("blur", 3), ("depth", 12), ("flow", 12)] {
        let [one, two] =
            ["one-out", "two-out"].map(|out| read(&place.path(&format!("{out}/tiny/base/{kind}"))));
        assert!(one == two && one.len() == count, "{kind}: {} and {} files", one.len(), two.len());
    }
}

#[test]
fn a_trajectory_too_short_for_an_exposure_is_reported() {
    let place = Workspace::new();
    place.write("tiny.yaml", TINY.replace("[events, sharp]", "[blur]"));
    let ended = place.gs2e("build tiny.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let wanted =
        "the trajectory has 12 poses, but an exposure of 15 frames needs 17; lower `frames` in `blur`";
    assert!(ended.stderr.contains(wanted), "{}", ended.stderr);
}

/// A scene pays only for its own outputs: without blur it has no blur step, and other products stay
/// up to date.
#[test]
fn each_kind_is_a_step_of_its_own() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    let more = TINY.replace("[events, sharp]", "[events, sharp, blur, depth, flow]\nblur: { frames: 5 }");
    place.write("tiny.yaml", &more);
    assert_eq!(place.stale("tiny.yaml"), ["tiny/base/blur", "tiny/base/depth", "tiny/base/flow"]);
    place.ok("build -q tiny.yaml");
    place.write("tiny.yaml", more.replace("frames: 5", "frames: 7"));
    assert_eq!(place.stale("tiny.yaml"), ["tiny/base/blur"]);
    // There are fewer sharp frames, but those in the middle of exposures are kept.
    place.write("tiny.yaml", format!("{more}sharp: {{ every: 4 }}\n"));
    assert_eq!(place.stale("tiny.yaml"), ["tiny/base/sharp", "tiny/base/checks"]);
    place.ok("release --copy --to out tiny.yaml");
    let names: Vec<String> = read(&place.path("out/tiny/base/sharp")).into_keys().collect();
    assert_eq!(names, ["000000.png", "000003.png", "000004.png", "000008.png"]);
}
