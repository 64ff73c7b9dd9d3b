//! `gs2e convert`: a scene in another file format.

use super::console::Console;
use super::message::{Level, Message};
use super::problem::{Exit, Problem};
use crate::scene::form::{Form, Loss};
use crate::scene::{self, Gaussians, SceneError, ply};
use crate::units::amount;
use serde_json::json;
use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Arguments of `convert`.
#[derive(Debug, clap::Args)]
pub(super) struct Convert {
    /// Scene: .ply, compressed .ply, .splat, .spz, .sog, or the folder of a SOG
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// File to write: .ply, .spz or .splat
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Write it although something is lost
    #[arg(long)]
    lossy: bool,
}

/// What the names of event files end with.
const EVENTS: [&str; 9] = ["h5", "hdf5", "npz", "raw", "aedat4", "aedat", "txt", "csv", "bin"];

impl Convert {
    pub(super) fn run(self, console: &Console) -> Result<Exit, Problem> {
        let form = self.form()?;
        let scene = self.read()?;
        let (bytes, mut losses) = form.write(&scene).map_err(|e| {
            Problem::failed("not-written", format!("{}: failed to {e}", self.output.display()))
        })?;
        losses.extend(self.left_out());
        if !losses.is_empty() && !self.lossy {
            return Err(self.refused(&losses));
        }
        write_beside(&self.output, &bytes)
            .map_err(|e| Problem::failed("not-written", format!("{}: {e}", self.output.display())))?;
        self.tell(&scene, bytes.len(), &losses, console);
        Ok(Exit::Done)
    }

    /// The form that the output's name asks for, unless one of the names is of no scene.
    fn form(&self) -> Result<Form, Problem> {
        let of_events = |path: &Path| {
            EVENTS.iter().any(|known| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(known)))
        };
        let refuse = |what: String| Err(Problem::usage("format", what).help(SUPPORTED));
        if let Some(path) = [&self.input, &self.output].into_iter().find(|path| of_events(path)) {
            return refuse(format!("{}: only scenes are converted", path.display()));
        }
        match Form::of(&self.output) {
            _ if self.output.is_dir() => refuse(format!("{} is a folder", self.output.display())),
            Some(form) => Ok(form),
            None => {
                refuse(format!("{}: its name ends with no format that is written", self.output.display()))
            }
        }
    }

    fn read(&self) -> Result<Gaussians, Problem> {
        let input = self.input.display();
        if let Err(e) = fs::metadata(&self.input) {
            return Err(Problem::usage("input-missing", format!("{input} cannot be read: {e}")));
        }
        scene::read_any(&self.input).map_err(|error| match error {
            SceneError::Content { because, .. } => {
                Problem::failed("input-unreadable", format!("{input}: failed to {because}"))
            }
            other => Problem::failed("input-unreadable", format!("failed to {other}")),
        })
    }

    /// What the input holds beside the Gaussians.
    fn left_out(&self) -> Option<Loss> {
        let mut head = Vec::new();
        let file = File::open(&self.input).ok()?;
        file.take(ply::MAX_HEADER as u64 + 1).read_to_end(&mut head).ok()?;
        let names = ply::left_out(&head);
        let what = format!("dropped: {}", names.join(", "));
        (!names.is_empty()).then_some(Loss { field: "other properties", what, largest: None })
    }

    fn refused(&self, losses: &[Loss]) -> Problem {
        let what = format!("{} would lose something", self.output.display());
        let message = Message::new(Level::Error, "lossy", what).help("--lossy writes it all the same");
        let told = losses.iter().fold(message, |m, loss| m.detail(format!("{}: {}", loss.field, loss.what)));
        Problem::of(Exit::Usage, told)
    }

    fn tell(&self, scene: &Gaussians, bytes: usize, losses: &[Loss], console: &Console) {
        let (screening, written) = (scene.screening, scene.len());
        let output = self.output.display();
        console.say(&format!("{output}: {written} Gaussians, {}", amount(bytes as u64, "B")));
        if screening.non_finite > 0 {
            console.say(&format!("dropped {}: a NaN or an infinity in them", screening.non_finite));
        }
        losses.iter().for_each(|loss| console.say(&format!("{}: {}", loss.field, loss.what)));
        if console.json {
            console.result(&json!({
                "input": self.input, "output": self.output, "read": screening.read,
                "dropped": screening.non_finite, "written": written, "bytes": bytes, "lost": losses,
            }));
        }
    }
}

const SUPPORTED: &str =
    "read: .ply, compressed .ply, .splat, .spz, .sog or the folder of a SOG; written: .ply, .spz, .splat";

/// Writes a file whole or not at all: beside its place, then into it.
fn write_beside(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let beside = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let written = File::create_new(&beside)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        // The first error is the one to tell.
        let _ = fs::remove_file(&beside);
    }
    written
}
