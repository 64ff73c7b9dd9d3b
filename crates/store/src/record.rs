//! Records of the outputs of a key: one immutable JSON file per key, in `ac/`.

use super::blob::fresh_name;
use super::description::ExplanationLine;
use super::disk::StoreDisk;
use super::{Digest, Key, StoreError, TMP};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One output file of a step.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct StoredOutput {
    /// Its name within the step, `/`-separated.
    pub name: String,
    /// Digest of its bytes.
    pub digest: Digest,
    /// Its length in bytes.
    pub size: u64,
}

/// The content digest of a step's outputs: of the sorted list of names, sizes and digests. The keys
/// of later steps contain it.
#[must_use]
pub fn content_digest(outputs: &[StoredOutput]) -> Digest {
    let mut hasher = blake3::Hasher::new_derive_key("gs2e 2026 output list v1");
    for output in outputs {
        // The length keeps a name apart from the bytes after it.
        hasher.update(&(output.name.len() as u64).to_le_bytes());
        hasher.update(output.name.as_bytes());
        hasher.update(&output.size.to_le_bytes());
        hasher.update(output.digest.as_bytes());
    }
    hasher.finalize().into()
}

/// Information about a step that does not enter its key.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StepProvenance {
    /// Version of the program.
    pub tool: String,
    /// Wall time of the step in seconds. Of steps that were made together, its share.
    pub seconds: f64,
    /// An estimate of the seconds that it takes alone, if it was made together with others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alone_seconds: Option<f64>,
    /// Number of threads.
    pub threads: usize,
    /// Processor time of the step in seconds, if it is known. Of steps that were made together, its share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub core_seconds: Option<f64>,
    /// Memory granted, bytes.
    pub memory: u64,
    /// Warnings of the step.
    pub warnings: Vec<String>,
}

/// A record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Format of this file.
    pub format: u32,
    /// The key.
    pub key: Key,
    /// Name of the stage.
    pub stage: String,
    /// The outputs, sorted by name.
    pub outputs: Vec<StoredOutput>,
    /// The description, whose hash is the key, as text.
    pub description: Vec<ExplanationLine>,
    /// Resources used.
    pub provenance: StepProvenance,
    /// BLAKE3 of this record's JSON with an empty seal.
    seal: String,
}

const FORMAT: u32 = 1;

/// The part of a record in the index.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordSummary {
    /// Name of the stage.
    pub stage: String,
    /// As [`StepProvenance::seconds`].
    pub seconds: f64,
    /// As [`StepProvenance::alone_seconds`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alone_seconds: Option<f64>,
    /// Number of threads.
    pub threads: usize,
    /// As [`StepProvenance::core_seconds`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub core_seconds: Option<f64>,
    /// Memory granted, bytes.
    pub memory: u64,
    /// The outputs, sorted by name.
    pub outputs: Vec<StoredOutput>,
}

impl RecordSummary {
    /// Processor time of the step, s.
    #[must_use]
    pub fn core_seconds(&self) -> f64 {
        // Threads of older versions were the cores of the step, and of no other one.
        self.core_seconds.unwrap_or(self.seconds * self.threads as f64)
    }

    /// An estimate of the processor time of the step alone, s.
    #[must_use]
    pub fn alone_core_seconds(&self) -> f64 {
        let cores = if self.seconds > 0.0 { self.core_seconds() / self.seconds } else { 1.0 };
        self.alone_seconds.map_or_else(|| self.core_seconds(), |seconds| seconds * cores)
    }

    /// The row of the index.
    pub(super) fn row(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("a record is plain data")
    }
}

impl StepRecord {
    /// A record without outputs yet.
    #[must_use]
    pub fn new(key: Key, stage: &str, description: Vec<ExplanationLine>, provenance: StepProvenance) -> Self {
        let seal = String::new();
        Self {
            format: FORMAT,
            key,
            stage: stage.to_owned(),
            outputs: Vec::new(),
            description,
            provenance,
            seal,
        }
    }

    pub(super) fn record_path(root: &Path, key: &Key) -> PathBuf {
        root.join(Self::record_name(key))
    }

    /// The name of the file below a store.
    pub(super) fn record_name(key: &Key) -> String {
        let name = key.to_string();
        format!("ac/{}/{name}.json", &name[..2])
    }

    /// The part of the record for the index.
    pub(super) fn brief(&self) -> RecordSummary {
        let StepProvenance { seconds, alone_seconds, threads, core_seconds, memory, .. } = self.provenance;
        let (stage, outputs) = (self.stage.clone(), self.outputs.clone());
        RecordSummary { stage, seconds, alone_seconds, threads, core_seconds, memory, outputs }
    }

    fn sealed(&self) -> String {
        let open = Self { seal: String::new(), ..self.clone() };
        Digest::of_bytes(&serde_json::to_vec(&open).expect("a record is plain data")).to_string()
    }

    pub(super) fn write(&mut self, root: &Path, disk: &StoreDisk) -> Result<(), StoreError> {
        self.seal = self.sealed();
        let path = Self::record_path(root, &self.key);
        if let Some(folder) = path.parent() {
            disk.create_dir(folder)?;
        }
        let bytes = self.to_bytes();
        // In the store itself, because a rename does not cross file systems.
        let temporary = root.join(TMP).join(fresh_name(format_args!("{}.json", self.key)));
        disk.write_atomically(&path, &temporary, &bytes)
    }

    /// The text of the file.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("a record is plain data")
    }

    /// The record of a key; `None` if it is absent. A torn or altered record, and one of another
    /// format, counts as absent.
    pub(super) fn read(root: &Path, disk: &StoreDisk, key: &Key) -> Result<Option<Self>, StoreError> {
        let bytes = disk.read_optional(&Self::record_path(root, key))?;
        Ok(bytes.and_then(|bytes| Self::parse_of(&bytes, key)))
    }

    /// The record in the file of a key. A sound record of another key counts as absent.
    pub(super) fn parse_of(bytes: &[u8], key: &Key) -> Option<Self> {
        Self::parse(bytes).filter(|record| record.key == *key)
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let record: Self = serde_json::from_slice(bytes).ok()?;
        // The seal is over the parsed values: another spelling of them is sound.
        (record.format == FORMAT && record.seal == record.sealed()).then_some(record)
    }

    /// All sound records below `ac/`, and the number of files that are not.
    pub(super) fn read_all(root: &Path, disk: &StoreDisk) -> Result<(Vec<Self>, usize), StoreError> {
        let folder = root.join("ac");
        if !folder.is_dir() {
            return Ok((Vec::new(), 0));
        }
        let (mut records, mut damaged) = (Vec::new(), 0);
        for (_, path) in disk.files_below(&folder)? {
            match disk.read_optional(&path)?.and_then(|bytes| Self::parse(&bytes)) {
                Some(record) => records.push(record),
                None => damaged += 1,
            }
        }
        Ok((records, damaged))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> StepRecord {
        let line = ExplanationLine { path: "params.rate".into(), text: "2400/1".into() };
        let provenance = StepProvenance {
            tool: "0".into(),
            seconds: 0.1,
            threads: 2,
            memory: 7,
            ..StepProvenance::default()
        };
        let mut record = StepRecord::new(Key(Digest::of_bytes(b"key")), "trajectory", vec![line], provenance);
        record.outputs.push(StoredOutput {
            name: "poses.txt".into(),
            digest: Digest::of_bytes(b"poses"),
            size: 5,
        });
        record
    }

    #[test]
    fn any_cut_or_flipped_record_is_a_miss() {
        let folder = tempfile::tempdir().unwrap();
        let mut record = sample();
        std::fs::create_dir(folder.path().join(TMP)).unwrap();
        let disk = StoreDisk::new(folder.path(), std::sync::Arc::new(crate::fs::SystemFs), false);
        record.write(folder.path(), &disk).unwrap();
        let read = || StepRecord::read(folder.path(), &disk, &record.key).unwrap();
        assert_eq!(read(), Some(record.clone()));
        let path = StepRecord::record_path(folder.path(), &record.key);
        let whole = std::fs::read(&path).unwrap();
        for n in 0..whole.len() {
            std::fs::write(&path, &whole[..n]).unwrap();
            assert_eq!(read(), None, "cut at {n}");
            let mut flipped = whole.clone();
            flipped[n] ^= 1 << (n % 8);
            std::fs::write(&path, &flipped).unwrap();
            // A flipped bit may keep the meaning (the case of a digit in an exponent, for example),
            // but never change it.
            assert!(read().is_none_or(|r| r == record), "flipped at {n}");
        }
    }

    #[test]
    fn content_depends_on_names_sizes_and_bytes() {
        let a = sample().outputs;
        let mut b = a.clone();
        b[0].name = "pose.txt".into();
        assert_ne!(content_digest(&a), content_digest(&b));
    }
}
