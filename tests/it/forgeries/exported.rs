//! Forgeries of exports: code of others, other contents, and other descriptions.

use super::rich::{judged, released};
use crate::release::forger::{edit, read};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

const EXPORTS: &str = "rich/single/alone/exports";
const EVREAL: &str = "rich/single/alone/exports/evreal";

/// Counts the files of an export in its description, as they are now.
fn recount(tree: &Path, folder: &str) {
    let count = read(&tree.join(folder)).len();
    edit(tree, &format!("{folder}/export.json"), |text| text["files"] = count.into());
}

fn found_after(forge: impl FnOnce(&Path), wanted: &[&str]) {
    assert_eq!(judged(forge), wanted.iter().map(|&fault| fault.to_owned()).collect());
}

#[test]
fn names_that_programs_run_are_foreign_to_exports() {
    let names = ["setup.py", "numpy.py", ".git/hooks/post-checkout", "site.pth", "program", ".hidden.txt"];
    let wanted: BTreeSet<String> = names.map(|name| format!("stray {EVREAL}/{name}")).into();
    let found = judged(|tree| {
        for name in names {
            let path = tree.join(EVREAL).join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"\x7fELF").unwrap();
        }
        recount(tree, EVREAL);
    });
    assert_eq!(found, wanted);
}

#[test]
fn every_file_of_an_export_is_what_the_scene_gives() {
    let files = read(&released().path("tree").join(EXPORTS));
    let names: Vec<&String> = files.keys().filter(|name| !name.ends_with("/export.json")).collect();
    assert!(names.len() > 20 && names.iter().any(|name| name.ends_with(".tar")), "{names:?}");
    let wanted: BTreeSet<String> =
        names.iter().map(|name| format!("not-composed {EXPORTS}/{name}")).collect();
    let found = judged(|tree| {
        for name in names {
            let path = tree.join(EXPORTS).join(name);
            let mut bytes = files[name.as_str()].clone();
            // In a tar archive, the last bytes are padding, which no reader looks at.
            *bytes.last_mut().unwrap() ^= 1;
            fs::write(path, bytes).unwrap();
        }
    });
    assert_eq!(found, wanted);
}

#[test]
fn files_that_come_or_go_are_found_whatever_the_description_states() {
    let extra = format!("stray {EVREAL}/events_more.npy");
    let gone = format!("scene-incomplete {EXPORTS}/webdataset/train-000000.tar");
    let stated = [EVREAL.to_owned(), format!("{EXPORTS}/webdataset")]
        .map(|folder| format!("not-composed {folder}/export.json"));
    found_after(
        |tree| {
            fs::write(tree.join(EVREAL).join("events_more.npy"), b"").unwrap();
            fs::remove_file(tree.join(EXPORTS).join("webdataset/train-000000.tar")).unwrap();
            recount(tree, EVREAL);
            recount(tree, &format!("{EXPORTS}/webdataset"));
        },
        &[&extra, &gone, &stated[0], &stated[1]],
    );
}

#[test]
fn a_folder_of_temporary_files_that_is_not_there_is_no_fault_of_the_release() {
    let mut command = released().command("audit tree");
    let output = command.env("TMPDIR", "/nonexistent").output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("exports are made again in /nonexistent; TMPDIR names another folder"), "{said}");
}

#[test]
fn descriptions_state_what_the_scene_gives() {
    type Forge = fn(&mut Value);
    let forgeries: [(&str, Forge); 4] = [
        ("evreal", |text| text["losses"] = json!([])),
        ("robust-e-nerf", |text| text["facts"]["thresholds"]["on"] = json!(0.3)),
        ("webdataset", |text| text["source"]["scene_licence"]["expression"] = json!("MIT")),
        ("dsec", |text| text["note"] = json!("free for any use")),
    ];
    let wanted: BTreeSet<String> =
        forgeries.map(|(format, _)| format!("not-composed {EXPORTS}/{format}/export.json")).into();
    let found = judged(|tree| {
        for (format, forge) in forgeries {
            edit(tree, &format!("{EXPORTS}/{format}/export.json"), forge);
        }
    });
    assert_eq!(found, wanted);
}
