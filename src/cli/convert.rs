//! `gs2e convert`: writes a scene, or events, in another file format.

pub(super) mod events;
mod picture;

use super::console::{Console, path};
use super::message::{MessageLevel, UserMessage};
use super::output;
use super::problem::{ExitKind, VerbError};
use events::EventConversion;
use gs2e_event::file::EventFormat;
use gs2e_files as files;
use gs2e_files::write_by_rename;
use gs2e_num::units::format_amount;
use gs2e_scene as scene;
use gs2e_scene::form::{FormatLoss, SceneFormat};
use gs2e_scene::{Gaussians, SceneError, ply};
use serde_json::json;
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Arguments of `convert`.
#[derive(Debug, clap::Args)]
pub(super) struct ConvertArgs {
    /// Scene: .ply, compressed .ply, .splat, .spz, .sog, or the folder of a SOG;
    /// or events: .h5, .npz, .raw, .aedat4, .txt, .csv, .mcap
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// File to write: .ply, .spz or .splat for a scene; the formats above except .mcap, or a .png, for
    /// events
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Write the output although something is lost
    #[arg(long)]
    lossy: bool,
    #[command(flatten)]
    events: events::EventOptions,
    #[command(flatten)]
    picture: picture::PictureOptions,
}

impl ConvertArgs {
    pub(super) fn run(self, console: &Console) -> Result<ExitKind, VerbError> {
        // A picture is checked first: .png is no format of events, so the conversion would refuse
        // it.
        let drawn = self.picture.of(&self.output)?;
        if let (true, Some(format)) = (drawn, self.events.format(&self.input)) {
            return self.picture.draw((&self.input, format), &self.output, &self.events, console);
        }
        if let Some(conversion) = self.of_events()? {
            return conversion.run(console);
        }
        let form = self.form()?;
        output::screen_outputs([self.output.as_path()], [], false)?;
        let scene = self.read()?;
        let (bytes, mut losses) = form.write(&scene).map_err(|e| {
            VerbError::failed("not-written", format!("{}: failed to {e}", self.output.display()))
        })?;
        losses.extend(self.left_out());
        if !losses.is_empty() && !self.lossy {
            return Err(self.refused(&losses));
        }
        write_by_rename(&self.output, |part| File::create_new(part)?.write_all(&bytes))
            .map_err(|e| VerbError::failed("not-written", format!("{}: {e}", self.output.display())))?;
        self.tell(&scene, bytes.len(), &losses, console);
        Ok(ExitKind::Done)
    }

    /// The conversion of events, if both names are those of event files.
    fn of_events(&self) -> Result<Option<EventConversion<'_>>, VerbError> {
        let formats = [&self.input, &self.output].map(|path| self.events.format(path));
        let name = |path: &Path| path.display().to_string();
        match formats {
            [None, None] => Ok(None),
            [Some(_), Some(EventFormat::Mcap)] => refuse_usage(format!(
                "{}: a .mcap is read only; `gs2e export --to mcap` writes recordings of releases",
                name(&self.output)
            )),
            [Some(from), Some(to)] => Ok(Some(EventConversion {
                from: (&self.input, from),
                to: (&self.output, to),
                options: &self.events,
                lossy: self.lossy,
            })),
            [Some(_), None] => refuse_usage(format!(
                "{} is an event file, but {} is not",
                name(&self.input),
                name(&self.output)
            )),
            [None, Some(_)] => refuse_usage(format!(
                "{} is an event file, but {} is not",
                name(&self.output),
                name(&self.input)
            )),
        }
    }

    /// The scene format that belongs to the name of the output.
    fn form(&self) -> Result<SceneFormat, VerbError> {
        match SceneFormat::for_path(&self.output) {
            _ if self.output.is_dir() => refuse_usage(format!("{} is a folder", self.output.display())),
            Some(form) => Ok(form),
            None => refuse_usage(format!("{}: not a format that gs2e writes", self.output.display())),
        }
    }

    fn read(&self) -> Result<Gaussians, VerbError> {
        let input = self.input.display();
        // A SOG may be a folder, which cannot be opened as a file.
        if !self.input.is_dir()
            && let Err(e) = files::open(&self.input)
        {
            return Err(VerbError::usage("input-missing", format!("{input} cannot be read: {e}")));
        }
        scene::read_any(&self.input).map_err(|error| match error {
            SceneError::Content { because, .. } => {
                VerbError::failed("input-unreadable", format!("{input}: failed to {because}"))
            }
            other => VerbError::failed("input-unreadable", format!("failed to {other}")),
        })
    }

    /// The properties of the input in addition to the Gaussians.
    fn left_out(&self) -> Option<FormatLoss> {
        let mut head = Vec::new();
        let file = files::open(&self.input).ok()?;
        file.take(ply::MAX_HEADER as u64 + 1).read_to_end(&mut head).ok()?;
        // Empty for a file of another format, which has no such header.
        let names = ply::left_out(&head);
        let what = format!("dropped: {}", names.join(", "));
        (!names.is_empty()).then_some(FormatLoss { field: "other properties", what, largest: None })
    }

    fn refused(&self, losses: &[FormatLoss]) -> VerbError {
        let what = format!("{} cannot store all of the input", self.output.display());
        let message =
            UserMessage::new(MessageLevel::Error, "lossy", what).help("pass --lossy to write it anyway");
        let message =
            losses.iter().fold(message, |m, loss| m.detail(format!("{}: {}", loss.field, loss.what)));
        VerbError::from_message(ExitKind::Usage, message)
    }

    fn tell(&self, scene: &Gaussians, bytes: usize, losses: &[FormatLoss], console: &Console) {
        let (screening, written) = (scene.screening, scene.len());
        let output = self.output.display();
        console.say(&format!("{output}: {written} Gaussians, {}", format_amount(bytes as u64, "B")));
        if screening.non_finite > 0 {
            console.say(&format!("dropped {} with a NaN or an infinity", screening.non_finite));
        }
        losses.iter().for_each(|loss| console.say(&format!("{}: {}", loss.field, loss.what)));
        if console.json {
            console.result(&json!({
                "input": path(&self.input), "output": path(&self.output), "read": screening.read,
                "dropped": screening.non_finite, "written": written, "bytes": bytes, "lost": losses,
            }));
        }
    }
}

fn refuse_usage<T>(what: String) -> Result<T, VerbError> {
    let scenes =
        "scenes read: .ply, compressed .ply, .splat, .spz, .sog or a SOG folder; written: .ply, .spz, .splat";
    Err(VerbError::usage("format", what).help(&format!("{scenes}; {}", events::SUPPORTED)))
}
