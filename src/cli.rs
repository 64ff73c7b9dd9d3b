//! The command line: the arguments of the user, the output, and the exit code.
//!
//! This is the only module that prints, reads the environment, or looks at a clock for people.
//! Results go to stdout, and all other text to stderr. `docs/command-line.md` lists the parts that
//! programs may rely on.

mod audit;
mod build;
mod check;
mod clock;
mod commands;
mod completions;
mod console;
mod convert;
mod diff;
mod environment;
mod failure;
mod gc;
mod info;
mod init;
mod input;
mod left_out;
mod machine;
mod message;
mod open;
mod output;
mod plan;
mod problem;
mod progress;
mod release;
mod render;
mod renderers;
mod screening;
mod simulate;
mod stress;
mod study;
mod supervise;
mod takedown;
mod targets;
mod train;
mod trajectory;
mod verdicts;
mod why;

use crate::programs::{ProgramFinder, SUPERVISE};
use crate::render::OmissionPolicy;
use crate::render::backend::Backend;
use crate::render::gpu::{self, GpuDevice, GpuError};
use crate::run::backends::{AutoRenderers, RendererChoice, RendererKind};
use crate::{escape, files, recipe};
use clap::error::ErrorKind;
use clap::{Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand, ValueEnum};
use console::Console;
pub use console::ConsoleStreams;
pub use environment::Environment;
pub use problem::ExitKind;
use problem::VerbError;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use targets::{RecipeTargets, is_recipe_path};

/// Builds datasets of synthetic event-camera streams from 3D Gaussian splats, and proves them.
#[derive(Debug, Parser)]
#[command(name = "gs2e", bin_name = "gs2e", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    verb: VerbCommand,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Debug, Subcommand)]
enum VerbCommand {
    /// Run the stale steps, and no others
    Build(build::BuildArgs),
    /// Show the steps that `build` would run, may run and keep, each with its reason; runs nothing
    Plan(plan::PlanArgs),
    /// Show the parts of a step's key, and the changes since the step was last made
    Why(why::WhyArgs),
    /// Print the paths of what was built
    Open(open::OpenArgs),
    /// Show the verdicts of the validation passes
    Check(check::CheckArgs),
    /// Build the stale steps, check the results, and write the release
    Release(release::ReleaseArgs),
    /// Read every byte of a release, and check that it is complete and consistent
    Audit(audit::AuditArgs),
    /// Show the differences between two releases, each with its reason
    Diff(diff::DiffArgs),
    /// Show the properties of a scene, an event file, a capture, a release or a store
    Info(info::InfoArgs),
    /// Convert a scene or an event file to another format, or draw events
    Convert(convert::ConvertArgs),
    /// Write one recipe for each scene of a dataset on disk
    Init(init::InitArgs),
    /// Delete the stored files that no recipe and no release refers to
    Gc(gc::GcArgs),
    /// Render one view of a scene file
    Render(render::RenderArgs),
    /// Simulate a sensor on your own frames, and write its events
    Simulate(simulate::SimulateArgs),
    /// Compare the arithmetic in stiff and extreme cases with independent answers
    Stress(stress::StressArgs),
    /// Measure the error and the run time of sampling settings on a scene
    Study(study::StudyArgs),
    /// Train a scene on the photos of a capture
    Train(train::TrainArgs),
    /// Compute the poses of one trajectory of a recipe on your own capture
    Trajectory(trajectory::TrajectoryArgs),
    /// Print the JSON Schema of recipes, for editors
    Schema,
    /// Print the completions of a shell
    Completions(completions::CompletionsArgs),
}

/// Options of every verb.
#[derive(Debug, Clone, Args)]
struct CommonArgs {
    /// Work in this folder
    #[arg(short = 'C', long = "directory", value_name = "DIR", global = true)]
    directory: Option<PathBuf>,
    /// Folder of the store, which keeps the built products
    #[arg(long, value_name = "DIR", default_value = CommonArgs::STORE, global = true)]
    store: PathBuf,
    /// Cores to use [default: all]
    #[arg(short = 'j', long = "jobs", value_name = "N", global = true, value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Keep going past a failed scene
    #[arg(short = 'k', long, global = true)]
    keep_going: bool,
    /// Renderer
    #[arg(long, value_enum, default_value_t = BackendArg::Auto, global = true)]
    backend: BackendArg,
    /// GPU to render on: its index in the list of all GPUs, from 0, or a part of its name
    #[arg(long, value_name = "NAME or INDEX", global = true)]
    gpu: Option<gpu::DeviceChoice>,
    /// Also do the rendering work that changes no bit, for comparison with a normal build
    #[arg(long, global = true)]
    no_omit: bool,
    /// Run the programs that recipes name, instead of showing them
    #[arg(long, global = true)]
    allow_commands: bool,
    /// Fail instead of waiting while another gs2e uses the store
    #[arg(long, global = true)]
    no_wait: bool,
    /// Print results for programs to stdout
    #[arg(long, global = true)]
    json: bool,
    /// Print failures only
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Print more: the work that each trajectory skipped
    #[arg(short, long, global = true)]
    verbose: bool,
    /// The whole command as typed, shown to other processes that wait for this one.
    #[arg(skip)]
    command: String,
    #[arg(skip)]
    environment: Environment,
}

impl CommonArgs {
    /// Default folder of the store.
    const STORE: &'static str = ".gs2e";

    /// The renderer of the scenes of recipes. The keys of their steps depend on it.
    fn renderers(&self) -> Result<RendererChoice, VerbError> {
        let by = match self.backend {
            // A software GPU is slower than the CPU renderer, so it is used only if it is named.
            BackendArg::Auto => RendererKind::Auto(AutoRenderers::new(
                self.gpu.clone().unwrap_or(gpu::DeviceChoice::Hardware),
            )),
            _ => RendererKind::One(self.backend()?),
        };
        Ok(RendererChoice::new(by, self.omit(), self.programs()))
    }

    /// The programs on the user's path. This program supervises them, even if its own file was
    /// replaced meanwhile.
    fn programs(&self) -> ProgramFinder {
        // The link in /proc still leads to the running executable after its file was replaced or
        // deleted.
        let own = PathBuf::from("/proc/self/exe");
        let own = if files::is_there(&own) { own } else { std::env::current_exe().unwrap_or_default() };
        ProgramFinder::new(self.environment.path(), own)
    }

    /// Number of cores to use.
    fn cores(&self) -> usize {
        self.jobs.map_or_else(machine::available_cores, usize::from)
    }

    /// Limits `-j` to the cores of this machine. Idle threads look for work at each other, so the
    /// time that they take grows with the square of their number.
    fn clamp_jobs(&mut self, console: &Console) {
        let cores = u16::try_from(machine::available_cores()).unwrap_or(u16::MAX);
        if let Some(jobs) = self.jobs.filter(|jobs| *jobs > cores) {
            console.say(&format!("-j {jobs} exceeds the cores of this machine: using {cores} cores"));
            self.jobs = Some(cores);
        }
    }

    /// The work that renderers leave out.
    fn omit(&self) -> OmissionPolicy {
        if self.no_omit { OmissionPolicy::Nothing } else { OmissionPolicy::Needless }
    }

    /// The back end for renderings other than the scenes of recipes: the CPU unless another one is
    /// requested.
    fn backend(&self) -> Result<Backend, VerbError> {
        match self.backend {
            BackendArg::Gpu => {
                self.device(&gpu::DeviceChoice::Any).map(Backend::Gpu).map_err(|e| no_adapter(&e))
            }
            _ if self.gpu.is_some() => Err(VerbError::usage(
                "no-adapter",
                "--gpu selects a GPU, but the backend is not a GPU".to_owned(),
            )
            .help("add --backend gpu")),
            BackendArg::Auto | BackendArg::Cpu => Ok(Backend::Cpu),
            BackendArg::Reference => Ok(Backend::Reference),
        }
    }

    /// The GPU that `--gpu` chooses, or else one that matches `otherwise`.
    fn device(&self, otherwise: &gpu::DeviceChoice) -> Result<GpuDevice, GpuError> {
        GpuDevice::open(self.gpu.as_ref().unwrap_or(otherwise))
    }

    /// Limits a single step to the cores that it may use.
    fn limit_cores(&self) {
        if let Some(jobs) = self.jobs {
            // It fails only if a thread pool exists already, and no verb starts one before this
            // call.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(jobs.into()).build_global();
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BackendArg {
    Auto,
    Cpu,
    Gpu,
    Reference,
}

/// The error for a requested GPU that is absent or cannot be used.
fn no_adapter(error: &GpuError) -> VerbError {
    VerbError::usage("no-adapter", error.to_string()).help("use --backend cpu, or leave the option out")
}

/// Returns the command line as clap knows it: every verb and option with its help, from which
/// `docs/cli.md` is written.
#[must_use]
pub fn command_line() -> clap::Command {
    hide_irrelevant(Cli::command())
}

/// The common options that have an effect in some verbs only. All verbs accept them, so that scripts
/// can pass one set of options; the help of a verb lists its own.
const RELEVANT: [(&str, &[&str]); 9] = [
    ("store", &["build", "plan", "why", "check", "release", "open", "gc", "study", "info"]),
    (
        "jobs",
        &[
            "build",
            "plan",
            "release",
            "audit",
            "render",
            "simulate",
            "stress",
            "study",
            "train",
            "trajectory",
        ],
    ),
    ("keep_going", &["build", "release"]),
    ("backend", RENDERING),
    ("gpu", RENDERING),
    ("no_omit", &["build", "plan", "why", "check", "release", "open", "gc", "render", "study"]),
    ("allow_commands", &["build", "release"]),
    ("no_wait", &["build", "release", "gc"]),
    ("verbose", &["build", "release"]),
];

/// Verbs that render, or that compute the keys of what is rendered.
const RENDERING: &[&str] = &[
    "build",
    "plan",
    "why",
    "check",
    "release",
    "open",
    "gc",
    "render",
    "study",
    "stress",
    "audit",
    "trajectory",
];

fn hide_irrelevant(command: clap::Command) -> clap::Command {
    let common: Vec<clap::Arg> = command.get_arguments().filter(|arg| arg.is_global_set()).cloned().collect();
    command.mut_subcommands(|verb| {
        let name = verb.get_name().to_owned();
        let is_irrelevant = |arg: &&clap::Arg| {
            let known = RELEVANT.iter().find(|(id, _)| arg.get_id() == *id);
            known.is_some_and(|(_, verbs)| !verbs.contains(&name.as_str()))
        };
        // A common option that the verb has itself is not passed down to it, so it stays hidden.
        verb.args(common.iter().filter(is_irrelevant).cloned().map(|arg| arg.hide(true)))
    })
}

/// Runs the program with these arguments on the streams of the process. The first argument is the
/// name of the program.
#[must_use]
pub fn run_program(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    // Supervision comes before the parser: the other arguments belong to the supervised program.
    if arguments.get(1).is_some_and(|verb| verb == SUPERVISE) {
        return supervise::run(arguments.into_iter().skip(2).collect());
    }
    run_on(ConsoleStreams::of_process(), Environment::of_process(), arguments).into()
}

/// Runs the program with these arguments; the first is the name of the program. Only two things are
/// written past `streams`: the bars of a run on a terminal, and results for which the user names
/// `-` as the output.
#[must_use]
pub fn run_on(
    streams: ConsoleStreams,
    environment: Environment,
    arguments: impl IntoIterator<Item = OsString>,
) -> ExitKind {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let (console, ended) = match parse(&arguments) {
        Ok(mut cli) => {
            let console = Console::new(streams, cli.common.json, cli.common.quiet);
            cli.common.environment = environment;
            cli.common.clamp_jobs(&console);
            let ended = run_verb(cli, &console);
            (console, ended)
        }
        Err(error) => {
            // The arguments could not be parsed, so the words alone decide the form of the error.
            let console = Console::new(streams, wants_json(&arguments), false);
            // Help and version arrive as errors too, but they are results.
            let ended = if error.use_stderr() {
                Err(misread(&arguments, error))
            } else {
                console.help(&error);
                Ok(ExitKind::Done)
            };
            (console, ended)
        }
    };
    let exit = ended.unwrap_or_else(|problem| {
        console.problem(&problem);
        problem.exit
    });
    console.finish(exit)
}

fn parse(arguments: &[OsString]) -> Result<Cli, clap::Error> {
    let mut known = with_negative_numbers(command_line());
    let mut matches = known.try_get_matches_from_mut(arguments)?;
    let mut cli = Cli::from_arg_matches_mut(&mut matches).map_err(|error| error.format(&mut known))?;
    cli.common.command = typed_command(arguments);
    Ok(cli)
}

/// Makes `-1` a value where one is expected. The error of the field then says more than an error
/// about an unknown option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let takes = |arg: clap::Arg| {
        if arg.get_action().takes_values() { arg.allow_negative_numbers(true) } else { arg }
    };
    command.mut_args(takes).mut_subcommands(with_negative_numbers)
}

/// Returns true if the command line asks for results for programs, even if it cannot be parsed as a
/// whole.
fn wants_json(arguments: &[OsString]) -> bool {
    // Words after `--` are values.
    arguments.iter().skip(1).take_while(|word| *word != "--").any(|word| word == "--json")
}

/// The error for a command line that cannot be parsed.
fn misread(arguments: &[OsString], error: clap::Error) -> VerbError {
    // The parser repeats words unchanged, and a hidden character in them could act on the terminal.
    // So the words are parsed again in their visible form.
    let shown = arguments.iter().map(|word| OsString::from(visible(word)));
    let again = with_negative_numbers(command_line()).try_get_matches_from(shown).err();
    // An escaped word may fail for another reason than the original; the original error counts
    // then.
    let error = again.filter(|again| again.kind() == error.kind()).unwrap_or(error);
    let what = match error.kind() {
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => "no verb is given".to_owned(),
        _ => {
            let text = error.render().to_string();
            let first = text.split("\n\n").next().unwrap_or_default().trim_end();
            first.strip_prefix("error: ").unwrap_or(first).to_owned()
        }
    };
    VerbError::misread(what, error.render().to_string().trim_end().lines().map(str::to_owned).collect())
}

/// A word of the command line in visible characters, on one line.
fn visible(word: &OsString) -> String {
    escape::line(&console::path(word)).into_owned()
}

/// A command as it was typed, except for quotes, hidden characters and the path of the program.
fn typed_command(arguments: &[OsString]) -> String {
    let mut words: Vec<String> = arguments.iter().map(visible).collect();
    if let Some(program) = words.first_mut() {
        *program = program.rsplit(std::path::MAIN_SEPARATOR).next().unwrap_or_default().to_owned();
    }
    words.join(" ")
}

fn run_verb(cli: Cli, console: &Console) -> Result<ExitKind, VerbError> {
    // Before any path is used, so that all paths of the command line are relative to this folder.
    if let Some(directory) = &cli.common.directory {
        std::env::set_current_dir(directory).map_err(|e| {
            VerbError::usage(
                "input-missing",
                format!("failed to change to folder {}: {e}", directory.display()),
            )
        })?;
    }
    let common = &cli.common;
    match cli.verb {
        VerbCommand::Build(verb) => verb.run(common, console),
        VerbCommand::Plan(verb) => verb.run(common, console),
        VerbCommand::Why(verb) => verb.run(common, console),
        VerbCommand::Check(verb) => verb.run(common, console),
        VerbCommand::Open(verb) => verb.run(common, console),
        VerbCommand::Release(verb) => verb.run(common, console),
        VerbCommand::Audit(verb) => verb.run(common, console),
        VerbCommand::Diff(verb) => verb.run(console),
        VerbCommand::Info(verb) => verb.run(console),
        VerbCommand::Convert(verb) => verb.run(console),
        VerbCommand::Init(verb) => verb.run(common, console),
        VerbCommand::Gc(verb) => verb.run(common, console),
        VerbCommand::Render(verb) => verb.run(common, console),
        VerbCommand::Simulate(verb) => verb.run(common, console),
        VerbCommand::Stress(verb) => verb.run(common, console),
        VerbCommand::Study(verb) => verb.run(common, console),
        VerbCommand::Train(verb) => verb.run(common, console),
        VerbCommand::Trajectory(verb) => verb.run(common, console),
        VerbCommand::Schema => {
            console.text(recipe::JSON_SCHEMA);
            Ok(ExitKind::Done)
        }
        VerbCommand::Completions(verb) => Ok(verb.run(console)),
    }
}

/// A flag that the first interrupt sets. The second interrupt ends the program at once, which is as
/// safe as a power cut. The end of a terminal counts as an interrupt, unless the program was
/// started to outlive it, as by `nohup`.
fn on_interrupt() -> Result<Arc<AtomicBool>, VerbError> {
    let flag = Arc::new(AtomicBool::new(false));
    let mut signals = vec![SIGINT, SIGTERM, SIGQUIT];
    if !machine::ignores(SIGHUP) {
        signals.push(SIGHUP);
    }
    // 130 is what a shell reports for a program that an interrupt ended.
    for signal in signals {
        // The shutdown is registered first: in the other order the first signal would set the flag
        // and then end the program.
        signal_hook::flag::register_conditional_shutdown(signal, 130, flag.clone())
            .and_then(|_| signal_hook::flag::register(signal, flag.clone()))
            .map_err(|e| {
                VerbError::failed("signals", format!("failed to install the handler of interrupts: {e}"))
            })?;
    }
    Ok(flag)
}
