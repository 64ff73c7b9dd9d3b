//! The power fails after every operation of some builds; unsynced data is dropped, torn, or kept
//! out of order.
//!
//! The builds run over recorded file operations. A possible state of the disk after the n-th is
//! written to the store's own place, and stat fields are reported as they were. A torn file
//! therefore looks like the whole one, as it does on a file system that journals only its metadata.
//! Then the store is read, and built.

mod disk;
mod recorder;

use crate::Size;
use crate::engine::Engine;
use crate::frozen::Frozen;
use crate::place::{Place, Products, same, within};
use crate::random::Random;
use crate::scenes;
use crate::tally::Tally;
use crate::workers::spread;
use disk::{Disk, Loss};
use gs2e::store::fs::SystemFs;
use recorder::Recorder;
use std::fs;
use std::sync::Arc;
use std::time::Duration;

/// Recorded builds and their products.
struct Recording {
    place: Place,
    truth: Products,
    recorder: Arc<Recorder>,
}

impl Recording {
    /// Three builds, each of more scenes than the one before, so that rows of the database refer to
    /// files of several batches.
    fn new(scenes: u32) -> Self {
        let place = Place::in_memory();
        let recorder = Arc::new(Recorder::new(place.store()));
        let mut truth = Products::new();
        for part in 1..=3 {
            scenes::write(&place, (scenes * part / 3).max(1), u32::MAX);
            if part == 3 {
                // Old enough that the last build leaves memos.
                std::thread::sleep(Duration::from_millis(2100));
            }
            truth = Engine::new(&place, recorder.clone()).build(&place).products(&place).unwrap();
        }
        Self { place, truth, recorder }
    }
}

pub(crate) fn run(size: Size) -> Tally {
    let (scenes, reorderings) = size.of((3, 2), (50, 3));
    let mut losses = vec![Loss::Dropped, Loss::Torn];
    losses.extend(vec![Loss::Reordered; reorderings]);
    let prefixes = Recording::new(scenes).recorder.len() + 1;
    let mut tally = spread(
        size,
        prefixes * losses.len(),
        || Recording::new(scenes),
        |recording, number, tally| {
            let (prefix, loss) = (number / losses.len(), losses[number % losses.len()]);
            let mut random = Random::new(size.seed, number as u64);
            let ended = trial(recording, prefix, loss, &mut random);
            tally.count("records of absent or wrong bytes", u64::from(ended.is_err()));
            ended.map_err(|why| format!("after operation {prefix}, {loss:?}: {why}"))
        },
    );
    tally.count("operations recorded", prefixes as u64 - 1);
    tally
}

fn trial(recording: &Recording, prefix: usize, loss: Loss, random: &mut Random) -> Result<(), String> {
    let Recording { place, truth, recorder } = recording;
    let _ = fs::remove_dir_all(place.store());
    let ops = recorder.ops();
    Disk::after(&ops[..prefix.min(ops.len())], loss, random).write(&place.store());
    let frozen = Engine::new(place, Arc::new(Frozen::new(recorder.stats())));
    within(&frozen.look(place)?, truth).map_err(|why| format!("looking: {why}"))?;
    let next = frozen.build(place).products(place).and_then(|products| same(&products, truth));
    next.map_err(|why| format!("the next build: {why}"))?;
    // A later look must not be deceived either.
    same(&Engine::new(place, Arc::new(SystemFs)).look(place)?, truth)
}
