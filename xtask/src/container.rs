//! A container without an engine: the program under a read-only root, as an unknown user.

use crate::command::{Outcome, cargo, program, root, say};
use std::ffi::OsStr;

const SCRIPT: &str = "tests/container/read_only.sh";
const DEMO: &str = "recipes/demo.yaml";

/// Builds the demo with the program in `args`, or with the one of a release build.
pub(crate) fn run(args: &[String]) -> Outcome {
    let own = root().join("target/release/gs2e");
    let tried = match args {
        [] => {
            cargo(&["build", "--quiet", "--release"]).run()?;
            own.into_os_string()
        }
        [tried] => std::path::absolute(tried).map_err(|e| format!("{tried}: {e}"))?.into_os_string(),
        _ => return Err("wanted at most one program".to_owned()),
    };
    let alone =
        ["--user", "--mount", "--map-user=12345", "--keep-caps", "mount", "-t", "tmpfs", "none", "/mnt"];
    if !program(OsStr::new("unshare"), &alone).succeeds() {
        say("absent: user namespaces: the program was not tried under a read-only root");
        return Ok(());
    }
    program(root().join(SCRIPT).as_os_str(), &[tried.as_os_str(), OsStr::new(DEMO)]).run()
}
