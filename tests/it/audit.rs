//! `audit` finds each planted damage, with exit 3 and the file's name, and finds nothing in a sound tree.

use crate::support::workspace::Workspace;
use std::fs;
use std::path::Path;

#[test]
fn a_sound_tree_passes_without_its_store() {
    let place = released();
    fs::remove_dir_all(place.path(".gs2e")).expect("the store is there");
    place.ok("audit out");
}

#[test]
fn damage_is_found_where_it_is() {
    let t = |damage: &dyn Fn(&Path), named: &str| {
        let place = released();
        damage(&place.path("out"));
        let ended = place.gs2e("audit out");
        assert_eq!(ended.code, 3, "{named}: {}{}", ended.stdout, ended.stderr);
        let told = ended.stdout + &ended.stderr;
        assert!(told.contains(named), "nothing about {named} in:\n{told}");
    };
    let image = "tiny/base/sharp/000003.png";
    t(&|out| flip_a_bit(&out.join(image)), image);
    t(&|out| flip_a_bit(&out.join("tiny/base/events.h5")), "tiny/base/events.h5");
    t(&|out| fs::remove_file(out.join(image)).expect("it was there"), image);
    t(&|out| fs::write(out.join("tiny/notes.txt"), "x").expect("it can be written"), "tiny/notes.txt");
    t(&|out| fs::create_dir(out.join("tiny/empty")).expect("it can be made"), "tiny/empty");
    t(
        &|out| fs::rename(out.join(image), out.join("tiny/base/sharp/3.png")).expect("it can be moved"),
        "3.png",
    );
    t(&|out| flip_a_bit(&out.join("SHA256SUMS")), "SHA256SUMS");
    t(&|out| fs::remove_file(out.join("LICENSES/CC0-1.0.txt")).expect("it was there"), "CC0-1.0");
}

#[test]
fn what_is_no_release_is_said_to_be_none() {
    let place = Workspace::new();
    place.write("folder/file.txt", "x");
    assert_eq!(place.gs2e("audit folder").code, 3);
    assert_eq!(place.gs2e("audit nowhere").code, 2);
}

fn released() -> Workspace {
    let place = Workspace::with_tiny();
    place.ok("release --to out tiny.yaml");
    place
}

/// One bit in the middle; length and modification time stay.
fn flip_a_bit(path: &Path) {
    let stamp = fs::metadata(path).and_then(|meta| meta.modified()).expect("it is there");
    let mut bytes = fs::read(path).expect("it can be read");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    // Released files are read-only, as the store's are: replaced, as a failing disk would not ask either.
    fs::remove_file(path).expect("it can be replaced");
    fs::write(path, bytes).expect("it can be replaced");
    let file = fs::File::options().write(true).open(path).expect("it is ours");
    file.set_modified(stamp).expect("stamps can be set");
}
