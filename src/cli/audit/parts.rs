//! `gs2e audit --shard I/N --parts FOLDER` writes a part of an audit, and `gs2e audit --parts FOLDER` gives
//! the verdict.

use crate::cli::{Console, VerbError, input, output};
use gs2e_audit::{AuditPart, PartsError};
use gs2e_build::plan::shard::SceneShard;
use gs2e_files::{self as files, MAX_DOCUMENT};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Options of an audit in parts.
#[derive(Debug, clap::Args)]
pub(super) struct PartArgs {
    /// Read only the I-th of N parts of the files, and write what was found to --parts
    #[arg(long, value_name = "I/N", requires = "parts", conflicts_with_all = ["full", "takedown", "public_key", "rebuild"])]
    shard: Option<SceneShard>,
    /// Folder of the parts; without --shard, give the verdict of all of them
    #[arg(long, value_name = "FOLDER")]
    parts: Option<PathBuf>,
}

impl PartArgs {
    /// Writes a part, if one is asked for.
    pub(super) fn write(&self, dir: &Path, console: &Console) -> Result<bool, VerbError> {
        let (Some(shard), Some(folder)) = (self.shard, &self.parts) else { return Ok(false) };
        output::refuse_inside(folder, dir, "the release")?;
        let SceneShard { number, of } = shard;
        let part = AuditPart::audit(dir, number, of).map_err(|e| input::unreadable_path(dir, e))?;
        let path = folder.join(format!("part-{number}-of-{of}.json"));
        let text = serde_json::to_vec(&part).expect("a part is plain data");
        let written = fs::create_dir_all(folder).and_then(|()| output::write_whole(&path, &text));
        written.map_err(|e| output::not_written(&path, e))?;
        let (files, bytes) = part.size();
        let mb = bytes as f64 * 1e-6;
        console.note(&format!("{}: {files} files, {mb:.1} MB. --parts gives the verdict", path.display()));
        Ok(true)
    }

    /// The parts in the folder, if there is one.
    pub(super) fn read(&self) -> Result<Option<Vec<AuditPart>>, VerbError> {
        let Some(folder) = &self.parts else { return Ok(None) };
        let unread =
            |path: &Path, e: io::Error| VerbError::usage("parts", format!("{}: {e}", path.display()));
        let mut parts = Vec::new();
        for entry in fs::read_dir(folder).map_err(|e| unread(folder, e))? {
            let path = entry.map_err(|e| unread(folder, e))?.path();
            if path.extension() != Some("json".as_ref()) {
                continue;
            }
            let text = files::read(&path, MAX_DOCUMENT).map_err(|e| unread(&path, e))?;
            parts.push(serde_json::from_slice(&text).map_err(|e| unread(&path, e.into()))?);
        }
        Ok(Some(parts))
    }

    /// The message about parts that give no verdict.
    pub(super) fn refused(&self, dir: &Path, error: &PartsError) -> VerbError {
        let folder = self.parts.as_deref().unwrap_or(Path::new(".")).display();
        let dir = dir.display();
        let message = VerbError::usage("parts", format!("{folder}: {error}"));
        match error {
            PartsError::Missing { number, of } => {
                message.help(format!("gs2e audit {dir} --shard {number}/{of} --parts {folder}"))
            }
            PartsError::Empty => message.help(format!("gs2e audit {dir} --shard 1/8 --parts {folder}")),
            PartsError::Unlike { .. } => message.help("write all parts again, into an empty folder"),
        }
    }
}
