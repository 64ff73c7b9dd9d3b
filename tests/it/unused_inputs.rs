//! Inputs and outputs that are refused before anything runs: named files that nothing would read, and outputs
//! in folders that must stay as they are.

use crate::support::given::{sound, transforms};
use crate::support::workspace::{TINY, Workspace, tree};
use std::fs;
use std::os::unix::fs::symlink;

/// Checks that the command line is refused with exit code 2 and these words, and changes no file.
#[track_caller]
fn refused(place: &Workspace, args: &str, wanted: &str) {
    let before = tree(&place.path(""));
    let ended = place.gs2e(args);
    assert_eq!(ended.code, 2, "{args}: {}", ended.stderr);
    assert!(ended.stderr.contains(wanted), "{args}: {}", ended.stderr);
    assert!(before == tree(&place.path("")), "{args}: files were changed");
}

#[test]
fn a_named_file_is_looked_for_even_where_it_is_not_needed() {
    let place = Workspace::new();
    place.write("few.txt", "8 8\n0 1 1 1\n9 5 5 0\n");
    symlink("/dev/zero", place.path("zero")).unwrap();
    place.ok("check --events few.txt --size 8x8");
    for option in ["camera", "stamps", "poses"] {
        let args = format!("check --events few.txt --size 8x8 --{option}");
        refused(&place, &format!("{args} nope.txt"), &format!("{option}: nope.txt does not exist"));
        refused(&place, &format!("{args} zero"), &format!("{option}: zero is a device, not a regular file"));
    }
    place.write("transforms.json", transforms(1.0));
    place.write("tiny.yaml", TINY);
    let args = "trajectory --recipe tiny.yaml --name base --capture transforms.json --out poses.txt --scene";
    refused(&place, &format!("{args} nope.ply"), "scene: nope.ply does not exist");
    refused(&place, &format!("{args} zero"), "scene: zero is a device");
}

#[test]
fn nothing_is_written_into_a_release_or_a_store() {
    let place = sound();
    place.ok("release --to out recipe.yaml");
    refused(&place, "audit out --shard 1/2 --parts out/parts", "is in the release out");
    symlink("out", place.path("other")).unwrap();
    refused(&place, "audit out --shard 1/2 --parts other/a/b", "is in the release out");
    refused(&place, "export out --to colmap --out out/colmap", "is in the release out");
    refused(&place, "build --to .gs2e recipe.yaml", "is in the store .gs2e");
    refused(&place, "build --store new --to new/links recipe.yaml", "is in the store new");
    place.ok("audit out");
}

#[test]
fn a_photo_beyond_the_limit_is_refused_unread() {
    let place = sound();
    let photo = fs::File::create(place.path("images/huge.png")).or_else(|_| {
        fs::create_dir_all(place.path("images")).unwrap();
        fs::File::create(place.path("images/huge.png"))
    });
    // Sparse: it takes no space, and hashing it would take minutes.
    photo.unwrap().set_len(1 << 40).unwrap();
    place.write(
        "photos.yaml",
        "version: 1\nscene: many\nsource: { photos: { path: images } }\nreconstruct: { builtin: {} }\n\
        trajectories: [{ name: base, refine: { factor: 2 }, speed: { function: \"1\" } }]\noutputs: [sharp]\n\
        licence: { expression: CC0-1.0, holder: a test }\n",
    );
    // 1 TiB at 10 GB/s is 100 s. Seconds of a core, which no other load takes from it.
    let limited = ["-c", "ulimit -t 50; exec \"$0\" plan photos.yaml", env!("CARGO_BIN_EXE_gs2e")];
    let ended = std::process::Command::new("sh").args(limited).current_dir(place.path("")).output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.code().is_some_and(|code| code != 0), "{}: {said}", ended.status);
    assert!(said.contains("larger than the limit"), "{said}");
}

/// The embedded scene has a camera of its own, so the plan knows that of the recipe.
#[test]
fn a_lens_that_folds_for_the_camera_of_the_source_is_refused_by_the_plan() {
    let place = Workspace::new();
    let folds = "camera: { width: 64, height: 48, lens: { opencv: [-5, 0, 0, 0] } }";
    place.write("tiny.yaml", TINY.replace("camera: { width: 64, height: 48 }", folds));
    refused(&place, "plan tiny.yaml", "shows no ray at pixel");
    let ended = place.gs2e("build tiny.yaml");
    assert!(ended.code == 2 && ended.stderr.contains("the camera of tiny shows no ray"), "{}", ended.stderr);
}

/// A shell or a mail may append a blank to the name of the list of scenes that must not be released.
#[test]
fn a_list_of_scenes_with_a_blank_in_its_name_is_refused() {
    let place = Workspace::with_tiny();
    place.write("takedown.txt ", "tiny 2026-01-01\n");
    refused(&place, "plan tiny.yaml", "wanted takedown.txt");
}

#[test]
fn a_public_key_signs_nothing_and_is_named() {
    let place = Workspace::with_tiny();
    // The algorithm `Ed`, the number of the key, and 32 bytes.
    place.write(
        "key.pub",
        "untrusted comment: minisign public key\nRWQAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\n",
    );
    refused(&place, "release --to out --sign key.pub tiny.yaml", "it is a public key, wanted the secret key");
}
