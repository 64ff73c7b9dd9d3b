//! Programs under the supervisor: their output, the reports of their ends, and their leftover
//! processes.

use crate::support::foreign::programs;
use gs2e_files::programs::{
    EndKind, ProgramCall, ProgramEnd, ProgramFinder, last_lines, length, run, run_within, says,
};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;

fn shell(script: &str, folder: &Path) -> ProgramCall {
    ProgramCall {
        program: "/bin/sh".into(),
        arguments: ["-c", script].map(OsString::from).to_vec(),
        environment: BTreeMap::from([("WORD".to_owned(), "a $b".to_owned())]),
        folder: folder.to_owned(),
    }
}

#[test]
fn output_and_exit_of_a_program_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    let t = |script: &str, wanted: &str, said: &str| {
        let from = length(&log);
        let ended = run(&programs(), &shell(script, folder.path()), &log, &|| true);
        let found = match ended {
            Ok(()) => "fine".to_owned(),
            Err(ProgramEnd::Failed(how)) => how.to_string(),
            Err(ProgramEnd::Stopped) => "stopped".to_owned(),
        };
        assert_eq!(found, wanted, "{script}");
        assert_eq!(last_lines(&log, from)[1..].join("|"), said, "{script}");
    };
    t("echo out; echo err >&2", "fine", "out|err");
    t("echo $WORD; pwd | grep -c .; cat", "fine", "a $b|1");
    t("printf '1%%\\r2%%\\n\\n\\033[1mbold'; exit 3", "it ended with exit code 3", "2%|[1mbold");
    t("kill -9 $$", "signal 9 ended it", "");
    t("seq 100", "fine", &(82..=100).map(|n| n.to_string()).collect::<Vec<_>>().join("|"));
}

/// A command line that holds the version is no proof of the program's version.
#[test]
fn a_command_line_is_no_proof_of_a_version() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log");
    run(&programs(), &shell(": 1.1.4", folder.path()), &log, &|| true).unwrap();
    assert!(!says(&log, 0, "1.1.4"), "{}", std::fs::read_to_string(&log).unwrap());
    run(&programs(), &shell("echo 1.1.4", folder.path()), &log, &|| true).unwrap();
    assert!(says(&log, 0, "1.1.4"));
}

#[test]
fn a_missing_program_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let missing = ProgramCall { program: "/no/such/program".into(), ..shell("", folder.path()) };
    let ended = run(&programs(), &missing, &folder.path().join("log"), &|| true);
    let Err(ProgramEnd::Failed(how)) = ended else { panic!("{ended:?}") };
    assert!(how.to_string().starts_with("it cannot be started: "), "{how}");
}

/// Runs a script that holds the pipe `held` open, and returns when no process holds it any more.
fn run_holding(script: &str, folder: &Path, goes_on: &dyn Fn() -> bool) -> Result<(), ProgramEnd> {
    let pipe = folder.join("held");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| std::fs::read(&pipe).unwrap());
        let script = format!("exec 9> held; {script}");
        let ended = run(&programs(), &shell(&script, folder), &folder.join("log"), goes_on);
        reader.join().unwrap();
        ended
    })
}

#[test]
fn nothing_outlives_a_program() {
    let folder = tempfile::tempdir().unwrap();
    assert!(run_holding("sleep 600 & echo started", folder.path(), &|| true).is_ok());
}

#[test]
fn a_slow_program_is_stopped_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let run = |seconds, script: &str| {
        run_within(seconds, &programs(), &shell(script, folder.path()), &folder.path().join("log"), &|| true)
    };
    let ended = run(0, "sleep 600");
    assert!(matches!(ended, Err(ProgramEnd::Failed(EndKind::TooLong(0)))), "{ended:?}");
    assert!(run(60, ":").is_ok());
}

#[test]
fn a_stopped_program_ends_with_its_children() {
    let folder = tempfile::tempdir().unwrap();
    let at_work = folder.path().join("at work");
    let script = "trap 'echo stopping; exit 0' TERM; sleep 600 & : > 'at work'; wait";
    let ended = run_holding(script, folder.path(), &|| !at_work.exists());
    assert!(matches!(ended, Err(ProgramEnd::Stopped)), "{ended:?}");
    assert!(
        std::fs::read_to_string(folder.path().join("log")).unwrap().contains("stopping"),
        "it was asked before it was made to"
    );
}

#[test]
fn an_answer_is_the_output_of_a_program() {
    let programs = programs();
    assert_eq!(programs.ask("sh", &["-c", "pwd; echo $PWD; exit 3"]).unwrap(), "/\n/\n");
    let absent = programs.ask("no-such-program", &[]).unwrap_err();
    assert_eq!(absent, "there is no program `no-such-program`");
    // The answer is longer than the limit: the rest is neither waited for nor kept.
    let long = programs.ask("sh", &["-c", "while :; do echo 0123456789; done"]).unwrap();
    assert_eq!(long.len(), 1 << 20);
    let none = ProgramFinder::default().ask("sh", &["-c", ":"]).unwrap_err();
    assert_eq!(none, "there is no program `sh`");
}
