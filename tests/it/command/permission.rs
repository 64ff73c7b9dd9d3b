//! No program of a recipe runs unless the user allows it.

use super::{COPY, edit, runs, trained_by, with_tiny};
use crate::messages::check;
use std::fs;

#[test]
fn without_permission_the_command_is_shown_and_nothing_runs() {
    let place = trained_by(COPY);
    with_tiny(&place);
    let ended = place.gs2e("build --json recipe.yaml tiny.yaml");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    check(&place, "command-refused", &ended);
    assert_eq!(place.stale("tiny.yaml").len(), 6, "nothing ran");
    assert_eq!(place.gs2e("release --to out recipe.yaml").code, 2);
    assert_eq!(runs(&place), 0);
    place.ok("plan recipe.yaml");
    place.ok("why trained/reconstruct --recipes recipe.yaml");
}

#[test]
fn without_permission_the_other_scenes_continue_on_request() {
    let place = trained_by(COPY);
    with_tiny(&place);
    let ended = place.gs2e("build -k -j 1 --json recipe.yaml tiny.yaml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    check(&place, "command-refused-keep-going", &ended);
    assert_eq!(place.stale("tiny.yaml"), [""; 0]);
    assert_eq!(runs(&place), 0);
}

/// A command line that tries to hide its contents on the terminal.
#[test]
fn a_shown_command_cannot_hide_its_contents() {
    let place = trained_by(COPY);
    edit(&place, "\"{planted}\"]", "\"{planted}\", \"\\u001b[2J\", \"; rm -rf \\u202e~\"]");
    let ended = place.gs2e("build recipe.yaml");
    assert_eq!(ended.code, 2);
    assert!(ended.stderr.contains(r"'\u{1b}[2J' '; rm -rf \u{202e}~'"), "{}", ended.stderr);
    assert!(!ended.stderr.contains(['\u{1b}', '\u{202e}']), "{:?}", ended.stderr);
}

#[test]
fn no_shell_reads_its_arguments() {
    let place = trained_by(&format!("{COPY}; shift 3; printf '<%s>\\n' \"$@\""));
    let odd = "\"$(touch x)\", \"`touch x`\", \"a b; touch x\", \"*\", \"\", \"{{out}}\", \"~\"";
    edit(&place, "\"{planted}\"]", &format!("\"{{planted}}\", {odd}]"));
    place.ok("build -q --allow-commands recipe.yaml");
    let logs: Vec<_> = fs::read_dir(place.path(".gs2e/logs")).unwrap().map(|e| e.unwrap().path()).collect();
    let log = fs::read_to_string(&logs[0]).unwrap();
    let said: Vec<&str> = log.lines().filter(|line| line.starts_with('<')).collect();
    assert_eq!(
        said,
        ["<$(touch x)>", "<`touch x`>", "<a b; touch x>", "<*>", "<>", "<{out}>", "<~>"],
        "{log}"
    );
    let touched = walkdir::WalkDir::new(place.path(".")).into_iter().any(|e| e.unwrap().file_name() == "x");
    assert!(!touched);
}
