//! One writer per store: an advisory lock that the kernel releases with its holder, so it never
//! needs to be removed by hand. The content of the file describes the holder for people; a file
//! that is not locked is overwritten.

use super::{StoreError, disk};
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;
use std::time::Duration;

/// The process that wants the lock, and its patience.
#[derive(Debug, Clone)]
pub struct Claim {
    /// The command, shown to others who wait.
    pub command: String,
    /// Start time: `YYYY-MM-DDThh:mm:ssZ`.
    pub since: String,
    /// Interval after which a waiting process is informed again.
    pub remind: Duration,
}

impl Default for Claim {
    fn default() -> Self {
        Self { command: String::new(), since: String::new(), remind: Duration::from_mins(1) }
    }
}

/// Interval between attempts to take a held lock.
const TRY: Duration = Duration::from_millis(50);

#[derive(Debug)]
pub(super) struct Lock {
    file: File,
}

impl Lock {
    /// Takes the lock. If it is held, waits and calls `waiting` with the holder from time to time,
    /// or fails.
    pub(super) fn take(
        root: &Path,
        claim: &Claim,
        wait: bool,
        waiting: &mut dyn FnMut(&str),
    ) -> Result<Self, StoreError> {
        let path = root.join("lock");
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(disk::failed("opening", &path))?;
        let mut tries = 0;
        let tries_a_reminder = claim.remind.as_millis().div_ceil(TRY.as_millis()).max(1);
        loop {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::WouldBlock) => {}
                Err(TryLockError::Error(e)) => return Err(disk::failed("locking", &path)(e)),
            }
            if !wait {
                return Err(StoreError::Locked { path: root.to_owned(), holder: holder(&mut file, claim) });
            }
            if tries % tries_a_reminder == 0 {
                waiting(&holder(&mut file, claim));
            }
            tries += 1;
            std::thread::sleep(TRY);
        }
        write(&mut file, &Holder::us(claim).to_text()).map_err(disk::failed("writing", &path))?;
        Ok(Self { file })
    }
}

impl Lock {
    /// The same lock: it is held until both are dropped, whichever process holds the other.
    pub(super) fn share(&self) -> std::io::Result<File> {
        self.file.try_clone()
    }
}

fn write(file: &mut File, text: &str) -> std::io::Result<()> {
    // The file is never empty in between, because others may read it to see the holder.
    file.rewind()?;
    file.write_all(text.as_bytes())?;
    file.set_len(text.len() as u64)
}

/// The holder of the lock, as text. The first holder of a new store has the lock shortly before its
/// name is written.
fn holder(file: &mut File, claim: &Claim) -> String {
    const LOOKS: usize = 20;
    for look in 0..LOOKS {
        if look > 0 {
            std::thread::sleep(TRY);
        }
        let mut text = String::new();
        // The wait is as long if the file cannot be read.
        let read = file.rewind().and_then(|()| file.read_to_string(&mut text));
        if let Some(holder) = read.ok().and_then(|_| Holder::parse(&text)) {
            return holder.to_words(&claim.since);
        }
    }
    "another process".to_owned()
}

/// The content of the lock's file.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Holder {
    host: String,
    pid: u32,
    /// Identity of the machine's boot. If it differs, the process no longer exists, whatever its
    /// number.
    boot: String,
    since: String,
    command: String,
}

impl Holder {
    fn us(claim: &Claim) -> Self {
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        // Only Linux has it.
        let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
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
        format!("host: {host}\npid: {pid}\nboot: {boot}\nsince: {since}\ncommand: {command}\n")
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

    fn sample() -> Holder {
        Holder {
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
        assert_eq!(Holder::parse(&text), Some(sample()));
        assert_eq!(Holder::parse(&format!("{text}rest of a longer one\n")), Some(sample()));
        for n in 0..text.len() {
            assert_eq!(Holder::parse(&text[..n]), None, "cut at {n}");
        }
        assert_eq!(Holder::parse("pid 4711 on host node3\n"), None);
    }

    #[test]
    fn a_holder_is_told_with_the_time_and_where_it_helps_the_date() {
        let t = |holder: Holder, now: &str, wanted: &str| assert_eq!(holder.to_words(now), wanted);
        t(sample(), "2026-03-01T15:00:00Z", "pid 4711 on host node3 since 14:02 UTC (gs2e build -j8)");
        t(
            sample(),
            "2026-03-02T15:00:00Z",
            "pid 4711 on host node3 since 2026-03-01 14:02 UTC (gs2e build -j8)",
        );
        let bare = Holder { since: String::new(), command: String::new(), ..sample() };
        t(bare, "", "pid 4711 on host node3");
    }

    #[test]
    fn who_waits_is_told_again_and_then_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let claim = Claim { command: "first\nof two".into(), remind: 2 * TRY, ..Claim::default() };
        let first = Lock::take(folder.path(), &claim, false, &mut |_| {}).unwrap();
        let mut told = Vec::new();
        let mut held = Some(first);
        let second = Lock::take(folder.path(), &claim, true, &mut |holder| {
            told.push(holder.to_owned());
            if told.len() == 3 {
                held.take();
            }
        });
        assert!(second.is_ok() && told.len() == 3, "{told:?}");
        assert!(told.iter().all(|holder| holder.ends_with("(first of two)")), "{told:?}");
    }

    #[test]
    fn what_a_dead_holder_left_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        std::fs::write(&path, sample().to_text().repeat(3)).unwrap();
        let told = &mut |holder: &str| panic!("nobody holds it, and it waits for {holder}");
        let _ours = Lock::take(folder.path(), &Claim::default(), true, told).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        assert_eq!(Holder::parse(&text).unwrap().pid, std::process::id());
        assert_eq!(text.lines().count(), 5);
    }
}
