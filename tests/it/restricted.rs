//! Scenes of datasets whose terms forbid passing on: released as recipe, poses and reports, or by the releaser's word.

use crate::sources::datasets::Generator;
use crate::support::given;
use crate::support::workspace::Workspace;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;

pub(crate) const SCENE: &str = "mvimgnet/0/00000000";

const DEFAULTS: &str = "\
camera: { width: 32, height: 18 }
trajectories: [{ name: base, refine: { factor: 2 } }]
outputs: [events, sharp]
licence: { expression: CC-BY-4.0, holder: a test }
";

/// A dataset of one instance with its recipe, and a scene of the user's own beside it.
pub(crate) fn place() -> Workspace {
    let place = Workspace::new();
    let scene = given::ply(|_, value| value);
    Generator::new().mvimgnet(&place.path("data"), 0, 1, &scene);
    place.write("recipes/defaults.yaml", DEFAULTS);
    place.ok("init mvimgnet data --to recipes");
    let own = "version: 1\nscene: own\nsource: { procedural: { gaussians: 200, views: 6, arc: 6 } }\n";
    place.write("recipes/own.yaml", own);
    place
}

fn released(place: &Workspace) -> BTreeSet<String> {
    let sums = fs::read_to_string(place.path("tree/SHA256SUMS")).unwrap();
    sums.lines().map(|line| line[66..].to_owned()).collect()
}

fn scene(place: &Workspace) -> Value {
    serde_json::from_slice(&fs::read(place.path(&format!("tree/{SCENE}/scene.json"))).unwrap()).unwrap()
}

#[test]
fn without_a_word_no_likeness_is_passed_on() {
    let place = place();
    let ended = place.ok("release --to tree recipes");
    assert!(ended.stderr.contains("mvimgnet forbids passing on what is made from it"), "{}", ended.stderr);
    let files = released(&place);
    let own: Vec<&str> = files.iter().filter_map(|f| f.strip_prefix(SCENE)).collect();
    let wanted = [
        "/base/checks.json",
        "/base/poses.txt",
        "/base/speed.json",
        "/base/timestamps_us.txt",
        "/base/trajectory.svg",
        "/base/transforms.json",
        "/checks.json",
        "/scene.json",
    ];
    assert_eq!(own, wanted);
    assert!(files.contains("own/base/events.h5") && files.contains("own/base/sharp/000000.png"));
    let scene = scene(&place);
    assert_eq!((&scene["licence"]["withheld"], &scene["licence"]["gated"]), (&true.into(), &true.into()));
    assert_eq!(scene["licence"]["expression"], "CC-BY-4.0 AND CC-BY-NC-4.0 AND LicenseRef-MVImgNet-ToU");
    assert_eq!(scene["attributes"]["data_type"], serde_json::json!([]));
    place.ok("audit tree");
    let card = fs::read_to_string(place.path("tree/README.md")).unwrap();
    assert!(
        card.contains("extra_gated_prompt") && card.contains("recipe, poses and reports alone"),
        "{card}"
    );
}

#[test]
fn the_releasers_word_is_released_with_the_scene() {
    let place = place();
    place.write(
        "recipes/sources.yaml",
        "mvimgnet: { redistribute: allowed, because: a letter of 2025-01-01 }\n",
    );
    let ended = place.ok("release --to tree recipes");
    assert!(!ended.stderr.contains("forbids"), "{}", ended.stderr);
    let files = released(&place);
    assert!(files.contains(&format!("{SCENE}/base/events.h5")));
    let scene = scene(&place);
    assert_eq!(scene["licence"]["redistribution"], "a letter of 2025-01-01");
    assert_eq!((&scene["licence"]["withheld"], &scene["licence"]["gated"]), (&Value::Null, &true.into()));
    place.ok("audit tree");
    // No photo of the dataset is in it, by any name.
    let photo = &scene["images"][0]["sha256"].as_str().unwrap();
    assert!(!fs::read_to_string(place.path("tree/SHA256SUMS")).unwrap().contains(photo));
}
