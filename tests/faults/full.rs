//! A disk that fills at random steps and is freed: the build reports it and ends with 1, and the
//! next build finishes.
//!
//! The store lies on a `tmpfs` of a few hundred KiB that grows from one build to the next. Mounting
//! it needs privileges. Without them the program restarts itself in a name space of its own. Where
//! that is impossible too, the store's file operations fail in its place.

use crate::engine::{BuildOutcome, Engine};
use crate::failing::{Failing, FailureMode, Injection};
use crate::place::{Place, Products, same, sound, within};
use crate::random::Random;
use crate::tally::Tally;
use crate::{Size, is_over, scenes};
use gs2e_store::fs::SystemFs;
use std::ffi::OsStr;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

const SCENES: u32 = 20;

pub(crate) fn run(size: Size) -> Tally {
    let mut tally = Tally::default();
    let place = Place::new();
    scenes::write(&place, SCENES, 5);
    let truth = place.build("").unwrap();
    let mounts = may_mount(place.root());
    if !mounts {
        tally
            .notes
            .push("no disk could be mounted: the file operations of the store fail instead".to_owned());
    }
    tally.count("builds that met a full disk", 0);
    let end = size.end();
    for round in (0..size.of(20, 500)).take_while(|_| !is_over(end)) {
        let mut random = Random::new(size.seed, round);
        let ended = if mounts {
            fill_and_free(&truth, &mut random, &mut tally)
        } else {
            fail_and_mend(&truth, &mut random, &mut tally)
        };
        tally.trial(ended.map_err(|why| format!("round {round}: {why}")));
    }
    tally
}

fn may_mount(folder: &Path) -> bool {
    Disk::mount(folder, 64).is_ok()
}

/// Restarts this program with its own arguments in a name space where it may mount, unless it may
/// mount here. Returns if a restart is not needed or not possible.
pub(crate) fn enter_name_space() {
    const NAME_SPACE: [&str; 4] = ["--user", "--map-root-user", "--mount", "--"];
    let place = Place::new();
    if may_mount(place.root()) {
        return;
    }
    let mut probe = Command::new("unshare");
    probe.args(NAME_SPACE).args(["mount", "-t", "tmpfs", "tmpfs"]).arg(place.root());
    if let (true, Ok(this)) = (quiet(&mut probe), std::env::current_exe()) {
        let mut anew = Command::new("unshare");
        anew.args(NAME_SPACE).arg(this).args(std::env::args_os().skip(1));
        // `exec` returns only if the start failed. The test then uses its other way.
        let _ = anew.exec();
    }
}

fn quiet(command: &mut Command) -> bool {
    let command = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// A small file system, unmounted when the value is dropped.
pub(crate) struct Disk {
    at: PathBuf,
}

impl Disk {
    pub(crate) fn mount(at: &Path, kib: usize) -> Result<Self, String> {
        mount(["-t", "tmpfs", "-o", &format!("size={kib}k"), "tmpfs"].map(OsStr::new), at)?;
        Ok(Self { at: at.to_owned() })
    }

    pub(crate) fn grow(&self, kib: usize) -> Result<(), String> {
        mount(["-o", &format!("remount,size={kib}k")].map(OsStr::new), &self.at)
    }
}

fn mount<const N: usize>(args: [&OsStr; N], at: &Path) -> Result<(), String> {
    let mut command = Command::new("mount");
    if quiet(command.args(args).arg(at)) { Ok(()) } else { Err(format!("{command:?} failed")) }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // A leftover mount goes with the name space or the machine.
        let _ = quiet(Command::new("umount").arg(&self.at));
    }
}

fn fill_and_free(truth: &Products, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = Place::new();
    scenes::write(&place, SCENES, 5);
    std::fs::create_dir(place.store()).unwrap();
    let mut kib = 4 + 4 * random.below(250);
    let disk = Disk::mount(&place.store(), kib)?;
    for _ in 0..100 {
        let ended = place.run("build -q -j 2")?;
        if ended.code == Some(0) {
            return same(&place.finished()?, truth);
        }
        tally.count("builds that met a full disk", 1);
        let says_so = ended.stderr.to_lowercase().contains("no space") || ended.stderr.contains("is full");
        if ended.code != Some(1) || !says_so {
            return Err(format!("{kib} KiB: {ended}"));
        }
        // A reader of a store on a full disk sees the finished steps.
        within(&sound(&place.plan()?)?, truth).map_err(|why| format!("{kib} KiB: {why}"))?;
        kib += 4 + 4 * random.below(150);
        disk.grow(kib)?;
    }
    Err(format!("not finished with {kib} KiB"))
}

/// The variant without mounting: from a random operation on there is no space, and each build gets
/// further.
fn fail_and_mend(truth: &Products, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = Place::in_memory();
    scenes::write(&place, SCENES, 5);
    loop {
        let at = random.below(1500);
        let full = Failing::new(Injection { at, how: FailureMode::NoSpace, forever: true });
        match Engine::new(&place, Arc::new(full)).build(&place) {
            BuildOutcome::Failed(why) if why.to_lowercase().contains("no space") => {}
            BuildOutcome::Failed(why) => return Err(format!("operation {at}: {why}")),
            BuildOutcome::Panicked => return Err(format!("operation {at}: a panic")),
            done @ BuildOutcome::Done { .. } => return same(&done.products(&place)?, truth),
        }
        tally.count("builds that met a full disk", 1);
        let sound = Engine::new(&place, Arc::new(SystemFs));
        within(&sound.look(&place)?, truth).map_err(|why| format!("operation {at}: {why}"))?;
    }
}
