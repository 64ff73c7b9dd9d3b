//! One writer a store: an advisory lock that the kernel drops with its holder, so there is nothing to unlock by hand.

use super::{StoreError, disk};
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;

#[derive(Debug)]
pub(super) struct Lock {
    _file: File,
}

impl Lock {
    /// Takes the lock. Where it is held: waits, telling `waiting` for whom, or fails with that.
    pub(super) fn take(root: &Path, wait: bool, waiting: &mut dyn FnMut(&str)) -> Result<Self, StoreError> {
        let path = root.join("lock");
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(disk::failed("opening", &path))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                // The text is for people; where it cannot be read the wait is as long.
                let _ = file.read_to_string(&mut holder);
                let holder = match holder.trim() {
                    "" => "another process".to_owned(),
                    text => text.to_owned(),
                };
                if !wait {
                    return Err(StoreError::Locked { path: root.to_owned(), holder });
                }
                waiting(&holder);
                file.lock().map_err(disk::failed("locking", &path))?;
            }
            Err(TryLockError::Error(e)) => return Err(disk::failed("locking", &path)(e)),
        }
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let text = format!("pid {} on host {host}\n", std::process::id());
        let write = |file: &mut File| -> std::io::Result<()> {
            // Never empty in between: somebody may want to know for whom they wait.
            file.rewind()?;
            file.write_all(text.as_bytes())?;
            file.set_len(text.len() as u64)
        };
        write(&mut file).map_err(disk::failed("writing", &path))?;
        Ok(Self { _file: file })
    }
}
