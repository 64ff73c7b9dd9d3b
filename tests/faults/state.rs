//! `state.db`, its log and the records, truncated and corrupted: an answer may be slow or an error,
//! never wrong.

use crate::Size;
use crate::damage::Flip;
use crate::place::{Place, Products, same, sound, within};
use crate::random::Random;
use crate::scenes;
use crate::tally::Tally;
use crate::workers::spread;
use rusqlite::Connection;
use serde_json::json;
use std::fs;
use std::path::PathBuf;

/// A built store whose last rows are in the database's log alone, and its products.
struct Fixture {
    place: Place,
    truth: Products,
    database: File,
    log: File,
    records: Vec<File>,
}

struct File {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl File {
    fn read(path: PathBuf) -> Self {
        Self { bytes: fs::read(&path).unwrap(), path }
    }

    fn put(&self, bytes: &[u8]) {
        // The old file may be read-only, or linked elsewhere.
        let _ = fs::remove_file(&self.path);
        fs::write(&self.path, bytes).unwrap();
    }
}

impl Fixture {
    fn new() -> Self {
        let place = Place::in_memory();
        scenes::write(&place, 3, 3);
        place.build("").unwrap();
        // An open reader keeps the next build from folding the log into the database.
        let reader = Connection::open(place.path(".gs2e/state.db")).unwrap();
        let count: i64 =
            reader.query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get(0)).unwrap();
        assert!(count > 0, "the database has tables");
        let mut edited = scenes::recipe("s0", 0, &[]);
        edited["checks"] = json!({ "event_rate": { "max": 4321 } });
        place.write("recipes/0.yaml", edited.to_string());
        let truth = place.build("").unwrap();
        let [database, log] = ["state.db", "state.db-wal"].map(|name| File::read(place.store().join(name)));
        assert!(!log.bytes.is_empty(), "the log holds the last rows");
        drop(reader);
        let mut records = Vec::new();
        for entry in walkdir::WalkDir::new(place.path(".gs2e/ac")).sort_by_file_name() {
            let entry = entry.unwrap();
            if entry.file_type().is_file() {
                records.push(File::read(entry.into_path()));
            }
        }
        Self { place, truth, database, log, records }
    }

    /// Restores the database and the records after the last build. Blobs stay as they are.
    fn restore(&self) {
        for name in ["state.db", "state.db-wal", "state.db-shm"] {
            let _ = fs::remove_file(self.place.store().join(name));
        }
        let _ = fs::remove_dir_all(self.place.store().join("gs2e-trash"));
        self.records.iter().chain([&self.database, &self.log]).for_each(|file| file.put(&file.bytes));
    }

    fn forget_database(&self) {
        let _ = fs::remove_file(&self.database.path);
        let _ = fs::remove_file(&self.log.path);
    }

    /// Runs the program to look, to build, and to look again.
    fn judge(&self, tally: &mut Tally) -> Result<(), String> {
        let looked = self.place.run("plan --json")?;
        let built = self.place.run("build -q")?;
        for ended in [&looked, &built] {
            tally.count("clear errors", u64::from(ended.code != Some(0)));
            tally.count("rebuilt", u64::from(ended.stderr.contains("rebuilt")));
        }
        if looked.code == Some(0) {
            within(&sound(&self.place.read_plan(&looked)?)?, &self.truth)?;
        }
        if built.code == Some(0) { same(&self.place.finished()?, &self.truth) } else { Ok(()) }
    }
}

/// Damage to the files of a store.
#[derive(Debug, Clone, Copy)]
enum Damage {
    /// The record `number` truncated at this byte, the database lost.
    Record {
        number: usize,
        at: usize,
    },
    Database {
        at: usize,
    },
    Log {
        at: usize,
    },
    /// Random flips.
    Flips,
}

fn all_damage(size: Size, fixture: &Fixture) -> Vec<Damage> {
    let records = size.of(1, fixture.records.len());
    let step = size.of(64, 1);
    let record =
        |number: usize| (0..fixture.records[number].bytes.len()).map(move |at| Damage::Record { number, at });
    let cuts = |file: &File| (0..file.bytes.len()).step_by(step);
    let mut all: Vec<Damage> = (0..records).flat_map(record).collect();
    all.extend(cuts(&fixture.database).map(|at| Damage::Database { at }));
    all.extend(cuts(&fixture.log).map(|at| Damage::Log { at }));
    all.extend(vec![Damage::Flips; size.of(1000, 10_000)]);
    all
}

pub(crate) fn run(size: Size) -> Tally {
    let all = all_damage(size, &Fixture::new());
    spread(size, all.len(), Fixture::new, |fixture, number, tally| {
        fixture.restore();
        let damage = all[number];
        match damage {
            Damage::Record { number, at } => {
                fixture.forget_database();
                let file = &fixture.records[number];
                file.put(&file.bytes[..at]);
            }
            Damage::Database { at } => fixture.database.put(&fixture.database.bytes[..at]),
            Damage::Log { at } => fixture.log.put(&fixture.log.bytes[..at]),
            Damage::Flips => flip(fixture, &mut Random::new(size.seed, number as u64)),
        }
        fixture.judge(tally).map_err(|why| format!("{damage:?}: {why}"))
    })
}

/// Flips one to four bits of the database, of its log, or of a record without a database.
fn flip(fixture: &Fixture, random: &mut Random) {
    let file = match random.below(3) {
        0 => &fixture.database,
        1 => &fixture.log,
        _ => {
            if random.once_in(2) {
                fixture.forget_database();
            }
            random.pick(&fixture.records)
        }
    };
    let mut bytes = file.bytes.clone();
    for _ in 0..=random.below(4) {
        Flip::any(bytes.len() as u64, random).in_bytes(&mut bytes);
    }
    file.put(&bytes);
}
