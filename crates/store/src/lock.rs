//! One writer per store: an advisory lock that the kernel releases with its holder, so it never
//! needs to be removed by hand. The content of the file describes the holder for people; a file
//! that is not locked is overwritten.

use super::{StoreError, disk};
use gs2e_files as files;
use gs2e_files::{LinkRule, Removal};
use rustix::fs::{Mode, OFlags};
use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The process that wants the lock, and its patience.
#[derive(Debug, Clone)]
pub struct LockClaim {
    /// The command, shown to others who wait.
    pub command: String,
    /// Start time: `YYYY-MM-DDThh:mm:ssZ`.
    pub since: String,
    /// Interval after which a waiting process is informed again.
    pub remind: Duration,
}

impl Default for LockClaim {
    fn default() -> Self {
        Self { command: String::new(), since: String::new(), remind: Duration::from_mins(1) }
    }
}

/// Interval between attempts to take a held lock.
const TRY: Duration = Duration::from_millis(50);

/// Name of the lock of a store.
pub(super) const LOCK: &str = "lock";

/// An exclusive lock between processes, held until it is dropped.
#[derive(Debug)]
pub struct StoreLock {
    file: File,
    /// The file to remove with the lock.
    temporary: Option<PathBuf>,
}

impl StoreLock {
    /// Takes the lock. If it is held, waits and calls `waiting` with the holder from time to time,
    /// or fails.
    pub(super) fn take_lock(
        root: &Path,
        claim: &LockClaim,
        wait: bool,
        waiting: &mut dyn FnMut(&str),
    ) -> Result<Self, StoreError> {
        let path = root.join(LOCK);
        // Until the lock is taken, the text is that of another holder.
        let mut file = open_lock_file(&path).map_err(disk::disk_error("opening", &path))?;
        let request = LockRequest { path: &path, of: root, claim, wait, cancel: &AtomicBool::new(false) };
        request.lock(&mut file, waiting)?;
        // Only under the lock: before it is taken, another holder may be in the middle of its text.
        refuse_foreign(&mut file).map_err(disk::disk_error("locking", &path))?;
        write_holder(&mut file, &LockHolder::this_process(claim).to_text())
            .map_err(disk::disk_error("writing", &path))?;
        Ok(Self { file, temporary: None })
    }

    /// Takes a lock whose file exists only while the lock is held or awaited. A link or a file that
    /// this program did not write is never followed or changed. `waiting` receives the holder from time
    /// to time.
    ///
    /// # Errors
    /// [`StoreError::Locked`] with the holder if the request does not wait; an I/O error of the kind
    /// `Interrupted` if it is cancelled during the wait; any other error of the file system.
    pub fn take_temporary(
        request: &LockRequest<'_>,
        waiting: &mut dyn FnMut(&str),
    ) -> Result<Self, StoreError> {
        let path = request.path;
        loop {
            let mut file = open_lock_file(path).map_err(disk::disk_error("opening", path))?;
            request.lock(&mut file, waiting)?;
            // A holder removes the file before it lets go, so the awaited file may be gone by now.
            if !is_at(&file, path) {
                continue;
            }
            refuse_foreign(&mut file).map_err(disk::disk_error("locking", path))?;
            write_holder(&mut file, &LockHolder::this_process(request.claim).to_text())
                .map_err(disk::disk_error("writing", path))?;
            return Ok(Self { file, temporary: Some(path.to_owned()) });
        }
    }
}

impl StoreLock {
    /// Another handle of the lock, which is held until both are dropped, in whichever process.
    pub(super) fn share(&self) -> io::Result<File> {
        self.file.try_clone()
    }
}

impl Drop for StoreLock {
    fn drop(&mut self) {
        // The lock is still held here, so no other process can have taken a file of this name for
        // its own.
        if let Some(path) = self.temporary.take().filter(|path| is_at(&self.file, path)) {
            // The next holder takes over a file that stays.
            let _ = files::remove(&path, Removal::File);
        }
    }
}

/// A request for a lock.
#[derive(Debug)]
pub struct LockRequest<'a> {
    /// The file that is locked.
    pub path: &'a Path,
    /// The place that the lock protects, as messages name it.
    pub of: &'a Path,
    /// The holder to be.
    pub claim: &'a LockClaim,
    /// True to wait for another holder.
    pub wait: bool,
    /// Ends the wait.
    pub cancel: &'a AtomicBool,
}

impl LockRequest<'_> {
    fn lock(&self, file: &mut File, waiting: &mut dyn FnMut(&str)) -> Result<(), StoreError> {
        let mut tries = 0;
        let tries_a_reminder = self.claim.remind.as_millis().div_ceil(TRY.as_millis()).max(1);
        loop {
            // A lock that blocks could neither remind nor be cancelled.
            match file.try_lock() {
                Ok(()) => return Ok(()),
                Err(TryLockError::WouldBlock) => {}
                Err(TryLockError::Error(e)) => return Err(disk::disk_error("locking", self.path)(e)),
            }
            if !self.wait {
                let holder = holder_text(file, self.claim);
                return Err(StoreError::Locked { path: self.of.to_owned(), holder });
            }
            if self.cancel.load(Ordering::Relaxed) {
                return Err(disk::disk_error("locking", self.path)(io::ErrorKind::Interrupted.into()));
            }
            if tries % tries_a_reminder == 0 {
                waiting(&holder_text(file, self.claim));
            }
            tries += 1;
            std::thread::sleep(TRY);
        }
    }
}

/// Opens or creates a lock's own file. `O_NONBLOCK` keeps a FIFO of that name from blocking the
/// call.
fn open_lock_file(path: &Path) -> io::Result<File> {
    // The lock belongs to the open file: a child that inherited it would hold the lock after this process.
    let flags = OFlags::RDWR | OFlags::CREATE | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let mode = Mode::from_raw_mode(0o644);
    Ok(File::from(rustix::fs::open(path, flags, mode)?))
}

/// Returns true if a lock wrote this file.
pub(super) fn is_lock(path: &Path) -> bool {
    let text = files::read_with(path, LinkRule::Refuse, files::MAX_TEXT);
    text.is_ok_and(|text| text.starts_with(HOST.as_bytes()))
}

/// Returns true if `path` still names the open file.
fn is_at(file: &File, path: &Path) -> bool {
    let same = |there: &std::fs::Metadata| {
        file.metadata().is_ok_and(|own| (own.dev(), own.ino()) == (there.dev(), there.ino()))
    };
    std::fs::symlink_metadata(path).is_ok_and(|there| same(&there))
}

/// Refuses a file that no lock wrote. A power cut may leave one empty or of zeros.
fn refuse_foreign(file: &mut File) -> io::Result<()> {
    const MAX_LENGTH: usize = 1 << 16;
    let mut text = Vec::new();
    file.rewind()?;
    // A lock has a few short lines, so a long file belongs to another program.
    let is_short =
        file.metadata()?.is_file() && file.take(MAX_LENGTH as u64).read_to_end(&mut text)? < MAX_LENGTH;
    let is_lock_text = text.starts_with(HOST.as_bytes()) || text.iter().all(|byte| *byte == 0);
    if is_short && is_lock_text {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "the file is not a lock of gs2e; remove or rename it"))
}

fn write_holder(file: &mut File, text: &str) -> std::io::Result<()> {
    // The file is never empty in between, because others may read it to see the holder.
    file.rewind()?;
    file.write_all(text.as_bytes())?;
    file.set_len(text.len() as u64)
}

/// The holder of the lock, as text. The first holder of a new store has the lock shortly before its
/// name is written.
fn holder_text(file: &mut File, claim: &LockClaim) -> String {
    const LOOKS: usize = 20;
    for look in 0..LOOKS {
        if look > 0 {
            std::thread::sleep(TRY);
        }
        let mut text = String::new();
        // The wait is as long if the file cannot be read.
        let read = file.rewind().and_then(|()| file.read_to_string(&mut text));
        if let Some(holder) = read.ok().and_then(|_| LockHolder::parse(&text)) {
            return holder.to_words(&claim.since);
        }
    }
    "another process".to_owned()
}

/// Beginning of the text of a lock.
const HOST: &str = "host: ";

/// Content of a lock's file.
#[derive(Debug, Clone, PartialEq, Eq)]
struct LockHolder {
    host: String,
    pid: u32,
    /// Identity of the machine's boot. If it differs, the process no longer exists, whatever its
    /// number.
    boot: String,
    since: String,
    command: String,
}

impl LockHolder {
    fn this_process(claim: &LockClaim) -> Self {
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        // Only Linux has it.
        let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
        // `parse` reads one field per line, so a line break in a command must not begin a field.
        let line = |text: &str| text.trim().replace(char::is_control, " ");
        Self {
            host: line(&host),
            pid: std::process::id(),
            boot: line(&boot),
            since: line(&claim.since),
            command: line(&claim.command),
        }
    }

    fn to_text(&self) -> String {
        let Self { host, pid, boot, since, command } = self;
        format!("{HOST}{host}\npid: {pid}\nboot: {boot}\nsince: {since}\ncommand: {command}\n")
    }

    /// Reads the first five lines. The rest of a longer text that is being replaced may follow.
    fn parse(text: &str) -> Option<Self> {
        let mut lines = text.split_inclusive('\n');
        let mut field = |name: &str| {
            let line = lines.next()?.strip_suffix('\n')?.strip_prefix(name)?.strip_prefix(':')?;
            Some(line.trim().to_owned())
        };
        Some(Self {
            host: field("host")?,
            pid: field("pid")?.parse().ok()?,
            boot: field("boot")?,
            since: field("since")?,
            command: field("command")?,
        })
    }

    /// As text: `pid 4711 on host node3 since 14:02 UTC (gs2e build)`, with the date if it was
    /// another day.
    fn to_words(&self, now: &str) -> String {
        let mut words = format!("pid {} on host {}", self.pid, self.host);
        if let Some((date, time)) = self.since.split_once('T') {
            let minutes = time.get(..5).unwrap_or(time);
            let date = if now.starts_with(date) { String::new() } else { format!("{date} ") };
            words.push_str(&format!(" since {date}{minutes} UTC"));
        }
        if !self.command.is_empty() {
            words.push_str(&format!(" ({})", self.command));
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> LockHolder {
        LockHolder {
            host: "node3".into(),
            pid: 4711,
            boot: "f2a0".into(),
            since: "2026-03-01T14:02:59Z".into(),
            command: "gs2e build -j8".into(),
        }
    }

    #[test]
    fn a_holder_is_read_as_it_was_written_and_nothing_else_is() {
        let text = sample().to_text();
        assert_eq!(LockHolder::parse(&text), Some(sample()));
        assert_eq!(LockHolder::parse(&format!("{text}rest of a longer one\n")), Some(sample()));
        for n in 0..text.len() {
            assert_eq!(LockHolder::parse(&text[..n]), None, "cut at {n}");
        }
        assert_eq!(LockHolder::parse("pid 4711 on host node3\n"), None);
    }

    #[test]
    fn a_holder_is_told_with_the_time_and_where_it_helps_the_date() {
        let t = |holder: LockHolder, now: &str, wanted: &str| assert_eq!(holder.to_words(now), wanted);
        t(sample(), "2026-03-01T15:00:00Z", "pid 4711 on host node3 since 14:02 UTC (gs2e build -j8)");
        t(
            sample(),
            "2026-03-02T15:00:00Z",
            "pid 4711 on host node3 since 2026-03-01 14:02 UTC (gs2e build -j8)",
        );
        let bare = LockHolder { since: String::new(), command: String::new(), ..sample() };
        t(bare, "", "pid 4711 on host node3");
    }

    #[test]
    fn who_waits_is_told_again_and_then_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let claim = LockClaim { command: "first\nof two".into(), remind: 2 * TRY, ..LockClaim::default() };
        let first = StoreLock::take_lock(folder.path(), &claim, false, &mut |_| {}).unwrap();
        let mut found = Vec::new();
        let mut held = Some(first);
        let second = StoreLock::take_lock(folder.path(), &claim, true, &mut |holder| {
            found.push(holder.to_owned());
            if found.len() == 3 {
                held.take();
            }
        });
        assert!(second.is_ok() && found.len() == 3, "{found:?}");
        assert!(found.iter().all(|holder| holder.ends_with("(first of two)")), "{found:?}");
    }

    fn take_temporary(path: &Path) -> Result<StoreLock, StoreError> {
        take_unless(path, &AtomicBool::new(false))
    }

    fn take_unless(path: &Path, cancel: &AtomicBool) -> Result<StoreLock, StoreError> {
        let claim = &LockClaim::default();
        StoreLock::take_temporary(&LockRequest { path, of: path, claim, wait: true, cancel }, &mut |_| {})
    }

    #[test]
    fn a_temporary_lock_excludes_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(".lock");
        let inside = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..5 {
                        let _lock = take_temporary(&path).unwrap();
                        assert!(!inside.swap(true, Ordering::SeqCst), "two hold it");
                        std::thread::sleep(Duration::from_millis(2));
                        inside.store(false, Ordering::SeqCst);
                    }
                });
            }
        });
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_temporary_lock_changes_no_file_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(".lock");
        std::fs::write(&path, "thesis").unwrap();
        assert!(take_temporary(&path).unwrap_err().to_string().contains("not a lock of gs2e"));
        assert_eq!(std::fs::read(&path).unwrap(), b"thesis");
        std::fs::rename(&path, folder.path().join("thesis")).unwrap();
        std::os::unix::fs::symlink("thesis", &path).unwrap();
        assert!(take_temporary(&path).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"thesis");
        std::fs::remove_file(&path).unwrap();
        // A killed holder leaves its text; the next one takes the file over and removes it.
        std::fs::write(&path, sample().to_text()).unwrap();
        drop(take_temporary(&path).unwrap());
        assert!(!path.exists());
    }

    #[test]
    fn a_wait_ends_when_it_is_cancelled() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(".lock");
        let _held = take_temporary(&path).unwrap();
        let ended = take_unless(&path, &AtomicBool::new(true));
        let Err(StoreError::Io { source, .. }) = ended else { panic!("{ended:?}") };
        assert_eq!(source.kind(), io::ErrorKind::Interrupted);
    }

    #[test]
    fn what_a_dead_holder_left_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        std::fs::write(&path, sample().to_text().repeat(3)).unwrap();
        let message = &mut |holder: &str| panic!("nobody holds it, and it waits for {holder}");
        let _ours = StoreLock::take_lock(folder.path(), &LockClaim::default(), true, message).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        assert_eq!(LockHolder::parse(&text).unwrap().pid, std::process::id());
        assert_eq!(text.lines().count(), 5);
    }
}
