//! A run of the program, and the peak of its resident memory.
//!
//! A process inherits the peak of the process that starts it. This harness has held the bombs in
//! memory, so it starts itself again as a meter, and the meter starts the program.

use serde_json::{Value, json};
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};
use wait4::Wait4 as _;

/// The argument that makes a process a meter.
pub(crate) const METER: &str = "--meter";
/// Limit of the address space, kilobytes. Allocations above it fail.
const ADDRESS_SPACE: u64 = 6 << 20;
/// Time after which a program is stopped.
const PATIENCE: Duration = Duration::from_secs(60);
/// Resident memory at which a program is stopped, kilobytes.
const ENOUGH: u64 = 4_000_000;

/// Outcome of a run.
pub(crate) struct Run {
    /// The exit code; `None` if a signal ended the program.
    pub(crate) code: Option<i32>,
    /// True if the program was stopped for its time or its memory.
    pub(crate) stopped: bool,
    /// Peak of resident memory, bytes.
    pub(crate) peak: u64,
    /// The program's stderr.
    pub(crate) stderr: String,
}

impl Run {
    /// Runs a program with these arguments, separated by spaces, in a folder.
    pub(crate) fn of(program: &Path, args: &str, folder: &Path) -> Self {
        let mut meter = Command::new(std::env::current_exe().unwrap());
        meter.arg(METER).arg(program).args(args.split_whitespace()).current_dir(folder).stdin(Stdio::null());
        let output = meter.output().unwrap();
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        Self {
            code: found["code"].as_i64().map(|code| i32::try_from(code).unwrap()),
            stopped: found["stopped"] == true,
            peak: found["peak"].as_u64().unwrap(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// Runs the program that the arguments name, and prints its outcome as JSON.
pub(crate) fn meter(args: impl Iterator<Item = String>) -> ExitCode {
    let mut command = Command::new("sh");
    let script = format!("ulimit -c 0; ulimit -v {ADDRESS_SPACE}; exec \"$0\" \"$@\"");
    command.args(["-c", &script]).args(args).stdout(Stdio::null());
    // No GPU, since its driver would take memory of its own. Two threads, so that the peak does not
    // depend on the machine's cores.
    command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    command.env("RAYON_NUM_THREADS", "2").env("MALLOC_ARENA_MAX", "2");
    let child = command.spawn().unwrap();
    let pid = child.id();
    let watch = std::thread::spawn(move || watch(pid));
    let ended = child.wait4().unwrap();
    let stopped = watch.join().unwrap();
    let message = json!({ "code": ended.status.code(), "stopped": stopped, "peak": ended.rusage.maxrss });
    std::io::stdout().write_all(message.to_string().as_bytes()).unwrap();
    ExitCode::SUCCESS
}

/// Stops a process that takes too much time or memory. Returns true if it did.
fn watch(pid: u32) -> bool {
    let (status, begin) = (format!("/proc/{pid}/status"), Instant::now());
    loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        // A process that has ended reports no resident memory.
        let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let Some(kb) = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok())
        else {
            return false;
        };
        if begin.elapsed() > PATIENCE || kb > ENOUGH {
            let pid = rustix::process::Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
            rustix::process::kill_process(pid, rustix::process::Signal::KILL).unwrap();
            return true;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
