//! `gs2e train`, and training as a step, on photos of a known scene.

use crate::support::given::{self, GIVEN};
use crate::support::gpu;
use crate::support::workspace::Workspace;
use gs2e_image::likeness::{mean_square, psnr_db};
use gs2e_image::{Image, png};
use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
use gs2e_scene as scene;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use gs2e_source::{Capture, nerfstudio};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Number of photos, and the distance between those that are held out.
const VIEWS: u32 = 9;
const HOLD_OUT: usize = 4;

/// Photos of the row of Gaussians from an arc of half a radian, with their poses.
pub(crate) fn photographed() -> Workspace {
    let place = Workspace::new();
    let frame = |i: u32| {
        let (sin, cos) = (0.06 * f64::from(i) - 0.24).sin_cos();
        let rows = [
            [cos, 0.0, sin, 4.0 * sin],
            [0.0, 1.0, 0.0, 0.0],
            [-sin, 0.0, cos, 4.0 * cos],
            [0.0, 0.0, 0.0, 1.0],
        ];
        json!({ "file_path": format!("images/{i:03}.png"), "transform_matrix": rows })
    };
    let frames: Vec<Value> = (0..VIEWS).map(frame).collect();
    let transforms =
        json!({ "w": 64, "h": 48, "fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "frames": frames });
    place.write("transforms.json", transforms.to_string());
    place.write("truth.ply", given::ply(|_, value| value));
    let truth = scene::read_file(&place.path("truth.ply")).unwrap();
    let capture = capture(&place);
    for (view, picture) in capture.views.iter().zip(renderings(truth, &capture)) {
        let mut bytes = Vec::new();
        png::write_image(&png::to_bytes(&picture), &mut bytes).unwrap();
        place.write(&view.name, bytes);
    }
    place
}

fn capture(place: &Workspace) -> Capture {
    nerfstudio::read_capture(&place.path("transforms.json")).unwrap().0
}

/// Pictures of all views by the renderer that users have, clipped as files are.
fn renderings(scene: Gaussians, capture: &Capture) -> Vec<Image<[f32; 3]>> {
    let style = RenderStyle {
        rules: RenderRules::Soft,
        order: LayerOrder::Depth,
        antialiased: false,
        background: [0.0; 3],
    };
    let mut renderer = CpuRenderer::new(Arc::new(scene), style).unwrap();
    let mut picture = |at: &CameraView| {
        let mut out = RenderedImages::default();
        renderer.render(at, ChannelSet { rgb: true, ..ChannelSet::NONE }, &mut out).unwrap();
        let mut rgb = out.rgb.unwrap();
        rgb.pixels_mut().as_flattened_mut().iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
        rgb
    };
    capture.views.iter().map(|v| picture(&CameraView::at_rest(v.camera, v.world_from_camera))).collect()
}

/// The photos as they are on disk.
fn photos(place: &Workspace, capture: &Capture) -> Vec<Image<[f32; 3]>> {
    let read = |name: &str| {
        let bytes = fs::read(place.path(name)).unwrap();
        let photo = png::read_rgb(std::io::Cursor::new(bytes)).unwrap();
        let pixels = photo.pixels().iter().map(|rgb| rgb.map(|v| f32::from(v) / 255.0)).collect();
        Image::from_vec(photo.size(), pixels)
    };
    capture.views.iter().map(|view| read(&view.name)).collect()
}

/// Writes the capture as a COLMAP model whose points are the means of the true Gaussians, without
/// their colours. Returns its `images.txt`.
fn write_model(place: &Workspace) -> String {
    let mut images = String::new();
    for (i, view) in capture(place).views.iter().enumerate() {
        let (q, c) = (view.world_from_camera.rotation.conjugate(), view.world_from_camera.translation);
        let (t, name) = (-(q * c), view.name.trim_start_matches("images/"));
        images += &format!("{} {} {} {} {} {} {} {} 1 {name}\n\n", i + 1, q.w, q.x, q.y, q.z, t.x, t.y, t.z);
    }
    let truth = scene::read_file(&place.path("truth.ply")).unwrap();
    let points = truth.positions.iter().zip(1..);
    let points: String =
        points.map(|([x, y, z], id)| format!("{id} {x} {y} {z} 128 128 128 0.5 1 0\n")).collect();
    place.write("sparse/0/images.txt", &images);
    place.write("sparse/0/cameras.txt", "1 PINHOLE 64 48 60 60 32 24\n");
    place.write("sparse/0/points3D.txt", points);
    images
}

const TRAIN: &str = "train --capture transforms.json --gaussians 300 --iterations 120 --hold-out 4 --seed 3";

/// The floor is a picture that knows the photos and ignores the pose: the mean of those trained on.
/// The figures of a view agree with the renderer and the photo.
#[test]
fn held_out_photos_are_shown_better_than_by_the_mean_photo() {
    let place = photographed();
    shows_held_out_photos(&place, &TRAIN.replace("120", "200"));
    write_model(&place);
    shows_held_out_photos(&place, &TRAIN.replace("transforms.json", ".").replace("120", "200"));
}

fn shows_held_out_photos(place: &Workspace, train: &str) {
    let ended = place.ok(&format!("{train} --out trained.ply --json"));
    let report: Value = serde_json::from_str(&ended.stdout).unwrap();
    let capture = capture(place);
    let photos = photos(place, &capture);
    let trained = scene::read_file(&place.path("trained.ply")).unwrap();
    assert!(trained.len() <= 300 && report["gaussians"] == trained.len(), "{report}");
    let shown = renderings(trained, &capture);
    let is_held = |i: &usize| i.is_multiple_of(HOLD_OUT);
    let others: Vec<&Image<[f32; 3]>> =
        (0..photos.len()).filter(|i| !is_held(i)).map(|i| &photos[i]).collect();
    let mean_at = |k: usize| {
        let sum = others
            .iter()
            .fold([0.0; 3], |sum: [f32; 3], photo| std::array::from_fn(|c| sum[c] + photo.pixels()[k][c]));
        sum.map(|v| v / others.len() as f32)
    };
    let size = photos[0].size();
    let mean = Image::from_vec(size, (0..size.pixels()).map(mean_at).collect());
    let held: Vec<usize> = (0..photos.len()).filter(is_held).collect();
    for (report, i) in report["held_out"].as_array().unwrap().iter().zip(&held) {
        let psnr = psnr_db(mean_square(&shown[*i], &photos[*i]));
        // Both are f64 sums over the same 32-bit pictures.
        assert!((report["psnr"].as_f64().unwrap() - psnr).abs() < 1e-9, "{report}, {psnr}");
        let name = report["name"].as_str().unwrap();
        assert_eq!(name.trim_start_matches("images/"), capture.views[*i].name.trim_start_matches("images/"));
    }
    let mean_psnr = |error: &dyn Fn(usize) -> f64| {
        held.iter().map(|i| psnr_db(error(*i))).sum::<f64>() / held.len() as f64
    };
    let found = mean_psnr(&|i| mean_square(&shown[i], &photos[i]));
    let floor = mean_psnr(&|i| mean_square(&mean, &photos[i]));
    assert!(found > floor, "{found} dB, the mean photo has {floor} dB");
    assert!((report["psnr"].as_f64().unwrap() - found).abs() < 1e-9);
}

#[test]
fn threads_and_interruptions_leave_no_trace() {
    let place = photographed();
    place.ok(&format!("{TRAIN} --out one.ply -j 1"));
    let whole = fs::read(place.path("one.ply")).unwrap();
    place.ok(&format!("{TRAIN} --out two.ply -j 2"));
    assert!(whole == fs::read(place.path("two.ply")).unwrap(), "one thread and two");
    // Killed as soon as there is a checkpoint, long before the end.
    let command = format!("{TRAIN} --out three.ply --checkpoint state");
    let mut child = place.spawn(&command);
    while !place.path("state").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended without a checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!place.path("three.ply").exists(), "it ended before it was killed");
    let again = place.ok(&command);
    assert!(!again.stderr.contains("\n6/120"), "it started again: {}", again.stderr);
    assert!(whole == fs::read(place.path("three.ply")).unwrap(), "killed and resumed");

    // Another training does not go on from it, and neither does a damaged one.
    let other =
        place.gs2e(&format!("{} --out four.ply --checkpoint state", TRAIN.replace("seed 3", "seed 4")));
    assert!(other.code == 1 && other.stderr.contains("it belongs to another training"), "{}", other.stderr);
    let mut bytes = fs::read(place.path("state")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    place.write("state", bytes);
    let damaged = place.gs2e(&command);
    assert!(damaged.code == 1 && damaged.stderr.contains("it is damaged"), "{}", damaged.stderr);
}

/// The bytes of a GPU are its own, but the scene is as good as that of the CPU.
#[test]
fn a_gpu_trains_the_scene_as_well() {
    if gpu::device().is_none() {
        return;
    }
    let place = photographed();
    let psnr = |arguments: &str| {
        let mut command = place.command_with_gpu(&format!("{TRAIN} --json {arguments}"));
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<Value>(&output.stdout).unwrap()["psnr"].as_f64().unwrap()
    };
    let by_cpu = psnr("--backend cpu --out cpu.ply --checkpoint by-cpu");
    let by_gpu = psnr("--backend gpu --out one.ply");
    // Seeds differ by some tenths of a decibel; roundings matter less.
    assert!((by_gpu - by_cpu).abs() < 1.0, "{by_gpu} dB on the GPU, {by_cpu} dB on the CPU");
    psnr("--backend gpu --out two.ply");
    assert!(fs::read(place.path("one.ply")).unwrap() == fs::read(place.path("two.ply")).unwrap());
    // A training that goes on elsewhere would have the bytes of neither.
    let mut command =
        place.command_with_gpu(&format!("{TRAIN} --backend gpu --out three.ply --checkpoint by-cpu"));
    let message = String::from_utf8(command.output().unwrap().stderr).unwrap();
    assert!(message.contains("it belongs to another training"), "{message}");
}

#[test]
fn a_back_end_without_gradients_is_refused() {
    let place = photographed();
    let ended = place.gs2e(&format!("{TRAIN} --backend reference --out x.ply"));
    assert!(ended.code == 2 && ended.stderr.contains("has no gradients"), "{}", ended.stderr);
    let without = place.gs2e(&format!("{TRAIN} --backend gpu --out x.ply"));
    assert!(without.code == 2 && without.stderr.contains("no GPU is available"), "{}", without.stderr);
    assert!(!place.path("x.ply").exists());
}

#[test]
fn unusable_captures_are_named() {
    let place = photographed();
    let t = |args: &str, code: i32, wanted: &str| {
        let ended = place.gs2e(args);
        assert_eq!((ended.code, ended.stdout.as_str()), (code, ""), "{args}: {}", ended.stderr);
        assert!(ended.stderr.contains(wanted), "{args}: {}", ended.stderr);
        assert!(!place.path("x.ply").exists(), "{args}");
    };
    let train = TRAIN.replace("--hold-out 4", "");
    t(&format!("{train} --out x.spz"), 2, "a trained scene is written as .ply");
    t(&format!("{train} --out x.ply --hold-out 1"), 2, "of 9 views, 0 have no photo and 9 are held out");
    t("train --capture nothing --out x.ply", 2, "nothing does not exist");

    // Colmap models with a world of their own: all points behind every camera, and no points.
    let images = write_model(&place);
    place.write("behind/sparse/0/images.txt", images);
    place.write("behind/sparse/0/cameras.txt", "1 PINHOLE 64 48 60 60 32 24\n");
    for view in &capture(&place).views {
        place.write(&format!("behind/{}", view.name), fs::read(place.path(&view.name)).unwrap());
    }
    place.write("behind/sparse/0/points3D.txt", "1 0 0 90 200 100 50 0.5\n2 1 0 95 200 100 50 0.5\n");
    t("train --capture behind --out x.ply", 2, "none of 2 points is in any photo");

    // A photo that ends early.
    let photo = fs::read(place.path("images/004.png")).unwrap();
    place.write("images/004.png", &photo[..photo.len() / 2]);
    t(&format!("{train} --out x.ply"), 1, "failed to read the photo");
    place.write("images/004.png", photo);
    t(&format!("{train} --out x.ply --until-psnr 0"), 2, "is not a number above 0");

    // Photos that are gone.
    (0..7).for_each(|i| fs::remove_file(place.path(&format!("images/{i:03}.png"))).unwrap());
    t(&format!("{train} --out x.ply"), 2, "of 9 views, 7 have no photo");
}

#[test]
fn a_budget_larger_than_the_memory_is_refused() {
    let place = photographed();
    let command = "train --capture transforms.json --out x.ply --iterations 1 --memory 100MB";
    // The smallest estimate of 200,000 Gaussians: their 236 bytes in the file, as parameters, two means
    // and gradients, is 189 MB.
    let ended = place.gs2e(&format!("{command} --gaussians 200000"));
    assert!(ended.code == 2 && ended.stderr.contains("the training needs about"), "{}", ended.stderr);
    assert!(ended.stderr.contains("budget 100.0 MB"), "{}", ended.stderr);
    assert!(ended.stderr.contains("lower --gaussians"), "{}", ended.stderr);
    assert!(!place.path("x.ply").exists());
    let ended = place.gs2e(&format!("{command} --gaussians 1000"));
    assert_eq!(ended.code, 0, "{}", ended.stderr);
}

/// A recipe that trains on the photos of [`photographed`], with `more` settings.
fn training_recipe(more: &str) -> String {
    let builtin =
        format!("reconstruct: {{ builtin: {{ gaussians: 200, iterations: 60, hold_out: 4{more} }} }}");
    GIVEN.replace("reconstruct: { given: { path: scene.ply } }", &builtin).replace(
        "outputs: [events, sharp]",
        "outputs: []\nrender: { rules: soft }\nlicence: { expression: CC0-1.0, holder: a test }",
    )
}

/// The files in a folder and below, by their paths in it.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = walkdir::WalkDir::new(folder).into_iter().filter_map(Result::ok);
    entries.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path).collect()
}

/// The outputs of the step that trains: names and digests.
fn trained_outputs(place: &Workspace, arguments: &str) -> Value {
    let ended = place.ok(&format!("build --json recipe.yaml {arguments}"));
    let steps = ended.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let mut training = steps.filter(|step| step["step"] == "given/reconstruct");
    let outputs = training.next().expect("the recipe trains")["outputs"].clone();
    // Paths hold the name of the store.
    let files = outputs.as_array().unwrap().iter();
    files.map(|file| json!([file["role"], file["digest"]])).collect()
}

#[test]
fn a_killed_build_goes_on_with_its_training() {
    let place = photographed();
    place.write("recipe.yaml", training_recipe("").replace("iterations: 60", "iterations: 120"));
    let whole = trained_outputs(&place, "--store one -j 1");
    assert!(whole.as_array().unwrap().iter().any(|file| file[0] == "scene.ply"), "{whole}");
    assert_eq!(trained_outputs(&place, "--store two -j 2"), whole, "one thread and two");

    let states = || files_below(&place.path("three/resume"));
    let mut child = place.spawn("build --store three recipe.yaml");
    while !states().iter().any(|path| path.ends_with("state")) {
        assert!(child.try_wait().unwrap().is_none(), "it ended without a checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();

    // Another recipe does not pick the state up: its key is another one.
    let text = fs::read_to_string(place.path("recipe.yaml")).unwrap();
    place.write("other.yaml", text.replace("hold_out: 4", "hold_out: 4, seed: 9"));
    let other = place.ok("build --store three other.yaml");
    assert!(other.stderr.contains("given/reconstruct: 6/120: loss "), "{}", other.stderr);
    assert!(states().iter().any(|path| path.ends_with("state")), "the state of the first recipe is gone");

    let resumed = place.ok("build --store three recipe.yaml");
    assert!(!resumed.stderr.contains(" 6/120: loss "), "it started again: {}", resumed.stderr);
    // Lines of progress are rationed, so the last one may be absent.
    assert!(resumed.stderr.contains("/120: loss "), "{}", resumed.stderr);
    assert_eq!(trained_outputs(&place, "--store three"), whole, "killed and resumed");
    assert_eq!(states(), [] as [PathBuf; 0], "a step that is made leaves no state");
}

#[test]
fn a_recipe_can_end_a_training_early() {
    let place = photographed();
    let t = |until: &str, ended: &str| {
        place.write("recipe.yaml", training_recipe(&format!(", until: {{ {until} }}")));
        let notes = place.ok("release --to tree --replace recipe.yaml").stderr;
        let text = fs::read(place.path("tree/given/scene.json")).unwrap();
        let training = serde_json::from_slice::<Value>(&text).unwrap()["reconstruction"]["training"].clone();
        assert_eq!(training["ended"], ended, "{training}");
        assert!(training["iterations"].as_u64().unwrap() < 60, "{training}");
        (training, notes)
    };
    let (training, _) = t("psnr: 1", "psnr");
    // The first report already has more than one decibel.
    assert_eq!(training["iterations"], 3, "{training}");
    let (_, notes) = t("minutes: 0.000001", "minutes");
    assert!(notes.contains("another run may make other bytes"), "{notes}");
}

/// As a step: trained once, judged by the photos, named in the release.
#[test]
fn a_recipe_trains_its_scene() {
    let place = photographed();
    let recipe = training_recipe("");
    place.write("recipe.yaml", &recipe);
    let made = place.build("recipe.yaml");
    assert!(made.contains(&"given/reconstruct".to_owned()), "{made:?}");
    assert!(place.stale("recipe.yaml").is_empty());

    // A limit of a check trains nothing; a seed does.
    place.write("limit.yaml", recipe.clone() + "checks: { recon_psnr: { mean: 12 } }\n");
    assert!(!place.stale("limit.yaml").contains(&"given/reconstruct".to_owned()));
    let seed = recipe.replace("hold_out: 4", "hold_out: 4, seed: 8");
    place.write("seed.yaml", seed);
    assert!(place.stale("seed.yaml").contains(&"given/reconstruct".to_owned()));

    place.write("recipe.yaml", recipe.replace("holder: a test", "holder: Your Lab"));
    let said = place.ok("release --to tree recipe.yaml").stderr;
    assert!(said.contains("the holder `Your Lab` is that of an example"), "{said}");
    place.ok("audit tree");
    // The terms of the official trainer are no terms of this scene.
    let card = fs::read_to_string(place.path("tree/README.md")).unwrap();
    assert!(!card.contains("3DGS") && !card.contains("3D Gaussian Splatting"), "{card}");
    let text = fs::read(place.path("tree/given/scene.json")).unwrap();
    let of = &serde_json::from_slice::<Value>(&text).unwrap()["reconstruction"];
    assert_eq!(
        (&of["kind"], &of["iterations"], &of["command"]),
        (&json!("builtin"), &json!(60), &Value::Null)
    );
    assert!(of["psnr"]["held_out"].as_f64().unwrap() > 12.0, "{of}");
    // The training held out other views than the convention: every fourth of nine.
    let held_out = of["training"]["held_out"].as_array().unwrap();
    let names: Vec<&str> = held_out.iter().map(|view| view["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["images/000.png", "images/004.png", "images/008.png"]);
    assert_eq!(of["training"]["course"].as_array().unwrap().len(), 20);
    let page = fs::read_to_string(place.path("tree/report.html")).unwrap();
    assert!(page.contains("Training: 6 photos, 60 iterations; 3 held-out photos"), "no word of the training");
}

/// The bytes of a checkpoint with these bytes at an offset, and a digest that fits them.
fn forged(sound: &[u8], at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut forged = sound[..sound.len() - 32].to_vec();
    forged[at..at + bytes.len()].copy_from_slice(bytes);
    let digest = blake3::hash(&forged);
    forged.extend(digest.as_bytes());
    forged
}

/// Offset of the iteration in a checkpoint: behind its magic number and its key.
const ITERATION: usize = 48;

/// Offset of the logits in a checkpoint: behind the numbers of the head, the course, and ten floats per
/// Gaussian.
fn logits(state: &[u8]) -> usize {
    let points = u32::from_le_bytes(state[92..96].try_into().unwrap()) as usize;
    let gaussians = usize::try_from(u64::from_le_bytes(state[52..60].try_into().unwrap())).unwrap();
    96 + 28 * points + 4 * 10 * gaussians
}

/// A digest is no signature: anyone can compute it.
#[test]
fn a_checkpoint_with_values_of_no_training_is_refused() {
    let place = photographed();
    let train = TRAIN.replace("120", "40");
    // Ends in the middle, where a checkpoint is of use.
    place.ok(&format!("{train} --out sound.ply --checkpoint state --until-psnr 1"));
    let sound = fs::read(place.path("state")).unwrap();
    let logits = logits(&sound);
    let t = |at: usize, bytes: &[u8], wanted: &str| {
        let state = forged(&sound, at, bytes);
        place.write("state", &state);
        let ended = place.gs2e(&format!("{train} --out x.ply --checkpoint state"));
        assert!(ended.code == 1 && ended.stderr.contains(wanted), "{wanted}: {}", ended.stderr);
        assert!(!place.path("x.ply").exists(), "{wanted}");
        assert!(fs::read(place.path("state")).unwrap() == state, "{wanted}: the file was changed");
    };
    t(ITERATION, &41_u32.to_le_bytes(), "it is at iteration 41 of 40");
    t(ITERATION, &u32::MAX.to_le_bytes(), "it is at iteration 4294967295 of 40");
    // Untrained, and said to be done.
    t(ITERATION, &40_u32.to_le_bytes(), "reports are not those of 40 iterations");
    t(ITERATION + 4, &u64::MAX.to_le_bytes(), "Gaussians, wanted 1 to 300");
    t(ITERATION + 4, &0_u64.to_le_bytes(), "it has 0 Gaussians, wanted 1 to 300");
    t(logits, &f32::INFINITY.to_le_bytes(), "it holds a number that is not finite");
    t(sound.len() - 36, &f32::NAN.to_le_bytes(), "it holds a number that is not finite");
    t(sound.len() - 36, &(-1.0_f32).to_le_bytes(), "it holds -1 where no number below 0 can be");
    place.write("state", &sound);
    place.ok(&format!("{train} --out x.ply --checkpoint state"));
    place.ok(&format!("{train} --out whole.ply"));
    assert!(fs::read(place.path("x.ply")).unwrap() == fs::read(place.path("whole.ply")).unwrap());
}

/// The state in a store is the program's own: the training starts again, and says so.
#[test]
fn a_kept_state_with_values_of_no_training_is_replaced() {
    let place = photographed();
    place.write("recipe.yaml", training_recipe("").replace("iterations: 60", "iterations: 120"));
    let whole = trained_outputs(&place, "--store one");
    let states = || files_below(&place.path("two/resume"));
    let mut child = place.spawn("build --store two recipe.yaml");
    while !states().iter().any(|path| path.ends_with("state")) {
        assert!(child.try_wait().unwrap().is_none(), "it ended without a checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let state = states().into_iter().find(|path| path.ends_with("state")).unwrap();
    let sound = fs::read(&state).unwrap();
    fs::write(&state, forged(&sound, ITERATION, &9999_u32.to_le_bytes())).unwrap();
    let ended = place.ok("build --store two recipe.yaml");
    assert!(ended.stderr.contains("the training started again, because its kept state"), "{}", ended.stderr);
    assert!(ended.stderr.contains("it is at iteration 9999 of 120"), "{}", ended.stderr);
    assert_eq!(trained_outputs(&place, "--store two"), whole);
}

/// The suffix of browsers for downloads, and of a name that `--checkpoint` itself may have.
#[test]
fn a_checkpoint_replaces_no_other_file() {
    let place = photographed();
    place.write("state.part", "precious");
    place.write("behind", "precious");
    std::os::unix::fs::symlink("behind", place.path("link.part")).unwrap();
    let made = std::process::Command::new("mkfifo").arg(place.path("pipe.part")).status().unwrap();
    assert!(made.success());
    let train = TRAIN.replace("120", "20");
    let names = || {
        let entries = fs::read_dir(place.path("")).unwrap().map(|entry| entry.unwrap().file_name());
        entries.map(|name| name.into_string().unwrap()).collect::<std::collections::BTreeSet<_>>()
    };
    let mut wanted = names();
    for checkpoint in ["state.ckpt", "link.ckpt", "pipe.ckpt", "own.part"] {
        place.ok(&format!("{train} --out x.ply --checkpoint {checkpoint}"));
        wanted.insert(checkpoint.to_owned());
    }
    wanted.insert("x.ply".to_owned());
    assert_eq!(names(), wanted);
    assert_eq!(fs::read(place.path("state.part")).unwrap(), b"precious");
    assert_eq!(fs::read(place.path("behind")).unwrap(), b"precious");
    assert!(fs::symlink_metadata(place.path("link.part")).unwrap().is_symlink());
}
