//! Arguments as words: how they are parsed, shown in errors, and listed in the help of each verb.

use super::{Cli, VerbError, console};
use clap::error::ErrorKind;
use clap::{CommandFactory as _, FromArgMatches as _};
use gs2e_files::escape;
use std::ffi::OsString;

/// Returns the command line as clap knows it: every verb and option with its help, from which
/// `docs/cli.md` is written.
#[must_use]
pub fn command_line() -> clap::Command {
    hide_irrelevant(Cli::command())
}

/// The common options that have an effect in some verbs only. All verbs accept them, so that scripts
/// can pass one set of options; the help of a verb lists its own.
const RELEVANT: [(&str, &str); 10] = [
    ("store", "build plan why check release gc study info submit status cancel"),
    ("jobs", "build plan release audit render simulate stress study train trajectory"),
    ("keep_going", "build release"),
    ("backend", RENDERING),
    ("gpu", RENDERING),
    ("gpu_without", RENDERING),
    ("no_omit", "build plan why check release gc render study submit status cancel"),
    ("allow_commands", "build release submit"),
    ("no_wait", "build release gc submit"),
    ("verbose", "build release"),
];

/// Verbs that render, or that compute the keys of what is rendered.
const RENDERING: &str = "doctor build plan why check release gc render study stress audit train trajectory submit \
                         status cancel";

fn hide_irrelevant(command: clap::Command) -> clap::Command {
    let common: Vec<clap::Arg> = command.get_arguments().filter(|arg| arg.is_global_set()).cloned().collect();
    command.mut_subcommands(|verb| {
        let name = verb.get_name().to_owned();
        let is_irrelevant = |arg: &&clap::Arg| {
            let known = RELEVANT.iter().find(|(id, _)| arg.get_id() == *id);
            known.is_some_and(|(_, verbs)| !verbs.split(' ').any(|verb| verb == name))
        };
        // A common option that the verb has itself is not passed down to it, so it stays hidden.
        verb.args(common.iter().filter(is_irrelevant).cloned().map(|arg| arg.hide(true)))
    })
}

pub(super) fn parse(arguments: &[OsString]) -> Result<Cli, clap::Error> {
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
pub(super) fn wants_json(arguments: &[OsString]) -> bool {
    // Words after `--` are values.
    arguments.iter().skip(1).take_while(|word| *word != "--").any(|word| word == "--json")
}

/// The error for a command line that cannot be parsed.
pub(super) fn misread(arguments: &[OsString], error: clap::Error) -> VerbError {
    // The parser repeats words unchanged, and a hidden character in them could act on the terminal.
    // So the words are parsed again in their visible form.
    let visible_words = arguments.iter().map(|word| OsString::from(visible(word)));
    let repeat = with_negative_numbers(command_line()).try_get_matches_from(visible_words).err();
    // An escaped word may fail for another reason than the original; the original error counts
    // then.
    let error = repeat.filter(|repeat| repeat.kind() == error.kind()).unwrap_or(error);
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
