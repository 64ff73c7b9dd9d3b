//! Tests that do not run because the machine lacks something: named, listed, and failures where the thing
//! is required.

use std::io::Write as _;

/// Says that the current test does not run in full, and why. `NOT_RUN_LIST` names a file that gets a line
/// for it: `cargo xtask test` reads that list for its last line.
pub(crate) fn not_run(why: &str) {
    let thread = std::thread::current();
    // libtest names the thread of a test after the test.
    let line = format!("{} ({why})\n", thread.name().unwrap_or("a test"));
    // Past the capture of the test's output, since the test passes; at once, since others write too.
    drop(std::io::stderr().write_all(format!("not run: {line}").as_bytes()));
    if let Some(list) = std::env::var_os("NOT_RUN_LIST") {
        let mut list = std::fs::OpenOptions::new().create(true).append(true).open(list).unwrap();
        list.write_all(line.as_bytes()).unwrap();
    }
}

/// The same for something that `require`, an environment variable, makes a failure when it is 1.
pub(crate) fn absent(require: &str, why: &str) {
    assert!(std::env::var(require).as_deref() != Ok("1"), "{why}, and {require} is 1");
    not_run(why);
}
