//! A trainer as a recipe names it, and one training.

use super::argument::Argument;
use super::layout::{LayoutError, lay_out};
use super::trained::{self, Count};
use crate::programs::{self, Ended, Failed, How, Invocation, Programs, quoted};
use crate::scene::Gaussians;
use crate::source::Capture;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// A program, and how it is run. What enters the key of a training is what is serialised: no path is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Command {
    /// A name that is looked for in the absolute folders of `PATH`, or one of `files`.
    pub program: Argument,
    /// What it is started with.
    pub arguments: Vec<Argument>,
    /// Which version it is.
    pub version: String,
    /// Variables of its environment, beside those that this program was started with.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub environment: BTreeMap<String, String>,
    /// Where below `{out}` it leaves the scene; else the newest of a 3DGS model folder is taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// It is not given every `n`th view, the first of them included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hold_out: Option<u32>,
    /// How many Gaussians it has to bring.
    #[serde(skip_serializing_if = "Count::is_any")]
    pub gaussians: Count,
    /// Mean PSNR, dB, that its scene has to have where views are held out, for it to be kept. What was kept is judged by the
    /// check `recon_psnr`: a limit that is raised trains nothing again.
    #[serde(skip)]
    pub min_psnr: f64,
    /// What it is started with to say its version, where it does.
    #[serde(skip)]
    pub probe: Option<Vec<Argument>>,
    /// Files that arguments name: their content enters the key, as sources do.
    #[serde(skip)]
    pub files: BTreeMap<String, PathBuf>,
    /// SPDX expression of its terms.
    #[serde(skip)]
    pub licence: String,
    /// Training iterations, where the recipe says how many.
    #[serde(skip)]
    pub iterations: Option<u64>,
}

/// Names of the places in arguments that each training fills, beside those of files.
#[derive(Debug)]
pub struct Places;

impl Places {
    /// The capture: a folder with `images` and `sparse/0`.
    pub const CAPTURE: &'static str = "capture";
    /// The photos.
    pub const IMAGES: &'static str = "images";
    /// An empty folder for what it makes.
    pub const OUT: &'static str = "out";
    /// All of them.
    pub const ALL: [&'static str; 3] = [Self::CAPTURE, Self::IMAGES, Self::OUT];
}

/// Where a training happens.
#[derive(Clone, Copy)]
pub struct Desk<'a> {
    /// An empty folder. Nothing in it is needed afterwards.
    pub folder: &'a Path,
    /// The file for what the program says; one that is there is written over.
    pub log: &'a Path,
    /// Asked again and again; where it says no the program is stopped.
    pub goes_on: &'a (dyn Fn() -> bool + Sync),
    /// The programs that can be run.
    pub programs: &'a Programs,
}

impl std::fmt::Debug for Desk<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Desk").field("folder", &self.folder).field("log", &self.log).finish_non_exhaustive()
    }
}

/// What a training brought.
#[derive(Debug)]
pub struct Trained {
    /// The scene.
    pub gaussians: Gaussians,
    /// Views that it could not be given: their photos are not there.
    pub without_photo: usize,
}

/// Why a training brought nothing.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// It was asked to stop.
    #[error("finish: it was interrupted")]
    Stopped,
    /// The program failed.
    #[error(transparent)]
    Failed(#[from] Box<Failed>),
    /// It could not be given the capture.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// A folder or the log cannot be written.
    #[error("use {}: {cause}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Cause.
        cause: io::Error,
    },
}

impl Command {
    /// The PSNR of plain grey against a picture in which all greys are equally frequent: `10 log10(12)`. A scene below it
    /// shows less than nothing of its photos, as one does whose world was moved.
    pub const MIN_PSNR_DB: f64 = 10.79;

    /// The program's name: that of its file, where it is one of `files`.
    #[must_use]
    pub fn name(&self) -> String {
        let filled = PathBuf::from(self.program.fill(&self.places()));
        let last = filled.file_name().unwrap_or(filled.as_os_str());
        last.to_string_lossy().into_owned()
    }

    /// The training as the recipe has it, with its places in braces: no path is in it.
    #[must_use]
    pub fn written(&self) -> String {
        let words = std::iter::once(&self.program).chain(&self.arguments);
        let words: Vec<PathBuf> = words.map(|word| PathBuf::from(word.to_string())).collect();
        quoted(words.iter().map(PathBuf::as_path))
    }

    /// What would be run, a command a line, as a person may type it, the places of a training left open.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let (open, folder) = (self.places(), Path::new(""));
        let probe = self.probe.iter().map(|probe| self.invocation(probe, &open, folder).to_text());
        probe.chain([self.invocation(&self.arguments, &open, folder).to_text()]).collect()
    }

    /// Trains a scene. `files` are those of the capture's source, by their names in it.
    ///
    /// # Errors
    /// Where the capture cannot be laid out, the program fails or is not the version that it should be, or what it makes
    /// cannot be used.
    pub fn train(
        &self,
        capture: &Capture,
        files: &[(String, PathBuf)],
        desk: Desk<'_>,
    ) -> Result<Trained, TrainError> {
        let io = |path: &Path| {
            let path = path.to_owned();
            move |cause| TrainError::Io { path, cause }
        };
        std::fs::write(desk.log, "").map_err(io(desk.log))?;
        // The program works elsewhere.
        let root = std::path::absolute(desk.folder).map_err(io(desk.folder))?;
        let [given, out, work] = ["capture", "out", "work"].map(|name| root.join(name));
        for folder in [&out, &work] {
            std::fs::create_dir_all(folder).map_err(io(folder))?;
        }
        let places = self.places();
        if let Some(probe) = &self.probe {
            self.ask_version(&self.invocation(probe, &places, &work), desk)?;
        }
        let laid = lay_out(capture, files, self.hold_out, &given, desk.goes_on)?;
        let images = given.join("images");
        let own = Places::ALL.into_iter().zip([given, images, out.clone()]);
        let invocation = self.invocation(&self.arguments, &places.into_iter().chain(own).collect(), &work);
        let from = self.run(&invocation, desk)?;
        let gaussians = trained::read(&out, self.scene.as_deref(), self.gaussians);
        let gaussians =
            gaussians.map_err(|e| self.failed(&invocation, How::Product(e.to_string()), desk, from))?;
        Ok(Trained { gaussians, without_photo: laid.without_photo })
    }

    /// The places of files.
    fn places(&self) -> BTreeMap<&str, PathBuf> {
        let whole = |path: &PathBuf| std::path::absolute(path).unwrap_or_else(|_| path.clone());
        self.files.iter().map(|(name, path)| (name.as_str(), whole(path))).collect()
    }

    fn invocation(
        &self,
        arguments: &[Argument],
        places: &BTreeMap<&str, PathBuf>,
        folder: &Path,
    ) -> Invocation {
        Invocation {
            program: self.program.fill(places).into(),
            arguments: arguments.iter().map(|argument| argument.fill(places)).collect(),
            environment: self.environment.clone(),
            folder: folder.to_owned(),
        }
    }

    /// Runs it to its end; where in the log what it says begins.
    fn run(&self, invocation: &Invocation, desk: Desk<'_>) -> Result<u64, TrainError> {
        let from = programs::length(desk.log);
        match programs::run(desk.programs, invocation, desk.log, desk.goes_on) {
            Ok(()) => Ok(from),
            Err(Ended::Stopped) => Err(TrainError::Stopped),
            Err(Ended::Failed(how)) => Err(self.failed(invocation, how, desk, from).into()),
        }
    }

    /// Has the program say its version, which must be the one that the key holds.
    fn ask_version(&self, invocation: &Invocation, desk: Desk<'_>) -> Result<(), TrainError> {
        let from = self.run(invocation, desk)?;
        if programs::says(desk.log, from, &self.version) {
            return Ok(());
        }
        Err(self.failed(invocation, How::Version(self.version.clone()), desk, from).into())
    }

    fn failed(&self, invocation: &Invocation, how: How, desk: Desk<'_>, from: u64) -> Box<Failed> {
        Box::new(Failed {
            program: self.name(),
            command: invocation.to_text(),
            how,
            last: programs::last_lines(desk.log, from),
            log: desk.log.to_owned(),
        })
    }
}
