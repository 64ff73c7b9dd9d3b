//! Readings of this process for the cost of rendering: time of all cores, elapsed time, peak memory.

use gs2e_files as files;
use gs2e_lab::work_precision::TimeSpent;
use gs2e_lab::work_precision::cost::ProcessMeter;
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::fs;
use std::path::Path;

/// The clocks and the memory of this process.
#[derive(Debug)]
pub(super) struct ThisProcess;

impl ProcessMeter for ThisProcess {
    fn time(&self) -> TimeSpent {
        let seconds = |at: Timespec| at.tv_sec as f64 + at.tv_nsec as f64 * 1e-9;
        let [core_s, wall_s] =
            [ClockId::ProcessCPUTime, ClockId::Monotonic].map(|id| seconds(clock_gettime(id)));
        TimeSpent { core_s, wall_s }
    }

    fn forget_peak(&self) {
        // 5 resets the peak of the resident memory, and nothing else (proc(5)).
        let _ = fs::write("/proc/self/clear_refs", "5");
    }

    fn peak_mb(&self) -> Option<f64> {
        let text = files::read_text(Path::new("/proc/self/status"), files::MAX_TEXT).ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
        // `/proc` states KiB.
        Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? * 1024e-6)
    }
}
