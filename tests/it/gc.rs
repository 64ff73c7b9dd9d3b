//! `gs2e gc`: the files that it deletes and keeps, and kills that must cost nothing.

use crate::support::steps::{keys, recipe, steps};
use crate::support::workspace::{Workspace, tree};
use gs2e_store::{Store, StoreAccess};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime};

/// A scene that shares no step with a scene of another seed.
fn scene(id: &str, seed: u32) -> String {
    let mut recipe = recipe(id);
    recipe["source"]["procedural"]["seed"] = json!(seed);
    recipe["outputs"] = json!([]);
    recipe.to_string()
}

/// Two scenes, built.
fn two() -> Workspace {
    let place = Workspace::new();
    place.write("recipes/a.yaml", scene("a", 1));
    place.write("recipes/b.yaml", scene("b", 2));
    place.ok("build -q");
    place
}

/// The stored blobs and records, by their paths below the store.
fn stored(place: &Workspace) -> BTreeSet<String> {
    let all = tree(&place.path(".gs2e")).into_keys();
    all.filter(|path| path.starts_with("cas/") || path.starts_with("ac/")).collect()
}

/// The blobs of a scene, below the store.
fn blobs_of(place: &Workspace, scene: &str) -> BTreeSet<PathBuf> {
    let all = steps(place, "recipes").into_iter().filter(|(name, _)| name.starts_with(&format!("{scene}/")));
    all.flat_map(|(_, step)| step.outputs.into_values()).collect()
}

/// The JSON result of a `gc` run.
fn gc(place: &Workspace, args: &str) -> Value {
    let ended = place.ok(&format!("gc --json {args}"));
    serde_json::from_str(&ended.stdout).unwrap_or_else(|e| panic!("{e}: {}", ended.stdout))
}

/// Sets the mtimes of all blobs and records back by two days.
fn age(place: &Workspace) {
    let then = SystemTime::now() - Duration::from_secs(2 * 86_400);
    for path in stored(place) {
        File::open(place.path(".gs2e").join(path)).unwrap().set_modified(then).unwrap();
    }
}

#[test]
fn a_removed_recipe_frees_its_blobs_and_no_others() {
    let place = two();
    let (a, b) = (blobs_of(&place, "a"), blobs_of(&place, "b"));
    // The verdicts on two quiet scenes may be the same bytes.
    let a: BTreeSet<PathBuf> = a.difference(&b).cloned().collect();
    assert!(a.len() >= 3, "a scene of another seed shares next to nothing: {a:?}");
    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    assert_eq!(place.build("recipes"), [""; 0]);
    let bytes: u64 = a.iter().map(|path| fs::metadata(path).unwrap().len()).sum();

    let found = gc(&place, "--min-age 0");
    assert_eq!(found["blobs"], a.len());
    assert_eq!(found["bytes"], bytes);
    assert_eq!(
        (&found["records"], &found["kept_blobs"], &found["dry_run"]),
        (&json!(4), &json!(b.len()), &json!(false))
    );
    assert!(a.iter().all(|path| !path.exists()) && b.iter().all(|path| path.exists()));
    assert_eq!(tree(&place.path(".gs2e/gs2e-trash")).len(), 0);

    assert_eq!(place.build("recipes"), [""; 0]);
    assert_eq!(gc(&place, "--min-age 0")["blobs"], 0);
    place.write("recipes/a.yaml", scene("a", 1));
    let made: BTreeSet<String> = place.build("recipes").into_iter().collect();
    let wanted = ["a/capture", "a/reconstruct", "a/base/trajectory", "a/base/checks"].map(str::to_owned);
    assert_eq!(made, wanted.into());
}

#[test]
fn young_files_stay() {
    let place = two();
    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    let before = stored(&place);
    for args in ["", "--min-age 1h"] {
        let found = gc(&place, args);
        assert_eq!((&found["blobs"], &found["records"]), (&json!(0), &json!(0)));
    }
    age(&place);
    assert_eq!(gc(&place, "--min-age 3d")["blobs"], 0);
    assert_eq!(stored(&place), before);
    assert_ne!(gc(&place, "")["blobs"], 0, "the default is a day");
    assert_eq!(place.build("recipes"), [""; 0]);
}

/// A kept record keeps its blobs, even old ones: its step may have found them there.
#[test]
fn a_young_record_keeps_old_blobs() {
    let place = two();
    let a = blobs_of(&place, "a");
    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    age(&place);
    for path in stored(&place).iter().filter(|path| path.starts_with("ac/")) {
        File::open(place.path(".gs2e").join(path)).unwrap().set_modified(SystemTime::now()).unwrap();
    }
    assert_eq!(gc(&place, "")["blobs"], 0);
    assert!(a.iter().all(|path| path.exists()));
}

#[test]
fn a_dry_run_says_the_same_and_changes_nothing() {
    let place = two();
    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    place.write(".gs2e/gs2e-trash/4711.0", "an altered blob");
    let files = || -> BTreeMap<String, Vec<u8>> {
        let all = tree(&place.path(".gs2e")).into_iter();
        // SQLite's own log exists while the database is open for reading.
        all.filter(|(path, _)| !path.starts_with("state.db")).collect()
    };
    let before = files();
    // A dry run takes no lock.
    let holder = Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap();
    let held = files();
    let mut found = gc(&place, "--dry-run --min-age 0");
    assert!(files() == held);
    drop(holder);
    assert_eq!(held.keys().collect::<Vec<_>>(), before.keys().collect::<Vec<_>>());
    assert_eq!(
        (&found["dry_run"], &found["trash"], &found["trash_bytes"]),
        (&json!(true), &json!(1), &json!(15))
    );
    found["dry_run"] = json!(false);
    assert_eq!(gc(&place, "--min-age 0"), found);
    assert_eq!(tree(&place.path(".gs2e/gs2e-trash")).len(), 0);

    let nowhere = Workspace::new();
    nowhere.write("recipes/a.yaml", scene("a", 1));
    for args in ["--dry-run", ""] {
        assert_eq!(gc(&nowhere, args)["kept_blobs"], 0);
        assert!(!nowhere.path(".gs2e").exists(), "where no store is, none is made");
    }
}

/// An edit that is not built yet may be undone.
#[test]
fn the_last_products_of_a_step_stay() {
    let place = two();
    place.write("recipes/a.yaml", scene("a", 3));
    assert_eq!(gc(&place, "--min-age 0")["blobs"], 0);
    place.write("recipes/a.yaml", scene("a", 1));
    assert_eq!(place.build("recipes"), [""; 0]);
    place.write("recipes/a.yaml", scene("a", 3));
    place.ok("build -q");
    assert_ne!(gc(&place, "--min-age 0")["blobs"], 0, "now it is built, and what was before is nobody's");
}

#[test]
fn a_release_keeps_its_inputs_while_it_exists() {
    let place = two();
    place.ok("release -q --to out recipes/a.yaml");
    fs::create_dir(place.path("aside")).unwrap();
    fs::rename(place.path("recipes/a.yaml"), place.path("aside/a.yaml")).unwrap();
    assert_eq!(gc(&place, "--min-age 0")["blobs"], 0);
    assert_eq!(place.stale("aside"), [""; 0]);

    fs::rename(place.path("out"), place.path("moved")).unwrap();
    let ended = place.ok("gc --min-age 0 --dry-run");
    assert!(
        ended.stderr.contains("out no longer exists") && ended.stderr.contains("would delete"),
        "{}",
        ended.stderr
    );
    fs::rename(place.path("moved"), place.path("out")).unwrap();
    assert_eq!(gc(&place, "--min-age 0")["blobs"], 0, "a dry run takes no root away");

    let released = tree(&place.path("out"));
    fs::remove_dir_all(place.path("out")).unwrap();
    assert!(!released.is_empty());
    assert_ne!(gc(&place, "--min-age 0")["blobs"], 0);
    assert_eq!(tree(&place.path(".gs2e/roots")).len(), 0);
    assert_eq!(place.stale("aside").len(), 4);
}

/// Nothing is deleted if the roots are not known.
#[test]
fn unreadable_roots_delete_nothing() {
    let place = two();
    place.ok("release -q --to out recipes/b.yaml");
    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    fs::create_dir(place.path("empty")).unwrap();
    let before = stored(&place);
    let t = |args: &str, code: i32, text: &str| {
        let ended = place.gs2e(&format!("gc {args}"));
        assert_eq!(ended.code, code, "{args}: {}", ended.stderr);
        assert!(ended.stderr.contains(text), "{args}: `{text}` is not in {}", ended.stderr);
        assert!(stored(&place) == before, "{args}");
    };
    t("--min-age 0 nowhere", 2, "nowhere");
    t("--min-age 0 empty", 2, "empty");
    t("--min-age 1w", 2, "12h");
    place.write("recipes/c.yaml", "version: 1\nscene: [");
    t("--min-age 0", 2, "c.yaml");
    place.write("recipes/c.yaml", scene("c", 3).replace("procedural", "procedral"));
    t("--min-age 0", 2, "c.yaml");
    fs::remove_file(place.path("recipes/c.yaml")).unwrap();
    let root = tree(&place.path(".gs2e/roots")).into_keys().next().unwrap();
    place.write(&format!(".gs2e/roots/{root}"), "{");
    t("--min-age 0", 1, &root);
    let holder = Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap();
    t("--min-age 0 --no-wait", 1, "in use by pid");
    drop(holder);
}

/// `gc` is killed at random instants, again and again, while it has much to delete. Marked files
/// are never harmed. Every kill leaves more for the next round.
#[test]
fn a_kill_at_any_moment_loses_no_marked_file() {
    const GARBAGE: u32 = 400;
    let place = two();
    let marked = keys(&place, "recipes");
    let whole = stored(&place);
    // The instants come from SplitMix64 with a fixed seed.
    let mut seed = 11_u64;
    let mut instant = || {
        seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (seed ^ (seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Duration::from_micros((z ^ (z >> 31)) % 20_000)
    };
    let (mut killed, mut midway) = (0, 0);
    for round in 0..20_u32 {
        for i in 0..GARBAGE {
            let name = blake3::hash(&[round.to_le_bytes(), i.to_le_bytes()].concat()).to_hex();
            place.write(&format!(".gs2e/cas/{}/{name}", &name[..2]), "nobody's");
            place.write(&format!(".gs2e/ac/{}/{name}.json", &name[..2]), "{}");
        }
        let before = stored(&place).len();
        let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
        command.args(["gc", "-q", "--min-age", "0"]).current_dir(place.path(""));
        let mut child =
            command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // In every other round the delay begins when the first file is moved to the trash.
        let first = place.path(&format!(".gs2e/gs2e-trash/gc.{}.0", child.id()));
        while round % 2 == 0 && !first.exists() && child.try_wait().unwrap().is_none() {}
        std::thread::sleep(instant());
        child.kill().unwrap();
        killed += usize::from(!child.wait().unwrap().success());
        let left = stored(&place);
        midway += usize::from(left.len() > whole.len() && left.len() < before);
        assert!(left.is_superset(&whole), "round {round}: {:?}", whole.difference(&left));
        assert_eq!(keys(&place, "recipes"), marked, "round {round}");
        assert_eq!(place.build("recipes"), [""; 0], "round {round}");
    }
    eprintln!(
        "kills of gc at random instants: seed 11, {killed} kills, {midway} in the midst of deleting, 0 wrong"
    );
    place.ok("gc -q --min-age 0");
    assert_eq!(stored(&place), whole);
    assert_eq!(tree(&place.path(".gs2e/gs2e-trash")).len(), 0);
}
