//! Exports that `release.yaml` includes: they are part of the release, of its manifest and its audit.

use crate::release::small::{RECIPE, edit, release, reseal};
use crate::support::workspace::{Workspace, alter, tree};
use serde_json::{Value, json};
use std::fs;

/// Robust e-NeRF of both trajectories, E2VID of one.
const INCLUDE: &str = "include: [robust-e-nerf, { format: e2vid-zip, trajectory: base }]\n";
const ROBUST: &str = "small/one/slow/exports/robust-e-nerf";

fn place(include: &str) -> Workspace {
    let place = Workspace::new();
    place.write("recipes/small.yaml", RECIPE);
    place.write("recipes/release.yaml", include);
    place
}

/// Codes and files of the faults that an audit finds.
fn faults(place: &Workspace, more: &str) -> Vec<String> {
    let text = place.gs2e(&format!("audit out --json {more}")).stdout;
    let records = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let faults = records.filter(|record| record["code"].is_string());
    faults
        .map(|fault| format!("{} {}", fault["code"].as_str().unwrap(), fault["file"].as_str().unwrap()))
        .collect()
}

/// The number of records of exports in the store.
fn stored(place: &Workspace) -> usize {
    let records = tree(&place.path(".gs2e/ac"));
    records.values().filter(|record| String::from_utf8_lossy(record).contains("\"stage\":\"export\"")).count()
}

#[test]
fn a_release_has_the_exports_that_it_includes() {
    let place = place(INCLUDE);
    place.ok("release -q --copy --to out");
    let files = tree(&place.path("out"));
    let exported = |path: &&String| path.contains("/exports/");
    let folders: std::collections::BTreeSet<String> = files
        .keys()
        .filter(exported)
        .map(|path| path.split('/').take(5).collect::<Vec<_>>().join("/"))
        .collect();
    let wanted = ["base/exports/e2vid-zip", "base/exports/robust-e-nerf", "slow/exports/robust-e-nerf"];
    assert_eq!(folders.into_iter().collect::<Vec<_>>(), wanted.map(|folder| format!("small/one/{folder}")));

    // The rest is the release without them, but for the files that describe the whole.
    let plain = tree(release());
    for (path, bytes) in &plain {
        let describes =
            ["B3SUMS", "SHA256SUMS", "README.md", "manifest.json", "croissant.json", "report.html"];
        assert!(describes.contains(&path.as_str()) || files[path] == *bytes, "{path}");
    }
    assert_eq!(files.keys().filter(|path| !exported(path)).count(), plain.len());

    // Manifest, sums, licences, card and catalogue have them.
    let manifest: Value = serde_json::from_slice(&files["manifest.json"]).unwrap();
    let include = json!([{ "format": "robust-e-nerf" }, { "format": "e2vid-zip", "trajectory": "base" }]);
    assert_eq!(manifest["include"], include);
    let listed = manifest["scenes"][0]["files"].as_array().unwrap();
    let listed: Vec<&str> = listed.iter().map(|file| file["path"].as_str().unwrap()).collect();
    let text = |name: &str| String::from_utf8(files[name].clone()).unwrap();
    for path in files.keys().filter(exported) {
        assert!(listed.contains(&path.as_str()) && text("SHA256SUMS").contains(path.as_str()), "{path}");
    }
    assert!(text("REUSE.toml").contains("path = \"small/one/**\""));
    assert!(text("README.md").contains("| `exports/*/` |"), "{}", text("README.md"));
    let catalogue: Value = serde_json::from_slice(&files["croissant.json"]).unwrap();
    let sets =
        catalogue["distribution"].as_array().unwrap().iter().filter(|node| node["@type"] == "cr:FileSet");
    assert!(sets.map(|set| assert_eq!(set["cr:excludes"], "**/exports/**")).count() > 3);

    // Each is what `gs2e export` makes of the release. Only the licence of the whole is not stated.
    place.ok("export out --trajectory slow --to robust-e-nerf --out robust");
    let again = tree(&place.path("robust"));
    assert_eq!(files.keys().filter(|path| path.starts_with(ROBUST)).count(), again.len());
    for (path, bytes) in &again {
        let own = &files[&format!("{ROBUST}/{path}")];
        if path == "export.json" {
            let [mut made, own] = [bytes, own].map(|json| serde_json::from_slice::<Value>(json).unwrap());
            made["source"].as_object_mut().unwrap().remove("licence");
            assert_eq!(made, own);
        } else {
            assert!(bytes == own, "{path}");
        }
    }

    // A sound release; made again from its recipes it has the same bytes.
    assert_eq!(faults(&place, "--rebuild 1"), [""; 0]);
}

#[test]
fn an_export_is_made_once_and_kept_by_gc() {
    let place = place(INCLUDE);
    place.ok("release -q --to out");
    assert_eq!(stored(&place), 3);
    let before = tree(&place.path("out"));
    assert!(place.ok("release --to out").stderr.contains("out is up to date"));
    place.ok("release -q --copy --to other");
    assert!(before == tree(&place.path("other")));
    place.ok("gc --min-age 0s");
    assert_eq!(stored(&place), 3);
    // A stored file that was altered is made again.
    let zip = place.path("out/small/one/base/exports/e2vid-zip/events.zip");
    let digest = blake3::hash(&fs::read(&zip).unwrap()).to_hex().to_string();
    alter(&place.path(&format!(".gs2e/cas/{}/{digest}", &digest[..2])), false);
    place.ok("release -q --copy --to third");
    assert!(before == tree(&place.path("third")));
    // Without the list, the release is that of a folder without `release.yaml`.
    fs::remove_file(place.path("recipes/release.yaml")).unwrap();
    place.ok("release -q --copy --to out");
    assert!(tree(&place.path("out")) == tree(release()));
}

#[test]
fn an_audit_finds_changes_of_exports() {
    let place = place("include: [{ format: e2vid-zip, trajectory: base }]\n");
    place.ok("release -q --copy --to out");
    let folder = "small/one/base/exports/e2vid-zip";
    let path = place.path(&format!("out/{folder}/images/timestamps.txt"));
    let sound = fs::read(&path).unwrap();
    fs::write(&path, b"0.000000\n").unwrap();
    let found = faults(&place, "");
    assert!(
        found.iter().any(|fault| fault.ends_with(&format!("{folder}/images/timestamps.txt"))),
        "{found:?}"
    );
    // Sealed again, a change is found by the export of the scene, and by a rebuild.
    reseal(&place.path("out"));
    assert_eq!(faults(&place, ""), [format!("not-composed {folder}/images/timestamps.txt")]);
    let found = faults(&place, "--rebuild 1");
    assert!(found.contains(&format!("rebuilt-differs {folder}/images/timestamps.txt")), "{found:?}");
    fs::write(&path, sound).unwrap();

    place.write(&format!("out/{folder}/more.txt"), "more");
    reseal(&place.path("out"));
    assert_eq!(faults(&place, ""), [format!("claims-disagree {folder}/export.json")]);
    fs::remove_file(place.path(&format!("out/{folder}/more.txt"))).unwrap();

    place.write("out/small/one/base/exports/colmap/cameras.txt", "1");
    reseal(&place.path("out"));
    assert_eq!(faults(&place, ""), ["stray small/one/base/exports/colmap/cameras.txt"]);
    fs::remove_dir_all(place.path("out/small/one/base/exports/colmap")).unwrap();

    edit(&place.path("out"), &format!("{folder}/export.json"), |text| {
        text["selection"]["scene"] = "x".into()
    });
    reseal(&place.path("out"));
    let found = faults(&place, "");
    assert!(found.contains(&format!("claims-disagree {folder}/export.json")), "{found:?}");
    fs::remove_file(place.path(&format!("out/{folder}/export.json"))).unwrap();
    reseal(&place.path("out"));
    assert_eq!(faults(&place, ""), [format!("missing {folder}/export.json")]);
}

#[test]
fn what_no_build_can_export_is_refused_before_the_build() {
    for (include, words) in [
        // The camera has 64x48 pixels.
        ("[e-nerf]", &["small/one/base/exports/e-nerf", "pictures of 64x48, wanted 201x201"][..]),
        ("[{ format: colmap, trajectory: fast }]", &["`fast`, wanted one of: base, slow"]),
        ("[{ format: colmap, sensor: left }]", &["small/one/base/exports/colmap", "the sensor `left`"]),
        ("[{ format: dsec, test_from: slow }]", &["test-every instead of --test-from"]),
        ("[nerf]", &["release.yaml:1:11", "unknown format \"nerf\""]),
        ("[colmap, { format: colmap, trajectory: base }]", &["release.yaml:1:19", "included twice"]),
        ("[{ format: colmap, test_every: 1 }]", &["is 1, wanted at least 2"]),
        ("[{ format: colmap, every: 1 }]", &["release.yaml:1:", "every"]),
        ("[{ trajectory: base }]", &["missing field", "format"]),
        ("colmap", &["wanted a list"]),
    ] {
        let place = place(&format!("include: {include}\n"));
        let ended = place.gs2e("release --to out");
        assert_eq!(ended.code, 2, "{include}: {}", ended.stderr);
        for word in words {
            assert!(ended.stderr.contains(word), "{include}: wanted `{word}`: {}", ended.stderr);
        }
        assert!(!place.path("out").exists() && !place.path(".gs2e").exists(), "{include}");
    }
    let place = place("include: [colmap]\n");
    place.write("recipes/small.yaml", RECIPE.replace("small/one", "exports/one"));
    let ended = place.gs2e("release --to out");
    assert!(ended.code == 2 && ended.stderr.contains("with the name `exports`"), "{}", ended.stderr);
}

/// The number of frames and the losses are known after the build.
#[test]
fn an_unmet_need_leaves_the_release_as_it_was() {
    let place = place("include: [{ format: colmap, trajectory: base }]\n");
    place.ok("release -q --copy --to out");
    let before = tree(&place.path("out"));
    for (include, words) in [
        (
            "[{ format: event-3dgs, lossy: true }]",
            ["base/exports/event-3dgs", "6 sharp frames, wanted at least 86"],
        ),
        ("[deblur-e-nerf]", ["sensor.circuit", "lossy: true"]),
    ] {
        place.write("recipes/release.yaml", format!("include: {include}\n"));
        let ended = place.gs2e("release --to out");
        assert_eq!(ended.code, 2, "{include}: {}", ended.stderr);
        for word in words {
            assert!(ended.stderr.contains(word), "{include}: wanted `{word}`: {}", ended.stderr);
        }
        assert!(before == tree(&place.path("out")), "{include}");
        let names: Vec<_> =
            fs::read_dir(place.path("")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names.len(), 3, "{names:?}");
        assert_eq!(fs::read_dir(place.path(".gs2e/gs2e-tmp")).unwrap().count(), 0, "{include}");
    }
}
