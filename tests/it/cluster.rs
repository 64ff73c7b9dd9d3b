//! Scenes that tasks of a batch system build: `submit`, `status` and `cancel` with a fake Slurm. `cargo xtask
//! slurm` does it with the real one.

mod fake;
mod files;
mod hostile;
mod scaling;

use crate::support::steps::recipe;
use crate::support::workspace::{Workspace, same_tree};
use fake::FakeSlurm;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead as _, BufReader};

/// Scenes whose steps all differ.
const SCENES: u64 = 4;

fn fake(mode: &str) -> FakeSlurm {
    let place = Workspace::new();
    for i in 0..SCENES {
        let mut recipe: Value = recipe(&format!("s{i}"));
        recipe["source"]["procedural"]["seed"] = json!(i);
        place.write(&format!("recipes/s{i}.yaml"), recipe.to_string());
    }
    FakeSlurm::new(place, mode)
}

fn all(state: &str) -> Vec<String> {
    vec![state.to_owned(); usize::try_from(SCENES).unwrap()]
}

#[test]
fn tasks_build_all_scenes_and_nothing_is_submitted_again() {
    let fake = fake("run");
    let ended = fake.submit(0, "");
    assert!(
        ended.stderr.contains("job 101: 4 scenes in 3 tasks, each with 1 cores and 1000 MB"),
        "{}",
        ended.stderr
    );
    assert_eq!(fake.states(), all("done"));
    let again = fake.submit(0, "");
    assert!(again.stderr.contains("all scenes are done"), "{}", again.stderr);
    assert_eq!(fake.jobs(), 1);
    // Another own store knows nothing, and finds the same.
    fake.submit(0, "--store other");
    assert_eq!(fake.jobs(), 1);
    fake.place.ok("release --store alone --to one");
    let ended = fake.place.ok("release --store new --shared-store shared --to two");
    assert!(ended.stderr.lines().any(|line| line.starts_with("0 steps built,")), "{}", ended.stderr);
    same_tree(&fake.place.path("one"), &fake.place.path("two"));
    // The stores of tasks are gone.
    let left = fs::read_dir(fake.place.path("")).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(left.into_iter().all(|name| !name.to_string_lossy().starts_with("gs2e-")));
}

#[test]
fn lines_of_tasks_say_where_and_how_each_step_was_made() {
    let fake = fake("run");
    fake.submit(0, "");
    let mut steps = 0;
    let mut jobs = BTreeSet::new();
    for plan in fake.plans() {
        for run in fs::read_dir(plan.join("results")).unwrap().map(|run| run.unwrap().path()) {
            let text = fs::read_to_string(run.join("steps.jsonl")).unwrap();
            for line in text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()) {
                let Some("made") = line["state"].as_str() else { continue };
                steps += 1;
                jobs.insert(line["job"].as_str().unwrap().to_owned());
                let scene = line["scene"].as_str().unwrap();
                assert!(line["step"].as_str().unwrap().starts_with(&format!("{scene}/")), "{line}");
                assert!(!line["host"].as_str().unwrap().is_empty(), "{line}");
                assert_eq!(line["cores"], 1, "{line}");
                assert!(line["ended"].as_str().is_some_and(|time| time.ends_with('Z')), "{line}");
                for number in ["seconds", "memory", "bytes"] {
                    assert!(line[number].as_f64().unwrap() >= 0.0, "{number} {line}");
                }
            }
        }
    }
    let found: u64 = fake.status("").iter().map(|line| line["finished"].as_u64().unwrap()).sum();
    assert_eq!(found, steps);
    assert_eq!(jobs, BTreeSet::from(["101_1", "101_2", "101_3"].map(str::to_owned)));
    // The page has the same numbers.
    fake.ends(0, "status --shared-store shared --html status.html");
    let page = fs::read_to_string(fake.place.path("status.html")).unwrap();
    for wanted in [
        "<strong>4 of 4</strong> scenes done".to_owned(),
        format!("<strong>{steps} of {steps}</strong> steps finished"),
        format!("<strong>{steps}</strong> steps made in the last hour"),
        "<td>s0</td><td>done</td>".to_owned(),
    ] {
        assert!(page.contains(&wanted), "{wanted}\n{page}");
    }
}

#[test]
fn queued_and_running_scenes_are_not_submitted_twice() {
    let fake = fake("queue");
    assert_eq!(fake.submit(0, "--detach").stderr.matches("detached").count(), 1);
    assert_eq!(fake.states(), all("queued"));
    fake.submit(0, "--detach");
    assert_eq!(fake.jobs(), 1);
    // The first task starts. Tasks with their scenes are in the file of the plan.
    let queue = fs::read_to_string(fake.place.path("slurm/queue")).unwrap();
    fake.set("queue", &queue.replacen("PENDING|", "RUNNING|n7", 1));
    let running: Vec<Value> = fake.status("").into_iter().filter(|line| line["state"] == "running").collect();
    assert!(!running.is_empty() && running.iter().all(|line| line["node"] == "n7" && line["job"] == "101_1"));
    let queued = fake.status("").into_iter().find(|line| line["state"] == "queued").unwrap();
    assert_eq!(queued["reason"], "Priority");
    // A scene that is changed is another one, and the others stay as they are.
    let mut changed = recipe("s0");
    changed["seed"] = json!(8);
    fake.place.write("recipes/s0.yaml", changed.to_string());
    assert_eq!(fake.states()[0], "open");
    fake.submit(0, "--detach");
    assert_eq!(fake.jobs(), 2);
}

#[test]
fn cancelled_tasks_are_gone_and_those_of_other_scenes_go_on() {
    let fake = fake("queue");
    fake.ends(0, "submit --to slurm --shared-store shared --tasks 1 --detach");
    let ended = fake.ends(0, "cancel --shared-store shared recipes/s0.yaml");
    assert!(ended.stderr.contains("101_1 goes on"), "{}", ended.stderr);
    assert!(ended.stderr.contains("cancelled 0 tasks"), "{}", ended.stderr);
    let ended = fake.ends(0, "cancel --json --shared-store shared");
    assert!(ended.stdout.contains(r#""cancelled":["101_1"]"#), "{}", ended.stdout);
    assert_eq!(fake.states(), all("open"));
}

#[test]
fn an_interrupt_detaches_and_the_jobs_go_on() {
    let fake = fake("queue");
    let mut child = fake.spawn_submit();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    lines.by_ref().map(Result::unwrap).find(|line| line.contains("3 queued")).unwrap();
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(lines.map(Result::unwrap).any(|line| line.contains("detached: the jobs go on")));
    assert_eq!(fake.states(), all("queued"));
}

/// Memory of each plan, MB.
fn memory(fake: &FakeSlurm) -> BTreeSet<u64> {
    let plan = |folder: std::path::PathBuf| -> Value {
        serde_json::from_slice(&fs::read(folder.join("plan.json")).unwrap()).unwrap()
    };
    fake.plans().into_iter().map(|folder| plan(folder)["memory_mb"].as_u64().unwrap()).collect()
}

#[test]
fn a_task_that_exceeded_its_memory_gets_more() {
    let fake = fake("kill");
    fake.set("next", "run");
    let ended = fake.submit(0, "--retries 1");
    assert_eq!((fake.jobs(), fake.states()), (2, all("done")), "{}", ended.stderr);
    assert_eq!(memory(&fake), BTreeSet::from([1000, 2000]));
}

#[test]
fn a_task_whose_node_is_lost_is_submitted_again_with_the_same_memory() {
    let fake = fake("lose");
    fake.set("next", "run");
    fake.submit(0, "");
    assert_eq!((fake.jobs(), memory(&fake)), (2, BTreeSet::from([1000])));
}

#[test]
fn failures_are_told_with_their_last_lines() {
    let fake = fake("lose");
    let ended = fake.submit(1, "--retries 0");
    assert!(ended.stderr.contains("error: s0: task 101_"), "{}", ended.stderr);
    assert!(ended.stderr.contains("it ended without a report"), "{}", ended.stderr);
    assert!(ended.stderr.contains("the node burns"), "{}", ended.stderr);
    assert_eq!((fake.jobs(), fake.states()), (1, all("failed")));
    // Slurm knows more, for some time.
    let end = |task: u32, state: &str| {
        format!("JobId=1 ArrayJobId=101 ArrayTaskId={task} JobState={state} Reason=None ExitCode=0:0\n")
    };
    fake.set("ends.101", &[end(1, "TIMEOUT"), end(2, "NODE_FAIL"), end(3, "OUT_OF_MEMORY")].concat());
    let lines = fake.status("");
    let because: BTreeSet<&str> = lines.iter().map(|line| line["because"].as_str().unwrap()).collect();
    assert_eq!(
        because,
        BTreeSet::from(["it exceeded its time", "its node failed", "it exceeded its memory"])
    );
    assert!(lines.iter().all(|line| line["log"] == json!(["the node burns"])), "{lines:?}");
    assert!(lines.iter().all(|line| (line["because"] == "it exceeded its memory") == line["out_of_memory"]));
    let said = fake.ends(0, "status --shared-store shared");
    assert!(said.stdout.contains("failed 101_1  s"), "{}", said.stdout);
    assert!(
        said.stderr.contains("4 scenes: done 0, running 0, queued 0, failed 4, open 0"),
        "{}",
        said.stderr
    );
}

#[test]
fn the_error_of_a_step_is_told() {
    let fake = fake("fail");
    fake.set(
        "steps",
        r#"{"level":"error","code":"step-failed","message":"s2/base/events: failed to bend","scene":"s2"}"#,
    );
    let ended = fake.submit(1, "--retries 1");
    assert!(ended.stderr.contains("failed: s2/base/events: failed to bend"), "{}", ended.stderr);
    assert_eq!(fake.jobs(), 2);
    let line = fake.status("recipes/s2.yaml").remove(0);
    assert_eq!(line["because"], "s2/base/events: failed to bend");
}

#[test]
fn the_script_is_printed_without_slurm() {
    let fake = fake("run");
    let slurm = fake.command("submit --to slurm --shared-store shared --dry-run --account a --gres gpu:1");
    let mut without = slurm;
    let ended = without.env("PATH", "/usr/bin:/bin").output().unwrap();
    // A machine with Slurm prints it too.
    let text = String::from_utf8(ended.stdout).unwrap();
    let wanted =
        ["#!/bin/sh\n", "#SBATCH --array=1-4\n", "--account=a\n", "--gres=gpu:1\n", "--backend gpu "];
    wanted.iter().for_each(|line| assert!(text.contains(line), "{line}\n{text}"));
    // Nothing is known, so the usual amounts are asked for.
    assert!(text.contains("--mem=8000M\n") && text.contains("--cpus-per-task=4\n"), "{text}");
    assert!(!fake.place.path("shared").exists() && !fake.place.path(".gs2e").exists());
    // After a build, its costs are known: these steps need little.
    fake.place.ok("build recipes/s0.yaml");
    let text = fake.ends(0, "submit --to slurm --shared-store shared --dry-run --cache-size 2GB").stdout;
    let memory = text.split("--mem=").nth(1).unwrap().split('M').next().unwrap().parse::<u64>().unwrap();
    assert!((1000..8000).contains(&memory) && text.contains("--cpus-per-task=1\n"), "{text}");
    assert!(text.contains(" --cache-size=2000000000 "), "{text}");
}

#[test]
fn what_slurm_refuses_is_told() {
    let fake = fake("refuse");
    let ended = fake.submit(1, "");
    assert!(ended.stderr.contains("`sbatch` failed: it ended with exit code 1"), "{}", ended.stderr);
    assert!(ended.stderr.contains("sbatch: error: invalid account"), "{}", ended.stderr);
    let ended = fake.submit(2, "--account a\u{1b}b");
    assert!(ended.stderr.contains("has a control or invisible character"), "{}", ended.stderr);
    fs::remove_file(fake.place.path("slurm/sbatch")).unwrap();
    // Only the fake is on this path.
    let ended = fake
        .command("submit --to slurm --shared-store shared")
        .env("PATH", fake.place.path("slurm"))
        .output();
    let ended = ended.unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert!(
        ended.status.code() == Some(1) && said.contains("there is no program `sbatch` in PATH"),
        "{said}"
    );
}

#[test]
fn a_controller_that_is_down_ends_status_and_not_the_wait() {
    let fake = fake("queue");
    let mut child = fake.spawn_submit();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    lines.by_ref().map(Result::unwrap).find(|line| line.contains("3 queued")).unwrap();
    fake.set("down", "");
    lines.by_ref().map(Result::unwrap).find(|line| line.starts_with("waiting: `squeue` failed")).unwrap();
    let ended = fake.ends(1, "status --shared-store shared");
    assert!(ended.stderr.contains("Unable to contact slurm controller"), "{}", ended.stderr);
    // It comes back, and the tasks are gone.
    fake.set("mode", "run");
    fake.set("queue", "");
    fs::remove_file(fake.place.path("slurm/down")).unwrap();
    assert!(child.wait().unwrap().success());
    assert_eq!(fake.states(), all("done"));
}

#[test]
fn folders_without_a_plan_of_this_program_are_refused() {
    let fake = fake("run");
    for verb in ["status", "cancel"] {
        let ended = fake.ends(2, &format!("{verb} --shared-store nowhere"));
        assert!(ended.stderr.contains("there is no shared store in "), "{}", ended.stderr);
    }
    fake.submit(0, "");
    fake.place.write("shared/VERSION", "gs2e shared store, format 99\n");
    for verb in ["status", "submit --to slurm"] {
        let ended = fake.ends(2, &format!("{verb} --shared-store shared"));
        assert!(ended.stderr.contains("has format 99"), "{}", ended.stderr);
    }
}
