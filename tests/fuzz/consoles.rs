//! Mutated names from outside, each placed wherever a foreign name may enter, and shown by the
//! program itself on a pipe or a terminal. No name may reach the output as more than text.

use crate::command_lines::TINY;
use crate::corpus::Corpus;
use crate::inert;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::Read as _;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Names that act on a terminal, one of each kind.
const NAMES: [&str; 18] = [
    "plain",
    "\u{1b}[31mred",
    "\u{1b}]0;title\u{7}",
    "\u{1b}]8;;http://x\u{1b}\\link",
    "\u{1b}P1$r\u{1b}\\",
    "\u{1b}c",
    "\u{1b}[2J\u{1b}[1;1H",
    "\u{1b}[5A\u{1b}[99D",
    "\u{1b}[?1049h",
    "\u{9b}31m\u{9d}0;x\u{9c}",
    "a\nerror: FAKE",
    "a\rerror: FAKE",
    "\u{8}\u{8}\u{8}x\u{7f}",
    "\u{202e}gnp.exe",
    "\u{2066}x\u{2069}\u{200f}\u{61c}",
    "a\u{2028}b\u{2029}c\u{85}d",
    "\u{feff}\u{200b}\u{e0041}",
    "\"'\\`$(x){y}",
];

/// The names. All bytes of a name decide where it is placed and which command shows it.
pub(crate) fn corpus() -> Corpus {
    NAMES.into_iter().map(|name| (format!("{name:?}"), name.as_bytes().to_vec())).collect()
}

/// Shows a name. Always returns true, since any exit code is right for some name.
pub(crate) fn read(name: &[u8]) -> bool {
    let text = String::from_utf8_lossy(name).replace('\0', "");
    let sum = name.iter().fold(7_usize, |sum, byte| sum.wrapping_mul(31).wrapping_add(usize::from(*byte)));
    let (place, stream) = (sum % PLACES.len(), sum / PLACES.len());
    let stage = Stage::new();
    let lines = PLACES[place](&stage, &text);
    for words in lines {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
        command.args(&words).current_dir(&stage.folder).stdin(Stdio::null());
        // The environment is untrusted as well.
        command.env("TERM", if stream & 2 == 0 { "xterm" } else { "dumb" });
        for (k, name) in
            ["LANG", "NO_COLOR", "CLICOLOR_FORCE", "COLUMNS", "RUST_LOG", "XDG_CACHE_HOME"].iter().enumerate()
        {
            if stream >> (k + 2) & 1 == 1 {
                command.env(name, &text);
            }
        }
        if stream & 1 == 0 {
            let output = command.output().unwrap();
            ended(output.status.code(), &words);
            for bytes in [output.stdout, output.stderr] {
                inert::judge(std::str::from_utf8(&bytes).expect("it speaks UTF-8"));
            }
        } else {
            let (code, bytes) = on_terminal(command);
            ended(code, &words);
            // The parser's help is coloured on a terminal, and holds no name.
            inert::judge_terminal(&bytes);
        }
    }
    true
}

fn ended(code: Option<i32>, words: &[OsString]) {
    assert!(matches!(code, Some(0..=3)), "{code:?}: {words:?}");
}

/// Runs a command with a terminal as its stdout and stderr. Returns its exit code and its output.
fn on_terminal(mut command: Command) -> (Option<i32>, Vec<u8>) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let terminal = File::options().read(true).write(true).open(OsStr::from_bytes(name.to_bytes())).unwrap();
    let mut child = command.stdout(terminal.try_clone().unwrap()).stderr(terminal).spawn().unwrap();
    // The command holds the terminal open; the end of the output would never be seen.
    drop(command);
    let mut bytes = Vec::new();
    // Reading from a terminal that is no longer open elsewhere is an error.
    let _ = File::from(master).read_to_end(&mut bytes);
    (child.wait().unwrap().code(), bytes)
}

/// The folder of one run.
struct Stage {
    folder: PathBuf,
}

impl Stage {
    fn new() -> Self {
        let folder = std::env::current_dir().unwrap().join("stage");
        if folder.exists() {
            fs::remove_dir_all(&folder).unwrap();
        }
        fs::create_dir(&folder).unwrap();
        Self { folder }
    }

    fn write(&self, path: impl AsRef<Path>, content: impl AsRef<[u8]>) {
        let path = self.folder.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// Copies a release into the stage, where its files may be changed.
    fn release(&self, to: &str) {
        let made = std::env::current_dir().unwrap().join("made");
        if !made.exists() {
            self.write("tiny.yaml", TINY);
            let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
            command
                .args(["release", "-q", "--copy", "--to", "../made", "tiny.yaml"])
                .current_dir(&self.folder);
            assert!(command.status().unwrap().success());
        }
        for entry in
            walkdir::WalkDir::new(&made).into_iter().map(Result::unwrap).filter(|e| e.file_type().is_file())
        {
            self.write(
                Path::new(to).join(entry.path().strip_prefix(&made).unwrap()),
                fs::read(entry.path()).unwrap(),
            );
        }
    }

    /// Replaces a text in a file.
    fn edit(&self, file: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.folder.join(file)).unwrap();
        self.write(file, text.replace(from, to));
    }
}

/// Puts a name into a place, and returns the command lines that show it.
type Put = fn(&Stage, &str) -> Vec<Vec<OsString>>;

/// Places where foreign text enters.
const PLACES: [Put; 9] = [
    // A path of a recipe.
    |stage, name| {
        let source = format!("source: {{ nerfstudio: {{ path: {} }} }}", quoted(name));
        stage.write("r.yaml", with(TINY, "source:", &source) + "reconstruct: { given: { path: x.ply } }\n");
        lines(&["build r.yaml", "plan --json r.yaml"])
    },
    // A scene's id.
    |stage, name| {
        stage.write("r.yaml", with(TINY, "scene:", &format!("scene: {}", quoted(name))));
        lines(&["plan r.yaml", "plan --json r.yaml"])
    },
    // A key.
    |stage, name| {
        stage.write("r.yaml", format!("{TINY}{}: 1\n", quoted(name)));
        lines(&["build r.yaml", "build --json r.yaml"])
    },
    // The text of a recipe, verbatim.
    |stage, name| {
        stage.write("r.yaml", format!("{TINY}note: {name}\n"));
        lines(&["plan r.yaml"])
    },
    // The name of a file that the program reads.
    |stage, name| {
        let name = file_name(name);
        stage.write(format!("data/{name}.yaml"), "nothing");
        stage.write(format!("data/{name}.csv"), "nothing");
        let mut lines = lines(&["plan data", "plan --json data", "convert --json"]);
        lines[2].extend([format!("data/{name}.csv").into(), "x.h5".into()]);
        lines
    },
    // A word of the command line.
    |_, name| {
        vec![
            vec![name.into()],
            vec!["build".into(), format!("--{name}").into()],
            vec!["why".into(), "--json".into(), name.into()],
        ]
    },
    // The name of a photo.
    |stage, name| {
        let frames = serde_json::json!({ "w": 16, "h": 12, "fl_x": 9, "fl_y": 9, "cx": 8, "cy": 6, "frames": [
            { "file_path": name, "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] },
            { "file_path": name, "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] }
        ] });
        stage.write("data/t/transforms.json", frames.to_string());
        lines(&[
            "init nerfstudio data --to r",
            "init --json nerfstudio data --to q --min-views 1 --min-side 1",
            "build r",
        ])
    },
    // The name of a file in a release.
    |stage, name| {
        stage.release("out");
        stage.write(format!("out/{}", file_name(name)), "nothing");
        lines(&["audit out", "audit --json out"])
    },
    // Ids and verdicts of a release.
    |stage, name| {
        stage.release("out");
        stage.release("other");
        for file in ["manifest.json", "tiny/scene.json", "tiny/base/checks.json"] {
            let name = serde_json::Value::from(name).to_string();
            stage.edit(&format!("other/{file}"), "\"tiny\"", &name);
            stage.edit(&format!("other/{file}"), "\"pass\"", &name);
        }
        lines(&["diff out other", "diff --json out other", "check --tree other", "audit other"])
    },
];

fn lines(lines: &[&str]) -> Vec<Vec<OsString>> {
    lines.iter().map(|line| line.split(' ').map(OsString::from).collect()).collect()
}

/// A text quoted for YAML.
fn quoted(text: &str) -> String {
    gs2e_files::escape::quoted(text)
}

/// The recipe, with the line that starts with `begins` replaced by `other`.
fn with(recipe: &str, begins: &str, other: &str) -> String {
    let line = |line: &str| if line.starts_with(begins) { format!("{other}\n") } else { format!("{line}\n") };
    recipe.lines().map(line).collect()
}

/// A file name made from the text.
fn file_name(text: &str) -> String {
    let mut name: String = text.replace('/', "_");
    while name.len() > 200 {
        name.pop();
    }
    if name.is_empty() || name == "." || name == ".." { "x".to_owned() } else { name }
}
