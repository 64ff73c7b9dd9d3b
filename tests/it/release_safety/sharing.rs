//! Files of a release and files of the store are separate, unless the user asks for links.

use super::{out, place, released};
use crate::support::workspace::Workspace;
use std::fs::{self, File, Permissions};
use std::io::Write as _;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};

const POSES_TXT: &str = "out/tiny/base/poses.txt";

fn append(place: &Workspace, path: &str) {
    let path = place.path(path);
    fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
    File::options().append(true).open(path).unwrap().write_all(b"0 0 0 0 0 0 0 1\n").unwrap();
}

fn names_of(place: &Workspace, path: &str) -> u64 {
    fs::metadata(place.path(path)).unwrap().nlink()
}

#[test]
fn a_line_appended_to_a_release_changes_nothing_else() {
    for how in ["", "--link reflink", "--link copy", "--copy"] {
        let place = place();
        place.ok(&format!("release {how} --to out r.yaml"));
        place.ok(&format!("release {how} --to other r.yaml"));
        append(&place, POSES_TXT);
        assert_eq!(place.gs2e("audit out").code, 3, "{how}");
        place.ok("audit other");
        assert!(place.stale("r.yaml").is_empty(), "{how}");
        place.ok("build --verify r.yaml");
        assert_eq!(names_of(&place, POSES_TXT), 1, "{how}");
    }
}

/// A link that somebody made after the release, or that an older version made.
#[test]
fn a_release_that_shares_a_file_is_written_again() {
    let place = released();
    fs::hard_link(place.path(POSES_TXT), place.path("second")).unwrap();
    let before = out(&place);
    place.ok("release --to out r.yaml");
    assert_eq!((names_of(&place, POSES_TXT), out(&place)), (1, before));
    for how in ["--link hard", "--copy --link copy"] {
        let ended = place.gs2e(&format!("release {how} --to out r.yaml"));
        assert_eq!(ended.code, 2, "{}", ended.stderr);
    }
}

#[test]
fn an_unchanged_release_is_not_written_again() {
    let place = released();
    let inode = |path: &str| fs::metadata(place.path(path)).unwrap().ino();
    let before = [inode("out"), inode(POSES_TXT)];
    let ended = place.ok("release --json --to out r.yaml");
    assert!(ended.stderr.contains("out is up to date: 1 scene(s), "), "{}", ended.stderr);
    assert!(ended.stdout.contains("\"written\":false"), "{}", ended.stdout);
    assert_eq!([inode("out"), inode(POSES_TXT)], before);
    // When one file's content changes, the unchanged files are taken over.
    place.write("release.yaml", "name: Another\n");
    let ended = place.ok("release --json --to out r.yaml");
    assert!(ended.stdout.contains("\"written\":true"), "{}", ended.stdout);
    assert_ne!(inode("out"), before[0]);
    assert_eq!((inode(POSES_TXT), names_of(&place, POSES_TXT)), (before[1], 1));
    place.ok("audit out");
}
