//! The command line: the arguments of the user, the output, and the exit code.
//!
//! This is the only module that prints, reads the environment, or looks at a clock for people.
//! Results go to stdout, and all other text to stderr. `docs/building.md` lists the parts that
//! programs may rely on.

mod arguments;
mod audit;
mod build;
mod calibrate;
mod cancel;
mod check;
mod clock;
mod cluster;
mod commands;
mod common;
mod completions;
mod console;
mod convert;
mod diff;
mod doctor;
mod environment;
mod export;
mod failure;
mod gc;
mod info;
mod init;
mod input;
mod left_out;
mod machine;
mod message;
mod output;
mod plan;
mod problem;
mod progress;
mod recording;
mod release;
mod render;
mod renderers;
mod screening;
mod simulate;
mod status;
mod stress;
mod study;
mod submit;
mod supervise;
mod takedown;
mod targets;
mod train;
mod trajectory;
mod verdicts;
mod why;
mod words;

pub use arguments::command_line;
use arguments::{misread, parse, wants_json};

use clap::{Parser, Subcommand};
use common::{BackendArg, CommonArgs};
pub use console::ConsoleStreams;
use console::{Console, path};
pub use environment::Environment;
use gs2e_files::programs::SUPERVISE;
use gs2e_recipe as recipe;
use message::UserMessage;
pub use problem::ExitKind;
use problem::VerbError;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::ffi::OsString;
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
    /// Show the verdicts of the validation passes
    Check(check::CheckArgs),
    /// Build the stale steps, check the results, and write the release
    Release(release::ReleaseArgs),
    /// Build scenes by array jobs of a batch system, on a store that their tasks share
    Submit(submit::SubmitArgs),
    /// Show which scenes of a shared store are done, running, queued and failed
    Status(status::StatusArgs),
    /// End the queued and running tasks of scenes
    Cancel(cancel::CancelArgs),
    /// Read every byte of a release, and check that it is complete and consistent
    Audit(audit::AuditArgs),
    /// Show the differences between two releases, each with its reason
    Diff(diff::DiffArgs),
    /// Show the properties of a scene, an event file, a capture, a release or a store
    Info(info::InfoArgs),
    /// Convert a scene or an event file to another format, or draw events
    Convert(convert::ConvertArgs),
    /// Write a trajectory of a release in the layout of a published method
    Export(export::ExportArgs),
    /// Write one recipe for each scene of a dataset on disk
    Init(init::InitArgs),
    /// Delete the stored files that no recipe and no release refers to
    Gc(gc::GcArgs),
    /// Render one view of a scene file
    Render(render::RenderArgs),
    /// Simulate a sensor on your own frames, and write its events
    Simulate(simulate::SimulateArgs),
    /// Estimate a sensor from a recording of frames and events, and write it for recipes
    Calibrate(calibrate::CalibrateArgs),
    /// Compare the arithmetic in stiff and extreme cases with independent answers
    Stress(stress::StressArgs),
    /// Measure the error and the run time of sampling settings on a scene
    Study(study::StudyArgs),
    /// Train a scene on the photos of a capture
    Train(train::TrainArgs),
    /// Compute the poses of one trajectory of a recipe on your own capture
    Trajectory(trajectory::TrajectoryArgs),
    /// Show this machine as the program sees it, and compare its GPUs with the CPU
    Doctor(doctor::DoctorArgs),
    /// Print the JSON Schema of recipes, for editors
    Schema,
    /// Print the completions of a shell
    Completions(completions::CompletionsArgs),
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

fn run_verb(cli: Cli, console: &Console) -> Result<ExitKind, VerbError> {
    // Before any path is used, so that all paths of the command line are relative to this folder.
    if let Some(directory) = &cli.common.directory {
        std::env::set_current_dir(directory).map_err(|e| {
            let what = format!("failed to change to folder {}: {e}", directory.display());
            VerbError::usage("input-missing", what)
        })?;
    }
    let common = &cli.common;
    match cli.verb {
        VerbCommand::Build(verb) => verb.run(common, console),
        VerbCommand::Plan(verb) => verb.run(common, console),
        VerbCommand::Why(verb) => verb.run(common, console),
        VerbCommand::Check(verb) => verb.run(common, console),
        VerbCommand::Release(verb) => verb.run(common, console),
        VerbCommand::Submit(verb) => verb.run(common, console),
        VerbCommand::Status(verb) => verb.run(common, console),
        VerbCommand::Cancel(verb) => verb.run(common, console),
        VerbCommand::Audit(verb) => verb.run(common, console),
        VerbCommand::Diff(verb) => verb.run(console),
        VerbCommand::Info(verb) => verb.run(console),
        VerbCommand::Convert(verb) => verb.run(console),
        VerbCommand::Export(verb) => verb.run(console),
        VerbCommand::Init(verb) => verb.run(common, console),
        VerbCommand::Gc(verb) => verb.run(common, console),
        VerbCommand::Render(verb) => verb.run(common, console),
        VerbCommand::Simulate(verb) => verb.run(common, console),
        VerbCommand::Calibrate(verb) => verb.run(common, console),
        VerbCommand::Stress(verb) => verb.run(common, console),
        VerbCommand::Study(verb) => verb.run(common, console),
        VerbCommand::Train(verb) => verb.run(common, console),
        VerbCommand::Trajectory(verb) => verb.run(common, console),
        VerbCommand::Doctor(verb) => verb.run(common, console),
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
