//! The user's folders with names like the program's own, and the program's leftovers.

use super::{named, neighbours, out, place, released, text};
use crate::support::workspace::{Workspace, same_tree};
use sha2::{Digest as _, Sha256};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

/// Names that earlier versions used for their own folders, and two like today's.
const LIKE_OURS: [&str; 4] = ["out.partial", "out.old", ".out.gs2e-notes", ".out.gs2e-abcdefgh01234567"];

#[test]
fn folders_named_like_temporary_ones_stay() {
    let place = place();
    for name in LIKE_OURS {
        place.write(&format!("{name}/thesis.txt"), "the only copy");
    }
    for _ in 0..2 {
        let ended = place.ok("release --to out r.yaml");
        assert!(ended.stderr.contains("left as it is"), "{}", ended.stderr);
        place.write("r.yaml", super::POSES.replace("seed: 7", "seed: 8"));
    }
    for name in LIKE_OURS {
        assert_eq!(text(&place.path(&format!("{name}/thesis.txt"))), "the only copy", "{name}");
    }
    place.ok("audit out");
}

/// The reported case: the recipes themselves are in a folder with this name.
#[test]
fn recipes_in_a_folder_named_like_a_temporary_one_stay() {
    let place = place();
    place.write("out.partial/r.yaml", super::POSES);
    place.ok("release --to out out.partial");
    assert_eq!(text(&place.path("out.partial/r.yaml")), super::POSES);
}

#[test]
fn links_named_like_temporary_folders_are_neither_followed_nor_removed() {
    let place = place();
    place.write("mine/thesis.txt", "the only copy");
    for name in LIKE_OURS {
        symlink("mine", place.path(name)).unwrap();
    }
    place.ok("release --to out r.yaml");
    for name in LIKE_OURS {
        assert_eq!(fs::read_link(place.path(name)).unwrap(), Path::new("mine"), "{name}");
    }
    assert_eq!(text(&place.path("mine/thesis.txt")), "the only copy");
}

#[test]
fn a_file_named_like_the_lock_stays() {
    let place = place();
    place.write(".out.gs2e-lock", "the only copy");
    let ended = place.gs2e("release --to out r.yaml");
    assert_ne!(ended.code, 0, "{}", ended.stderr);
    assert!(ended.stderr.contains(".out.gs2e-lock"), "{}", ended.stderr);
    assert_eq!(text(&place.path(".out.gs2e-lock")), "the only copy");
}

/// A data set with its own manifest and complete sums, as is common.
fn data_set(place: &Workspace, manifest: &str) {
    place.write("out/thesis.txt", "precious");
    place.write("out/manifest.json", manifest);
    let sum = |bytes: &[u8]| Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect::<String>();
    let sums = format!("{}  manifest.json\n{}  thesis.txt\n", sum(manifest.as_bytes()), sum(b"precious"));
    place.write("out/SHA256SUMS", sums);
    let sum = |bytes: &[u8]| blake3::hash(bytes).to_hex().to_string();
    let sums = format!("{}  manifest.json\n{}  thesis.txt\n", sum(manifest.as_bytes()), sum(b"precious"));
    place.write("out/B3SUMS", sums);
}

#[test]
fn a_foreign_data_set_is_refused_and_with_replace_moved_aside_whole() {
    let real = text(&released().path("out/manifest.json"));
    for manifest in ["{}", "{\"format\":1}", &real] {
        let place = place();
        data_set(&place, manifest);
        let before = out(&place);
        let ended = place.gs2e("release --to out r.yaml");
        assert_eq!(ended.code, 2, "{}", ended.stderr);
        assert_eq!(out(&place), before, "{manifest}");
        let ended = place.ok("release --replace --to out r.yaml");
        let kept = named(&place, "out.replaced-");
        assert!(ended.stderr.contains(&kept), "{}", ended.stderr);
        assert_eq!(crate::support::workspace::tree(&place.path(&kept)), before, "{manifest}");
        place.ok("audit out");
    }
}

#[test]
fn a_changed_release_is_refused_and_with_replace_its_changes_are_kept() {
    let place = released();
    let before = out(&place);
    place.write("out/tiny/notes.txt", "mine");
    place.write("out/README.md", "my own card");
    fs::remove_file(place.path("out/tiny/base/speed.json")).unwrap();
    fs::create_dir(place.path("out/empty")).unwrap();
    let ended = place.gs2e("release --to out r.yaml");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    let wanted = ["tiny/notes.txt is not listed", "README.md was edited", "speed.json is missing", "empty"];
    for words in wanted {
        assert!(ended.stderr.contains(words), "`{words}` is not in {}", ended.stderr);
    }
    assert_eq!(text(&place.path("out/tiny/notes.txt")), "mine");
    place.ok("release --replace --to out r.yaml");
    assert_eq!(out(&place), before);
    let kept = named(&place, "out.replaced-");
    let kept = crate::support::workspace::tree(&place.path(&kept));
    let names: Vec<&str> = kept.keys().map(String::as_str).collect();
    assert_eq!(names, ["README.md", "tiny/notes.txt"], "and nothing that the program can write again");
    assert_eq!((&kept["README.md"][..], &kept["tiny/notes.txt"][..]), (&b"my own card"[..], &b"mine"[..]));
}

/// A link in a release is not part of it, and is not followed.
#[test]
fn links_in_a_release_are_kept_and_not_followed() {
    let place = released();
    place.write("mine/thesis.txt", "the only copy");
    // A folder of the release was moved elsewhere and replaced by a link.
    fs::rename(place.path("out/tiny/base"), place.path("mine/base")).unwrap();
    symlink("../../mine/base", place.path("out/tiny/base")).unwrap();
    symlink("../mine", place.path("out/shortcut")).unwrap();
    assert_eq!(place.gs2e("release --to out r.yaml").code, 2);
    place.ok("release --replace --to out r.yaml");
    assert_eq!(text(&place.path("mine/thesis.txt")), "the only copy");
    assert!(place.path("mine/base/poses.txt").exists());
    let kept = place.path(&named(&place, "out.replaced-"));
    assert!(kept.join("shortcut").is_symlink() && kept.join("tiny/base").is_symlink());
    place.ok("audit out");
}

#[test]
fn an_updated_release_leaves_no_other_folder() {
    let place = released();
    place.write("r.yaml", super::POSES.replace("seed: 7", "seed: 8"));
    place.ok("release --to out r.yaml");
    place.ok("audit out");
    assert_eq!(neighbours(&place), ["out"]);
    // An empty folder holds nothing to lose.
    fs::create_dir(place.path("empty")).unwrap();
    place.ok("release --to empty r.yaml");
    same_tree(&place.path("out"), &place.path("empty"));
    assert_eq!(neighbours(&place), ["empty", "out"]);
}

#[test]
fn a_failed_release_leaves_no_other_folder() {
    let place = released();
    let before = out(&place);
    place.write("r.yaml", format!("{}checks: {{ pose_continuity: {{ max: 1e-9 }} }}\n", super::POSES));
    let ended = place.gs2e("release --to out r.yaml");
    assert_ne!(ended.code, 0, "{}", ended.stderr);
    let ended = place.gs2e("release --to new/deep/folder r.yaml");
    assert_ne!(ended.code, 0, "{}", ended.stderr);
    assert_eq!((neighbours(&place), out(&place)), (vec!["out".to_owned()], before));
}
