//! Ages are set by hand: a file looks as if it were written or used at that time.

use super::*;
use crate::record::StepProvenance;
use crate::{Store, StoreAccess, StoreOptions};
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::time::SystemTime;

const DAY: Duration = Duration::from_secs(86_400);
const HOUR: Duration = Duration::from_secs(3600);

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn shared(&self) -> PathBuf {
        self.folder.path().join("shared")
    }

    fn store(&self, name: &str) -> Store {
        let options = StoreOptions { shared: Some(self.shared()), ..StoreAccess::Write.into() };
        Store::open(&self.folder.path().join(name), options, &mut |_| {}).unwrap()
    }

    /// Publishes a step with one file of these bytes, and offers it.
    fn step(&self, store: &Store, name: &str, text: &str) -> Key {
        let key = Key(Digest::of_bytes(name.as_bytes()));
        let workspace = store.workspace().unwrap();
        fs::write(workspace.path().join("a.txt"), text).unwrap();
        store.publish(&workspace, record(key)).unwrap();
        store.share(&key).unwrap();
        key
    }

    fn record_path(&self, key: &Key) -> PathBuf {
        let name = key.to_string();
        self.shared().join("ac").join(&name[..2]).join(format!("{name}.json"))
    }

    fn blob_path(&self, text: &str) -> PathBuf {
        let name = Digest::of_bytes(text.as_bytes()).to_string();
        self.shared().join("cas").join(&name[..2]).join(name)
    }

    /// Makes every file and folder of the shared folder this old.
    fn age(&self, by: Duration) {
        for folder in ["ac", "cas", TMP, TRASH] {
            let all = walkdir::WalkDir::new(self.shared().join(folder)).contents_first(true);
            all.into_iter().flatten().for_each(|entry| set_age(entry.path(), by));
        }
    }

    fn sweep(&self, older_than: Duration) -> SharedSweepSummary {
        self.sweep_at(older_than, now_ns(), false).unwrap()
    }

    fn sweep_at(
        &self,
        older_than: Duration,
        now_ns: i64,
        dry_run: bool,
    ) -> Result<SharedSweepSummary, StoreError> {
        sweep_shared(&self.shared(), SharedSweep { older_than, now_ns, dry_run })
    }
}

fn record(key: Key) -> crate::record::StepRecord {
    crate::record::StepRecord::new(key, "test", Vec::new(), StepProvenance::default())
}

fn now_ns() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    i64::try_from(since.as_nanos()).unwrap()
}

fn set_age(path: &Path, by: Duration) {
    set_time(path, SystemTime::now() - by);
}

fn set_time(path: &Path, to: SystemTime) {
    let before = fs::metadata(path).unwrap().permissions();
    // Only root may write to a blob.
    fs::set_permissions(path, fs::Permissions::from_mode(before.mode() | 0o200)).unwrap();
    fs::File::open(path).unwrap().set_modified(to).unwrap();
    fs::set_permissions(path, before).unwrap();
}

#[test]
fn unused_files_go_to_the_trash_and_are_deleted_after_the_same_time() {
    let place = Place::new();
    let store = place.store("one");
    let (old, young) = (place.step(&store, "old", "old bytes"), place.step(&store, "young", "young"));
    place.age(3 * DAY);
    set_age(&place.record_path(&young), HOUR);
    let planned = place.sweep_at(2 * DAY, now_ns(), true).unwrap();
    let swept = place.sweep(2 * DAY);
    assert_eq!((swept.records, swept.blobs, swept.bytes, swept.kept_records), (1, 1, 9, 1));
    assert_eq!(SharedSweepSummary { kept_records: 1, ..planned }, swept);
    assert!(!place.record_path(&old).exists() && !place.blob_path("old bytes").exists());
    // The old blob of the young record stays.
    assert!(place.blob_path("young").exists());
    assert_eq!(place.sweep(2 * DAY).deleted, 0);
    place.age(3 * DAY);
    set_age(&place.record_path(&young), HOUR);
    let swept = place.sweep(2 * DAY);
    assert_eq!((swept.deleted, swept.records), (2, 0));
    assert!(place.store("two").adopt(&young).unwrap().is_some());
}

#[test]
fn adoption_and_offers_count_as_use() {
    let place = Place::new();
    let store = place.store("one");
    let [adopted, offered, unused] = ["a", "b", "c"].map(|name| place.step(&store, name, name));
    place.age(3 * DAY);
    place.store("two").adopt(&adopted).unwrap().unwrap();
    store.share(&offered).unwrap();
    assert_eq!(place.sweep(DAY).records, 1);
    let there = [adopted, offered, unused].map(|key| place.record_path(&key).exists());
    assert_eq!(there, [true, true, false]);
    // Both still have their files.
    for key in [adopted, offered] {
        assert!(place.store("three").adopt(&key).unwrap().is_some());
    }
}

#[test]
fn a_clock_that_differs_by_an_hour_deletes_nothing_early() {
    let place = Place::new();
    let key = place.step(&place.store("one"), "a", "a");
    let hour = i64::try_from(HOUR.as_nanos()).unwrap();
    // The record was used 23 hours ago, and the builder's clock was an hour behind.
    place.age(DAY);
    for shift in [-hour, 0, hour] {
        let swept = place.sweep_at(DAY, now_ns() + shift, false).unwrap();
        assert_eq!((swept.records, swept.blobs), (0, 0), "{shift}");
        assert!(swept.clock_difference <= 3601);
    }
    // A clock that is far off is refused, in both directions.
    for shift in [-3 * hour, 3 * hour] {
        let error = place.sweep_at(DAY, now_ns() + shift, false).unwrap_err();
        assert!(matches!(error, StoreError::Clocks { .. }), "{error}");
    }
    // So is a file of the future.
    set_time(&place.record_path(&key), SystemTime::now() + 3 * HOUR);
    assert!(matches!(place.sweep_at(DAY, now_ns(), false), Err(StoreError::Clocks { .. })));
}

#[test]
fn a_file_that_a_record_names_returns_from_the_trash() {
    let place = Place::new();
    let key = place.step(&place.store("one"), "a", "bytes");
    // As if a collection had been killed after it moved the file of a record that came meanwhile.
    let batch = place.shared().join("gs2e-trash/gs2e-killed");
    fs::create_dir_all(&batch).unwrap();
    let blob = place.blob_path("bytes");
    fs::rename(&blob, batch.join(blob.file_name().unwrap())).unwrap();
    assert_eq!(place.sweep(DAY).restored, 1);
    assert!(place.store("two").adopt(&key).unwrap().is_some());
}

#[test]
fn folders_of_killed_processes_are_deleted_and_those_of_running_ones_stay() {
    let place = Place::new();
    let running = place.store("one");
    place.step(&running, "a", "a");
    place.age(3 * DAY);
    let killed = place.shared().join("gs2e-tmp/gs2e-killed");
    fs::create_dir_all(&killed).unwrap();
    fs::write(killed.join("0"), "part").unwrap();
    set_age(&killed, 3 * DAY);
    // A running process has put something into its folder since it was started.
    place.step(&running, "b", "b");
    let swept = place.sweep(DAY);
    assert_eq!((swept.deleted, swept.deleted_bytes), (1, 4));
    place.step(&running, "c", "c");
}

/// Adopters and publishers against a collector, all at once, with every file old all the time.
#[test]
fn no_record_loses_its_files_while_a_collection_runs() {
    let place = Place::new();
    let seed = place.store("seed");
    for i in 0..20 {
        // All records share one file.
        place.step(&seed, &format!("seed {i}"), "shared bytes");
    }
    place.age(3 * DAY);
    let stores: Vec<Store> = (0..3).map(|i| place.store(&format!("m{i}"))).collect();
    std::thread::scope(|scope| {
        for (i, store) in stores.iter().enumerate() {
            let place = &place;
            scope.spawn(move || {
                for step in 0..30 {
                    place.step(store, &format!("step {i} {step}"), "shared bytes");
                    // It may be moved away at this moment.
                    let long_ago = SystemTime::now() - 3 * DAY;
                    let file = fs::File::open(place.blob_path("shared bytes"));
                    let _ = file.and_then(|file| file.set_modified(long_ago));
                }
            });
        }
        for _ in 0..10 {
            place.sweep(DAY);
        }
    });
    place.sweep(DAY);
    let reader = place.store("reader");
    for (i, step) in (0..3).flat_map(|i| (0..30).map(move |step| (i, step))) {
        let key = Key(Digest::of_bytes(format!("step {i} {step}").as_bytes()));
        assert!(reader.adopt(&key).unwrap().is_some(), "step {i} {step}");
    }
}

/// All of them find the same files to move, to put back and to delete.
#[test]
fn collections_at_the_same_time_end_well() {
    for round in 0..20 {
        let place = Place::new();
        let store = place.store("one");
        let keys: Vec<Key> = (0..8).map(|i| place.step(&store, &format!("{i}"), &format!("{i}"))).collect();
        // A killed collection left a file that a record names, and another one that no record names.
        let batch = place.shared().join("gs2e-trash/gs2e-killed");
        fs::create_dir_all(&batch).unwrap();
        let blob = place.blob_path("0");
        fs::rename(&blob, batch.join(blob.file_name().unwrap())).unwrap();
        fs::write(batch.join(Digest::of_bytes(b"old").to_string()), "old").unwrap();
        fs::create_dir_all(place.shared().join("gs2e-tmp/gs2e-killed")).unwrap();
        place.age(3 * DAY);
        for key in &keys[..4] {
            set_age(&place.record_path(key), HOUR);
        }
        let barrier = std::sync::Barrier::new(4);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    barrier.wait();
                    place.sweep(2 * DAY)
                });
            }
        });
        assert!(!batch.exists(), "{round}");
        for (i, key) in keys.iter().enumerate() {
            let adopted = place.store("two").adopt(key).unwrap();
            assert_eq!(adopted.is_some(), i < 4, "round {round}, step {i}");
        }
    }
}
