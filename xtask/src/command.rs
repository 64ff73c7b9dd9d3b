//! Commands run in the repository's root, and messages about them.

use std::ffi::OsStr;
use std::fmt;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// The reason why a task stopped: a sentence for users.
pub(crate) type Outcome<T = ()> = Result<T, String>;

/// The repository's root: the folder above this crate.
pub(crate) fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().expect("xtask lies in the repository").to_owned()
}

/// Prints a message to stderr.
pub(crate) fn say(line: &str) {
    // A closed stderr is no reason to stop the work.
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// A command that will run in the repository's root.
pub(crate) struct Task(Command);

/// The cargo that runs this program, with these arguments.
pub(crate) fn cargo<A: AsRef<OsStr>>(args: &[A]) -> Task {
    program(&std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()), args)
}

/// Any other program.
pub(crate) fn program<A: AsRef<OsStr>>(name: &OsStr, args: &[A]) -> Task {
    let mut command = Command::new(name);
    command.args(args).current_dir(root());
    Task(command)
}

impl Task {
    /// Adds arguments.
    pub(crate) fn args<A: AsRef<OsStr>>(mut self, args: impl IntoIterator<Item = A>) -> Self {
        self.0.args(args);
        self
    }

    /// Sets an environment variable.
    pub(crate) fn env(mut self, name: &str, value: &str) -> Self {
        self.0.env(name, value);
        self
    }

    /// Runs the command, with its output going to ours.
    pub(crate) fn run(mut self) -> Outcome {
        let status = self.0.status().map_err(|e| self.not_started(&e))?;
        if status.success() { Ok(()) } else { Err(format!("`{self}` ended with {status}")) }
    }

    /// Runs the command and keeps its stdout and stderr. An exit code other than 0 is an error that
    /// shows both.
    pub(crate) fn capture(mut self) -> Outcome<Output> {
        let output = self.0.stdin(Stdio::null()).output().map_err(|e| self.not_started(&e))?;
        if output.status.success() {
            return Ok(output);
        }
        let [out, err] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
        Err(format!("`{self}` ended with {}\n{out}{err}", output.status))
    }

    /// Runs the command and keeps its stdout and stderr, whatever its exit code.
    pub(crate) fn any_code(mut self) -> Outcome<Output> {
        self.0.stdin(Stdio::null()).output().map_err(|e| self.not_started(&e))
    }

    /// Returns true if the command runs and ends with 0. Prints nothing.
    pub(crate) fn succeeds(mut self) -> bool {
        let quiet = self.0.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        quiet.status().is_ok_and(|status| status.success())
    }

    /// Runs the command and passes stdout on line by line. Returns true if it ended with 0.
    pub(crate) fn each_line(mut self, mut line: impl FnMut(&str)) -> Outcome<bool> {
        use std::io::BufRead as _;
        let mut child = self.0.stdout(Stdio::piped()).spawn().map_err(|e| self.not_started(&e))?;
        let stdout = child.stdout.take().expect("stdout is piped");
        for text in std::io::BufReader::new(stdout).split(b'\n') {
            let text = text.map_err(|e| format!("the output of `{self}` cannot be read: {e}"))?;
            line(&String::from_utf8_lossy(&text));
        }
        let status = child.wait().map_err(|e| format!("`{self}` cannot be waited for: {e}"))?;
        Ok(status.success())
    }

    fn not_started(&self, why: &std::io::Error) -> String {
        format!("`{self}` cannot be started: {why}")
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Path::new(self.0.get_program()).file_stem().unwrap_or_default();
        write!(f, "{}", name.to_string_lossy())?;
        self.0.get_args().try_for_each(|arg| write!(f, " {}", arg.to_string_lossy()))
    }
}
