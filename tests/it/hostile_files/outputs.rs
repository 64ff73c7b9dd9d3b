//! Outputs that the user names: only regular files are replaced, they keep their mode, links are
//! followed, and a read-only file stays.

use super::{plant, run};
use crate::support::given::sound;
use crate::support::workspace::Workspace;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};

/// Each verb that writes one file, with `OUT` for the file's name, and the name's extension.
const WRITERS: [(&str, &str); 5] = [
    ("convert scene.ply OUT --lossy", "spz"),
    ("convert e.csv OUT --size 8x8", "npz"),
    ("convert e.csv OUT --size 8x8 --lossy", "png"),
    ("render --scene scene.ply --view transforms.json --out OUT", "npy"),
    ("trajectory --capture transforms.json --recipe recipe.yaml --name base --out OUT", "txt"),
];

fn place() -> Workspace {
    let place = sound();
    place.write("e.csv", "t,x,y,p\n1,2,3,1\n5,4,3,0\n");
    place
}

fn mode(place: &Workspace, name: &str) -> u32 {
    fs::metadata(place.path(name)).unwrap().permissions().mode() & 0o777
}

#[test]
fn only_regular_files_are_written_to() {
    let place = place();
    for (writer, end) in WRITERS {
        let out = format!("out.{end}");
        let args = writer.replace("OUT", &out);
        for kind in ["device", "FIFO", "socket", "loop", "folder"] {
            plant(kind, &place.path(&out));
            let before = fs::symlink_metadata(place.path(&out)).unwrap().file_type();
            let ended = run(&place.path(""), &args);
            assert_eq!(ended.code, 2, "{kind}, {args}: {}", ended.stderr);
            assert_eq!(fs::symlink_metadata(place.path(&out)).unwrap().file_type(), before, "{kind}, {args}");
        }
        plant("folder", &place.path(&out));
        fs::remove_dir(place.path(&out)).unwrap();
    }
}

#[test]
fn a_file_that_is_replaced_keeps_its_mode_and_a_link_its_target() {
    let place = place();
    for (writer, end) in WRITERS {
        let out = format!("out.{end}");
        let args = writer.replace("OUT", &out);
        place.ok(&args);
        let written = fs::read(place.path(&out)).unwrap();
        for wanted in [0o600, 0o640, 0o755] {
            fs::set_permissions(place.path(&out), fs::Permissions::from_mode(wanted)).unwrap();
            place.ok(&args);
            assert_eq!(mode(&place, &out), wanted, "{args}");
        }
        place.write(&out, "to be kept");
        fs::set_permissions(place.path(&out), fs::Permissions::from_mode(0o444)).unwrap();
        let ended = place.gs2e(&args);
        assert_eq!(ended.code, 2, "{args}: {}", ended.stderr);
        assert!(ended.stderr.contains("a read-only file"), "{args}: {}", ended.stderr);
        assert_eq!(fs::read(place.path(&out)).unwrap(), b"to be kept", "{args}");

        fs::create_dir_all(place.path("elsewhere")).unwrap();
        fs::remove_file(place.path(&out)).unwrap();
        symlink(format!("elsewhere/{out}"), place.path(&out)).unwrap();
        for _ in 0..2 {
            place.ok(&args);
            assert!(place.path(&out).is_symlink(), "{args}");
            assert_eq!(fs::read(place.path(&format!("elsewhere/{out}"))).unwrap(), written, "{args}");
        }
        let left = fs::read_dir(place.path("elsewhere")).unwrap().count();
        assert_eq!(left, 1, "{args}: no part is left");
        fs::remove_dir_all(place.path("elsewhere")).unwrap();
        fs::remove_file(place.path(&out)).unwrap();
    }
}

#[test]
fn an_empty_event_text_is_an_error_and_a_byte_order_mark_is_not() {
    let place = Workspace::new();
    for (name, text) in [("e.csv", ""), ("e.txt", ""), ("e.csv", "\n\n"), ("e.txt", "\u{feff}")] {
        place.write(name, text);
        let ended = place.gs2e(&format!("convert --size 8x8 {name} new.npz"));
        assert_eq!(ended.code, 1, "{name} {text:?}: {}", ended.stderr);
        assert!(ended.stderr.contains("the file is empty"), "{}", ended.stderr);
    }
    place.write("e.csv", "t,x,y,p\n");
    assert!(place.ok("convert --size 8x8 e.csv new.npz").stderr.contains("0 events"));
    place.write("e.csv", "\u{feff}t,x,y,p\r\n7,1,2,1\r\n");
    assert!(place.ok("convert --size 8x8 e.csv new.npz").stderr.contains("1 event"));
    place.write("e.csv", format!("t,x,y,p\n{}", "1".repeat(1 << 17)));
    let ended = place.gs2e("convert --size 8x8 e.csv new.npz");
    assert!(
        ended.code == 1 && ended.stderr.contains("line 2: a line of more than 65536 bytes"),
        "{}",
        ended.stderr
    );
}
