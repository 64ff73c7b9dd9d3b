//! Tables of the state database and the seals of their rows.

use super::Seal;
use rusqlite::{Connection, OpenFlags, OptionalExtension};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum StateTable {
    /// Key to outputs.
    Record,
    /// Scene and step to the last key.
    Last,
    /// Path to stat fields and digest.
    Stat,
    /// See [`super::memo`].
    Memo,
    /// Scene to its last recipe.
    Recipe,
}

impl StateTable {
    const ALL: [Self; 5] = [Self::Record, Self::Last, Self::Stat, Self::Memo, Self::Recipe];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Record => "record",
            Self::Last => "last",
            Self::Stat => "stat",
            Self::Memo => "memo",
            Self::Recipe => "recipe",
        }
    }
}

/// `user_version` of the database. A database with another one is rebuilt.
pub(super) const VERSION: i64 = 2;

/// Maximum wait of a reader for a writer.
const BUSY: std::time::Duration = std::time::Duration::from_secs(30);

pub(super) fn row_seal(table: StateTable, name: &str, body: &[u8]) -> Seal {
    let mut hasher = blake3::Hasher::new_derive_key("gs2e 2026 state row v1");
    // Lengths keep the parts apart.
    for part in [table.name().as_bytes(), name.as_bytes()] {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    hasher.update(body);
    let mut seal = Seal::default();
    hasher.finalize_xof().fill(&mut seal);
    seal
}

/// Suffixes that SQLite adds to the name of a database for its files, and none for the database
/// itself.
pub(super) const SUFFIXES: [&str; 3] = ["", "-wal", "-shm"];

pub(super) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.to_owned().into_os_string();
    name.push(suffix);
    name.into()
}

pub(super) fn connection(path: &Path, access: OpenFlags) -> rusqlite::Result<Connection> {
    // The mutex of the store serialises all use of the connection.
    let database = Connection::open_with_flags(path, access | OpenFlags::SQLITE_OPEN_NO_MUTEX)?;
    database.busy_timeout(BUSY)?;
    // The file may be damaged: sizes are checked, and nothing stored in it is run.
    database.pragma_update(None, "cell_size_check", true)?;
    database.pragma_update(None, "trusted_schema", false)?;
    if access.contains(OpenFlags::SQLITE_OPEN_READ_WRITE) {
        database.pragma_update(None, "journal_mode", "WAL")?;
        // NORMAL may lose the last transactions in a power cut, which costs time only.
        database.pragma_update(None, "synchronous", "NORMAL")?;
    }
    Ok(database)
}

pub(super) fn create_tables(database: &Connection) -> rusqlite::Result<()> {
    for table in StateTable::ALL {
        let name = table.name();
        database.execute_batch(&format!(
            "CREATE TABLE {name} (name TEXT PRIMARY KEY NOT NULL, body BLOB NOT NULL, seal BLOB NOT NULL)"
        ))?;
    }
    database.pragma_update(None, "user_version", VERSION)
}

pub(super) fn look_up(
    database: &Connection,
    table: StateTable,
    name: &str,
) -> rusqlite::Result<Option<Vec<u8>>> {
    let query = format!("SELECT body, seal FROM {} WHERE name = ?1", table.name());
    let mut query = database.prepare_cached(&query)?;
    let found = query.query_row([name], |row| Ok((row.get::<_, Vec<u8>>(0)?, row.get::<_, Vec<u8>>(1)?)));
    let sound = found.optional()?.filter(|(body, found)| *found == row_seal(table, name, body));
    Ok(sound.map(|(body, _)| body))
}

pub(super) fn read_all(
    database: &Connection,
    table: StateTable,
) -> rusqlite::Result<BTreeMap<String, Vec<u8>>> {
    let mut query = database.prepare(&format!("SELECT name, body, seal FROM {}", table.name()))?;
    let mut rows = query.query([])?;
    let mut found = BTreeMap::new();
    while let Some(row) = rows.next()? {
        // A row of another shape counts as damaged.
        let (Ok(name), Ok(body), Ok(mark)) =
            (row.get::<_, String>(0), row.get::<_, Vec<u8>>(1), row.get::<_, Vec<u8>>(2))
        else {
            continue;
        };
        if mark == row_seal(table, &name, &body) {
            found.insert(name, body);
        }
    }
    Ok(found)
}

pub(super) fn is_damage(error: &rusqlite::Error) -> bool {
    use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase, TypeMismatch};
    match error {
        rusqlite::Error::SqliteFailure(e, _) => {
            // An altered schema shows as the generic error "no such table".
            matches!(e.code, DatabaseCorrupt | NotADatabase | TypeMismatch | rusqlite::ErrorCode::Unknown)
        }
        _ => true,
    }
}
