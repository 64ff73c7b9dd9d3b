//! Independent trials, spread over the machine's cores.

use crate::tally::Tally;
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Runs trials `0..trials`, each worker with what `prepare` made for it. Which worker has which trial is left to
/// chance: a trial must depend on its number alone.
pub(crate) fn spread<W>(
    trials: usize,
    prepare: impl Fn() -> W + Sync,
    trial: impl Fn(&mut W, usize, &mut Tally) -> Result<(), String> + Sync,
) -> Tally {
    spread_over(1, trials, prepare, trial)
}

/// The same with several workers a core, for trials that mostly wait.
pub(crate) fn spread_over<W>(
    workers_a_core: usize,
    trials: usize,
    prepare: impl Fn() -> W + Sync,
    trial: impl Fn(&mut W, usize, &mut Tally) -> Result<(), String> + Sync,
) -> Tally {
    let next = AtomicUsize::new(0);
    let work = || {
        let (mut worker, mut tally) = (prepare(), Tally::default());
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= trials {
                return tally;
            }
            let ended = trial(&mut worker, number, &mut tally);
            tally.trial(ended.map_err(|why| format!("trial {number}: {why}")));
        }
    };
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    let workers = (workers_a_core * cores).min(trials);
    thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        let mut total = Tally::default();
        for worker in workers {
            total.merge(worker.join().unwrap());
        }
        total
    })
}
