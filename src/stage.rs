//! Stages: what a step is. Each holds its parameters, names its inputs, and calls the room that does the work.
//!
//! A stage's own fields are its parameters: nothing else of a recipe can enter its key. What must not enter
//! (paths, a back end already told by the class) is skipped in its serialisation. No stage holds arithmetic.

pub mod blur;
pub mod capture;
pub mod checks;
pub mod events;
pub mod fidelity;
pub mod foreign;
pub mod geometry;
pub mod reconstruct;
pub mod scene_checks;
pub mod sharp;
pub mod shot;
pub mod trajectory;

use crate::artifact::{Artifact, ArtifactError, Files};
use crate::camera::{self, Camera, CameraChoice};
use crate::frames::rendered::Saving;
use crate::image::Size;
use crate::programs::{Failed, Programs};
use crate::render::backend::Backend;
use crate::source::Capture;
use crate::store::Digest;
use crate::store::description::{Value, describe};
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Index of a step in its plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct StepId(pub usize);

/// A promise that a step will make an artifact of kind `A`: wiring the wrong kind does not compile.
#[derive(Debug)]
pub struct Target<A> {
    /// The step.
    pub step: StepId,
    kind: PhantomData<fn() -> A>,
}

impl<A> Target<A> {
    /// The product of a step, whose stage makes `A` by the type of [`crate::plan::Wiring::add`].
    pub(crate) fn new(step: StepId) -> Self {
        Self { step, kind: PhantomData }
    }
}

impl<A> Clone for Target<A> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<A> Copy for Target<A> {}

/// What a stage takes: nothing, targets, or targets that may be absent.
pub trait Inputs {
    /// The opened artifacts.
    type Opened;

    /// Role and step of each input that is there.
    fn targets(&self) -> Vec<(&'static str, StepId)>;

    /// Opens the inputs; `files` are those of [`Inputs::targets`], in order.
    ///
    /// # Errors
    /// When an artifact cannot be opened.
    fn open(&self, files: &mut dyn Iterator<Item = &Files>) -> Result<Self::Opened, ArtifactError>;
}

impl Inputs for () {
    type Opened = ();

    fn targets(&self) -> Vec<(&'static str, StepId)> {
        Vec::new()
    }

    fn open(&self, _: &mut dyn Iterator<Item = &Files>) -> Result<(), ArtifactError> {
        Ok(())
    }
}

impl<A: Artifact> Inputs for Target<A> {
    type Opened = A;

    fn targets(&self) -> Vec<(&'static str, StepId)> {
        vec![(A::KIND, self.step)]
    }

    fn open(&self, files: &mut dyn Iterator<Item = &Files>) -> Result<A, ArtifactError> {
        A::open(files.next().expect("one set of files for each target"))
    }
}

impl<I: Inputs> Inputs for Option<I> {
    type Opened = Option<I::Opened>;

    fn targets(&self) -> Vec<(&'static str, StepId)> {
        self.as_ref().map(I::targets).unwrap_or_default()
    }

    fn open(&self, files: &mut dyn Iterator<Item = &Files>) -> Result<Self::Opened, ArtifactError> {
        self.as_ref().map(|inputs| inputs.open(files)).transpose()
    }
}

macro_rules! tuple_inputs {
    ($($name:ident $index:tt),+) => {
        impl<$($name: Inputs),+> Inputs for ($($name,)+) {
            type Opened = ($($name::Opened,)+);

            fn targets(&self) -> Vec<(&'static str, StepId)> {
                [$(self.$index.targets()),+].concat()
            }

            fn open(&self, files: &mut dyn Iterator<Item = &Files>) -> Result<Self::Opened, ArtifactError> {
                Ok(($(self.$index.open(files)?,)+))
            }
        }
    };
}
tuple_inputs!(A 0, B 1);
tuple_inputs!(A 0, B 1, C 2);
tuple_inputs!(A 0, B 1, C 2, D 3);

/// A file outside the store that a stage reads.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceFile {
    /// Its name within the source: this enters the key.
    pub name: String,
    /// Where it is: this does not.
    pub path: PathBuf,
}

/// A stage: parameters, inputs, and how its product is made.
pub trait Stage: serde::Serialize {
    /// Its name.
    const NAME: &'static str;

    /// Raised when the same parameters and inputs come to mean other bytes.
    const REVISION: u32;

    /// Parameters that came after the first revision, as their place among the parameters and the text of the value
    /// that they had until then: a parameter that has this value stays out of the key. So adding one rekeys nothing,
    /// and another default later rekeys just what relies on it. An entry is never changed.
    const ADDED: &'static [(&'static str, &'static str)] = &[];

    /// What it takes from other steps.
    type Inputs: Inputs;

    /// What it makes.
    type Output: Artifact;

    /// The numerical class, for stages whose bytes depend on the machinery that computes them.
    fn class(&self) -> Option<String> {
        None
    }

    /// The files outside the store that it reads, in a stable order.
    ///
    /// # Errors
    /// When a source cannot be listed.
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        Ok(Vec::new())
    }

    /// The folders whose listing decides which files [`Stage::sources`] names, as far as they exist.
    fn source_folders(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// What it will need, by the sizes of its inputs; `files` are those of its inputs that are there, in order.
    fn need(&self, files: &[Files]) -> Need {
        Need::memory([copies(files)])
    }

    /// The programs that it would run, a command a line, as a person may type it.
    fn programs(&self) -> Vec<String> {
        Vec::new()
    }

    /// Whether it runs programs that need no leave, whatever a recipe says: what they say is kept, too.
    fn runs_known_programs(&self) -> bool {
        false
    }

    /// A program whose version its class lacks: it was not asked, so the key is not known.
    fn unasked(&self) -> Option<&'static str> {
        None
    }

    /// Writes the product's files into `cx.out`.
    ///
    /// # Errors
    /// When the work fails, or was asked to stop.
    fn run(&self, inputs: <Self::Inputs as Inputs>::Opened, cx: &mut Context<'_>) -> Result<(), StageError>;
}

/// What a step needs beside cores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Need {
    /// Memory at its peak, bytes; an estimate.
    pub memory: u64,
    /// Whether it renders on a graphics processor.
    pub gpu: bool,
}

impl Need {
    /// Memory for these parts, bytes, beside what every step needs.
    #[must_use]
    pub fn memory(parts: impl IntoIterator<Item = u64>) -> Self {
        /// Buffers, stacks and tables; with the program itself.
        const BASE: u64 = 24 << 20;
        Self { memory: parts.into_iter().fold(BASE, u64::saturating_add), gpu: false }
    }
}

/// Bytes that a small stage holds of its inputs: each a few times over.
fn copies(files: &[Files]) -> u64 {
    const COPIES: u64 = 4;
    COPIES * files.iter().map(Files::bytes).sum::<u64>()
}

/// What a stage needs that renders: the renderer, and `others` bytes a pixel of its own. Its first input is the capture;
/// without one that can be read the number of pixels is not known, and the stage will not run either. The scene is its
/// second.
fn rendering_need(backend: &Backend, choice: Option<CameraChoice>, files: &[Files], others: u64) -> Need {
    let capture = files.first().and_then(|capture| Capture::open(capture).ok());
    let own = |capture: Capture| capture.camera().map(|(own, _)| own);
    let camera = capture.and_then(|capture| camera::choose(choice, own(capture).as_ref()));
    let size = camera.map(|camera| camera.size);
    let scene = files.get(1).map_or(0, Files::bytes);
    let own = |size: Size| u64::from(size.width) * u64::from(size.height) * others;
    let need = Need::memory(size.into_iter().flat_map(|size| [backend.memory(scene, size), own(size)]));
    Need { gpu: backend.takes_gpu(), ..need }
}

/// What a running stage may use beside its inputs.
#[derive(Debug)]
pub struct Context<'a> {
    /// Empty folder for its files.
    pub out: &'a Path,
    cancel: &'a AtomicBool,
    /// What it has to say beside its product.
    pub warnings: Vec<String>,
    /// A word on the size of its product, for the line of progress.
    pub remark: Option<String>,
    /// Seconds since some moment, for what is told of the work and enters no product.
    pub clock: Option<fn() -> f64>,
    /// What leaving out saved, where it was measured.
    pub saving: Option<Saving>,
    /// Whether programs that a recipe names may be run.
    pub allows_commands: bool,
    /// Where the file goes that holds what they say; else it lies beside the product's files while they run.
    pub log: Option<PathBuf>,
    /// The programs that can be run.
    pub programs: Programs,
}

impl<'a> Context<'a> {
    /// A context that writes into `out` and stops when `cancel` is set.
    #[must_use]
    pub fn new(out: &'a Path, cancel: &'a AtomicBool) -> Self {
        let (warnings, remark, clock, saving) = (Vec::new(), None, None, None);
        let programs = Programs::default();
        Self { out, cancel, warnings, remark, clock, saving, allows_commands: false, log: None, programs }
    }

    /// Whether the work is asked to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// Asked at every frame or chunk: `Err` where the work shall stop.
    ///
    /// # Errors
    /// [`StageError::Cancelled`].
    pub fn go_on(&self) -> Result<(), StageError> {
        if self.is_cancelled() { Err(StageError::Cancelled) } else { Ok(()) }
    }
}

/// The camera of a trajectory: the recipe's choice, else the source's own, with a warning where views disagree.
fn camera(choice: Option<CameraChoice>, capture: &Capture, cx: &mut Context<'_>) -> Camera {
    let (own, warning) = capture.camera().unzip();
    cx.warnings.extend(warning.flatten().map(|w| w.to_string()));
    camera::choose(choice, own.as_ref()).expect("recipes without views write a whole camera")
}

/// Why a step failed. The texts fit after "failed to ".
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// It was asked to stop.
    #[error("finish: it was interrupted")]
    Cancelled,
    /// A source is not there.
    #[error("find {}", path.display())]
    Missing {
        /// Where it should be.
        path: PathBuf,
    },
    /// An input cannot be opened.
    #[error(transparent)]
    Artifact(#[from] ArtifactError),
    /// It would run programs, and may not.
    #[error("run a program that the recipe names: it is not allowed to")]
    Refused {
        /// The commands, one a line.
        programs: Vec<String>,
    },
    /// A program that it ran failed.
    #[error(transparent)]
    Program(Box<Failed>),
    /// The work itself failed.
    #[error("{doing}: {cause}")]
    Work {
        /// At what.
        doing: String,
        /// Why.
        #[source]
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A file cannot be read or written.
    #[error("use {}: {source}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
}

impl StageError {
    /// A failure of the work, as `doing: cause`.
    pub fn work<E>(doing: &str) -> impl FnOnce(E) -> Self
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        let doing = doing.to_owned();
        move |e| Self::Work { doing, cause: Box::new(e) }
    }

    /// A failure to use a file.
    pub fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}

/// A stage with its inputs.
#[derive(Debug)]
pub struct Wired<S: Stage> {
    /// Parameters.
    pub stage: S,
    /// Where its inputs come from.
    pub inputs: S::Inputs,
}

/// A wired stage whatever its types.
pub trait AnyStep: std::fmt::Debug + Send + Sync {
    /// Name of the stage.
    fn stage(&self) -> &'static str;

    /// Role and step of each input.
    fn inputs(&self) -> Vec<(&'static str, StepId)>;

    /// The numerical class, for stages whose bytes depend on the machinery that computes them.
    fn class(&self) -> Option<String>;

    /// Files outside the store that it reads.
    ///
    /// # Errors
    /// When a source cannot be listed.
    fn sources(&self) -> Result<Vec<SourceFile>, StageError>;

    /// Folders whose listing decides which files those are.
    fn source_folders(&self) -> Vec<PathBuf>;

    /// What enters the key: the stage, its revision and class, its parameters, and the digests of its inputs by
    /// role.
    fn describe(&self, inputs: &[(String, Digest)]) -> Value;

    /// What it will need, by the sizes of its inputs.
    fn need(&self, inputs: &[Files]) -> Need;

    /// The programs that it would run, a command a line.
    fn programs(&self) -> Vec<String>;

    /// Whether it runs programs that need no leave.
    fn runs_known_programs(&self) -> bool;

    /// A program that must be asked for its version before the key is known.
    fn unasked(&self) -> Option<&'static str>;

    /// Opens the inputs and does the work.
    ///
    /// # Errors
    /// When an input cannot be opened, or the work fails.
    fn run(&self, inputs: &[Files], cx: &mut Context<'_>) -> Result<(), StageError>;
}

impl<S> AnyStep for Wired<S>
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

    fn describe(&self, inputs: &[(String, Digest)]) -> Value {
        let inputs = inputs.iter().map(|(role, digest)| (role.clone(), Value::Digest(*digest))).collect();
        let mut fields = BTreeMap::from([
            ("stage".to_owned(), Value::Text(S::NAME.to_owned())),
            ("revision".to_owned(), Value::Unsigned(S::REVISION.into())),
            ("params".to_owned(), describe(&self.stage).with_implied(S::ADDED)),
            ("inputs".to_owned(), Value::Record(inputs)),
        ]);
        if let Some(class) = self.stage.class() {
            fields.insert("class".to_owned(), Value::Text(class));
        }
        Value::Record(fields)
    }

    fn need(&self, inputs: &[Files]) -> Need {
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

    fn run(&self, files: &[Files], cx: &mut Context<'_>) -> Result<(), StageError> {
        let inputs = self.inputs.open(&mut files.iter())?;
        self.stage.run(inputs, cx)
    }
}
