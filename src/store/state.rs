//! `state.db`: an index of the records, the key that each step last had, and the stat cache. All of it is read once
//! at opening and written in batches; all but the history of `last` can be rebuilt from `ac/`.

use super::record::{Output, Record};
use super::stat_cache::{Entry, Stat};
use super::{Digest, Key, StoreError, disk};
use rusqlite::{Connection, OpenFlags, params};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Debug)]
pub(super) struct State {
    path: PathBuf,
    /// `None` where the store is only looked at.
    database: Option<Connection>,
    records: BTreeMap<Key, Vec<Output>>,
    last: BTreeMap<(String, String), Key>,
    stats: BTreeMap<PathBuf, Entry>,
    new_records: Vec<Key>,
    new_last: Vec<(String, String)>,
}

/// `user_version` of the database; another one is rebuilt.
const VERSION: i64 = 1;

const SCHEMA: &str = "
    CREATE TABLE record (key BLOB PRIMARY KEY, outputs TEXT NOT NULL) WITHOUT ROWID;
    CREATE TABLE last (scene TEXT, step TEXT, key BLOB NOT NULL, PRIMARY KEY (scene, step)) WITHOUT ROWID;
    CREATE TABLE stat (path TEXT PRIMARY KEY, dev INTEGER, ino INTEGER, size INTEGER, mtime INTEGER,
                       ctime INTEGER, observed INTEGER, digest BLOB NOT NULL) WITHOUT ROWID;
";

impl State {
    /// Opens the index. A missing, unreadable or older one is set aside and rebuilt from the records, with a notice.
    pub(super) fn open(root: &Path, write: bool) -> Result<(Self, Vec<String>), StoreError> {
        let path = root.join("state.db");
        let mut state = Self {
            path: path.clone(),
            database: None,
            records: BTreeMap::new(),
            last: BTreeMap::new(),
            stats: BTreeMap::new(),
            new_records: Vec::new(),
            new_last: Vec::new(),
        };
        let mut notices = Vec::new();
        let existed = path.exists();
        if existed {
            match state.load(write) {
                Ok(()) => return Ok((state, notices)),
                Err(e) => notices.push(format!("state.db could not be read ({e}); rebuilt from the records")),
            }
        }
        let (records, damaged) = Record::read_all(root)?;
        if damaged > 0 {
            notices.push(format!("{damaged} records are damaged and count as absent"));
        }
        state.database = None;
        (state.last, state.stats) = (BTreeMap::new(), BTreeMap::new());
        state.records = records.into_iter().map(|r| (r.key, r.outputs)).collect();
        if write {
            if existed {
                let aside = root.join("trash").join(format!("state.db.{}", std::process::id()));
                disk::rename(&path, &aside)?;
            }
            state.create().map_err(|source| StoreError::State { path, source })?;
            state.new_records = state.records.keys().copied().collect();
            state.flush(&[])?;
        }
        Ok((state, notices))
    }

    /// Whoever only looks neither creates nor changes a database that a writer may be at work in.
    fn connect(&self, write: bool) -> rusqlite::Result<Connection> {
        let access = if write {
            OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_CREATE
        } else {
            OpenFlags::SQLITE_OPEN_READ_ONLY
        };
        let database = Connection::open_with_flags(&self.path, access | OpenFlags::SQLITE_OPEN_NO_MUTEX)?;
        database.busy_timeout(std::time::Duration::from_secs(30))?;
        if write {
            database.pragma_update(None, "journal_mode", "WAL")?;
            database.pragma_update(None, "synchronous", "NORMAL")?;
        }
        Ok(database)
    }

    fn create(&mut self) -> rusqlite::Result<()> {
        let database = self.connect(true)?;
        database.execute_batch(SCHEMA)?;
        database.pragma_update(None, "user_version", VERSION)?;
        self.database = Some(database);
        Ok(())
    }

    /// Reads everything; the error says why the database cannot be used.
    fn load(&mut self, write: bool) -> Result<(), String> {
        let version = self.read_tables(write).map_err(|e| e.to_string())?;
        if version == VERSION { Ok(()) } else { Err(format!("its version is {version}, not {VERSION}")) }
    }

    fn read_tables(&mut self, write: bool) -> rusqlite::Result<i64> {
        let database = self.connect(write)?;
        // One moment for all tables, whatever a writer does meanwhile.
        let snapshot = database.unchecked_transaction()?;
        let version = snapshot.pragma_query_value(None, "user_version", |row| row.get(0))?;
        if version == VERSION {
            self.records = read_records(&snapshot)?;
            self.last = read_last(&snapshot)?;
            self.stats = read_stats(&snapshot)?;
        }
        snapshot.finish()?;
        self.database = (version == VERSION && write).then_some(database);
        Ok(version)
    }

    pub(super) fn stat_entries(&self) -> BTreeMap<PathBuf, Entry> {
        self.stats.clone()
    }

    pub(super) fn outputs(&self, key: &Key) -> Option<Vec<Output>> {
        self.records.get(key).cloned()
    }

    pub(super) fn insert(&mut self, key: &Key, outputs: Vec<Output>) {
        self.records.insert(*key, outputs);
        self.new_records.push(*key);
    }

    pub(super) fn last(&self, scene: &str, step: &str) -> Option<Key> {
        self.last.get(&(scene.to_owned(), step.to_owned())).copied()
    }

    pub(super) fn set_last(&mut self, scene: &str, step: &str, key: Key) {
        let name = (scene.to_owned(), step.to_owned());
        if self.last.insert(name.clone(), key) != Some(key) {
            self.new_last.push(name);
        }
    }

    /// Writes what is new since the last call, in one transaction.
    pub(super) fn flush(&mut self, stats: &[(PathBuf, Entry)]) -> Result<(), StoreError> {
        if self.new_records.is_empty() && self.new_last.is_empty() && stats.is_empty() {
            return Ok(());
        }
        self.write(stats).map_err(|source| StoreError::State { path: self.path.clone(), source })?;
        self.new_records.clear();
        self.new_last.clear();
        Ok(())
    }

    fn write(&mut self, stats: &[(PathBuf, Entry)]) -> rusqlite::Result<()> {
        let Some(database) = &mut self.database else { return Ok(()) };
        let transaction = database.transaction()?;
        {
            let mut put = transaction.prepare("INSERT OR REPLACE INTO record VALUES (?1, ?2)")?;
            for key in &self.new_records {
                let outputs = serde_json::to_string(&self.records[key]).expect("outputs are plain data");
                put.execute(params![key.0.as_bytes(), outputs])?;
            }
            let mut put = transaction.prepare("INSERT OR REPLACE INTO last VALUES (?1, ?2, ?3)")?;
            for name in &self.new_last {
                put.execute(params![name.0, name.1, self.last[name].0.as_bytes()])?;
            }
            let mut put =
                transaction.prepare("INSERT OR REPLACE INTO stat VALUES (?1,?2,?3,?4,?5,?6,?7,?8)")?;
            for (path, e) in stats {
                // A path that is not UTF-8 is hashed each time: correct, only slower.
                let Some(path) = path.to_str() else { continue };
                let s = &e.stat;
                let digest = e.digest.as_bytes();
                let unsigned = [s.dev, s.ino, s.size].map(u64::cast_signed);
                let [dev, ino, size] = unsigned;
                put.execute(params![path, dev, ino, size, s.mtime_ns, s.ctime_ns, e.observed_ns, digest])?;
            }
        }
        transaction.commit()
    }
}

fn rows<T>(
    database: &Connection,
    query: &str,
    read: impl FnMut(&rusqlite::Row<'_>) -> rusqlite::Result<T>,
) -> rusqlite::Result<Vec<T>> {
    database.prepare(query)?.query_map([], read)?.collect()
}

fn read_records(database: &Connection) -> rusqlite::Result<BTreeMap<Key, Vec<Output>>> {
    let read = rows(database, "SELECT key, outputs FROM record", |row| {
        let text: String = row.get(1)?;
        let outputs = serde_json::from_str(&text).map_err(|e| {
            rusqlite::Error::FromSqlConversionFailure(1, rusqlite::types::Type::Text, Box::new(e))
        })?;
        Ok((Key(Digest(row.get(0)?)), outputs))
    })?;
    Ok(read.into_iter().collect())
}

fn read_last(database: &Connection) -> rusqlite::Result<BTreeMap<(String, String), Key>> {
    let read = rows(database, "SELECT scene, step, key FROM last", |row| {
        Ok(((row.get(0)?, row.get(1)?), Key(Digest(row.get(2)?))))
    })?;
    Ok(read.into_iter().collect())
}

fn read_stats(database: &Connection) -> rusqlite::Result<BTreeMap<PathBuf, Entry>> {
    let query = "SELECT path, dev, ino, size, mtime, ctime, observed, digest FROM stat";
    let read = rows(database, query, |row| {
        let path: String = row.get(0)?;
        let [dev, ino, size] = [row.get::<_, i64>(1)?, row.get(2)?, row.get(3)?].map(i64::cast_unsigned);
        let stat = Stat { dev, ino, size, mtime_ns: row.get(4)?, ctime_ns: row.get(5)? };
        Ok((PathBuf::from(path), Entry { stat, observed_ns: row.get(6)?, digest: Digest(row.get(7)?) }))
    })?;
    Ok(read.into_iter().collect())
}
