//! The store through its public interface: publishing, damage, lost indices, locks.

use gs2e::store::description::describe_value;
use gs2e::store::record::{StepProvenance, StepRecord, StoredOutput};
use gs2e::store::{BlobState, Digest, Key, Store, StoreAccess, StoreError, StoreOptions};
use std::path::Path;

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
            message.contains("old file kept as trash/state.db."),
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
    std::fs::write(folder.path().join("VERSION"), "999\n").unwrap();
    let refused = Store::open(folder.path(), StoreAccess::Read, &mut |_| {});
    assert!(matches!(refused, Err(StoreError::Newer { .. })), "{refused:?}");
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
    std::fs::create_dir(folder.path().join("tmp/4711.0")).unwrap();
    std::fs::write(folder.path().join("tmp/4711.0/half"), "half").unwrap();
    drop(open(folder.path()));
    assert_eq!(std::fs::read_dir(folder.path().join("tmp")).unwrap().count(), 0);
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
