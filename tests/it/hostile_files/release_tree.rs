//! A release from an untrusted source: nothing outside its folder is read, and no special file in
//! it.

use super::{KINDS, plant, run};
use crate::release::small::{copy, read, reseal};
use rust_hdf5::H5File;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

const SCENE: &str = "small/one";

/// Runs a verb on a tree. `TREE` in the verb means the tree's path.
fn checked(verb: &str, tree: &Path) -> (i32, String) {
    let folder = tree.parent().unwrap();
    let args = verb.replace("TREE", tree.to_str().unwrap());
    let ended = run(folder, &args);
    (ended.code, format!("{}{}", ended.stdout, ended.stderr))
}

#[test]
fn no_reader_of_a_tree_takes_a_special_file() {
    let tree = copy();
    let other = copy();
    let change = |text: &str| text.replacen("small/one", "small/two", 1);
    let manifest = fs::read_to_string(other.path().join("manifest.json")).unwrap();
    fs::write(other.path().join("manifest.json"), change(&manifest)).unwrap();
    let diff = format!("diff TREE {}", other.path().display());
    let in_scene = |name: &str| format!("{SCENE}/{name}");
    let check = "check --tree TREE";
    for (verb, file, codes) in [
        ("audit TREE", "SHA256SUMS".to_owned(), [3, 3]),
        ("audit TREE", "B3SUMS".to_owned(), [3, 3]),
        ("audit TREE", "manifest.json".to_owned(), [3, 3]),
        ("audit TREE", in_scene("scene.json"), [3, 3]),
        ("audit TREE", in_scene("base/events.h5"), [3, 3]),
        (check, "manifest.json".to_owned(), [1, 2]),
        (check, in_scene("scene.json"), [1, 2]),
        (check, in_scene("base/poses.txt"), [1, 2]),
        (check, in_scene("base/speed.json"), [1, 2]),
        (check, in_scene("base/events.h5"), [1, 2]),
        (&diff, "manifest.json".to_owned(), [2, 2]),
    ] {
        let path = tree.path().join(&file);
        let before = fs::read(&path).unwrap();
        for kind in KINDS {
            plant(kind, &path);
            let (code, message) = checked(verb, tree.path());
            assert!(codes.contains(&code), "{kind} at {file}, {verb}: exit {code}\n{message}");
            let name = file.rsplit('/').next().unwrap();
            assert!(message.contains(name), "{kind} at {file}, {verb}:\n{message}");
        }
        plant("folder", &path);
        fs::remove_dir(&path).unwrap();
        fs::write(&path, before).unwrap();
    }
    assert_eq!(checked("audit TREE", tree.path()).0, 0, "the tree is whole again");
}

#[test]
fn links_of_a_tree_are_refused_even_to_equal_files() {
    let tree = copy();
    let outside = copy();
    for name in
        ["manifest.json", "small/one/scene.json", "small/one/base/poses.txt", "small/one/base", "small"]
    {
        let path = tree.path().join(name);
        let aside = tree.path().with_extension("aside");
        fs::rename(&path, &aside).unwrap();
        symlink(outside.path().join(name), &path).unwrap();
        let (code, message) = checked("check --tree TREE", tree.path());
        assert_eq!(code, 1, "{name}: {message}");
        assert!(message.contains("a link"), "{name}: {message}");
        assert_eq!(checked("audit TREE", tree.path()).0, 3, "{name}");
        fs::remove_file(&path).unwrap();
        fs::rename(&aside, &path).unwrap();
    }
}

#[test]
fn a_name_that_leads_out_of_the_tree_is_refused() {
    let outside = copy();
    let tree = copy();
    let out_of = |name: &str| format!("../../../../{}/{SCENE}/{name}", relative(outside.path()));
    let path = tree.path().join(SCENE).join("scene.json");
    let sound = fs::read_to_string(&path).unwrap();
    let mut scene: serde_json::Value = serde_json::from_str(&sound).unwrap();
    scene["trajectories"][0]["name"] = out_of("base").into();
    fs::write(&path, scene.to_string()).unwrap();
    reseal(tree.path());
    let (code, message) = checked("check --tree TREE", tree.path());
    assert_eq!(code, 1, "{message}");
    assert!(message.contains("the path leads out of its folder"), "{message}");
    assert_eq!(checked("audit TREE", tree.path()).0, 3);

    fs::write(&path, sound).unwrap();
    reseal(tree.path());
    let path = tree.path().join("manifest.json");
    let mut manifest: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    manifest["scenes"][0]["id"] = format!("../{}/{SCENE}", relative(outside.path())).into();
    fs::write(&path, manifest.to_string()).unwrap();
    for (verb, codes) in [("check --tree TREE", 1), ("audit TREE", 3)] {
        let (code, message) = checked(verb, tree.path());
        assert_eq!(code, codes, "{verb}: {message}");
    }
}

/// Path of a test's folder, relative to another's: they are siblings.
fn relative(folder: &Path) -> String {
    folder.file_name().unwrap().to_str().unwrap().to_owned()
}

#[test]
fn events_that_lie_in_another_file_are_refused() {
    let tree = copy();
    let whole = tree.path().with_extension("h5");
    let path = tree.path().join(SCENE).join("base/events.h5");
    fs::rename(&path, &whole).unwrap();
    let file = H5File::create(&path).unwrap();
    for name in ["events", "ms_to_idx", "t_offset"] {
        file.create_external_link(name, whole.to_str().unwrap(), &format!("/{name}")).unwrap();
    }
    file.close().unwrap();
    reseal(tree.path());
    let (code, message) = checked("audit TREE", tree.path());
    assert!(code == 3 && message.contains("a link to another file"), "{code} {message}");
    let (code, message) = checked("check --tree TREE", tree.path());
    assert!(code == 1 && message.contains("a link to another file"), "{code} {message}");
    let (code, message) =
        checked("convert --lossy --size 64x48 TREE/small/one/base/events.h5 e.txt", tree.path());
    assert!(code == 1 && message.contains("a link to another file"), "{code} {message}");
    fs::remove_file(whole).unwrap();
    assert!(!read(tree.path()).contains_key("e.txt"));
}
