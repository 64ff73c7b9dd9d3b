//! Independent trials, spread over the machine's cores.

use crate::tally::Tally;
use crate::{Size, is_over};
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Runs trials `0..trials`, each worker with its own value from `prepare`. The assignment of trials
/// to workers is left to chance, so a trial must depend on its number alone.
pub(crate) fn spread<W>(
    size: Size,
    trials: usize,
    prepare: impl Fn() -> W + Sync,
    trial: impl Fn(&mut W, usize, &mut Tally) -> Result<(), String> + Sync,
) -> Tally {
    spread_over(size, 1, trials, prepare, trial)
}

/// Like [`spread`], with several workers per core, for trials that mostly wait.
pub(crate) fn spread_over<W>(
    size: Size,
    workers_a_core: usize,
    trials: usize,
    prepare: impl Fn() -> W + Sync,
    trial: impl Fn(&mut W, usize, &mut Tally) -> Result<(), String> + Sync,
) -> Tally {
    let (next, end) = (AtomicUsize::new(0), size.end());
    // If time may run out, the finished trials should be of every kind. They are taken in steps of
    // about the golden section, made coprime to their number.
    let golden = trials * 618 / 1000;
    let stride =
        if end.is_none() { 1 } else { (golden.max(1)..).find(|n| gcd(*n, trials) == 1).unwrap_or(1) };
    let work = || {
        let (mut worker, mut tally) = (prepare(), Tally::default());
        loop {
            let turn = next.fetch_add(1, Ordering::Relaxed);
            if turn >= trials || is_over(end) {
                return tally;
            }
            let number = turn * stride % trials;
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
        if total.trials() < trials as u64 {
            total.notes.push(format!("its time was over after {} of {trials} trials", total.trials()));
        }
        total
    })
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
