//! Eight processes with one shared store on a network file system: two mounts of one folder by sshfs, which
//! caches names and attributes, as NFS does.
//!
//! It needs no daemon: the server of SFTP runs on this machine, for each mount. Debian: `apt install sshfs
//! openssh-sftp-server`.

use crate::command::{Outcome, program, say};
use crate::folder::Folder;
use crate::shards::{PROCESSES, ShardPlace};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

const SERVER: &str = "/usr/lib/openssh/sftp-server";

/// Runs it: `--scenes N` (80), `--program FILE` (built in release mode).
pub(crate) fn run(args: &[String]) -> Outcome {
    if !Path::new(SERVER).exists() || !program(OsStr::new("which"), &["sshfs"]).succeeds() {
        return Err(
            "sshfs is not installed, and nothing ran: apt install sshfs openssh-sftp-server".to_owned()
        );
    }
    let folder = Folder::new("network")?;
    let place = ShardPlace::new(folder.path(), args)?;
    let _mounts = [Mount::new(folder.path(), "a")?, Mount::new(folder.path(), "b")?];
    place.ok("release recipes --store alone --to one")?;
    // Each its share, half of them on each mount.
    let first = place
        .all("first", |i| (["a/shared", "b/shared"][i % 2], format!("--shard {}/{PROCESSES}", i + 1)))?;
    say(&format!("shares on two mounts: {first}"));
    // Each the share of another, on the other mount: all must be there.
    let second = place
        .all("second", |i| (["b/shared", "a/shared"][i % 2], format!("--shard {}/{PROCESSES}", i + 1)))?;
    say(&format!("the same on the other mounts: {second}"));
    if second.made > 0 {
        return Err("a mount did not show what the other one had".to_owned());
    }
    place.release("b/shared", "other")?;
    // All of them the same scenes at the same time, in a new shared store.
    let third = place.all("third", |i| (["a/race", "b/race"][i % 2], String::new()))?;
    say(&format!("all scenes by each of them at the same time: {third}"));
    place.release("a/race", "raced")
}

/// A mount of the folder `server`, unmounted on drop.
struct Mount(PathBuf);

impl Mount {
    fn new(folder: &Path, name: &str) -> Outcome<Self> {
        let (server, at) = (folder.join("server"), folder.join(name));
        for path in [&server, &at] {
            fs::create_dir_all(path).map_err(|e| format!("{}: {e}", path.display()))?;
        }
        let script = folder.join("sftp.sh");
        fs::write(&script, format!("#!/bin/sh\nexec {SERVER}\n")).map_err(|e| e.to_string())?;
        program(OsStr::new("chmod"), &[OsStr::new("755"), script.as_os_str()]).run()?;
        let source = format!("here:{}", server.display());
        let options = format!("ssh_command={},cache=yes,cache_timeout=20,attr_timeout=3", script.display());
        program(OsStr::new("sshfs"), &[source.as_str(), &at.to_string_lossy(), "-o", &options]).run()?;
        Ok(Self(at))
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        if let Err(why) = program(OsStr::new("fusermount"), &[OsStr::new("-u"), self.0.as_os_str()]).run() {
            say(&why);
        }
    }
}
