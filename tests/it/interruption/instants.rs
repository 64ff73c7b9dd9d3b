//! Builds stopped at many instants, step by step: what was told as finished stays and is never made again, and the
//! products are those of a build that nobody disturbed.

use crate::support::steps::{keys, recipe, steps};
use crate::support::workspace::Workspace;
use gs2e::store::Digest;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const SCENES: usize = 4;

fn place() -> Workspace {
    let place = Workspace::new();
    for i in 0..SCENES {
        let mut value = recipe(&format!("s{i}"));
        value["source"]["procedural"]["seed"] = i.into();
        place.write(&format!("recipes/{i}.yaml"), value.to_string());
    }
    place
}

fn start(place: &Workspace) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    command.args(["build", "--json", "-j", "2"]).current_dir(place.path("")).stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// The step that a line of `build --json` says was made.
fn made(line: &str) -> Option<String> {
    let told: Value = serde_json::from_str(line).ok()?;
    (told["state"] == "made").then(|| told["step"].as_str().unwrap().to_owned())
}

/// Digests of all products, read from the store: each must be what its name says.
fn products(place: &Workspace) -> BTreeMap<(String, String), Digest> {
    let mut products = BTreeMap::new();
    for (name, step) in steps(place, "recipes") {
        assert_eq!(step.action, "keep", "{name}");
        for (role, path) in step.outputs {
            let digest = Digest::of(&std::fs::read(&path).unwrap());
            assert!(
                path.ends_with(digest.to_string()),
                "{name}, {role}: the bytes are not those of the name"
            );
            products.insert((name.clone(), role), digest);
        }
    }
    products
}

fn files_in(place: &Workspace, folder: &str) -> usize {
    std::fs::read_dir(place.path(folder)).unwrap().count()
}

#[test]
fn an_interrupt_tells_how_many_steps_it_keeps() {
    let place = place();
    let mut child = start(&place);
    let mut told = BufReader::new(child.stdout.take().unwrap());
    let (mut finished, mut line) = (BTreeSet::new(), String::new());
    while finished.len() < 3 {
        line.clear();
        assert_ne!(told.read_line(&mut line).unwrap(), 0, "it ended by itself");
        finished.extend(made(line.trim()));
    }
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let mut rest = String::new();
    told.read_to_string(&mut rest).unwrap();
    finished.extend(rest.lines().filter_map(made));
    let ended = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(130), "{stderr}");
    let all = 6 * SCENES;
    let said = format!("interrupted: {} of {all} steps are finished and kept", finished.len());
    assert!(stderr.contains(&said), "not `{said}`:\n{stderr}");
    assert_eq!(files_in(&place, ".gs2e/tmp"), 0);

    let after: BTreeSet<String> = place.build("recipes").into_iter().collect();
    assert!(after.is_disjoint(&finished), "made twice: {after:?} and {finished:?}");
    assert_eq!(after.len() + finished.len(), all);
    let undisturbed = self::place();
    undisturbed.ok("build");
    assert_eq!(keys(&place, "recipes"), keys(&undisturbed, "recipes"));
    assert_eq!(products(&place), products(&undisturbed));
}

#[test]
fn kills_at_random_instants_lose_only_what_was_at_work() {
    let undisturbed = place();
    let started = Instant::now();
    undisturbed.ok("build");
    let whole = started.elapsed();

    // Numerical Recipes' linear congruential generator, seed 2.
    let (mut random, mut kills) = (2u32, 0);
    let mut instant = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        whole.mul_f64(0.5 * f64::from(random >> 8) / f64::from(1 << 24))
    };
    while kills < 15 {
        let place = place();
        let mut once = BTreeSet::new();
        while !survives(&place, instant(), &mut once) {
            kills += 1;
            place.ok("plan");
        }
        assert_eq!(products(&place), products(&undisturbed));
        assert_eq!(files_in(&place, ".gs2e/tmp"), 0);
    }
    eprintln!("kills at random instants: seed 2, {kills} kills in a build of {whole:.2?}, 0 wrong");
}

/// Builds, and kills the program after a while: whether it was done before. No step may be made that `once` has.
fn survives(place: &Workspace, after: Duration, once: &mut BTreeSet<String>) -> bool {
    let mut child = start(place);
    std::thread::sleep(after);
    let is_killed = child.try_wait().unwrap().is_none();
    if is_killed {
        child.kill().unwrap();
    }
    let ended = child.wait_with_output().unwrap();
    assert!(is_killed || ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    // The last line may be cut, and a step may be finished and not told yet; what was told stays.
    for step in String::from_utf8_lossy(&ended.stdout).lines().filter_map(made) {
        assert!(once.insert(step.clone()), "{step} was made twice");
    }
    !is_killed
}
