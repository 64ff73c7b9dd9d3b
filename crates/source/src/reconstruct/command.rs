//! A trainer as named by a recipe, and the execution of one training.

use super::argument::ArgumentTemplate;
use super::layout::{LayoutError, lay_out};
use super::trained::{self, GaussianCount};
use crate::Capture;
use gs2e_files::programs::{EndKind, ProgramCall, ProgramEnd, ProgramFailure, ProgramFinder, quoted};
use gs2e_files::{PathError, programs};
use gs2e_scene::Gaussians;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A program and its settings. The serialised fields enter the key of a training; paths do not.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainerCommand {
    /// A name that is looked for in the absolute folders of `PATH`, or one of `files`.
    pub program: ArgumentTemplate,
    /// Its arguments.
    pub arguments: Vec<ArgumentTemplate>,
    /// Its version.
    pub version: String,
    /// Additional environment variables.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub environment: BTreeMap<String, String>,
    /// Path of the resulting scene below `{out}`. By default, the newest scene of a 3DGS model
    /// folder is used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// Every `n`th view is held out from training, starting with the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hold_out: Option<u32>,
    /// Accepted number of Gaussians.
    #[serde(skip_serializing_if = "GaussianCount::is_any")]
    pub gaussians: GaussianCount,
    /// Minimum mean PSNR on held-out views, dB, for the scene to be kept. The check `recon_psnr`
    /// judges a kept scene, so a raised limit does not train it again.
    #[serde(skip)]
    pub min_psnr: f64,
    /// Arguments that make the program print its version, if it can.
    #[serde(skip)]
    pub probe: Option<Vec<ArgumentTemplate>>,
    /// Files that arguments refer to. Their content enters the key, like that of sources.
    #[serde(skip)]
    pub files: BTreeMap<String, PathBuf>,
    /// SPDX expression of its terms.
    #[serde(skip)]
    pub licence: String,
    /// Number of training iterations, if the recipe states it.
    #[serde(skip)]
    pub iterations: Option<u64>,
}

/// Names of the placeholders that each training fills, in addition to those of files.
#[derive(Debug)]
pub struct ArgumentPlaces;

impl ArgumentPlaces {
    /// The capture: a folder with `images` and `sparse/0`.
    pub const CAPTURE: &'static str = "capture";
    /// The folder of the photos.
    pub const IMAGES: &'static str = "images";
    /// An empty folder for the results.
    pub const OUT: &'static str = "out";
    /// All names.
    pub const ALL: [&'static str; 3] = [Self::CAPTURE, Self::IMAGES, Self::OUT];
}

/// Folder, log and stop signal of a run of programs.
#[derive(Clone, Copy)]
pub struct ProgramWorkspace<'a> {
    /// An empty folder. Its content is not needed afterwards.
    pub folder: &'a Path,
    /// The log file of the program's output. An existing file is overwritten.
    pub log: &'a Path,
    /// Polled during the run. The program is stopped when it returns false.
    pub goes_on: &'a (dyn Fn() -> bool + Sync),
    /// The programs that can be run.
    pub programs: &'a ProgramFinder,
}

impl std::fmt::Debug for ProgramWorkspace<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ProgramWorkspace")
            .field("folder", &self.folder)
            .field("log", &self.log)
            .finish_non_exhaustive()
    }
}

/// The result of a training.
#[derive(Debug)]
pub struct TrainedScene {
    /// The scene.
    pub gaussians: Gaussians,
    /// Number of views without a photo, which could not be used.
    pub without_photo: usize,
}

/// The reason why a training failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The training was asked to stop.
    #[error("finish: it was interrupted")]
    Stopped,
    /// The program failed.
    #[error(transparent)]
    Failed(#[from] Box<ProgramFailure>),
    /// The capture could not be prepared.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// A folder or the log cannot be written.
    #[error("use {0}")]
    Io(#[from] PathError),
}

impl TrainerCommand {
    /// PSNR of plain grey against a picture with a uniform distribution of greys: `10 log10(12)`. A
    /// scene below this value is worse than plain grey, for example because its world was moved.
    pub const MIN_PSNR_DB: f64 = 10.79;

    /// Returns the program's name, which is its file name if it is one of `files`.
    #[must_use]
    pub fn name(&self) -> String {
        let filled = PathBuf::from(self.program.fill(&self.places()));
        let last = filled.file_name().unwrap_or(filled.as_os_str());
        last.to_string_lossy().into_owned()
    }

    /// Returns the command as the recipe has it, with placeholders in braces and without paths.
    #[must_use]
    pub fn written(&self) -> String {
        let words = std::iter::once(&self.program).chain(&self.arguments);
        let words: Vec<PathBuf> = words.map(|word| PathBuf::from(word.to_string())).collect();
        quoted(words.iter().map(PathBuf::as_path))
    }

    /// Returns the commands of a training, one per line, as a person could type them. Placeholders
    /// of a training stay open.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let (open, folder) = (self.places(), Path::new(""));
        let probe = self.probe.iter().map(|probe| self.invocation(probe, &open, folder).to_text());
        probe.chain([self.invocation(&self.arguments, &open, folder).to_text()]).collect()
    }

    /// Trains a scene. `files` are the files of the capture's source, by their names in the source.
    ///
    /// # Errors
    /// The capture cannot be prepared, the program fails or has the wrong version, or its result
    /// cannot be used.
    pub fn train(
        &self,
        capture: &Capture,
        files: &[(String, PathBuf)],
        workspace: ProgramWorkspace<'_>,
    ) -> Result<TrainedScene, TrainError> {
        let io = |path: &Path| {
            let path = path.to_owned();
            move |source| PathError::new(path, source)
        };
        // Both commands of a training append to the log, so an old log is emptied first.
        std::fs::write(workspace.log, "").map_err(io(workspace.log))?;
        // The program runs in another working folder.
        let root = std::path::absolute(workspace.folder).map_err(io(workspace.folder))?;
        let [given, out, work] = ["capture", "out", "work"].map(|name| root.join(name));
        for folder in [&out, &work] {
            std::fs::create_dir_all(folder).map_err(io(folder))?;
        }
        let places = self.places();
        // A wrong version must stop the training before the capture is copied.
        if let Some(probe) = &self.probe {
            self.ask_version(&self.invocation(probe, &places, &work), workspace)?;
        }
        let laid = lay_out(capture, files, self.hold_out, &given, workspace.goes_on)?;
        let images = given.join("images");
        let own = ArgumentPlaces::ALL.into_iter().zip([given, images, out.clone()]);
        let invocation = self.invocation(&self.arguments, &places.into_iter().chain(own).collect(), &work);
        let from = self.run(&invocation, workspace)?;
        let gaussians = trained::read_trained(&out, self.scene.as_deref(), self.gaussians);
        let gaussians = gaussians
            .map_err(|e| self.failed(&invocation, EndKind::Product(e.to_string()), workspace, from))?;
        Ok(TrainedScene { gaussians, without_photo: laid.without_photo })
    }

    /// Returns the values of the placeholders of files.
    fn places(&self) -> BTreeMap<&str, PathBuf> {
        // The program runs in another working folder, so its paths must be absolute.
        let whole = |path: &PathBuf| std::path::absolute(path).unwrap_or_else(|_| path.clone());
        self.files.iter().map(|(name, path)| (name.as_str(), whole(path))).collect()
    }

    fn invocation(
        &self,
        arguments: &[ArgumentTemplate],
        places: &BTreeMap<&str, PathBuf>,
        folder: &Path,
    ) -> ProgramCall {
        ProgramCall {
            program: self.program.fill(places).into(),
            arguments: arguments.iter().map(|argument| argument.fill(places)).collect(),
            environment: self.environment.clone(),
            folder: folder.to_owned(),
        }
    }

    /// Runs a command to its end. Returns the offset of its output in the log.
    fn run(&self, invocation: &ProgramCall, workspace: ProgramWorkspace<'_>) -> Result<u64, TrainError> {
        let from = programs::length(workspace.log);
        match programs::run(workspace.programs, invocation, workspace.log, workspace.goes_on) {
            Ok(()) => Ok(from),
            Err(ProgramEnd::Stopped) => Err(TrainError::Stopped),
            Err(ProgramEnd::Failed(how)) => Err(self.failed(invocation, how, workspace, from).into()),
        }
    }

    /// Runs the version command. The output must contain the version in the key.
    fn ask_version(
        &self,
        invocation: &ProgramCall,
        workspace: ProgramWorkspace<'_>,
    ) -> Result<(), TrainError> {
        let from = self.run(invocation, workspace)?;
        if programs::says(workspace.log, from, &self.version) {
            return Ok(());
        }
        Err(self.failed(invocation, EndKind::Version(self.version.clone()), workspace, from).into())
    }

    fn failed(
        &self,
        invocation: &ProgramCall,
        how: EndKind,
        workspace: ProgramWorkspace<'_>,
        from: u64,
    ) -> Box<ProgramFailure> {
        Box::new(ProgramFailure {
            program: self.name(),
            command: invocation.to_text(),
            how,
            last: programs::last_lines(workspace.log, from),
            log: workspace.log.to_owned(),
        })
    }
}
