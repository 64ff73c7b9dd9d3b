//! Programs of other people: how they are found and run.
//!
//! A name is looked for only in the absolute folders of `PATH`, and the program is run by the
//! absolute path at which it was found. Therefore no file of the current folder, of a recipe's
//! folder or of a release can replace a program.
//!
//! Every program runs under a supervisor: this program itself, started again with [`SUPERVISE`] as
//! its first argument. The supervisor holds one end of a socket, and the process that started it
//! holds the other. When the socket closes, for whatever reason, the supervisor kills the program
//! and all processes that the program started. Without the supervisor, a program would go on after
//! a `kill -9` of the build, in a folder that the next build deletes.

mod log;
mod piped;
mod process;
mod quoted;
mod report;

pub use piped::{PipedProgram, WatchedProgram};
pub use process::{EndKind, ProgramCall, ProgramEnd, ProgramFailure, run, run_within};
pub use quoted::quoted;
pub use report::{NoReport, ProgramReport};

pub use log::{last_lines, last_lines_in, length, says};

use rustix::fs::Access;
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};

/// First argument of this program when it supervises another one. The path and the arguments of
/// that program follow.
///
/// Stdin is the socket: a byte that arrives asks the program to end, the end of the socket kills
/// the program, and a [`ProgramReport`] is written to it. The output of the program goes to stderr.
/// Stdout is held open and not used.
pub const SUPERVISE: &str = "supervise-program";

/// The programs that can be run. The default value finds none.
#[derive(Debug, Clone, Default)]
pub struct ProgramFinder {
    /// Absolute folders in which names are looked for.
    folders: Vec<PathBuf>,
    supervisor: PathBuf,
    /// Held open by every supervisor.
    held: Option<Arc<File>>,
    /// Answers by the words of the command.
    answers: Arc<Mutex<BTreeMap<String, Answer>>>,
}

/// The output of a program, or the reason why it could not be asked.
type Answer = Result<String, String>;

/// Maximum bytes of an answer that are read.
const MAX_ANSWER: u64 = 1 << 20;
/// Seconds that an answer may take. Importing OpenCV on a network file system takes a minute.
const MAX_ANSWER_SECONDS: u32 = 300;

impl ProgramFinder {
    /// Finds programs in the folders of `path`, the value of the variable `PATH`, without its
    /// relative and empty entries. `supervisor` is the path of this program.
    #[must_use]
    pub fn new(path: Option<&OsStr>, supervisor: PathBuf) -> Self {
        Self { folders: path.map(absolute_folders).unwrap_or_default(), supervisor, ..Self::default() }
    }

    /// Finds the same programs. `file` stays open, with its lock, until the last of them has ended.
    #[must_use]
    pub fn holding(&self, file: File) -> Self {
        Self { held: Some(Arc::new(file)), ..self.clone() }
    }

    /// The absolute path of a program: `program` itself if it is absolute, else the first
    /// executable file of that name.
    ///
    /// # Errors
    /// No folder has it, or it is a relative path and not a name.
    pub fn find(&self, program: &Path) -> io::Result<PathBuf> {
        find_in(&self.folders, program)
    }

    /// The output of a program that is run with these arguments, whatever its exit code. It is run
    /// once, in the root folder, where no stranger can put files.
    ///
    /// # Errors
    /// A sentence for the user if no program has this name, or it cannot be started.
    pub fn ask(&self, program: &str, arguments: &[&str]) -> Answer {
        // No argument of a program can contain NUL.
        let command = [&[program], arguments].concat().join("\0");
        // The lock is held while the program runs, so two askers at the same time run it once.
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        answers.entry(command).or_insert_with(|| self.ask_now(program, arguments)).clone()
    }

    fn ask_now(&self, program: &str, arguments: &[&str]) -> Answer {
        let not_started = |error: io::Error| match error.kind() {
            io::ErrorKind::NotFound => format!("there is no program `{program}`"),
            _ => format!("the program `{program}` cannot be started: {error}"),
        };
        let invocation = ProgramCall {
            program: program.into(),
            arguments: arguments.iter().map(OsString::from).collect(),
            // Programs with a Qt user interface abort without a display unless Qt draws off screen.
            environment: BTreeMap::from([("QT_QPA_PLATFORM".to_owned(), "offscreen".to_owned())]),
            folder: PathBuf::from("/"),
        };
        let (printed, ended) = self.output_of(&invocation, MAX_ANSWER, MAX_ANSWER_SECONDS);
        match ended {
            Err(ProgramEnd::Failed(EndKind::NotStarted(error))) => Err(not_started(error)),
            Err(ProgramEnd::Failed(how @ EndKind::TooLong(_))) => {
                Err(format!("the program `{program}`: {how}"))
            }
            // Some programs print their version and end with an error code.
            _ => Ok(printed),
        }
    }

    /// Runs a program to its end, for at most `seconds`. Returns at most `limit` bytes of its output, and how
    /// it ended.
    pub fn output_of(
        &self,
        call: &ProgramCall,
        limit: u64,
        seconds: u32,
    ) -> (String, Result<(), ProgramEnd>) {
        let (reader, writer) = match io::pipe() {
            Ok(ends) => ends,
            Err(error) => return (String::new(), Err(ProgramEnd::Failed(EndKind::NotStarted(error)))),
        };
        std::thread::scope(|scope| {
            // The pipe is read while the program runs: a full pipe would block it.
            let printed = scope.spawn(move || log::read_text(reader, limit));
            let ended = process::within(seconds, &|| true, |goes_on| {
                process::run_into(self, call, Stdio::from(writer), goes_on)
            });
            (printed.join().unwrap_or_default(), ended)
        })
    }

    /// The value of `PATH` for programs that are run: the folders in which they were found.
    fn path(&self) -> Option<OsString> {
        (!self.folders.is_empty()).then(|| {
            let folders: Vec<&OsStr> = self.folders.iter().map(|folder| folder.as_os_str()).collect();
            folders.join(OsStr::new(":"))
        })
    }
}

/// The absolute folders among the entries of a `PATH`.
fn absolute_folders(path: &OsStr) -> Vec<PathBuf> {
    let entries = path.as_bytes().split(|byte| *byte == b':');
    let folders = entries.map(|entry| PathBuf::from(OsStr::from_bytes(entry)));
    folders.filter(|folder| folder.is_absolute()).collect()
}

fn find_in(folders: &[PathBuf], program: &Path) -> io::Result<PathBuf> {
    if program.is_absolute() {
        return Ok(program.to_owned());
    }
    // `./tool` would depend on the current folder.
    if program.file_name() != Some(program.as_os_str()) {
        let because = format!("{} is a relative path, wanted a name or an absolute path", program.display());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, because));
    }
    let is_program = |file: &PathBuf| {
        // Folders pass the access check below as well.
        file.metadata().is_ok_and(|about| about.is_file())
            && rustix::fs::access(file, Access::EXEC_OK).is_ok()
    };
    folders.iter().map(|folder| folder.join(program)).find(is_program).ok_or_else(|| {
        io::Error::new(io::ErrorKind::NotFound, "no absolute folder in PATH has a program with this name")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn relative_and_empty_entries_of_path_are_skipped() {
        let t = |path: &str, wanted: &[&str]| {
            let wanted: Vec<PathBuf> = wanted.iter().map(PathBuf::from).collect();
            assert_eq!(absolute_folders(OsStr::new(path)), wanted, "{path}");
        };
        t("", &[]);
        t("/usr/bin", &["/usr/bin"]);
        t(":/usr/bin::.:bin:../x:/bin:", &["/usr/bin", "/bin"]);
    }

    #[test]
    fn the_first_executable_file_of_the_name_is_found() {
        let place = tempfile::tempdir().unwrap();
        let folders = ["a", "b", "c", "d"].map(|name| place.path().join(name));
        folders.iter().for_each(|folder| std::fs::create_dir(folder).unwrap());
        let put = |folder: usize, mode: u32| {
            let file = folders[folder].join("tool");
            std::fs::write(&file, "#!/bin/sh\n").unwrap();
            std::fs::set_permissions(file, std::fs::Permissions::from_mode(mode)).unwrap();
        };
        std::fs::create_dir(folders[0].join("tool")).unwrap();
        put(1, 0o644);
        put(2, 0o755);
        put(3, 0o755);
        let find = |program: &str| find_in(&folders, Path::new(program)).map_err(|error| error.kind());
        assert_eq!(find("tool"), Ok(folders[2].join("tool")));
        assert_eq!(find("/bin/sh"), Ok("/bin/sh".into()));
        assert_eq!(find("other"), Err(io::ErrorKind::NotFound));
        for path in ["./tool", "c/tool", "..", "tool/", ""] {
            assert_eq!(find(path), Err(io::ErrorKind::InvalidInput), "{path}");
        }
    }
}
