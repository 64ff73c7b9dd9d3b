//! Scenes of datasets whose terms forbid passing on: released as recipe, poses and reports, or with
//! the holder's permission.

use crate::release::small::{edit, reseal};
use crate::sources::datasets::Generator;
use crate::support::given;
use crate::support::workspace::{TINY, Workspace};
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

/// A dataset of one instance with its recipe, and a scene of the user's own.
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
fn without_permission_no_picture_is_released() {
    let place = place();
    let ended = place.ok("release --to tree recipes");
    assert!(ended.stderr.contains("mvimgnet forbids redistribution of derived data"), "{}", ended.stderr);
    let files = released(&place);
    let own: Vec<&str> = files.iter().filter_map(|f| f.strip_prefix(SCENE)).collect();
    let wanted = [
        "/base/checks.json",
        "/base/poses.txt",
        "/base/speed.json",
        "/base/timestamps_us.txt",
        "/base/trajectory.png",
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
    assert!(card.contains("extra_gated_prompt") && card.contains("only recipe, poses and reports"), "{card}");
}

#[test]
fn the_permission_is_released_with_the_scene() {
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
    // No photo of the dataset is in the tree, under any name.
    let photo = &scene["images"][0]["sha256"].as_str().unwrap();
    assert!(!fs::read_to_string(place.path("tree/SHA256SUMS")).unwrap().contains(photo));
}

const UPSTREAM: &str = "licence: { expression: CC0-1.0, holder: a test, upstream: CC-BY-4.0";
const EVIDENCE: &str = "evidence: { granted_by: the project for this scene, url: \"https://example.org/letter\", date: 2025-06-01 }";

/// A place whose recipes state these terms and use only photos.
fn stating(licence: &str) -> Workspace {
    let place = Workspace::new();
    Generator::new().mvimgnet(&place.path("data"), 0, 1, &given::ply(|_, value| value));
    let defaults = "trajectories: [{ name: base, refine: { factor: 2 } }]\noutputs: []\n";
    place.write("recipes/defaults.yaml", format!("{defaults}{licence}\n"));
    place.ok("init mvimgnet data --to recipes");
    place
}

/// A paper's statement about the terms is not enough: the holder's grant is.
#[test]
fn terms_other_than_those_of_the_upstream_need_evidence() {
    for (licence, wanted) in [
        (format!("{UPSTREAM} }}"), "licence-forbidden without evidence"),
        (format!("{UPSTREAM}, evidence: {{}} }}"), "granted_by"),
        (format!("{UPSTREAM}, {EVIDENCE} }}").replace("the project for this scene", "\" \""), "is empty"),
        (format!("{UPSTREAM}, {EVIDENCE} }}").replace("2025-06-01", "june"), "wanted a day"),
        (format!("{UPSTREAM}, {EVIDENCE} }}").replace("CC-BY-4.0", "CC BY MIT"), "is not an SPDX expression"),
        (
            format!("licence: {{ expression: CC0-1.0, holder: a test, {EVIDENCE} }}"),
            "is given without upstream",
        ),
        ("licence: { expression: CC BY MIT, holder: a test }".to_owned(), "is not an SPDX expression"),
    ] {
        let ended = stating(&licence).gs2e("release --to tree recipes");
        assert_eq!(ended.code, 2, "{licence}: {}", ended.stderr);
        assert!(ended.stderr.contains(wanted), "{licence}: {}", ended.stderr);
    }
    // A user's own scene has no upstream that could grant anything.
    let place = Workspace::with_tiny();
    place.write("own.yaml", format!("{TINY}{UPSTREAM}, {EVIDENCE} }}\n"));
    let ended = place.gs2e("plan own.yaml");
    assert!(ended.code == 2 && ended.stderr.contains("has no upstream"), "{}", ended.stderr);
}

#[test]
fn a_known_program_has_its_own_terms() {
    let recipe = |licence: &str| {
        format!(
            "version: 1\nscene: mine\nsource: {{ colmap: {{ path: capture }} }}\nreconstruct:\n  command: {{ program: \
             gaussian-splatting, arguments: [\"{{capture}}\", \"{{out}}\"], version: \"1\", licence: {licence} }}\n\
             trajectories: [{{ name: base, refine: {{}} }}]\n"
        )
    };
    let place = Workspace::new();
    for (licence, wanted) in [
        ("MIT", "3D Gaussian Splatting is under LicenseRef-Inria-MPII-3DGS (licence-forbidden)"),
        ("CC BY MIT", "is not an SPDX expression"),
        // The recipe is sound, but its training data is not there.
        ("LicenseRef-Inria-MPII-3DGS", "capture"),
    ] {
        place.write("recipe.yaml", recipe(licence));
        let ended = place.gs2e("build recipe.yaml");
        assert!(ended.code > 0 && ended.stderr.contains(wanted), "{licence}: {}", ended.stderr);
        assert_eq!(
            ended.stderr.contains("recipe.yaml:5:"),
            wanted != "capture",
            "{licence}: {}",
            ended.stderr
        );
    }
}

#[test]
fn evidence_is_released_with_the_scene_and_audited() {
    let place = stating(&format!("{UPSTREAM}, {EVIDENCE} }}"));
    place.ok("release --to tree --copy recipes");
    let licence = scene(&place)["licence"].clone();
    assert_eq!(licence["expression"], "CC-BY-4.0 AND CC0-1.0");
    assert_eq!(licence["attribution"], "MVImgNet (Yu et al., CVPR 2023); a test");
    let part = &licence["parts"][0];
    assert_eq!((&part["asset"], &part["verified"]), (&"MVImgNet".into(), &false.into()));
    assert_eq!(part["grant"]["granted_by"], "the project for this scene");
    // Permission to pass the scene on is a separate question.
    assert_eq!((&licence["withheld"], &licence["gated"]), (&true.into(), &true.into()));
    place.ok("audit tree");
    let tree = place.path("tree");
    let path = format!("{SCENE}/scene.json");
    let sound = fs::read(tree.join(&path)).unwrap();
    let found = |change: &dyn Fn(&mut Value)| -> BTreeSet<String> {
        edit(&tree, &path, change);
        reseal(&tree);
        let faults = gs2e_audit::audit_release(&tree).unwrap().faults;
        fs::write(tree.join(&path), &sound).unwrap();
        // The recipe's own sum and the index are not forged with it.
        let own = faults.into_iter().filter(|fault| fault.code.name() != "claims-disagree");
        own.map(|fault| format!("{} {}", fault.code.name(), fault.scene.unwrap_or_default())).collect()
    };
    let forbidden = BTreeSet::from([format!("licence-forbidden {SCENE}")]);
    assert_eq!(found(&|_| ()), BTreeSet::new());
    for key in ["granted_by", "url", "date"] {
        let empty = |v: &mut Value| {
            v["licence"]["parts"][0]["grant"][key] = "".into();
            v["recipe"]["licence"]["evidence"][key] = "".into();
        };
        assert_eq!(found(&empty), forbidden, "{key}");
    }
    let none = |v: &mut Value| drop(v["licence"]["parts"][0].as_object_mut().unwrap().remove("grant"));
    assert_eq!(found(&none), forbidden);
    let another =
        |v: &mut Value| v["licence"]["parts"][0]["grant"]["url"] = "https://example.org/other".into();
    assert_eq!(found(&another), forbidden);
    let unsaid = |v: &mut Value| drop(v["recipe"]["licence"].as_object_mut().unwrap().remove("evidence"));
    assert_eq!(found(&unsaid), forbidden);
}

/// A capture read as the user's own is bound by the terms of its download address.
#[test]
fn an_address_names_its_upstream() {
    let place = stating("licence: { expression: MIT, holder: a test }");
    let recipe = "version: 1\nscene: mine\nsource: { colmap: { path: ../data/0/00000000, \
                  upstream_url: \"https://github.com/GAP-LAB-CUHK-SZ/MVImgNet\" } }\n";
    place.write("recipes/mine.yaml", recipe);
    let ended = place.ok("release --to tree recipes/mine.yaml");
    assert!(ended.stderr.contains("colmap (MVImgNet) forbids redistribution"), "{}", ended.stderr);
    let file: Value = place.json("tree/mine/scene.json");
    assert_eq!(file["licence"]["expression"], "CC-BY-NC-4.0 AND LicenseRef-MVImgNet-ToU AND MIT");
    assert_eq!(file["licence"]["withheld"], true);
    place.ok("audit tree");
}
