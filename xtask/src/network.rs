//! Eight processes with one shared store on a network file system: two mounts of one folder.
//!
//! `--mounts A,B` names two mounts of any network file system, such as NFS. Without it, sshfs mounts a folder
//! twice; it caches names and attributes, as NFS does. That needs no daemon: the server of SFTP runs on this
//! machine, for each mount. Debian: `apt install sshfs openssh-sftp-server`.

use crate::command::{Outcome, program, say};
use crate::folder::Folder;
use crate::shards::{PROCESSES, ShardPlace};
use std::ffi::OsStr;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const SERVER: &str = "/usr/lib/openssh/sftp-server";

/// Runs it: `--scenes N` (80), `--program FILE` (built in release mode), `--mounts A,B` (by sshfs).
pub(crate) fn run(args: &[String]) -> Outcome {
    let folder = Folder::new("network")?;
    let place = ShardPlace::new(folder.path(), args)?;
    let mounts = mounts(folder.path(), args)?;
    // Each process has its shared store on one of the mounts.
    let on = |i: usize, name: &str| mounts[i % 2].folder().join(name).display().to_string();
    place.ok("release recipes --store alone --to one")?;
    // Each its share, half of them on each mount.
    let first = place.all("first", |i| (on(i, "shared"), format!("--shard {}/{PROCESSES}", i + 1)))?;
    say(&format!("shares on two mounts: {first}"));
    // Each the share of another, on the other mount: all must be there.
    let second = place.all("second", |i| (on(i + 1, "shared"), format!("--shard {}/{PROCESSES}", i + 1)))?;
    say(&format!("the same on the other mounts: {second}"));
    if second.made > 0 {
        return Err("a mount did not show what the other one had".to_owned());
    }
    place.release(&on(1, "shared"), "other")?;
    // All of them the same scenes at the same time, in a new shared store.
    let third = place.all("third", |i| (on(i, "race"), String::new()))?;
    say(&format!("all scenes by each of them at the same time: {third}"));
    place.release(&on(0, "race"), "raced")
}

/// Two mounts of one folder: those that the arguments name, else those of sshfs.
fn mounts(folder: &Path, args: &[String]) -> Outcome<[Mount; 2]> {
    if let Some(at) = args.iter().position(|arg| arg == "--mounts") {
        let named = args.get(at + 1).and_then(|names| names.split_once(','));
        let (a, b) = named.ok_or("--mounts takes two folders with a comma between them")?;
        // A new folder, so that everything that is there stays as it is.
        let name = folder.file_name().unwrap_or_default();
        let mounts = [a, b].map(|mount| Mount::Named(Path::new(mount).join(name)));
        fs::create_dir(mounts[0].folder()).map_err(|e| format!("{a}: {e}"))?;
        if !mounts[1].folder().is_dir() {
            return Err(format!("a new folder in {a} is not in {b}"));
        }
        return Ok(mounts);
    }
    if !Path::new(SERVER).exists() || !program(OsStr::new("which"), &["sshfs"]).succeeds() {
        let why = "sshfs is not installed, and nothing ran: apt install sshfs openssh-sftp-server";
        return Err(why.to_owned());
    }
    Ok([Mount::sshfs(folder, "a")?, Mount::sshfs(folder, "b")?])
}

/// One of the mounts.
enum Mount {
    /// A folder on a mount of the user; removed on drop.
    Named(PathBuf),
    /// A mount of the folder `server` by sshfs; unmounted on drop.
    Sshfs(PathBuf),
}

impl Mount {
    fn sshfs(folder: &Path, name: &str) -> Outcome<Self> {
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
        Ok(Self::Sshfs(at))
    }

    fn folder(&self) -> &Path {
        let (Self::Named(path) | Self::Sshfs(path)) = self;
        path
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        let ended = match &*self {
            // The second mount shows the folder that the first one removed.
            Self::Named(path) => match fs::remove_dir_all(path) {
                Err(e) if e.kind() != ErrorKind::NotFound => Err(format!("{}: {e}", path.display())),
                _ => Ok(()),
            },
            Self::Sshfs(path) => {
                program(OsStr::new("fusermount"), &[OsStr::new("-u"), path.as_os_str()]).run()
            }
        };
        if let Err(why) = ended {
            say(&why);
        }
    }
}
