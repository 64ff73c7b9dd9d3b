//! The store through its public interface: publishing, damage, lost indices, locks.

#![expect(clippy::unwrap_used, reason = "test code outside of test functions")]

use gs2e_store::description::describe_value;
use gs2e_store::gc::GcSweep;
use gs2e_store::record::{StepProvenance, StepRecord, StoredOutput};
use gs2e_store::{BlobState, Digest, Key, Store, StoreAccess, StoreError, StoreOptions};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn open(root: &Path) -> Store {
    Store::open(root, StoreAccess::Write, &mut |_| {}).unwrap()
}

/// Publishes `files` under the key of `name`.
fn publish(store: &Store, name: &str, files: &[(&str, &str)]) -> Result<Vec<StoredOutput>, StoreError> {
    let workspace = store.workspace()?;
    for (file, content) in files {
        let path = workspace.path().join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }
    let description = describe_value(name);
    let record = StepRecord::new(
        Key::of_description(&description),
        "test",
        description.lines(),
        StepProvenance::default(),
    );
    store.publish(&workspace, record)
}

fn key(name: &str) -> Key {
    Key::of_description(&describe_value(name))
}

/// The outputs on record under the key of `name`.
fn outputs(store: &Store, name: &str) -> Option<Vec<StoredOutput>> {
    store.record(&key(name)).unwrap().map(|record| record.outputs)
}

#[test]
fn published_files_are_found_by_another_process() {
    let folder = tempfile::tempdir().unwrap();
    let made = publish(&open(folder.path()), "a", &[("b/c.txt", "one"), ("a.txt", "two")]).unwrap();
    let names: Vec<&str> = made.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["a.txt", "b/c.txt"]);
    let store = open(folder.path());
    // The index was not flushed: the record alone must be enough.
    assert_eq!(outputs(&store, "a"), Some(made.clone()));
    assert_eq!(std::fs::read(store.path_of(&made[1].digest)).unwrap(), b"one");
    assert!(made.iter().all(|o| store.examine(o).unwrap() == BlobState::Sound));
}

#[test]
fn a_lost_or_broken_index_is_rebuilt_from_the_records() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path());
    let made = publish(&store, "a", &[("a.txt", "one")]).unwrap();
    store.flush().unwrap();
    drop(store);
    for damage in [None, Some("this is no database"), Some("")] {
        for file in ["state.db", "state.db-wal", "state.db-shm"] {
            let _ = std::fs::remove_file(folder.path().join(file));
        }
        if let Some(text) = damage {
            std::fs::write(folder.path().join("state.db"), text).unwrap();
        }
        let store = open(folder.path());
        assert_eq!(outputs(&store, "a"), Some(made.clone()), "{damage:?}");
        let message = store.take_notices().join("\n");
        assert!(message.contains("rebuilt from 1 records"), "{damage:?}: {message}");
        assert_eq!(
            message.contains("old file kept as gs2e-trash/state.db."),
            damage.is_some(),
            "{damage:?}: {message}"
        );
    }
}

#[test]
fn damage_to_a_blob_is_seen_and_the_blob_can_be_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path());
    let output = publish(&store, "a", &[("a.txt", "one")]).unwrap().remove(0);
    let path = store.path_of(&output.digest);
    let times = std::fs::metadata(&path).unwrap().modified().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(20));
    std::fs::remove_file(&path).unwrap();
    assert_eq!(store.examine(&output).unwrap(), BlobState::Missing);
    std::fs::write(&path, "two").unwrap();
    std::fs::File::options().write(true).open(&path).unwrap().set_modified(times).unwrap();
    assert_eq!(store.examine(&output).unwrap(), BlobState::Altered);
    store.discard(&output.digest).unwrap();
    let again = publish(&store, "a", &[("a.txt", "one")]).unwrap();
    assert_eq!(again.as_slice(), std::slice::from_ref(&output));
    assert_eq!(store.examine(&output).unwrap(), BlobState::Sound);
}

#[test]
fn two_contents_for_one_key_are_an_error_and_the_first_stays() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path());
    let first = publish(&store, "a", &[("a.txt", "one")]).unwrap();
    let second = publish(&store, "a", &[("a.txt", "two")]);
    assert!(matches!(second, Err(StoreError::Nondeterministic(_))), "{second:?}");
    assert_eq!(outputs(&store, "a"), Some(first));
}

#[test]
fn a_second_writer_is_refused_or_waits_for_a_named_holder() {
    let folder = tempfile::tempdir().unwrap();
    let first = open(folder.path());
    let refused = Store::open(folder.path(), StoreAccess::WriteNow, &mut |_| {});
    let holder = format!("pid {}", std::process::id());
    assert!(
        matches!(&refused, Err(StoreError::Locked { holder: h, .. }) if h.starts_with(&holder)),
        "{refused:?}"
    );
    // Looking needs no lock.
    assert!(Store::open(folder.path(), StoreAccess::Read, &mut |_| {}).is_ok());
    let root = folder.path().to_owned();
    let (message, waits) = std::sync::mpsc::channel();
    let second = std::thread::spawn(move || {
        Store::open(&root, StoreAccess::Write, &mut |holder| message.send(holder.to_owned()).unwrap()).is_ok()
    });
    assert!(waits.recv().unwrap().starts_with(&holder));
    drop(first);
    assert!(second.join().unwrap());
}

#[test]
fn a_store_of_a_newer_program_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    drop(open(folder.path()));
    for version in ["999\n", "gs2e store, format 999\n", "gs2e store, format two\n"] {
        std::fs::write(folder.path().join("VERSION"), version).unwrap();
        let refused = Store::open(folder.path(), StoreAccess::Read, &mut |_| {});
        assert!(matches!(refused, Err(StoreError::Newer { .. })), "{refused:?}");
        assert!(Store::is_store(folder.path()));
    }
}

/// The names and texts below a folder, with the targets of links.
fn content(root: &Path) -> BTreeMap<PathBuf, String> {
    let entries = walkdir::WalkDir::new(root).into_iter().map(Result::unwrap);
    let text = |path: &Path| match std::fs::read_link(path) {
        Ok(target) => format!("-> {}", target.display()),
        Err(_) => std::fs::read_to_string(path).unwrap_or_default(),
    };
    entries.map(|entry| (entry.path().to_owned(), text(entry.path()))).collect()
}

/// A folder with content becomes no store, whichever names of a store it has.
#[test]
fn a_folder_of_others_is_refused_and_stays() {
    let names =
        ["tmp/thesis", "cas/ab/notes", "ac/ab/notes", "frames/1.png", "trash/old", "state.db", "lock"];
    for version in [None, Some(""), Some("1\n"), Some("gs2e\n"), Some("gs2e shared store, format 1\n")] {
        for count in 1..=names.len() {
            let folder = tempfile::tempdir().unwrap();
            for name in &names[..count] {
                std::fs::create_dir_all(folder.path().join(name).parent().unwrap()).unwrap();
                std::fs::write(folder.path().join(name), "mine").unwrap();
            }
            version.iter().for_each(|text| std::fs::write(folder.path().join("VERSION"), text).unwrap());
            let before = content(folder.path());
            for access in [StoreAccess::Read, StoreAccess::Write, StoreAccess::WriteNow] {
                let refused = Store::open(folder.path(), access, &mut |_| {});
                assert!(
                    matches!(refused, Err(StoreError::Foreign { .. })),
                    "{version:?} {count}: {refused:?}"
                );
            }
            assert_eq!(content(folder.path()), before, "{version:?} {count}");
            assert!(!Store::is_store(folder.path()));
        }
    }
}

/// The store of an earlier version had a number as its marker, which a power cut could empty.
#[test]
fn a_store_of_an_earlier_version_gets_a_marker() {
    for version in ["1\n", "1", "", "\0\0"] {
        let folder = tempfile::tempdir().unwrap();
        let made = publish(&open(folder.path()), "a", &[("a.txt", "one")]).unwrap();
        let marker = folder.path().join("VERSION");
        let text = std::fs::read_to_string(&marker).unwrap();
        std::fs::write(&marker, version).unwrap();
        std::fs::create_dir(folder.path().join("tmp")).unwrap();
        std::fs::write(folder.path().join("tmp/thesis"), "mine").unwrap();
        let reader = Store::open(folder.path(), StoreAccess::Read, &mut |_| {}).unwrap();
        assert_eq!(outputs(&reader, "a"), Some(made.clone()), "{version:?}");
        assert_eq!(std::fs::read_to_string(&marker).unwrap(), version, "a reader writes nothing");
        let store = open(folder.path());
        assert_eq!(outputs(&store, "a"), Some(made), "{version:?}");
        let notices = store.take_notices().join("\n");
        assert!(notices.contains("folders tmp and trash are not used any more"), "{notices}");
        assert_eq!(std::fs::read_to_string(&marker).unwrap(), text);
        assert_eq!(std::fs::read_to_string(folder.path().join("tmp/thesis")).unwrap(), "mine");
    }
}

#[test]
fn a_link_in_a_store_is_refused_and_not_followed() {
    for name in ["gs2e-tmp", "gs2e-trash", "cas", "ac", "frames", "logs", "resume", "roots"] {
        let folder = tempfile::tempdir().unwrap();
        let (root, others) = (folder.path().join("store"), folder.path().join("others"));
        drop(open(&root));
        std::fs::create_dir(&others).unwrap();
        std::fs::write(others.join("4711.0"), "mine").unwrap();
        let _ = std::fs::remove_dir_all(root.join(name));
        std::os::unix::fs::symlink(&others, root.join(name)).unwrap();
        let refused = Store::open(&root, StoreAccess::Write, &mut |_| {});
        assert!(matches!(refused, Err(StoreError::Link { .. })), "{name}: {refused:?}");
        assert_eq!(std::fs::read_to_string(others.join("4711.0")).unwrap(), "mine", "{name}");
    }
}

/// Of several processes that find an empty folder, each gets the store in its turn.
#[test]
fn an_empty_folder_becomes_one_store_for_all() {
    let folder = tempfile::tempdir().unwrap();
    // As the root of an ext4 file system.
    std::fs::create_dir(folder.path().join("lost+found")).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| drop(open(folder.path())));
        }
    });
    let hidden = content(folder.path()).into_keys().filter(|path| path.ends_with(".gs2e-version"));
    assert_eq!(hidden.count(), 0);
    assert!(Store::is_store(folder.path()));
}

/// Files that a person keeps in a store's folders stay, unless they have names of this program.
#[test]
fn files_with_other_names_are_not_deleted() {
    let folder = tempfile::tempdir().unwrap();
    drop(open(folder.path()));
    let kept =
        ["gs2e-tmp/thesis", "gs2e-tmp/12.thesis", "gs2e-trash/thesis", "frames/000001.png", "logs/a.txt"];
    for name in kept.iter().chain(&["gs2e-trash/4711.0", "gs2e-tmp/4711.0"]) {
        std::fs::create_dir_all(folder.path().join(name).parent().unwrap()).unwrap();
        std::fs::write(folder.path().join(name), "mine").unwrap();
    }
    let sweep = GcSweep { until_ns: i64::MAX, dry_run: false };
    let store = open(folder.path());
    assert_eq!(store.sweep(&BTreeSet::new(), sweep).unwrap().trash, 1);
    assert_eq!(store.sweep_frames(&BTreeSet::new(), sweep).unwrap().files, 0);
    assert!(kept.iter().all(|name| folder.path().join(name).exists()));
    assert!(!folder.path().join("gs2e-tmp/4711.0").exists());
}

#[test]
fn looking_at_a_missing_store_creates_no_store() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("absent");
    let store = Store::open(&root, StoreAccess::Read, &mut |_| {}).unwrap();
    assert_eq!(outputs(&store, "a"), None);
    assert!(!root.exists());
}

#[test]
fn leftovers_of_a_dead_process_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    drop(open(folder.path()));
    std::fs::create_dir(folder.path().join("gs2e-tmp/4711.0")).unwrap();
    std::fs::write(folder.path().join("gs2e-tmp/4711.0/half"), "half").unwrap();
    drop(open(folder.path()));
    assert_eq!(std::fs::read_dir(folder.path().join("gs2e-tmp")).unwrap().count(), 0);
}

/// Digests are those of the published algorithm, by the test vector of the empty input.
#[test]
fn digests_are_blake3() {
    let empty = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";
    assert_eq!(Digest::of_bytes(b"").to_string(), empty);
}

/// A store on a network file system keeps its database elsewhere; the records are in the store in
/// any case.
#[test]
fn the_database_may_lie_elsewhere() {
    let [store, elsewhere] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let index = elsewhere.path().join("deep/index");
    let open = |index: Option<&Path>| {
        let opening = StoreOptions { index: index.map(Path::to_owned), ..StoreAccess::Write.into() };
        Store::open(store.path(), opening, &mut |_| {}).unwrap()
    };
    let first = open(Some(&index));
    let made = publish(&first, "a", &[("a.txt", "one")]).unwrap();
    first.flush().unwrap();
    drop(first);
    assert!(index.join("state.db").is_file() && !store.path().join("state.db").exists());
    std::fs::write(index.join("state.db"), "no database").unwrap();
    let second = open(Some(&index));
    let message = second.take_notices().join("\n");
    assert!(
        message.contains(&format!("old file kept as {}", index.join("state.db.1").display())),
        "{message}"
    );
    assert_eq!(outputs(&second, "a"), Some(made.clone()));
    drop(second);
    assert_eq!(outputs(&open(None), "a"), Some(made));
}
