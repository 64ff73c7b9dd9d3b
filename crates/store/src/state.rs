//! `state.db`: an index of the records, the stat cache, the memos, and the last key and recipe of
//! each step and scene.
//!
//! Nothing in it is essential: losing a row costs time only. Nothing in it is trusted: each row
//! carries a hash of its table, name and body, and a row that disagrees counts as absent. Rows are
//! looked up on demand, so a build of one scene does not read those of two thousand. A row is
//! written only after the file system has been synced, so after a crash of the machine it cannot
//! claim lost bytes.

mod tables;

pub(super) use tables::StateTable;
use tables::{
    SUFFIXES, VERSION, connection, create_tables, is_damage, look_up, read_all, row_seal, with_suffix,
};

use super::disk::StoreDisk;
use super::record::StepRecord;
use super::{StoreError, TRASH};
use gs2e_files::is_there;
use rusqlite::{Connection, OpenFlags, params};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Beginning of the name of a database that was set aside. A number follows.
const ASIDE: &str = "state.db.";

/// Returns true for the name of a database that was set aside, or of one of its files.
pub(super) fn is_database_aside(name: &str) -> bool {
    let number = name.strip_prefix(ASIDE).and_then(|rest| rest.split('-').next());
    number.is_some_and(|number| number.parse::<usize>().is_ok())
}

/// Number of bytes of the hash that a row carries.
type Seal = [u8; 16];

#[derive(Debug)]
pub(super) struct StateDb {
    root: PathBuf,
    path: PathBuf,
    disk: StoreDisk,
    write: bool,
    /// `None` if there is no database, or it is damaged.
    database: Option<Connection>,
    /// The reason why it can no longer be used.
    damage: Option<String>,
    /// Rows that are not written yet; `None` for rows to delete.
    pending: BTreeMap<(StateTable, String), Option<Vec<u8>>>,
    notices: Vec<String>,
}

impl StateDb {
    /// Opens the index, in the store or in the folder `elsewhere`. A missing, unreadable or older
    /// one is set aside and rebuilt from the records, with a notice.
    pub(super) fn open(
        root: &Path,
        elsewhere: Option<&Path>,
        disk: StoreDisk,
        write: bool,
    ) -> Result<Self, StoreError> {
        let mut state = Self {
            root: root.to_owned(),
            path: elsewhere.unwrap_or(root).join("state.db"),
            disk,
            write,
            database: None,
            damage: None,
            pending: BTreeMap::new(),
            notices: Vec::new(),
        };
        if is_there(&state.path) {
            match state.connect() {
                Ok(database) => state.database = Some(database),
                Err(why) => state.give_up(&why),
            }
        }
        if let Some(folder) = elsewhere.filter(|_| write) {
            state.disk.create_dir(folder)?;
        }
        // A reader does without an index, and reads the records one by one.
        if write && state.database.is_none() {
            state.rebuild()?;
        }
        Ok(state)
    }

    /// Notices of repairs since the last call, one line each.
    pub(super) fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// Adds a notice.
    pub(super) fn note(&mut self, line: String) {
        self.notices.push(line);
    }

    /// Makes every row count as absent from now on.
    fn give_up(&mut self, why: &str) {
        self.database = None;
        if self.damage.is_none() {
            // A writer rebuilds the index, and has a notice of its own.
            if !self.write {
                let line = format!("state.db could not be read ({why}); the records are read one by one");
                self.notices.push(line);
            }
            self.damage = Some(why.to_owned());
        }
    }

    /// Opens the existing database. The error is the reason why it cannot be used.
    fn connect(&self) -> Result<Connection, String> {
        if self.path.is_symlink() {
            return Err("it is a link".to_owned());
        }
        let access =
            if self.write { OpenFlags::SQLITE_OPEN_READ_WRITE } else { OpenFlags::SQLITE_OPEN_READ_ONLY };
        let database = connection(&self.path, access).map_err(|e| e.to_string())?;
        let version: i64 =
            database.pragma_query_value(None, "user_version", |row| row.get(0)).map_err(|e| e.to_string())?;
        if version == VERSION {
            Ok(database)
        } else {
            Err(format!("its version is {version}, not {VERSION}"))
        }
    }

    /// Sets the present database aside, and makes a new one from the records.
    fn rebuild(&mut self) -> Result<(), StoreError> {
        self.database = None;
        let existed = is_there(&self.path);
        let aside = self.set_aside()?;
        let aside = aside.strip_prefix(&self.root).unwrap_or(&aside).display();
        let (records, damaged) = StepRecord::read_all(&self.root, &self.disk)?;
        let failed = |path: &Path, source| StoreError::State { path: path.to_owned(), source };
        let new = self.make_new()?;
        self.disk.rename(&new, &self.path)?;
        let database = connection(&self.path, OpenFlags::SQLITE_OPEN_READ_WRITE);
        self.database = Some(database.map_err(|e| failed(&self.path, e))?);
        if existed || !records.is_empty() {
            let why = self.damage.take().unwrap_or_else(|| "the file is missing".to_owned());
            let kept = if existed { format!("; old file kept as {aside}") } else { String::new() };
            let line =
                format!("state.db could not be read ({why}); rebuilt from {} records{kept}", records.len());
            self.notices.push(line);
        }
        if damaged > 0 {
            self.notices.push(format!("{damaged} records are damaged and count as absent"));
        }
        // As pending rows: the next flush syncs the files of these records before it writes them.
        for record in records {
            self.put(StateTable::Record, &record.key.to_string(), record.brief().row());
        }
        Ok(())
    }

    /// Makes a database without rows under another name. It is complete before it gets its own
    /// name: a process that is killed here leaves no database, instead of one without tables.
    fn make_new(&self) -> Result<PathBuf, StoreError> {
        let new = with_suffix(&self.path, ".new");
        for suffix in SUFFIXES {
            let left = with_suffix(&new, suffix);
            // Left by a process that was killed here.
            if is_there(&left) {
                self.disk.remove(&left)?;
            }
        }
        let access = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_CREATE;
        let made = connection(&new, access).and_then(|database| {
            create_tables(&database)?;
            // Its log goes into the file when the last connection ends.
            database.close().map_err(|(_, error)| error)
        });
        made.map_err(|source| StoreError::State { path: new.clone(), source })?;
        Ok(new)
    }

    /// Moves the database and its log into the trash. A database outside the store is renamed in its
    /// own folder.
    fn set_aside(&self) -> Result<PathBuf, StoreError> {
        let home = self.path.parent().unwrap_or(Path::new(""));
        let folder = if home == self.root { home.join(TRASH) } else { home.to_owned() };
        let aside = |number: usize| folder.join(format!("{ASIDE}{number}"));
        let number = (1..).find(|n| !is_there(&aside(*n))).unwrap_or(1);
        // A log that stays behind would be taken for that of the new database.
        for suffix in SUFFIXES {
            let from = with_suffix(&self.path, suffix);
            if is_there(&from) {
                self.disk.rename(&from, &with_suffix(&aside(number), suffix))?;
            }
        }
        Ok(aside(number))
    }

    /// The body of a row.
    pub(super) fn get(&mut self, table: StateTable, name: &str) -> Option<Vec<u8>> {
        // A row that waits is newer than that of the database.
        if let Some(pending) = self.pending.get(&(table, name.to_owned())) {
            return pending.clone();
        }
        let found = self.database.as_ref().map(|database| look_up(database, table, name));
        match found? {
            Ok(body) => body,
            Err(e) => {
                self.give_up(&e.to_string());
                None
            }
        }
    }

    /// Every row of a table, by name.
    pub(super) fn all(&mut self, table: StateTable) -> BTreeMap<String, Vec<u8>> {
        let found = self.database.as_ref().map(|database| read_all(database, table));
        let mut rows = match found {
            None => BTreeMap::new(),
            Some(Ok(rows)) => rows,
            Some(Err(e)) => {
                self.give_up(&e.to_string());
                BTreeMap::new()
            }
        };
        for ((_, name), body) in self.pending.iter().filter(|((of, _), _)| *of == table) {
            match body {
                Some(body) => drop(rows.insert(name.clone(), body.clone())),
                None => drop(rows.remove(name)),
            }
        }
        rows
    }

    pub(super) fn put(&mut self, table: StateTable, name: &str, body: Vec<u8>) {
        self.pending.insert((table, name.to_owned()), Some(body));
    }

    /// As [`StateDb::put`], unless the row already has this value.
    pub(super) fn put_new(&mut self, table: StateTable, name: &str, body: Vec<u8>) {
        // An unchanged row must not be pending, or a build that makes nothing would sync the whole disk.
        if self.get(table, name).as_ref() != Some(&body) {
            self.put(table, name, body);
        }
    }

    pub(super) fn delete(&mut self, table: StateTable, name: &str) {
        self.pending.insert((table, name.to_owned()), None);
    }

    /// Rows that are not written yet.
    pub(super) fn pending(&self) -> usize {
        self.pending.len()
    }

    /// Returns true if there are rows to write.
    pub(super) fn is_behind(&self) -> bool {
        self.write && (!self.pending.is_empty() || self.damage.is_some())
    }

    /// Writes the rows added since the last call, in one transaction. The caller has synced the
    /// files that they describe.
    pub(super) fn flush(&mut self) -> Result<(), StoreError> {
        if self.damage.is_some() {
            self.rebuild()?;
        }
        if let Err(first) = self.write() {
            // A database that turns out to be damaged only now is rebuilt once. Any other failure
            // is one of the disk.
            if !is_damage(&first) {
                return Err(StoreError::State { path: self.path.clone(), source: first });
            }
            self.give_up(&first.to_string());
            self.rebuild()?;
            self.write().map_err(|source| StoreError::State { path: self.path.clone(), source })?;
        }
        // Rows wait until they are committed: after an error, the next flush writes them.
        self.pending.clear();
        self.disk.committed(&self.path)
    }

    fn write(&mut self) -> rusqlite::Result<()> {
        let Some(database) = &mut self.database else { return Ok(()) };
        let transaction = database.transaction()?;
        for ((table, name), body) in &self.pending {
            let of = table.name();
            match body {
                Some(body) => {
                    let put = format!("INSERT OR REPLACE INTO {of} VALUES (?1, ?2, ?3)");
                    let mut put = transaction.prepare_cached(&put)?;
                    put.execute(params![name, body, row_seal(*table, name, body)])?;
                }
                None => {
                    let mut delete =
                        transaction.prepare_cached(&format!("DELETE FROM {of} WHERE name = ?1"))?;
                    delete.execute([name])?;
                }
            }
        }
        transaction.commit()
    }
}
