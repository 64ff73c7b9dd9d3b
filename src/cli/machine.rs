//! Properties of this machine: cores, processor and memory.

use gs2e_files as files;
use std::num::NonZero;
use std::path::Path;

/// Number of cores that this process may use.
pub(super) fn available_cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZero::get)
}

/// The name of the processor; `None` if the system does not state it.
pub(super) fn processor_name() -> Option<String> {
    cpu_model(&said("/proc/cpuinfo")?)
}

/// `model name` of `/proc/cpuinfo`.
fn cpu_model(cpuinfo: &str) -> Option<String> {
    let named =
        |line: &str| Some(line.strip_prefix("model name")?.trim_start().strip_prefix(':')?.trim().to_owned());
    cpuinfo.lines().find_map(named).filter(|name| !name.is_empty())
}

/// Four fifths of the memory that is free now, in bytes: in the machine, or in a control group of
/// this process if one has less. Unlimited if none can be read.
pub(super) fn free_memory() -> u64 {
    let machine = said("/proc/meminfo").and_then(|text| available_memory(&text));
    let groups = said("/proc/self/cgroup").and_then(|groups| free_in_groups(&groups, &said));
    // The division comes first, so that the product cannot overflow.
    machine.into_iter().chain(groups).min().map_or(u64::MAX, |bytes| bytes / 5 * 4)
}

/// `MemAvailable` of `/proc/meminfo`, bytes.
fn available_memory(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// The least memory that is free in the control group of this process (version 2) and in those that
/// contain it; `None` if none has a limit. `groups` is the text of `/proc/self/cgroup`.
fn free_in_groups(groups: &str, read: &dyn Fn(&str) -> Option<String>) -> Option<u64> {
    // Version 2 has the hierarchy 0, and no list of controllers.
    let own = groups.lines().find_map(|line| line.strip_prefix("0::"))?;
    let free = |group: &Path| {
        // Without a limit, `memory.max` holds the word `max`, which is no number.
        let number = |file: &str| {
            let path = Path::new("/sys/fs/cgroup").join(group.strip_prefix("/").ok()?).join(file);
            read(path.to_str()?)?.trim().parse::<u64>().ok()
        };
        Some(number("memory.max")?.saturating_sub(number("memory.current").unwrap_or(0)))
    };
    // A batch system limits the job, and the process is in a group below it.
    Path::new(own).ancestors().filter_map(free).min()
}

/// The text of a system file.
fn said(file: &str) -> Option<String> {
    files::read_text(Path::new(file), files::MAX_TEXT).ok()
}

/// Returns true if this process was started to ignore a signal; false if the system does not state
/// it.
pub(super) fn ignores(signal: i32) -> bool {
    said("/proc/self/status").is_some_and(|status| is_ignored(&status, signal))
}

/// Reads `SigIgn` of `/proc/self/status`: one bit per signal, signal 1 in the lowest.
fn is_ignored(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    // The mask has 64 bits; a higher signal is not in it.
    mask.checked_shr(signal.unsigned_abs() - 1).is_some_and(|bits| bits & 1 == 1)
}

/// Reads a number of bytes, as `8GB`, `500 MB` or `1073741824`.
pub(super) fn parse_bytes(text: &str) -> Result<u64, String> {
    // `B` comes last, because every other unit ends with it.
    const UNITS: [(&str, u64); 7] = [
        ("KiB", 1 << 10),
        ("MiB", 1 << 20),
        ("GiB", 1 << 30),
        ("kB", 1_000),
        ("MB", 1_000_000),
        ("GB", 1_000_000_000),
        ("B", 1),
    ];
    let found = UNITS.iter().find_map(|(unit, size)| Some((text.strip_suffix(unit)?, *size)));
    let (number, unit) = found.unwrap_or((text, 1));
    let wanted = || format!("found `{text}`, wanted a number of bytes such as 8GB or 500MB");
    let number: u64 = number.trim().parse().map_err(|_| wanted())?;
    number.checked_mul(unit).filter(|bytes| *bytes > 0).ok_or_else(wanted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_read_with_their_units() {
        let t = |text: &str, wanted: Option<u64>| assert_eq!(parse_bytes(text).ok(), wanted, "{text}");
        t("1", Some(1));
        t("8GB", Some(8_000_000_000));
        t("500 MB", Some(500_000_000));
        t("2GiB", Some(2 << 30));
        t("3B", Some(3));
        for wrong in ["", "GB", "-1", "1.5GB", "0", "99999999999GB", "1TB"] {
            t(wrong, None);
        }
    }

    #[test]
    fn ignored_signals_are_read() {
        let status = "Name:\tgs2e\nSigBlk:\tffffffffffffffff\nSigIgn:\t0000000000001001\n";
        let ignored: Vec<i32> = (1..=64).filter(|signal| is_ignored(status, *signal)).collect();
        assert_eq!(ignored, [1, 13]);
        assert!(!is_ignored("Name:\tgs2e\n", 1));
    }

    #[test]
    fn processors_are_named() {
        let text = "processor\t: 0\nmodel\t\t: 17\nmodel name\t: AMD EPYC\nflags : fpu\n";
        assert_eq!(cpu_model(text).as_deref(), Some("AMD EPYC"));
        assert_eq!(cpu_model("processor: 0\nmodel : 17\n"), None);
    }

    #[test]
    fn limits_of_outer_groups_count() {
        let files = [
            ("/sys/fs/cgroup/job/step/memory.max", "max\n"),
            ("/sys/fs/cgroup/job/step/memory.current", "10\n"),
            ("/sys/fs/cgroup/job/memory.max", "1000\n"),
            ("/sys/fs/cgroup/job/memory.current", "300\n"),
            ("/sys/fs/cgroup/memory.max", "5000\n"),
        ];
        let read = |path: &str| Some(files.iter().find(|(name, _)| *name == path)?.1.to_owned());
        assert_eq!(free_in_groups("1:cpu:/x\n0::/job/step\n", &read), Some(700));
        assert_eq!(free_in_groups("0::/other\n", &read), Some(5000));
        assert_eq!(free_in_groups("1:memory:/job\n", &read), None);
        assert_eq!(free_in_groups("0::/job\n", &|_| None), None);
    }

    #[test]
    fn free_memory_is_some_of_what_the_machine_has() {
        assert_eq!(available_memory("MemTotal: 9 kB\nMemAvailable:    1024 kB\n"), Some(1 << 20));
        assert_eq!(available_memory("MemTotal: 9 kB\n"), None);
        assert!(free_memory() > 0);
    }
}
