//! Stages: the kinds of steps. A stage holds its parameters, names its inputs, and calls the module
//! that does the work.
//!
//! The fields of a stage are its parameters: nothing else of a recipe can enter its key. Fields
//! that must not enter it (paths, a back end that the class already names) are skipped in the
//! serialisation. A stage contains no arithmetic.

pub mod blur;
pub mod capture;
pub mod checks;
pub mod events;
pub mod fidelity;
pub mod foreign;
pub mod frames;
pub mod geometry;
pub mod poses;
pub mod reconstruct;
pub mod scene_checks;
pub mod sharp;
pub mod shot;
mod target;
pub mod trajectory;

pub use target::{StageInputs, StepTarget};

use crate::artifact::{Artifact, ArtifactError, ArtifactFiles};
use crate::camera::{self, Camera, CameraChoice};
use crate::frames::rendered::TimeSaved;
use crate::image::Size;
use crate::programs::{ProgramFailure, ProgramFinder};
use crate::reconstruct::TrainingWorkspace;
use crate::render::backend::Backend;
use crate::source::Capture;
use crate::store::Digest;
use crate::store::description::{DescribedValue, describe_value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Index of a step in its plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct StepId(pub usize);

/// A file outside the store that a stage reads.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceFile {
    /// Name within the source; it enters the key.
    pub name: String,
    /// Path; it does not enter the key.
    pub path: PathBuf,
}

/// A stage: parameters, inputs, and the making of its product.
pub trait Stage: serde::Serialize {
    /// Its name.
    const NAME: &'static str;

    /// Revision. Raise it when the same parameters and inputs give other bytes.
    const REVISION: u32;

    /// Parameters that were added after the first revision: their place among the parameters, and
    /// the text of the value that they had implicitly until then. A parameter with this value stays
    /// out of the key, so adding one changes no key, and a later change of the default changes only
    /// the keys that rely on it. Entries never change.
    const ADDED: &'static [(&'static str, &'static str)] = &[];

    /// Inputs from other steps.
    type Inputs: StageInputs;

    /// The product.
    type Output: Artifact;

    /// The numerical class, for stages whose bytes depend on the machine that computes them.
    fn class(&self) -> Option<String> {
        None
    }

    /// The files outside the store that the stage reads, in a stable order.
    ///
    /// # Errors
    /// A source cannot be listed.
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        Ok(Vec::new())
    }

    /// The existing folders whose content decides which files [`Stage::sources`] returns.
    fn source_folders(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Resources needed, by the sizes of the inputs. `files` are those of the present inputs, in
    /// order.
    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        StepNeed::for_parts([small_stage_memory(files)])
    }

    /// The programs that the stage would run, one command per line, as typed in a shell.
    fn programs(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns true if the stage runs programs that need no permission, because no recipe names
    /// them. Their output is kept too.
    fn runs_known_programs(&self) -> bool {
        false
    }

    /// A program whose version the class lacks. The program was not asked, so the key is not known.
    fn unasked(&self) -> Option<&'static str> {
        None
    }

    /// Writes the product's files into `cx.out`.
    ///
    /// # Errors
    /// The work fails, or was cancelled.
    fn run(
        &self,
        inputs: <Self::Inputs as StageInputs>::Opened,
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError>;
}

/// Resources of a step other than cores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepNeed {
    /// Peak memory, bytes; an estimate.
    pub memory: u64,
    /// True if the step renders on a GPU.
    pub gpu: bool,
}

impl StepNeed {
    /// Memory for these parts plus the base of every step, bytes.
    #[must_use]
    pub fn for_parts(parts: impl IntoIterator<Item = u64>) -> Self {
        /// Base: the program itself with its buffers, stacks and tables.
        const BASE: u64 = 24 << 20;
        Self { memory: parts.into_iter().fold(BASE, u64::saturating_add), gpu: false }
    }
}

/// Factor on the bytes of the inputs that a small stage holds.
fn small_stage_memory(files: &[ArtifactFiles]) -> u64 {
    const COPIES: u64 = 4;
    COPIES * files.iter().map(ArtifactFiles::bytes).sum::<u64>()
}

/// Resources of a stage that renders: the renderer, and `others` bytes per pixel of its own. The
/// first input is the capture; if it cannot be read, the number of pixels is unknown, and the stage
/// will not run. The second input is the scene.
fn rendering_need(
    backend: &Backend,
    choice: Option<CameraChoice>,
    files: &[ArtifactFiles],
    others: u64,
) -> StepNeed {
    let capture = files.first().and_then(|capture| Capture::open(capture).ok());
    let own = |capture: Capture| capture.camera().map(|(own, _)| own);
    let camera = capture.and_then(|capture| camera::choose_camera(choice, own(capture).as_ref()));
    let size = camera.map(|camera| camera.size);
    let scene = files.get(1).map_or(0, ArtifactFiles::bytes);
    let own = |size: Size| u64::from(size.width) * u64::from(size.height) * others;
    let need =
        StepNeed::for_parts(size.into_iter().flat_map(|size| [backend.memory(scene, size), own(size)]));
    StepNeed { gpu: backend.takes_gpu(), ..need }
}

/// Facilities for a running stage.
#[derive(Debug)]
pub struct StageContext<'a> {
    /// Empty folder for its files.
    pub out: &'a Path,
    cancel: &'a AtomicBool,
    /// Warnings.
    pub warnings: Vec<String>,
    /// A short remark on the size of the product, for the progress line.
    pub remark: Option<String>,
    /// A clock in seconds, for reports on the work that enter no product.
    pub clock: Option<fn() -> f64>,
    /// Time saved by leaving work out, if it was measured.
    pub saving: Option<TimeSaved>,
    /// True if programs named by a recipe may be run.
    pub allows_commands: bool,
    /// Destination of the log of external programs. During the run it lies next to the product's
    /// files.
    pub log: Option<PathBuf>,
    /// The programs that can be run.
    pub programs: ProgramFinder,
    /// The receiver of progress within the step, if anything shows it.
    pub progress: Option<StepProgress<'a>>,
    /// A folder that outlives an interrupted step, and that only a step with the same key gets. It is
    /// removed when the step is made.
    pub resume: Option<PathBuf>,
}

/// The receiver of a step's progress.
#[derive(Clone, Copy)]
pub struct StepProgress<'a>(pub &'a (dyn Fn(&str) + Sync));

impl StepProgress<'_> {
    /// Passes on the state of the step, in words for people.
    pub fn tell(&self, words: &str) {
        (self.0)(words);
    }
}

impl std::fmt::Debug for StepProgress<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("StepProgress").finish_non_exhaustive()
    }
}

impl<'a> StageContext<'a> {
    /// A context that writes to `out` and stops when `cancel` is set.
    #[must_use]
    pub fn new(out: &'a Path, cancel: &'a AtomicBool) -> Self {
        let (warnings, remark, clock, saving) = (Vec::new(), None, None, None);
        let programs = ProgramFinder::default();
        Self {
            out,
            cancel,
            warnings,
            remark,
            clock,
            saving,
            allows_commands: false,
            log: None,
            programs,
            progress: None,
            resume: None,
        }
    }

    /// The file that keeps the state of a step that is interrupted, in a folder that exists; `None`
    /// if the run keeps none.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn resumable(&self) -> Result<Option<PathBuf>, StageError> {
        let Some(folder) = &self.resume else { return Ok(None) };
        std::fs::create_dir_all(folder).map_err(StageError::io_error(folder))?;
        Ok(Some(folder.join("state")))
    }

    /// Returns true if the work has been cancelled.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        // Only the flag matters: no other data is published with it.
        self.cancel.load(Ordering::Relaxed)
    }

    /// Called at every frame or chunk. Returns an error if the work has been cancelled.
    ///
    /// # Errors
    /// [`StageError::Cancelled`].
    pub fn go_on(&self) -> Result<(), StageError> {
        if self.is_cancelled() { Err(StageError::Cancelled) } else { Ok(()) }
    }
}

/// Runs programs that no recipe names in a separate folder that is not part of the product. `name` is
/// unused in the step's folder.
fn known_program<T, E>(
    name: &str,
    cx: &StageContext<'_>,
    run: impl FnOnce(TrainingWorkspace<'_>) -> Result<T, E>,
    failure: impl FnOnce(E) -> StageError,
) -> Result<T, StageError> {
    cx.go_on()?;
    // Programs work in the root folder, so their paths are absolute.
    let folder = std::path::absolute(cx.out.join(name)).map_err(StageError::io_error(cx.out))?;
    std::fs::create_dir(&folder).map_err(StageError::io_error(&folder))?;
    let log = cx.log.clone().unwrap_or_else(|| folder.join("log.txt"));
    let desk = TrainingWorkspace {
        folder: &folder,
        log: &log,
        goes_on: &|| !cx.is_cancelled(),
        programs: &cx.programs,
    };
    let made = run(desk).map_err(failure)?;
    // Everything that stays below `out` becomes part of the product.
    std::fs::remove_dir_all(&folder).map_err(StageError::io_error(&folder))?;
    Ok(made)
}

/// The camera of a trajectory: the recipe's choice, otherwise the source's own, with a warning if
/// views disagree.
fn choose_camera(choice: Option<CameraChoice>, capture: &Capture, cx: &mut StageContext<'_>) -> Camera {
    let (own, warning) = capture.camera().unzip();
    cx.warnings.extend(warning.flatten().map(|w| w.to_string()));
    camera::choose_camera(choice, own.as_ref()).expect("recipes without views write a whole camera")
}

/// The reason why a step failed. The texts complete the phrase "failed to ".
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// The step was cancelled.
    #[error("finish: it was interrupted")]
    Cancelled,
    /// A source does not exist.
    #[error("find {}", path.display())]
    Missing {
        /// Its path.
        path: PathBuf,
    },
    /// An input cannot be opened.
    #[error(transparent)]
    Artifact(#[from] ArtifactError),
    /// The step would run programs without permission.
    #[error("run a program that the recipe names: not allowed")]
    Refused {
        /// The commands, one per line.
        programs: Vec<String>,
    },
    /// A program failed.
    #[error(transparent)]
    Program(Box<ProgramFailure>),
    /// The work failed.
    #[error("{doing}: {cause}")]
    Work {
        /// The operation.
        doing: String,
        /// The reason.
        #[source]
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A file cannot be read or written.
    #[error("use {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
}

impl StageError {
    /// A failure of the work, shown as `doing: cause`.
    pub fn work_failed<E>(doing: &str) -> impl FnOnce(E) -> Self
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        let doing = doing.to_owned();
        move |e| Self::Work { doing, cause: Box::new(e) }
    }

    /// A failure to use a file.
    pub fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}

/// A stage with its inputs.
#[derive(Debug)]
pub struct WiredStage<S: Stage> {
    /// Parameters.
    pub stage: S,
    /// Sources of its inputs.
    pub inputs: S::Inputs,
}

/// A wired stage with its types erased.
pub trait AnyStep: std::fmt::Debug + Send + Sync {
    /// Name of the stage.
    fn stage(&self) -> &'static str;

    /// Role and step of each input.
    fn inputs(&self) -> Vec<(&'static str, StepId)>;

    /// The numerical class, for stages whose bytes depend on the machine that computes them.
    fn class(&self) -> Option<String>;

    /// Files outside the store that the stage reads.
    ///
    /// # Errors
    /// A source cannot be listed.
    fn sources(&self) -> Result<Vec<SourceFile>, StageError>;

    /// Folders whose content decides which files those are.
    fn source_folders(&self) -> Vec<PathBuf>;

    /// The content of the key: the stage, its revision and class, its parameters, and the digests
    /// of its inputs by role.
    fn describe(&self, inputs: &[(String, Digest)]) -> DescribedValue;

    /// Resources needed, by the sizes of the inputs.
    fn need(&self, inputs: &[ArtifactFiles]) -> StepNeed;

    /// The programs that the stage would run, one command per line.
    fn programs(&self) -> Vec<String>;

    /// Returns true if the stage runs programs that need no permission.
    fn runs_known_programs(&self) -> bool;

    /// A program that must be asked for its version before the key is known.
    fn unasked(&self) -> Option<&'static str>;

    /// Opens the inputs and does the work.
    ///
    /// # Errors
    /// An input cannot be opened, or the work fails.
    fn run(&self, inputs: &[ArtifactFiles], cx: &mut StageContext<'_>) -> Result<(), StageError>;
}

impl<S> AnyStep for WiredStage<S>
where
    S: Stage + std::fmt::Debug + Send + Sync,
    S::Inputs: std::fmt::Debug + Send + Sync,
{
    fn stage(&self) -> &'static str {
        S::NAME
    }

    fn inputs(&self) -> Vec<(&'static str, StepId)> {
        self.inputs.targets()
    }

    fn class(&self) -> Option<String> {
        self.stage.class()
    }

    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        self.stage.sources()
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        self.stage.source_folders()
    }

    fn describe(&self, inputs: &[(String, Digest)]) -> DescribedValue {
        let inputs =
            inputs.iter().map(|(role, digest)| (role.clone(), DescribedValue::Digest(*digest))).collect();
        let mut fields = BTreeMap::from([
            ("stage".to_owned(), DescribedValue::Text(S::NAME.to_owned())),
            ("revision".to_owned(), DescribedValue::Unsigned(S::REVISION.into())),
            ("params".to_owned(), describe_value(&self.stage).with_implied(S::ADDED)),
            ("inputs".to_owned(), DescribedValue::Record(inputs)),
        ]);
        if let Some(class) = self.stage.class() {
            fields.insert("class".to_owned(), DescribedValue::Text(class));
        }
        DescribedValue::Record(fields)
    }

    fn need(&self, inputs: &[ArtifactFiles]) -> StepNeed {
        self.stage.need(inputs)
    }

    fn programs(&self) -> Vec<String> {
        self.stage.programs()
    }

    fn runs_known_programs(&self) -> bool {
        self.stage.runs_known_programs()
    }

    fn unasked(&self) -> Option<&'static str> {
        self.stage.unasked()
    }

    fn run(&self, files: &[ArtifactFiles], cx: &mut StageContext<'_>) -> Result<(), StageError> {
        // The order of the files is that of `inputs`.
        let inputs = self.inputs.open(&mut files.iter())?;
        self.stage.run(inputs, cx)
    }
}
