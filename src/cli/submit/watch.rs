//! Waiting for the tasks of a shared store.

use crate::cli::{Console, UserMessage};
use gs2e_build::cluster::queue::LiveTask;
use gs2e_build::cluster::slurm::Slurm;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Why the wait ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WatchEnd {
    /// No task is left.
    Ended,
    /// The user wants to wait no longer.
    Detached,
}

/// Shortest and longest time between two looks at the queue. A short job should not wait, and a long one
/// should not load the controller.
const PERIODS: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(15));
/// Time between two looks at the wish of the user.
const BLINK: Duration = Duration::from_millis(50);

/// Waits until no task of jobs with these names is queued or running.
pub(super) fn wait_for_tasks(
    names: &BTreeSet<String>,
    slurm: &Slurm,
    detached: &AtomicBool,
    console: &Console,
) -> WatchEnd {
    let mut watch = Watch { console, reported: (0, 0), is_silent: false };
    let mut period = PERIODS.0;
    loop {
        if watch.no_task_is_left(names, slurm) {
            return WatchEnd::Ended;
        }
        let slept = Instant::now();
        while slept.elapsed() < period {
            if detached.load(Ordering::Relaxed) {
                return WatchEnd::Detached;
            }
            sleep(BLINK);
        }
        period = (period * 3 / 2).min(PERIODS.1);
    }
}

/// Messages about the tasks, each when something changes.
struct Watch<'a> {
    console: &'a Console,
    /// Numbers of running and waiting tasks.
    reported: (usize, usize),
    /// True if Slurm does not answer.
    is_silent: bool,
}

impl Watch<'_> {
    fn no_task_is_left(&mut self, names: &BTreeSet<String>, slurm: &Slurm) -> bool {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        match slurm.live(&names) {
            Ok(tasks) => {
                self.is_silent = false;
                self.report(&tasks);
                tasks.is_empty()
            }
            // The controller may be starting. The jobs go on without it.
            Err(error) => {
                if !self.is_silent {
                    let message = UserMessage::waiting("slurm", error.to_string());
                    self.console.report_to_people(&message);
                }
                self.is_silent = true;
                false
            }
        }
    }

    fn report(&mut self, tasks: &[LiveTask]) {
        let running = tasks.iter().filter(|task| task.node.is_some()).count();
        let waiting = tasks.len() - running;
        if self.reported != (running, waiting) && !tasks.is_empty() {
            self.reported = (running, waiting);
            let held = tasks.iter().find(|task| task.reason.contains("held"));
            let held = held.map_or(String::new(), |task| format!(" (task {}: {})", task.id, task.reason));
            self.console.note(&format!("{running} tasks running, {waiting} queued{held}"));
        }
    }
}
