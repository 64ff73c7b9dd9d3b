//! The executor on toy stages.

use super::*;
use crate::artifact::{Artifact, ArtifactError, ArtifactFiles};
use crate::stage::{SourceFile, Stage, StageContext, StageFacts, StepTarget};
use gs2e_recipe as recipe;
use gs2e_store::StoreAccess;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

/// Product of the steps in these tests.
#[derive(Debug)]
struct Note;

impl Artifact for Note {
    const KIND: &'static str = "note";

    fn open(_: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self)
    }
}

/// Action of a step before it writes its note.
#[derive(Debug, Clone, Default)]
enum Act {
    #[default]
    Nothing,
    Overwrite(PathBuf),
    /// Writes to a device without free space.
    Fill,
    Fail,
    /// Fails on a file that another process is writing.
    FailOver(PathBuf),
    Panic,
}

/// A step that writes a note.
#[derive(Debug, Clone, Default, serde::Serialize)]
struct Toy {
    parameter: &'static str,
    #[serde(skip)]
    note: &'static str,
    #[serde(skip)]
    source: Option<PathBuf>,
    #[serde(skip)]
    act: Act,
}

impl StageFacts for Toy {
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        let file = |path: &PathBuf| SourceFile { name: "source".into(), path: path.clone() };
        Ok(self.source.iter().map(file).collect())
    }
}

impl Stage for Toy {
    const NAME: &'static str = "toy";
    const REVISION: u32 = 1;
    type Inputs = Option<StepTarget<Note>>;
    type Output = Note;

    fn run(&self, _: Option<Note>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        match &self.act {
            Act::Nothing => {}
            Act::Overwrite(path) => std::fs::write(path, "moved").map_err(StageError::io_error(path))?,
            Act::Fill => {
                let full = Path::new("/dev/full");
                std::fs::write(full, [0; 100]).map_err(StageError::io_error(full))?;
            }
            Act::Fail => return Err(StageError::work_failed("please")(std::fmt::Error)),
            Act::FailOver(path) => {
                std::fs::write(path, "moved").map_err(StageError::io_error(path))?;
                return Err(StageError::work_failed("read it")(std::fmt::Error));
            }
            Act::Panic => panic!("the panic of a test"),
        }
        let out = cx.out.join("note");
        std::fs::write(&out, self.note).map_err(StageError::io_error(&out))
    }
}

struct Silent;

impl RunObserver for Silent {
    fn observe(&self, _: &RunEvent<'_>) {}
}

/// Steps by name, each with the index of the step before it.
type Steps = Vec<(Toy, Option<usize>)>;

fn plan(folder: &Path, steps: Steps) -> Plan {
    let file = folder.join("recipe.yaml");
    let text =
        "{ version: 1, scene: s, source: { procedural: {} }, trajectories: [{ name: a, refine: {} }] }";
    std::fs::write(&file, text).unwrap();
    let recipes = recipe::read_all(&[file]).unwrap_or_else(|faults| panic!("{}", faults.render_text()));
    Plan::of_steps(recipes, |wiring| {
        let mut targets: Vec<StepTarget<Note>> = Vec::new();
        for (i, (toy, before)) in steps.into_iter().enumerate() {
            targets.push(wiring.add(format!("step{i}"), toy, before.map(|b| targets[b])));
        }
    })
}

fn run_with(folder: &Path, steps: Steps, keep_going: bool, cancelled: bool) -> RunSummary {
    let store = Store::open(&folder.join("store"), StoreAccess::Write, &mut |_| {}).unwrap();
    let budget = ResourceBudget { cores: 1, memory: u64::MAX, gpus: 0 };
    let options = RunOptions {
        budget,
        keep_going,
        recheck: RecheckPolicy::default(),
        allow_commands: false,
        kept_frames: None,
        programs: ProgramFinder::default(),
    };
    run_plan(&plan(folder, steps), &store, options, &AtomicBool::new(cancelled), &Silent).unwrap()
}

fn counts(summary: &RunSummary) -> [usize; 4] {
    [summary.made, summary.kept, summary.failures.len(), summary.unreached]
}

fn toy(parameter: &'static str) -> Toy {
    Toy { parameter, note: parameter, ..Toy::default() }
}

#[test]
fn an_input_that_changes_while_it_is_read_is_not_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source");
    std::fs::write(&source, "still").unwrap();
    let reader = Toy { source: Some(source.clone()), ..toy("reader") };
    let moving = Toy { act: Act::Overwrite(source.clone()), ..reader.clone() };
    let summary = run_with(folder.path(), vec![(moving, None)], false, false);
    assert_eq!(counts(&summary), [0, 0, 1, 0]);
    let error = &summary.failures[0].error;
    assert_eq!(error.to_string(), "source changed while it was read; nothing was recorded");
    // The next build is right: the new bytes are read once, and the old ones still count as never
    // read.
    assert_eq!(counts(&run_with(folder.path(), vec![(reader.clone(), None)], false, false)), [1, 0, 0, 0]);
    std::fs::write(&source, "still").unwrap();
    assert_eq!(counts(&run_with(folder.path(), vec![(reader, None)], false, false)), [1, 0, 0, 0]);
}

/// The bytes that a step saw of a file that was rewritten meanwhile are not known, whatever the
/// file contains afterwards.
#[test]
fn an_input_that_is_written_anew_with_equal_bytes_is_not_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source");
    std::fs::write(&source, "moved").unwrap();
    // The clock's grain: without a pause both writes may be of one tick.
    std::thread::sleep(std::time::Duration::from_millis(20));
    let moving = Toy { source: Some(source.clone()), act: Act::Overwrite(source), ..toy("reader") };
    let summary = run_with(folder.path(), vec![(moving, None)], false, false);
    assert!(matches!(summary.failures[0].error, StepError::Moved(_)), "{:?}", summary.failures);
}

/// The key of a step that waits for a core is older than its work.
#[test]
fn an_input_that_changes_while_its_step_waits_is_not_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source");
    std::fs::write(&source, "still").unwrap();
    let first = Toy { act: Act::Overwrite(source.clone()), ..toy("first") };
    let reader = Toy { source: Some(source), ..toy("reader") };
    let summary = run_with(folder.path(), vec![(first, None), (reader.clone(), None)], true, false);
    assert_eq!(counts(&summary), [1, 0, 1, 0]);
    assert!(matches!(summary.failures[0].error, StepError::Moved(_)), "{:?}", summary.failures);
    assert_eq!(counts(&run_with(folder.path(), vec![(reader, None)], false, false)), [1, 0, 0, 0]);
}

#[test]
fn equal_bytes_stop_the_wave() {
    let folder = tempfile::tempdir().unwrap();
    let chain = |parameter, note| {
        vec![(Toy { parameter, note, ..Toy::default() }, None), (toy("b"), Some(0)), (toy("c"), Some(1))]
    };
    let t = |parameter, note, wanted| {
        let summary = run_with(folder.path(), chain(parameter, note), false, false);
        assert_eq!(counts(&summary), wanted, "{parameter}, {note}");
    };
    t("one", "same", [3, 0, 0, 0]);
    t("two", "same", [1, 2, 0, 0]);
    // The second step is made from other bytes, and makes what it made before.
    t("three", "other", [2, 1, 0, 0]);
    t("one", "same", [0, 3, 0, 0]);
}

#[test]
fn a_failure_stops_what_is_behind_it_and_with_keep_going_nothing_else() {
    let steps = || {
        let failing = Toy { act: Act::Fail, ..toy("a") };
        vec![(failing, None), (toy("b"), Some(0)), (toy("c"), None), (toy("d"), Some(2))]
    };
    for (keep_going, wanted) in [(true, [2, 0, 1, 1]), (false, [0, 0, 1, 3])] {
        let folder = tempfile::tempdir().unwrap();
        let summary = run_with(folder.path(), steps(), keep_going, false);
        assert_eq!(counts(&summary), wanted, "keep going: {keep_going}");
        let said = summary.failures[0].error.to_string();
        assert!(said.starts_with("failed to please: "), "{said}");
    }
}

/// If there is no room for one step, the next one would take what is left from the running steps.
#[test]
fn after_a_full_disk_nothing_starts_even_with_keep_going() {
    let folder = tempfile::tempdir().unwrap();
    let filling = Toy { act: Act::Fill, ..toy("b") };
    let steps = || vec![(toy("a"), None), (filling.clone(), None), (toy("c"), None), (toy("d"), Some(2))];
    let summary = run_with(folder.path(), steps(), true, false);
    assert_eq!(counts(&summary), [1, 0, 1, 2]);
    let error = &summary.failures[0].error;
    assert!(matches!(error, StepError::Full { wrote: 0, space: Some(_), .. }), "{error:?}");
    assert!(summary.is_full() && !summary.interrupted);
}

/// A half-written file that cannot be read is reported as such.
#[test]
fn a_step_that_fails_over_a_moving_input_blames_the_move() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source");
    std::fs::write(&source, "still").unwrap();
    // The clock's grain: without a pause both writes may be of one tick.
    std::thread::sleep(std::time::Duration::from_millis(20));
    let reader = Toy { source: Some(source.clone()), act: Act::FailOver(source), ..toy("reader") };
    let summary = run_with(folder.path(), vec![(reader, None)], false, false);
    assert!(matches!(summary.failures[0].error, StepError::Moved(_)), "{:?}", summary.failures);
}

#[test]
fn equal_keys_run_once() {
    let folder = tempfile::tempdir().unwrap();
    let summary = run_with(folder.path(), vec![(toy("a"), None), (toy("a"), None)], false, false);
    assert_eq!(counts(&summary), [1, 1, 0, 0]);
    assert_eq!(summary.products[&StepId(0)], summary.products[&StepId(1)]);
}

#[test]
fn a_run_that_is_cancelled_starts_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let summary = run_with(folder.path(), vec![(toy("a"), None), (toy("b"), Some(0))], false, true);
    assert_eq!((counts(&summary), summary.interrupted), ([0, 0, 0, 2], true));
}

/// A broken invariant in a step ends the program; the executor must not wait forever for the step.
#[test]
fn a_panic_of_a_step_is_carried_on() {
    let folder = tempfile::tempdir().unwrap();
    let panicking = Toy { act: Act::Panic, ..toy("a") };
    let ended = catch_unwind(|| run_with(folder.path(), vec![(panicking, None)], false, false));
    let panic = ended.expect_err("the step panics");
    assert_eq!(panic.downcast_ref::<&str>(), Some(&"the panic of a test"));
}
