//! Splits are dealt by the photographed object. They do not depend on the rest of the release, and
//! share no photos.

use crate::release::small::{edit, reseal};
use crate::sources::datasets::Generator;
use crate::support::given;
use crate::support::workspace::{TINY, Workspace};
use gs2e_audit::audit_release;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::{self, File};

/// Position of a key in [0, 1): the first 53 bits of its hash.
fn place_of(salt: &str, key: &str) -> f64 {
    let hash = Sha256::digest(format!("{salt}\0{key}").as_bytes());
    let bits = u64::from_be_bytes(hash[..8].try_into().unwrap());
    (bits / 2048) as f64 / 9_007_199_254_740_992.0
}

/// Split and group of a scene.
fn split_of(place: &Workspace, scene: &str) -> (String, String) {
    let split = place.json(&format!("out/{scene}/scene.json"))["split"].clone();
    let text = |key: &str| split[key].as_str().unwrap().to_owned();
    (text("name"), text("group"))
}

/// The split of each trajectory, according to the index.
fn indexed(place: &Workspace) -> BTreeMap<String, Option<String>> {
    let file = SerializedFileReader::new(File::open(place.path("out/index.parquet")).unwrap()).unwrap();
    let rows = file.get_row_iter(None).unwrap();
    let text = |field: &Field| match field {
        Field::Str(text) => Some(text.clone()),
        _ => None,
    };
    rows.map(|row| {
        let row: BTreeMap<String, Field> = row.unwrap().into_columns().into_iter().collect();
        (text(&row["scene"]).unwrap(), text(&row["split"]))
    })
    .collect()
}

const SPLITS: &str = "splits: { by: object, shares: { train: 0.6, test: 0.4 } }\n";

/// A scene with its own Gaussians, with a release of little more than the path.
fn recipe(id: &str, seed: u32) -> String {
    let recipe = TINY.replace("scene: tiny", &format!("scene: {id}"));
    let recipe = recipe.replace("arc: 6, seed: 1", &format!("arc: 6, seed: {seed}"));
    recipe.replace("outputs: [events, sharp]", "outputs: [sharp]\nsharp: { every: 12 }")
}

#[test]
fn the_split_of_a_scene_depends_only_on_its_own_key() {
    let place = Workspace::new();
    place.write("recipes/release.yaml", SPLITS);
    let ids = ["a", "b", "c", "d"];
    for (id, seed) in ids.iter().zip(1..) {
        place.write(&format!("recipes/{id}.yaml"), recipe(id, seed));
    }
    place.ok("release --to out recipes");
    let before: Vec<(String, String)> = ids.iter().map(|id| split_of(&place, id)).collect();
    let rows = indexed(&place);
    for (id, (split, group)) in ids.iter().zip(&before) {
        let gaussians = place.json(&format!("out/{id}/scene.json"))["reconstruction"]["scene_sha256"].clone();
        assert_eq!(*group, format!("gaussians/{}", gaussians.as_str().unwrap()));
        // In the order of the splits' names: test has [0, 0.4).
        let wanted = if place_of("", group) < 0.4 { "test" } else { "train" };
        assert_eq!((split.as_str(), rows[*id].as_deref()), (wanted, Some(wanted)), "{id}");
    }
    let manifest = place.json("out/manifest.json");
    let rule = serde_json::json!({ "by": "object", "shares": { "test": 0.4, "train": 0.6 }, "salt": "" });
    assert_eq!(manifest["splits"], rule);
    place.ok("audit out");
    place.write("recipes/0.yaml", recipe("0", 9));
    place.write("recipes/z.yaml", recipe("z", 10));
    place.ok("release --to out recipes");
    assert_eq!(ids.iter().map(|id| split_of(&place, id)).collect::<Vec<_>>(), before);
}

/// Two instances of a dataset with the same photos, and a salt that separates them.
fn photographed_twice() -> (Workspace, String) {
    let place = Workspace::new();
    Generator::new().mvimgnet(&place.path("data"), 0, 2, &given::ply(|_, value| value));
    place.write(
        "recipes/defaults.yaml",
        "trajectories: [{ name: base, refine: { factor: 2 } }]\noutputs: []\n",
    );
    place.ok("init mvimgnet data --to recipes");
    let keys = ["mvimgnet/0/00000000", "mvimgnet/0/9e3779b1"];
    let parted = |salt: &String| (place_of(salt, keys[0]) < 0.4) != (place_of(salt, keys[1]) < 0.4);
    let salt = (0..64).map(|i| format!("s{i}")).find(parted).unwrap();
    (place, salt)
}

fn salted(salt: &str) -> String {
    SPLITS.replace(" } }", &format!(" }}, salt: \"{salt}\" }}"))
}

#[test]
fn photos_that_two_splits_would_share_stop_a_release() {
    let (place, salt) = photographed_twice();
    place.write("recipes/release.yaml", salted(&salt));
    let ended = place.gs2e("release --to out recipes");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    let said = |part: &str| assert!(ended.stderr.contains(part), "{part}: {}", ended.stderr);
    said("the photo with SHA-256");
    said("mvimgnet/0/00000000 (");
    said("mvimgnet/0/9e3779b1 (");
    assert!(!place.path("out").exists());
    // Their recipes declare one object. In splits by capture that does not count.
    let defaults = fs::read_to_string(place.path("recipes/defaults.yaml")).unwrap();
    place.write("recipes/defaults.yaml", format!("{defaults}group: the same mug\n"));
    let by_capture = salted(&salt).replace("by: object", "by: capture");
    place.write("recipes/release.yaml", by_capture);
    assert_eq!(place.gs2e("release --to out recipes").code, 3);
    place.write("recipes/release.yaml", salted(&salt));
    let ended = place.ok("release --to out recipes");
    let [a, b] = ["mvimgnet/0/00000000", "mvimgnet/0/9e3779b1"].map(|id| split_of(&place, id));
    assert_eq!((a.1.as_str(), &a), ("group/the same mug", &b));
    let empty = if a.0 == "train" { "test" } else { "train" };
    assert!(ended.stderr.contains(&format!("no scene is in the split {empty}")), "{}", ended.stderr);
    place.ok("audit out");
}

#[test]
fn an_audit_deals_the_scenes_again() {
    let (place, salt) = photographed_twice();
    // The scenes are dealt together, as a release demands. Then the salt is replaced by the other
    // one, and the sums are rewritten.
    let keys = ["mvimgnet/0/00000000", "mvimgnet/0/9e3779b1"];
    let together = |salt: &String| keys.iter().all(|key| place_of(salt, key) >= 0.4);
    let kept = (0..64).map(|i| format!("t{i}")).find(together).unwrap();
    place.write("recipes/release.yaml", salted(&kept));
    place.ok("release --to out --copy recipes");
    let out = place.path("out");
    let codes = || -> Vec<String> {
        let faults = audit_release(&out).unwrap().faults;
        // The index and the card were not forged with the rest.
        let mut codes: Vec<String> = faults
            .iter()
            .filter(|fault| fault.file.is_none())
            .map(|fault| format!("{} {}", fault.code.name(), fault.scene.clone().unwrap_or_default()))
            .collect();
        codes.dedup();
        codes
    };
    assert_eq!(audit_release(&out).unwrap().faults, []);
    edit(&out, "manifest.json", |manifest| manifest["splits"]["salt"] = salt.as_str().into());
    reseal(&out);
    let moved: Vec<String> =
        keys.iter().filter(|key| place_of(&salt, key) < 0.4).map(|key| format!("split-leak {key}")).collect();
    assert_eq!(moved.len(), 1);
    assert_eq!(codes(), moved);
    // The scene's split is changed too. The shared photos remain as a fault.
    let scene = moved[0].strip_prefix("split-leak ").unwrap();
    edit(&out, &format!("{scene}/scene.json"), |file| file["split"]["name"] = "test".into());
    reseal(&out);
    // The fault is reported for the scene in the alphabetically first split, which is `test`.
    assert_eq!(codes(), [moved[0].as_str()]);
    let faults = audit_release(&out).unwrap().faults;
    assert!(faults.iter().any(|fault| fault.message.starts_with("the photo with SHA-256")), "{faults:#?}");
}

#[test]
fn invalid_splits_are_refused() {
    let place = Workspace::with_tiny();
    for (splits, wanted) in [
        ("{ by: trajectory, shares: { train: 1 } }", "trajectory"),
        ("{ by: object, shares: { train: 0.8, test: 0.1 } }", "the shares sum to 0.9, wanted 1"),
        ("{ by: object, shares: { train: 1.5, test: -0.5 } }", "the share of test is -0.5"),
        ("{ by: object, shares: {} }", "there is no split"),
        ("{ by: object, shares: { \"a/b\": 1 } }", "the split name is \"a/b\", which has more than one part"),
        ("{ shares: { train: 1 } }", "by"),
        ("{ by: object }", "shares"),
    ] {
        place.write("release.yaml", format!("splits: {splits}\n"));
        let ended = place.gs2e("release --to out tiny.yaml");
        assert_eq!(ended.code, 2, "{splits}: {}", ended.stderr);
        assert!(ended.stderr.contains(wanted), "{splits}: {}", ended.stderr);
        assert!(ended.stderr.contains("release.yaml:1:"), "{splits}: {}", ended.stderr);
    }
}
