//! The warning about a disk that is too small for what a build expects to write.

use crate::support::absent::not_run;
use crate::support::workspace::{TINY, Workspace};
use std::process::Command;

/// Runs a build with a store on a file system that has 400 kB free, in a name space of its own.
const SCRIPT: &str = "mkdir full && mount -t tmpfs -o size=$(( $(du -s -k .gs2e | cut -f1) + 400 ))k none full \
                      && cp -a .gs2e full/store && exec \"$0\" build --store full/store tiny.yaml";

#[test]
fn a_small_disk_is_named_before_the_steps_run() {
    let can = Command::new("unshare").args(["-rm", "mount", "-t", "tmpfs", "none", "/mnt"]).output();
    if !can.is_ok_and(|output| output.status.success()) {
        return not_run("no file system can be mounted");
    }
    let place = Workspace::new();
    let recipe = TINY.replace("width: 64, height: 48", "width: 320, height: 240");
    place.write("tiny.yaml", &recipe);
    place.ok("build tiny.yaml");
    // The pictures are made again, and take as much as before.
    place.write("tiny.yaml", format!("{recipe}render: {{ background: [1, 1, 1] }}\n"));
    let script = ["-rm", "sh", "-c", SCRIPT, env!("CARGO_BIN_EXE_gs2e")];
    let ended = Command::new("unshare").args(script).current_dir(place.path("")).output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(said.contains("the outputs take about ") && said.contains(" GB free"), "{said}");
    // On a disk with room the same build says nothing of it.
    let said = place.ok("build tiny.yaml").stderr;
    assert!(!said.contains("the outputs take about "), "{said}");
}
