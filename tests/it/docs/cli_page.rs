//! `docs/cli.md`: every verb and option, as the program itself parses them.

use super::markdown::wrapped;
use clap::{Arg, ArgAction, Command};
use std::fmt::Write as _;

/// The page's generated part.
pub(super) fn markdown() -> String {
    let mut program = gs2e::cli::command_line();
    program.build();
    let mut out = String::from("\n## Common options\n\nEvery verb takes these.\n\n");
    let common: Vec<&Arg> = program.get_arguments().filter(|arg| arg.is_global_set()).collect();
    out.push_str(&table(&common));
    for verb in program.get_subcommands().filter(|verb| verb.get_name() != "help") {
        describe(verb, "gs2e", &mut out);
    }
    out
}

fn describe(verb: &Command, before: &str, out: &mut String) {
    let name = format!("{before} {}", verb.get_name());
    let about = verb.get_about().map(ToString::to_string).unwrap_or_default();
    let _ = write!(out, "\n## {name}\n\n{}.\n\n", plain(&about));
    let _ = write!(out, "```text\n{}\n```\n\n", usage(verb, &name));
    let hidden = |arg: &&Arg| arg.is_global_set() || matches!(arg.get_id().as_str(), "help" | "version");
    let own: Vec<&Arg> = verb.get_arguments().filter(|arg| !hidden(arg)).collect();
    if !own.is_empty() {
        out.push_str(&table(&own));
    }
    if let Some(more) = verb.get_after_help() {
        let _ = write!(out, "\n{}\n", wrapped(&plain(&more.to_string())));
    }
    for inner in verb.get_subcommands().filter(|inner| inner.get_name() != "help") {
        describe(inner, &name, out);
    }
}

/// The verb, its required options and its arguments.
fn usage(verb: &Command, name: &str) -> String {
    let own = || verb.get_arguments().filter(|arg| !arg.is_global_set());
    let required = own().filter(|arg| !arg.is_positional() && arg.is_required_set()).map(written);
    let positional = own().filter(|arg| arg.is_positional()).map(|arg| {
        let value = value(arg);
        let more = if arg.get_num_args().is_some_and(|range| range.max_values() > 1) { "…" } else { "" };
        if arg.is_required_set() { format!("<{value}>{more}") } else { format!("[{value}]{more}") }
    });
    let words =
        [name.to_owned()].into_iter().chain(required).chain(["[OPTIONS]".to_owned()]).chain(positional);
    words.collect::<Vec<_>>().join(" ")
}

fn table(arguments: &[&Arg]) -> String {
    let mut out = String::from("| option | default | meaning |\n|---|---|---|\n");
    for arg in arguments {
        let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
        let (help, stated) = match help.rsplit_once(" [default: ") {
            Some((help, stated)) => (help.to_owned(), stated.trim_end_matches(']').to_owned()),
            None => (help, String::new()),
        };
        let default = if arg.is_required_set() { "required".to_owned() } else { default(arg, &stated) };
        let _ = writeln!(out, "| `{}` | {default} | {}{} |", written(arg), plain(&help), choices(arg));
    }
    out
}

/// The option as typed.
fn written(arg: &Arg) -> String {
    if arg.is_positional() {
        return value(arg);
    }
    let short = arg.get_short().map(|short| format!("-{short}"));
    let long = arg.get_long().map(|long| format!("--{long}"));
    let names = short.into_iter().chain(long).collect::<Vec<_>>().join(", ");
    let takes_value = matches!(arg.get_action(), ArgAction::Set | ArgAction::Append);
    if takes_value { format!("{names} <{}>", value(arg)) } else { names }
}

fn value(arg: &Arg) -> String {
    let names = arg.get_value_names().unwrap_or_default();
    names.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

fn default(arg: &Arg, stated: &str) -> String {
    let takes_value = matches!(arg.get_action(), ArgAction::Set | ArgAction::Append);
    let values: Vec<String> =
        arg.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()).collect();
    match (takes_value, values.is_empty()) {
        (true, false) => format!("`{}`", values.join(",")),
        _ => plain(stated),
    }
}

/// The values of an option, with their meaning if it is stated.
fn choices(arg: &Arg) -> String {
    let takes_value = matches!(arg.get_action(), ArgAction::Set | ArgAction::Append);
    let values = arg.get_possible_values();
    if !takes_value || values.is_empty() {
        return String::new();
    }
    if values.iter().all(|value| value.get_help().is_none()) {
        let names: Vec<String> = values.iter().map(|value| format!("`{}`", value.get_name())).collect();
        return format!(". One of {}", names.join(", "));
    }
    let line = |value: &clap::builder::PossibleValue| {
        let help = value.get_help().map(|help| format!(": {}", plain(&help.to_string()))).unwrap_or_default();
        format!("<br>`{}`{help}", value.get_name())
    };
    values.iter().map(line).collect()
}

/// The text without characters that Markdown would read as markup.
fn plain(text: &str) -> String {
    text.split('`')
        .enumerate()
        .map(|(i, part)| match i % 2 {
            0 => part.replace('|', "\\|").replace('*', "\\*").replace('<', "&lt;"),
            _ => format!("`{}`", part.replace('|', "\\|")),
        })
        .collect()
}
