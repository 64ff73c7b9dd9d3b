//! `gs2e init`: from a dataset on disk to one recipe per scene.

use crate::sources::datasets::{Defect, Generator, VIEWS};
use crate::support::given;
use crate::support::workspace::Workspace;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// All files below a folder, by path.
fn files(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries =
        walkdir::WalkDir::new(root).into_iter().map(Result::unwrap).filter(|e| e.file_type().is_file());
    let name = |path: &Path| path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
    entries.map(|e| (name(e.path()), fs::read(e.path()).unwrap())).collect()
}

fn scene_file() -> Vec<u8> {
    given::ply(|_, value| value)
}

/// The result of `init`, which must succeed.
fn init(place: &Workspace, arguments: &str) -> Value {
    serde_json::from_str(&place.ok(&format!("init {arguments} --json")).stdout).unwrap()
}

fn count(result: &Value, key: &str) -> usize {
    result[key].as_array().unwrap().len()
}

#[test]
fn each_instance_gets_a_short_recipe_that_builds() {
    let place = Workspace::new();
    Generator::new().mvimgnet(&place.path("data"), 0, 12, &scene_file());
    let result = init(&place, "mvimgnet data --to recipes");
    assert_eq!((count(&result, "written"), count(&result, "rejected"), &result["kept"]), (12, 0, &0.into()));
    let files = files(&place.path("recipes"));
    assert_eq!(files.len(), 13, "{:?}", files.keys());
    let recipe = String::from_utf8(files["0_00000000.yaml"].clone()).unwrap();
    let wanted = "version: 1\nscene: \"mvimgnet/0/00000000\"\nsource:\n  \
                  mvimgnet: { path: \"../data/0/00000000\" }\nreconstruct:\n  \
                  given: { path: \"../data/0/00000000/point_cloud.ply\" }\n";
    assert_eq!(recipe, wanted);
    let steps = place.plan("recipes");
    assert_eq!(steps.iter().filter(|(step, _)| step.ends_with("/mini-2/events")).count(), 12);
    // One scene through to the release: shorter, smaller, and with its owner's permission.
    let defaults = String::from_utf8(files["defaults.yaml"].clone()).unwrap();
    for line in ["speed: { flow: { px_s: 400 } }", "sampling: { tolerance: 0.1 }", "sharp: { fps: 30 }"] {
        assert!(defaults.contains(line), "{line}: {defaults}");
    }
    let defaults = defaults.replace("px_s: 400", "px_s: 30").replace("tolerance: 0.1", "rate: 2400")
        + "camera: { width: 32, height: 18 }\n";
    place.write("recipes/defaults.yaml", defaults);
    let steps = place.build("recipes/0_00000000.yaml");
    assert!(steps.contains(&"mvimgnet/0/00000000/mini-2/events".to_owned()), "{steps:?}");
}

/// Each defect, the code of its rejection, and parts of the message.
const CASES: [(Defect, &str, &[&str]); 10] = [
    (Defect::NoModel, "incomplete", &["sparse/0", "no COLMAP model"]),
    (Defect::NoCameras, "incomplete", &["sparse/0", "has no cameras"]),
    (Defect::Truncated, "unreadable", &["images.bin: image 12 of 12 at byte ", "the file ends"]),
    (
        Defect::UnknownCamera,
        "unreadable",
        &["cameras.bin: camera 1 of 1 at byte 8: camera model 99 is unknown"],
    ),
    (
        Defect::Fisheye,
        "unreadable",
        &["at byte 8: camera model SIMPLE_RADIAL_FISHEYE is not", "image_undistorter"],
    ),
    (
        Defect::TwiceNamed,
        "unreadable",
        &["images.bin: image ", "`008.jpg` is already used by image 5 of 12 at byte"],
    ),
    (
        Defect::NanPose,
        "unreadable",
        &["images.bin: image 4 of 12 at byte ", "`004.jpg`: the translation is [0, NaN, 4]"],
    ),
    (Defect::NoFocal, "unreadable", &["camera 1 of 1 at byte 8: the focal length is 0, wanted a positive"]),
    (Defect::FewViews, "few-views", &["5 registered views, wanted at least 10"]),
    (Defect::Small, "small", &["`001.jpg` is 96 px on its shorter side, wanted at least 256"]),
];

#[test]
fn every_known_defect_is_named_and_the_others_go_on() {
    let place = Workspace::new();
    let generator = Generator::new();
    for (i, (defect, ..)) in CASES.iter().enumerate() {
        generator.instance(&place.path(&format!("data/7/0000000{i}")), Some(*defect));
    }
    generator.instance(&place.path("data/7/0000000a"), Some(Defect::OnePhotoLess));
    generator.instance(&place.path("data/7/0000000b"), Some(Defect::Leftovers));
    generator.instance(&place.path("data/7/not an id"), None);
    place.write("data/notes/0000000c/readme.txt", "no class");
    place.write("data/README", "no folder");
    let result = init(&place, "mvimgnet data --to recipes");
    let rejected = result["rejected"].as_array().unwrap();
    for (i, (defect, code, parts)) in CASES.iter().enumerate() {
        let scene = format!("mvimgnet/7/0000000{i}");
        let found =
            rejected.iter().find(|r| r["scene"] == scene.as_str()).unwrap_or_else(|| panic!("{defect:?}"));
        assert_eq!(found["code"], *code, "{defect:?}: {found}");
        let because = found["because"].as_str().unwrap();
        for part in *parts {
            assert!(because.contains(part), "{defect:?}: {because}");
        }
    }
    let misnamed = rejected.last().unwrap();
    assert_eq!((&misnamed["scene"], &misnamed["code"]), (&"mvimgnet/7/not an id".into(), &"name".into()));
    assert_eq!(rejected.len(), 11);
    let written = |i: usize| result["written"][i]["scene"].as_str().unwrap().to_owned();
    assert_eq!([written(0), written(1)], ["mvimgnet/7/0000000a", "mvimgnet/7/0000000b"]);
    let noticed = result["noticed"].as_array().unwrap();
    assert_eq!(noticed.len(), 1, "{noticed:?}");
    let seen = noticed[0]["because"].as_str().unwrap();
    assert!(
        seen.starts_with("1 of 12 photos are not in ") && seen.ends_with("the first is `005.jpg`"),
        "{seen}"
    );
    // The list holds the same, one line each, and is not read as a recipe.
    let list = fs::read_to_string(place.path("recipes/rejected.tsv")).unwrap();
    assert_eq!(list.lines().count(), 12);
    assert!(list.lines().all(|line| line.split('\t').count() == 4), "{list}");
    assert_eq!(place.gs2e("plan recipes").code, 2, "no scene file is there yet");
    for scene in ["0000000a", "0000000b"] {
        place.write(&format!("data/7/{scene}/point_cloud.ply"), scene_file());
    }
    place.ok("plan recipes");
}

#[test]
fn a_second_run_adds_only_new_scenes() {
    let place = Workspace::new();
    let generator = Generator::new();
    generator.mvimgnet(&place.path("data"), 0, 25, &scene_file());
    init(&place, "mvimgnet data --to recipes");
    // The user's own text stays.
    place.write("recipes/defaults.yaml", "seed: 9\ntrajectories: [{ name: base, refine: {} }]\n");
    let own = "version: 1\nscene: mine\nsource: { procedural: {} }\n";
    place.write("recipes/own/0a.yaml", own);
    place.write("recipes/0_00000000.yaml", "version: 1\nscene: changed\nsource: { procedural: {} }\n");
    let before = files(&place.path("recipes"));
    let again = init(&place, "mvimgnet data --to recipes");
    assert_eq!((count(&again, "written"), &again["kept"]), (0, &25.into()));
    assert_eq!(files(&place.path("recipes")), before);
    generator.mvimgnet(&place.path("data"), 25, 10, &scene_file());
    let more = init(&place, "mvimgnet data --to recipes");
    assert_eq!((count(&more, "written"), &more["kept"]), (10, &25.into()));
    let mut after = files(&place.path("recipes"));
    assert_eq!(after.len(), before.len() + 10);
    after.retain(|name, _| before.contains_key(name));
    assert_eq!(after, before);
}

#[test]
fn a_sample_depends_on_the_seed() {
    let place = Workspace::new();
    let generator = Generator::new();
    generator.mvimgnet(&place.path("data"), 0, 40, &scene_file());
    let sample = |to: &str, limit: usize, seed: u64| {
        let result = init(&place, &format!("mvimgnet data --to {to} --limit {limit} --seed {seed}"));
        assert_eq!(result["left"], 40 - limit);
        let mut names: Vec<String> = files(&place.path(to)).into_keys().collect();
        names.retain(|name| name != "defaults.yaml");
        assert_eq!(names.len(), limit);
        names
    };
    let (five, nine, other) = (sample("a", 5, 1), sample("b", 9, 1), sample("c", 5, 2));
    assert!(five.iter().all(|name| nine.contains(name)), "{five:?} {nine:?}");
    assert_ne!(five, other);
    // Existing recipes count: no recipe is added until there is room.
    init(&place, "mvimgnet data --to a --limit 5 --seed 2");
    assert_eq!(files(&place.path("a")).len(), 6);
    init(&place, "mvimgnet data --to a --limit 9 --seed 1");
    let grown: Vec<String> =
        files(&place.path("a")).into_keys().filter(|name| name != "defaults.yaml").collect();
    assert_eq!(grown, nine);
}

#[test]
fn options_are_written_where_they_belong() {
    let place = Workspace::new();
    Generator::new().mvimgnet(&place.path("data"), 0, 20, &scene_file());
    let arguments = "mvimgnet data --to recipes --views 7 --classes 1 --exclude 00[12].jpg --pace strong --prefix ours \
                     --scene trained/{name}.ply";
    let result = init(&place, arguments);
    assert_eq!((count(&result, "written"), count(&result, "without_scene")), (10, 10));
    let files = files(&place.path("recipes"));
    let defaults = String::from_utf8(files["defaults.yaml"].clone()).unwrap();
    assert!(defaults.contains("px_s: 800"), "{defaults}");
    let (name, recipe) = files.iter().find(|(name, _)| name.starts_with("1_")).unwrap();
    let name = name.strip_suffix(".yaml").unwrap().replace('_', "/");
    let wanted = format!(
        "version: 1\nscene: \"ours/{name}\"\nsource:\n  mvimgnet: {{ path: \"../data/{name}\", views: 7, exclude: \
         [\"*_bg_removed.png\", \"00[12].jpg\"] }}\nreconstruct:\n  given: {{ path: \"../trained/{name}.ply\" }}\n"
    );
    assert_eq!(String::from_utf8(recipe.clone()).unwrap(), wanted);
    let refused = place.gs2e("init mvimgnet data --to recipes --pace mild");
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("defaults.yaml, which exists"), "{}", refused.stderr);
    // If the defaults define the reconstruction, the recipes do not.
    place.write("others/defaults.yaml", "reconstruct: { given: { path: one.ply } }\n");
    init(&place, "mvimgnet data --to others --limit 1");
    let all = self::files(&place.path("others"));
    assert!(
        all.iter().all(|(name, text)| name == "defaults.yaml" || !text.ends_with(b"} }\n")),
        "{:?}",
        all.keys()
    );
}

#[test]
fn views_that_are_not_used_are_listed_with_the_reason() {
    let place = Workspace::new();
    let generator = Generator::new();
    generator.instance(&place.path("data/7/0000000b"), Some(Defect::Leftovers));
    place.write("data/7/0000000b/point_cloud.ply", scene_file());
    init(&place, "mvimgnet data --to recipes --views 4");
    let defaults = "camera: { width: 32, height: 18 }\ntrajectories: [{ name: base, refine: { factor: 2 } }]\noutputs: []\n";
    place.write("recipes/defaults.yaml", defaults);
    place.ok("release --to tree recipes");
    let scene: Value = place.json("tree/mvimgnet/7/0000000b/scene.json");
    let images = scene["images"].as_array().unwrap();
    assert_eq!(images.len(), VIEWS as usize + 2);
    let used: Vec<&str> =
        images.iter().filter(|i| i["used"] == true).map(|i| i["name"].as_str().unwrap()).collect();
    // Four of twelve views: 0, 11/3, 22/3 and 11, rounded.
    assert_eq!(used, ["001.jpg", "005.jpg", "008.jpg", "012.jpg"]);
    let why = |name: &str| images.iter().find(|i| i["name"] == name).unwrap()["why_not"].as_str().unwrap();
    assert_eq!(why("001_bg_removed.png"), "is excluded by its name");
    assert_eq!(why("013.jpg"), "has no pose in the source");
    assert_eq!(why("002.jpg"), "was not picked");
    assert!(images.iter().all(|i| i["sha256"].as_str().unwrap().len() == 64));
    assert_eq!(scene["source"]["upstream_id"], "7/0000000b");
    assert_eq!(scene["source"]["upstream_url"], "https://github.com/GAP-LAB-CUHK-SZ/MVImgNet");
    assert_eq!(scene["attributes"]["scene_scale"], "object");
}

#[test]
fn both_layouts_of_dl3dv_are_read_and_brought_to_their_photos() {
    use gs2e_image::Size;
    use gs2e_source::kind::CaptureKind;
    use gs2e_source::{DiskCapture, PoseFile};
    let place = Workspace::new();
    let generator = Generator::new();
    let [bulk, sample] = ["a", "b"].map(|digit| digit.repeat(64));
    generator.dl3dv_bulk(&place.path(&format!("data/1K/{bulk}")));
    generator.dl3dv_sample(&place.path(&format!("data/{sample}")));
    let result = init(&place, "dl3dv data --to recipes");
    assert_eq!((count(&result, "written"), count(&result, "rejected")), (2, 0), "{result}");
    assert_eq!(result["written"][0]["scene"], format!("dl3dv/{bulk}"));
    assert!(place.path(&format!("recipes/{sample}.yaml")).is_file());

    let read = |path: &str, poses| {
        let mut captured = DiskCapture::all_views(CaptureKind::Dl3dv, place.path(path));
        captured.selection.poses = poses;
        captured.read().map(|(capture, _)| capture).map_err(|e| e.to_string())
    };
    let t = |path: &str, poses, size: [u32; 2], fx: f64, distance: f64| {
        let capture = read(path, poses).unwrap();
        assert_eq!(capture.views.len(), VIEWS as usize);
        let view = &capture.views[1];
        assert!(view.name.ends_with("frame_00002.png") && view.sha256.is_some(), "{}", view.name);
        assert_eq!(view.camera.size, Size { width: size[0], height: size[1] });
        assert!((view.camera.fx - fx).abs() < 1e-9, "{}", view.camera.fx);
        assert!((view.world_from_camera.translation.length() - distance).abs() < 1e-9, "{view:?}");
    };
    t(&format!("data/1K/{bulk}"), None, [960, 540], 750.0, 7.0);
    t(&format!("data/1K/{bulk}"), Some(PoseFile::Transforms), [960, 540], 750.0, 7.0);
    // The model's poses, unless the others are selected; the largest photos.
    t(&format!("data/{sample}"), None, [1920, 1080], 1920.0, 4.0);
    t(&format!("data/{sample}"), Some(PoseFile::Colmap), [1920, 1080], 1920.0, 4.0);
    t(&format!("data/{sample}"), Some(PoseFile::Transforms), [1920, 1080], 1500.0, 7.0);
    let seen = read(&format!("data/1K/{bulk}"), Some(PoseFile::Colmap)).unwrap_err();
    assert!(seen.contains("it contains no COLMAP model"), "{seen}");
}

#[test]
fn foreign_captures_are_found_at_any_depth() {
    let place = Workspace::new();
    let frames = |i: u32| given::transforms(1.0).replace("images/000", &format!("images/{i}"));
    for (i, folder) in
        ["data/one", "data/more/two", "data/more/deep/three", "data/one/inside"].iter().enumerate()
    {
        place.write(&format!("{folder}/transforms.json"), frames(u32::try_from(i).unwrap()));
    }
    place.write("data/a b/transforms.json", frames(9));
    place.write("data/more_two/transforms.json", frames(10));
    let result = init(&place, "nerfstudio data --to recipes --min-views 6 --min-side 48");
    let scenes: Vec<&str> =
        result["written"].as_array().unwrap().iter().map(|w| w["scene"].as_str().unwrap()).collect();
    assert_eq!(
        scenes,
        ["nerfstudio/more/deep/three", "nerfstudio/more/two", "nerfstudio/more_two", "nerfstudio/one"]
    );
    let rejected = &result["rejected"][0];
    assert_eq!((&rejected["scene"], &rejected["code"]), (&"nerfstudio/a b".into(), &"name".into()));
    assert!(rejected["because"].as_str().unwrap().contains("its id would be `nerfstudio/a b`"), "{rejected}");
    assert_eq!(count(&result, "rejected"), 1);
    let noticed = result["noticed"][0]["because"].as_str().unwrap();
    assert!(noticed.contains("because more_two.yaml belongs to another scene"), "{noticed}");
    // The tree itself may be the only capture.
    let result = init(&place, "nerfstudio data/one --to alone --min-views 1 --min-side 1");
    assert_eq!(result["written"][0]["scene"], "nerfstudio/one");
    assert!(fs::read_to_string(place.path("alone/one.yaml")).unwrap().contains("path: \"../data/one\""));
}

/// Photos without a model are no scene of COLMAP, and are listed as such.
#[test]
fn photos_without_a_model_are_rejected_by_name() {
    let place = Workspace::new();
    let generator = Generator::new();
    for (folder, defect) in [("s1", None), ("s7", Some(Defect::NoModel)), ("more/s8", Some(Defect::NoModel))]
    {
        generator.instance(&place.path(&format!("data/{folder}")), defect);
    }
    // Neither a folder without photos nor a picture next to scenes is a scene.
    place.write("data/notes/readme.txt", "no photo");
    place.write("data/overview.png", "a picture of all scenes");
    let result = init(&place, "colmap data --to recipes");
    assert_eq!(result["written"].as_array().unwrap().len(), 1);
    let rejected = result["rejected"].as_array().unwrap().iter();
    let rejected: Vec<_> = rejected.map(|r| [&r["scene"], &r["code"]].map(|v| v.as_str().unwrap())).collect();
    assert_eq!(rejected, [["colmap/more/s8", "incomplete"], ["colmap/s7", "incomplete"]]);
    let list = fs::read_to_string(place.path("recipes/rejected.tsv")).unwrap();
    assert!(list.contains("colmap/s7\tdata/s7\tincomplete\t"), "{list}");
}

/// The advice on missing scene files works as it is written.
#[test]
fn scenes_without_a_file_are_trained_after_the_advice() {
    let place = Workspace::new();
    Generator::new().instance(&place.path("data/s1"), None);
    let said = place.ok("init colmap data --to recipes").stderr;
    let help = said.lines().find(|line| line.starts_with("help: ")).expect(&said);
    assert!(help.contains("delete these recipes, and run gs2e init again with --train"), "{help}");
    fs::remove_file(place.path("recipes/s1.yaml")).unwrap();
    let said = place.ok("init colmap data --to recipes --train").stderr;
    assert!(!said.contains("warning"), "{said}");
    let recipe = fs::read_to_string(place.path("recipes/s1.yaml")).unwrap();
    assert!(recipe.ends_with("reconstruct:\n  builtin: {}\n"), "{recipe}");
    let steps = place.plan("recipes");
    assert!(
        steps.iter().any(|(step, action)| step == "colmap/s1/reconstruct" && action != "keep"),
        "{steps:?}"
    );
    fs::create_dir(place.path("models")).unwrap();
    let ended = place.gs2e("init model models --to other --train");
    assert!(ended.code == 2 && ended.stderr.contains("has the Gaussians"), "{}", ended.stderr);
}

#[test]
fn a_folder_without_scenes_is_reported() {
    let place = Workspace::new();
    fs::create_dir(place.path("data")).unwrap();
    for format in ["colmap", "mvimgnet", "dl3dv", "nerfstudio", "model"] {
        let ended = place.gs2e(&format!("init {format} data --to recipes"));
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        assert!(ended.stderr.contains(&format!("found no {format} scene in data")), "{}", ended.stderr);
    }
    let ended = place.gs2e("init colmap gone --to recipes");
    assert_eq!(ended.code, 2);
    assert!(ended.stderr.contains("dataset: gone does not exist"), "{}", ended.stderr);
    assert!(!place.path("recipes").exists());
    let ended = place.gs2e("init colmap data --to recipes --classes 3");
    assert_eq!(ended.code, 2);
}
