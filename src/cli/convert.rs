//! `gs2e convert`: writes a scene, or events, in another file format.

pub(super) mod events;
mod picture;

use super::{Console, ExitKind, VerbError, output, path};
use events::{EventConversion, InputEvents};
use gs2e_event::file::EventFormat;
use gs2e_files as files;
use gs2e_num::units::format_amount;
use gs2e_scene::form::{FormatLoss, SceneFormat};
use gs2e_scene::{self as scene, Gaussians, SceneError, ply};
use serde_json::json;
use std::io::Read as _;
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
            let events = InputEvents { path: &self.input, format, options: &self.events };
            return self.picture.draw(&events, &self.output, console);
        }
        if let Some(conversion) = self.of_events()? {
            return conversion.run(console);
        }
        let form = self.form()?;
        output::screen_outputs([self.output.as_path()], [], false)?;
        let scene = self.read()?;
        let written = form.write(&scene);
        let (bytes, mut losses) =
            written.map_err(|e| output::not_written(&self.output, format_args!("failed to {e}")))?;
        losses.extend(self.left_out());
        if !losses.is_empty() && !self.lossy {
            return Err(refuse_losses(&self.output, losses.iter().map(loss_words)));
        }
        output::write_whole(&self.output, &bytes).map_err(|e| output::not_written(&self.output, e))?;
        self.report(&scene, bytes.len(), &losses, console);
        Ok(ExitKind::Done)
    }

    /// The conversion of events, if both names are those of event files.
    fn of_events(&self) -> Result<Option<EventConversion<'_>>, VerbError> {
        let formats = [&self.input, &self.output].map(|path| self.events.format(path));
        let [input, output] = [&self.input, &self.output].map(|path| path.display());
        match formats {
            [None, None] => Ok(None),
            [Some(_), Some(EventFormat::Mcap | EventFormat::Bag)] => refuse_usage(format!(
                "{output}: recordings are read only; `gs2e export --to mcap` writes those of releases"
            )),
            [Some(format), Some(to)] => Ok(Some(EventConversion {
                from: InputEvents { path: &self.input, format, options: &self.events },
                output: &self.output,
                to,
                lossy: self.lossy,
            })),
            [Some(_), None] => refuse_usage(format!("{input} is an event file, but {output} is not")),
            [None, Some(_)] => refuse_usage(format!("{output} is an event file, but {input} is not")),
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
        scene::read_any(&self.input).map_err(|error| {
            let said = match error {
                SceneError::Content { because, .. } => format!("{input}: failed to {because}"),
                other => format!("failed to {other}"),
            };
            VerbError::failed("input-unreadable", said)
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

    fn report(&self, scene: &Gaussians, bytes: usize, losses: &[FormatLoss], console: &Console) {
        let (screening, written) = (scene.screening, scene.len());
        let output = self.output.display();
        console.note(&format!("{output}: {written} Gaussians, {}", format_amount(bytes as u64, "B")));
        if screening.non_finite > 0 {
            console.note(&format!("dropped {} with a NaN or an infinity", screening.non_finite));
        }
        losses.iter().for_each(|loss| console.note(&loss_words(loss)));
        console.result(&json!({
            "input": path(&self.input), "output": path(&self.output), "read": screening.read,
            "dropped": screening.non_finite, "written": written, "bytes": bytes, "lost": losses,
        }));
    }
}

fn loss_words(loss: &FormatLoss) -> String {
    format!("{}: {}", loss.field, loss.what)
}

/// The error for an output that cannot hold everything.
fn refuse_losses(output: &Path, losses: impl Iterator<Item = String>) -> VerbError {
    VerbError::usage("lossy", format!("{} cannot store all of the input", output.display()))
        .details(losses)
        .help("pass --lossy to write it anyway")
}

fn refuse_usage<T>(what: String) -> Result<T, VerbError> {
    let scenes =
        "scenes read: .ply, compressed .ply, .splat, .spz, .sog or a SOG folder; written: .ply, .spz, .splat";
    Err(VerbError::usage("format", what).help(format!("{scenes}; {}", events::SUPPORTED)))
}
