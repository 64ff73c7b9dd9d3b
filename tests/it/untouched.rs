//! A folder of a person is given to every option that takes a path, in every verb. Its files have the names
//! that the program uses itself. They stay byte for byte, except a file that the option names as an output.

use crate::support::absent::is_thorough;
use crate::support::workspace::{TINY, Workspace, hidden_gpus};
use crate::training::photographed;
use clap::builder::ValueParser;
use clap::{Arg, Command as Verb};
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Folders with names that the program uses, or used in earlier versions, for its own.
const FOLDERS: [&str; 32] = [
    "tmp",
    "trash",
    "cas",
    "ac",
    "roots",
    "frames",
    "logs",
    "resume",
    "results",
    "plans",
    "gs2e-tmp",
    "gs2e-trash",
    "gs2e-plans",
    ".gs2e",
    ".gs2e-export",
    ".out.gs2e-export",
    ".fresh.gs2e-export",
    ".fresh.gs2e-export-abcdefgh01234567",
    ".fresh.gs2e-abcdefgh01234567",
    ".fresh.gs2e-notes",
    "fresh.replaced-abcdefgh01234567",
    "LICENSES",
    "tiny",
    "study",
    "images",
    "sharp",
    "depth",
    "exports",
    "recipes",
    "sparse",
    "parts",
    "out",
];

/// Names in each of these folders.
const INSIDE: [&str; 4] =
    ["4711.0", "about", "tree/one", "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262.json"];

/// Files with such names.
const FILES: [&str; 76] = [
    "VERSION",
    "VERSION.new",
    ".4711.gs2e-version",
    "lock",
    ".fresh.gs2e-lock",
    ".out.gs2e-lock",
    "state.db",
    "state.db-wal",
    "state.db-shm",
    "state.db.new",
    "state.db.1",
    ".gs2e-1-0.part",
    "fresh.part",
    "fresh.partial",
    ".fresh.partial",
    ".defaults.yaml.partial",
    "o.part",
    "o.ply",
    "o.ckpt",
    "c.ckpt",
    "c.part",
    "e.h5",
    "e.npz",
    "e.npz.t.part",
    "e.h5.part",
    "poses.txt",
    "speed.json",
    "timestamps_us.txt",
    "trajectory.svg",
    "transforms.json",
    "cameras.json",
    "cameras.bin",
    "images.bin",
    "points3D.bin",
    "manifest.json",
    "scene.json",
    "checks.json",
    "export.json",
    "croissant.json",
    "plan.json",
    "shard-0001.json",
    "jobs.json",
    "part-1-of-2.json",
    "SHA256SUMS",
    "SHA256SUMS.minisig",
    "B3SUMS",
    "README.md",
    "DATASHEET.md",
    "REUSE.toml",
    "index.parquet",
    "report.html",
    "gs2e.py",
    "rejected.tsv",
    "tiny.yaml",
    "defaults.yaml",
    "sources.yaml",
    "release.yaml",
    "takedown.txt",
    "publisher.key",
    "publisher.pub",
    "scene.ply",
    "point_cloud.ply",
    "input.ply",
    "frames.npy",
    "stamps.npy",
    "events.raw",
    "events.txt",
    "info.txt",
    "table.csv",
    "summary.md",
    "picture.png",
    "video.mp4",
    "log.txt",
    "4711.0",
    "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262",
    "gs2e-notes",
];

/// A command of each verb that works in the folder of [`work`]. The options of a test are added, or take the
/// place of those here.
const SOUND: &[(&str, &str)] = &[
    ("build", "tiny.yaml"),
    ("plan", "tiny.yaml"),
    ("why", "tiny/base/events --recipes tiny.yaml"),
    ("check", "--recipes tiny.yaml"),
    ("release", "--to rel tiny.yaml"),
    ("submit", "--dry-run --shared-store shared --to slurm tiny.yaml"),
    ("status", "--shared-store shared tiny.yaml"),
    ("cancel", "--shared-store shared tiny.yaml"),
    ("audit", "rel"),
    ("diff", "rel rel"),
    ("info", "rel"),
    ("convert", "rel/tiny/base/events.h5 c.npz"),
    ("export", "--to dsec --lossy --out exported rel"),
    ("init", "--to made nerfstudio ."),
    ("gc", "tiny.yaml"),
    ("render", "--scene truth.ply --view transforms.json --out o.png"),
    ("simulate", "--frames rel/tiny/base/sharp --fps 2400 --sensor dvs346-paper --out e.h5"),
    ("stress", "splat/ties@cpu"),
    ("study", "--rates 600 --finest 1200 --no-pictures --to s tiny.yaml"),
    ("study thresholds", "--thresholds 1 tiny.yaml"),
    ("study real", "--frames rel/tiny/base/sharp --fps 2400 --events rel/tiny/base/events.h5"),
    ("study sensor", "esim"),
    ("calibrate", "--frames rel/tiny/base/sharp --fps 2400 --events many.npz"),
    ("train", "--capture transforms.json --gaussians 300 --iterations 20 --out t.ply"),
    ("trajectory", "--capture transforms.json --recipe tiny.yaml --name base --out poses.txt"),
    ("doctor", ""),
    ("schema", ""),
    ("completions", "bash"),
];

/// Verbs that take seconds. They get the folder and a new name only.
const SLOW: [&str; 6] = ["stress", "calibrate", "study", "study thresholds", "study real", "study sensor"];

/// Outputs that replace a file of their name, as all programs do.
const REPLACING: &[(&str, &str)] = &[
    ("convert", "2"),
    ("render", "out"),
    ("simulate", "out"),
    ("stress", "markdown"),
    ("study thresholds", "csv"),
    ("study thresholds", "picture"),
    ("study real", "csv"),
    ("study real", "picture"),
    ("study sensor", "picture"),
    ("calibrate", "out"),
    ("calibrate", "page"),
    ("train", "out"),
    ("train", "checkpoint"),
    ("trajectory", "out"),
    ("trajectory", "report"),
    ("trajectory", "svg"),
    ("trajectory", "stamps"),
    ("status", "html"),
    ("check", "report"),
];

/// Options that name a folder to fill: new files may appear in it.
const FILLING: &[(&str, &str)] = &[("build", "to"), ("init", "to"), ("study", "to"), ("audit", "parts")];

/// A name that is not in the folder.
const FRESH: &str = "fresh";

/// The files, links and folders below a folder, with bytes, targets and modes.
fn content(root: &Path) -> BTreeMap<PathBuf, (u32, Vec<u8>)> {
    let entries = walkdir::WalkDir::new(root).into_iter().map(Result::unwrap);
    let of = |path: &Path| {
        let about = fs::symlink_metadata(path).unwrap();
        let bytes = if about.is_symlink() {
            fs::read_link(path).unwrap().into_os_string().into_encoded_bytes()
        } else if about.is_file() {
            fs::read(path).unwrap()
        } else {
            Vec::new()
        };
        (about.permissions().mode(), bytes)
    };
    entries.map(|entry| (entry.path().to_owned(), of(entry.path()))).collect()
}

/// The folders of a test: the person's, which may lead to another by links, and one in which the program
/// works.
struct Place {
    _folder: tempfile::TempDir,
    person: PathBuf,
    work: PathBuf,
    before: BTreeMap<PathBuf, (u32, Vec<u8>)>,
}

impl Place {
    /// With `linked`, each name of the person's folder is a link to a thing of that name elsewhere.
    fn new(work: &Path, linked: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [person, others] = ["person", "others"].map(|name| folder.path().join(name));
        fs::create_dir(&person).unwrap();
        fs::create_dir(&others).unwrap();
        let real = if linked { &others } else { &person };
        for name in FOLDERS.iter().flat_map(|folder| INSIDE.map(|inside| format!("{folder}/{inside}"))) {
            fs::create_dir_all(real.join(&name).parent().unwrap()).unwrap();
            fs::write(real.join(&name), format!("mine: {name}")).unwrap();
        }
        FILES.iter().for_each(|name| fs::write(real.join(name), format!("mine: {name}")).unwrap());
        if linked {
            let names = FOLDERS.iter().chain(&FILES);
            names.for_each(|name| symlink(others.join(name), person.join(name)).unwrap());
        }
        let before = content(folder.path());
        Self { _folder: folder, person, work: work.to_owned(), before }
    }

    fn run(&self, args: &[String]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
        command.args(args).current_dir(&self.work).stdin(Stdio::null());
        hidden_gpus(command).output().unwrap()
    }

    /// Differences from the state before, apart from those that were asked for; then restores the state.
    fn changes(&self, asked: &PathOption) -> Vec<String> {
        let now = content(self.person.parent().unwrap());
        let mut changes = Vec::new();
        for path in self.before.keys().chain(now.keys().filter(|path| !self.before.contains_key(*path))) {
            let (then, now) = (self.before.get(path), now.get(path));
            // The mode of a folder stays; its times are not compared.
            if then != now && !asked.allows(path, then.is_none()) {
                let what = match (then, now) {
                    (None, _) => "new",
                    (_, None) => "gone",
                    _ => "changed",
                };
                changes.push(format!("{what}: {}", path.display()));
            }
        }
        changes
    }
}

/// The path that an option names, and what the option may do there.
struct PathOption {
    target: PathBuf,
    /// The target where it is a link.
    real: PathBuf,
    replaces: bool,
    fills: bool,
    existed: bool,
}

impl PathOption {
    fn new(verb: &str, id: &str, target: &Path) -> Self {
        let is_in = |list: &[(&str, &str)]| list.contains(&(verb, id));
        let existed = target.symlink_metadata().is_ok();
        let real = target.canonicalize().unwrap_or_else(|_| target.to_owned());
        let is_file = !real.is_dir();
        Self {
            replaces: is_in(REPLACING) && is_file,
            fills: is_in(FILLING),
            target: target.to_owned(),
            real,
            existed,
        }
    }

    fn allows(&self, path: &Path, is_new: bool) -> bool {
        let is_target = path == self.target || path == self.real;
        let is_below = path.starts_with(&self.target) || path.starts_with(&self.real);
        self.replaces && is_target || is_new && is_below && (self.fills || !self.existed)
    }
}

/// The verbs that do something, by their full names.
fn verbs(of: &Verb, name: &str, out: &mut Vec<(String, Verb)>) {
    for verb in of.get_subcommands().filter(|verb| verb.get_name() != "help") {
        let name = format!("{name} {}", verb.get_name()).trim().to_owned();
        verbs(verb, &name, out);
        out.push((name, verb.clone()));
    }
}

/// The arguments that take a path.
fn path_arguments(verb: &Verb) -> Vec<Arg> {
    let is_path = |arg: &&Arg| arg.get_value_parser().type_id() == ValueParser::path_buf().type_id();
    // Paths that are read as text, because they may also be a name or an address.
    let is_text = |arg: &&Arg| {
        let name = arg.get_value_names().and_then(|names| names.first()).map_or("", |name| name.as_str());
        ["FILE", "DIR", "PATH", "RECIPE", "FOLDER"].iter().any(|word| name.contains(word))
    };
    let takes = |arg: &&Arg| arg.get_action().takes_values();
    let visible = |arg: &&Arg| !arg.is_hide_set();
    let mut arguments: Vec<Arg> = verb
        .get_arguments()
        .filter(|arg| is_path(arg) || is_text(arg))
        .filter(takes)
        .filter(visible)
        .cloned()
        .collect();
    arguments.sort_by_key(|arg| arg.get_id().as_str().to_owned());
    arguments
}

/// The name of an argument here: that of an option, or the place of a positional value.
fn argument_name(arg: &Arg) -> String {
    arg.get_long().map_or_else(|| arg.get_index().unwrap_or(0).to_string(), str::to_owned)
}

/// The words of a command of a verb with another value for an argument.
fn words((name, sound): (&str, &str), verb: &Verb, changed: &Arg, value: &str) -> Vec<String> {
    let takes_value = |word: &str| {
        let long = word.strip_prefix("--");
        let mut all = verb.get_arguments();
        all.any(|arg| arg.get_long() == long && arg.get_long().is_some() && arg.get_action().takes_values())
    };
    let mut words: Vec<String> = sound.split_whitespace().map(str::to_owned).collect();
    let mut places = BTreeMap::new();
    let (mut at, mut positional) = (0, 0);
    while at < words.len() {
        if takes_value(&words[at]) {
            places.insert(words[at][2..].to_owned(), at + 1);
            at += 1;
        } else if !words[at].starts_with("--") {
            positional += 1;
            places.insert(positional.to_string(), at);
        }
        at += 1;
    }
    match places.get(&argument_name(changed)) {
        Some(place) => words[*place] = value.to_owned(),
        None => {
            words.extend(changed.get_long().map(|long| format!("--{long}")));
            words.push(value.to_owned());
        }
    }
    name.split(' ').map(str::to_owned).chain(words).collect()
}

/// A folder in which every command of [`SOUND`] works.
fn work() -> Workspace {
    let place = photographed();
    place.write("tiny.yaml", TINY);
    place.ok("release --to rel tiny.yaml");
    place.ok("build --shared-store shared tiny.yaml");
    place.write("eager.yaml", "esim: { contrast: 0.01 }\n");
    place.ok("simulate --frames rel/tiny/base/sharp --fps 2400 --sensor eager.yaml --out many.npz");
    place
}

#[test]
fn files_of_a_person_stay_as_they_are() {
    let work = work();
    // A command that does not work would show nothing. `cancel` needs a cluster.
    let sound = SOUND.iter().filter(|(verb, _)| *verb != "cancel");
    sound.for_each(|(verb, rest)| drop(work.ok(&format!("{verb} {rest}"))));
    let _ = fs::remove_dir_all(work.path("exported"));
    let mut all = Vec::new();
    verbs(&gs2e::cli::command_line(), "", &mut all);
    let (mut runs, mut options, mut faults) = (0, 0, Vec::new());
    let names: Vec<&str> = FOLDERS.iter().chain(&FILES).copied().collect();
    let mut next = 0;
    for (name, verb) in all {
        let sound =
            *SOUND.iter().find(|(verb, _)| *verb == name).unwrap_or_else(|| panic!("no `{name}` here"));
        for arg in path_arguments(&verb) {
            options += 1;
            for linked in [false, true] {
                let mut place = Place::new(&work.path(""), linked);
                let is_slow = SLOW.contains(&name.as_str());
                for target in
                    targets(&names, &mut next).into_iter().take(if is_slow { 2 } else { usize::MAX })
                {
                    let path = place.person.join(&target);
                    let args = words(sound, &verb, &arg, path.to_str().unwrap());
                    let asked = PathOption::new(&name, &argument_name(&arg), &path);
                    let output = place.run(&args);
                    runs += 1;
                    let changes = place.changes(&asked);
                    if !changes.is_empty() {
                        let said = String::from_utf8_lossy(&output.stderr).into_owned();
                        faults.push(format!("gs2e {}\n  {}\n  {said}", args.join(" "), changes.join("\n  ")));
                    }
                    if content(place.person.parent().unwrap()) != place.before {
                        place = Place::new(&work.path(""), linked);
                    }
                }
            }
        }
    }
    let inside = FOLDERS.len() * INSIDE.len();
    println!(
        "{runs} runs, {options} options of verbs, {} names, with and without links",
        names.len() + inside
    );
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}

/// The folder itself, a new name in it, and some of its names: all of them if slow tests were asked for.
fn targets(names: &[&str], next: &mut usize) -> Vec<String> {
    const EACH: usize = 3;
    let mut targets = vec![String::new(), FRESH.to_owned()];
    if is_thorough() {
        targets.extend(names.iter().map(|name| (*name).to_owned()));
    } else {
        // The names take turns, so that each is a target of some option.
        targets.extend((0..EACH).map(|i| names[(*next + i) % names.len()].to_owned()));
        *next += EACH;
    }
    targets
}
