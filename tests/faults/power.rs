//! The power fails after every operation of some builds; unsynced data is dropped, torn, or kept
//! out of order.
//!
//! The builds run over recorded file operations. A possible state of the disk after the n-th is
//! written to the store's own place, and stat fields are reported as they were. A torn file
//! therefore looks like the whole one, as it does on a file system that journals only its metadata.
//! Then the store is read, and built.

mod disk;
mod recorder;

use crate::engine::{BuildOutcome, Engine};
use crate::frozen::Frozen;
use crate::place::{Place, Products, same, within};
use crate::random::Random;
use crate::tally::Tally;
use crate::workers::spread;
use crate::{Size, scenes};
use disk::{Disk, Loss};
use gs2e_store::fs::{Fs, SystemFs};
use recorder::Recorder;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Recorded builds and their products.
struct Recording {
    place: Place,
    truth: Products,
    recorder: Arc<Recorder>,
    /// The shared store, if there is one. It lies in the store's folder, so that both lose data at once.
    shared: Option<PathBuf>,
}

impl Recording {
    /// Three builds, each of more scenes than the one before, so that rows of the database refer to
    /// files of several batches.
    fn new(scenes: u32, is_shared: bool) -> Self {
        let place = Place::in_memory();
        let shared = is_shared.then(|| place.store().join("shared"));
        let recorder = Arc::new(Recorder::new(place.store()));
        let mut truth = Products::new();
        for part in 1..=3 {
            scenes::write(&place, (scenes * part / 3).max(1), u32::MAX);
            if part == 3 {
                // Old enough that the last build leaves memos.
                std::thread::sleep(Duration::from_millis(2100));
            }
            let engine = Engine { shared: shared.clone(), ..Engine::new(&place, recorder.clone()) };
            truth = engine.build(&place).products(&place).unwrap();
        }
        Self { place, truth, recorder, shared }
    }

    fn engine(&self, fs: Arc<dyn Fs>) -> Engine {
        Engine { shared: self.shared.clone(), ..Engine::new(&self.place, fs) }
    }
}

pub(crate) fn run(size: Size) -> Tally {
    // Each half of the time.
    let half = Size { seconds: size.seconds.map(|seconds| seconds.div_ceil(2)), ..size };
    let mut tally = trials(half, false);
    tally.merge(trials(half, true));
    tally
}

fn trials(size: Size, is_shared: bool) -> Tally {
    let (scenes, reorderings) = size.of((3, 2), (50, 3));
    let mut losses = vec![Loss::Dropped, Loss::Torn];
    losses.extend(vec![Loss::Reordered; reorderings]);
    let prefixes = Recording::new(scenes, is_shared).recorder.len() + 1;
    let mut tally = spread(
        size,
        prefixes * losses.len(),
        || Recording::new(scenes, is_shared),
        |recording, number, tally| {
            let (prefix, loss) = (number / losses.len(), losses[number % losses.len()]);
            let mut random = Random::new(size.seed, number as u64);
            let ended = trial(recording, prefix, loss, &mut random);
            tally.count("records of absent or wrong bytes", u64::from(ended.is_err()));
            let of = if is_shared { "with a shared store, after" } else { "after" };
            ended.map_err(|why| format!("{of} operation {prefix}, {loss:?}: {why}"))
        },
    );
    tally.count("operations recorded", prefixes as u64 - 1);
    tally
}

fn trial(recording: &Recording, prefix: usize, loss: Loss, random: &mut Random) -> Result<(), String> {
    let Recording { place, truth, recorder, shared } = recording;
    let _ = fs::remove_dir_all(place.store());
    let ops = recorder.ops();
    Disk::after(&ops[..prefix.min(ops.len())], loss, random).write(&place.store());
    let frozen = recording.engine(Arc::new(Frozen::new(recorder.stats())));
    within(&frozen.look(place)?, truth).map_err(|why| format!("looking: {why}"))?;
    let next = frozen.build(place).products(place).and_then(|products| same(&products, truth));
    next.map_err(|why| format!("the next build: {why}"))?;
    // A later look must not be deceived either.
    same(&recording.engine(Arc::new(SystemFs)).look(place)?, truth)?;
    let Some(shared) = shared else { return Ok(()) };
    // Nor may another machine, which has only the shared store.
    for entry in fs::read_dir(place.store()).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() && entry != *shared {
            fs::remove_dir_all(entry).unwrap();
        } else if entry.is_file() {
            fs::remove_file(entry).unwrap();
        }
    }
    let other = recording.engine(Arc::new(SystemFs)).build(place);
    match other {
        BuildOutcome::Done { made, .. } if made > 0 => {
            Err(format!("{made} steps are not in the shared store"))
        }
        other => other.products(place).and_then(|products| same(&products, truth)),
    }
}
