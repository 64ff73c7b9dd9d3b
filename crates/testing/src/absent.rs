//! Tests that do not run because the machine lacks something: named, listed, and failures where the
//! thing is required.

use std::fmt::Display;
use std::io::Write as _;

/// Reports that the current test does not run in full, with the reason. `NOT_RUN_LIST` names a file
/// that gets a line for it: `cargo xtask test` reads this list for its last line.
pub fn not_run(why: &str) {
    let thread = std::thread::current();
    // libtest names the thread of a test after the test.
    let line = format!("{} ({why})\n", thread.name().unwrap_or("a test"));
    // Written directly, past the captured output, since the test passes; in one call, since other
    // threads write too.
    drop(std::io::stderr().write_all(format!("not run: {line}").as_bytes()));
    if let Some(list) = std::env::var_os("NOT_RUN_LIST") {
        let mut list = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(list)
            .expect("the list can be written");
        list.write_all(line.as_bytes()).expect("the list can be written");
    }
}

/// Returns true if slow tests were asked for (`RUN_SLOW_TESTS=1`).
pub fn is_thorough() -> bool {
    std::env::var("RUN_SLOW_TESTS").as_deref() == Ok("1")
}

/// [`is_thorough`]. If slow tests were not asked for, reports that the current one does not run in full.
pub fn runs_slow_tests() -> bool {
    let thorough = is_thorough();
    if !thorough {
        not_run("RUN_SLOW_TESTS is not set");
    }
    thorough
}

/// Reports that something is absent. If the environment variable `require` is 1, that is a failure.
pub fn absent(require: &str, why: &str) {
    assert!(std::env::var(require).as_deref() != Ok("1"), "{why}, and {require} is 1");
    not_run(why);
}

/// What was found. If nothing was, reports that it is [`absent`].
pub fn present<T>(require: &str, found: Result<T, impl Display>) -> Option<T> {
    found.map_err(|because| absent(require, &because.to_string())).ok()
}
