//! The files for other batch systems: their commands are run by a shell, and parsed by the program's parser.

use super::SCENES;
use crate::support::absent::not_run;
use crate::support::repository::{root, text_of};
use crate::support::steps::recipe;
use crate::support::workspace::{Workspace, hidden_gpus, same_tree};
use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;

/// Prints each of its arguments on a line.
const ECHO: &str = "#!/bin/sh\nprintf '%s\\n' \"$@\"\n";

/// The options of `gs2e build` that this command runs as the task with this index.
fn options(command: &[&str], variable: &str, index: u32) -> clap::ArgMatches {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("gs2e");
    fs::write(&program, ECHO).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:/usr/bin:/bin", folder.path().display());
    let mut shell = Command::new(command[0]);
    let said = shell.args(&command[1..]).env("PATH", path).env(variable, index.to_string()).output().unwrap();
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let words = String::from_utf8(said.stdout).unwrap();
    let words: Vec<&str> = ["gs2e"].into_iter().chain(words.lines()).collect();
    let matches = gs2e::cli::command_line().try_get_matches_from(&words).unwrap_or_else(|e| panic!("{e}"));
    let (verb, options) = matches.subcommand().unwrap();
    assert_eq!(verb, "build");
    options.clone()
}

/// The value of an option, as it was typed.
fn typed(options: &clap::ArgMatches, name: &str) -> String {
    let mut raw = options.get_raw(name).unwrap_or_else(|| panic!("--{name} is not there"));
    raw.next().unwrap().to_str().unwrap().to_owned()
}

fn check(command: &[&str], variable: &str, size: u32) {
    for index in [0, 1, size - 1] {
        let options = options(command, variable, index);
        assert_eq!(typed(&options, "shard"), format!("{}/{size}", index + 1));
        assert!(options.get_flag("keep_going"));
        assert_eq!(typed(&options, "jobs"), "8");
        assert!(typed(&options, "shared_store").starts_with("/shared/"));
    }
}

#[test]
fn the_manifest_of_kubernetes_gives_each_pod_its_share() {
    let job: Value = serde_saphyr::from_str(&text_of("docs/cluster/kubernetes.yaml")).unwrap();
    assert_eq!((&job["apiVersion"], &job["kind"]), (&json!("batch/v1"), &json!("Job")));
    let spec = &job["spec"];
    assert_eq!(spec["completionMode"], "Indexed");
    let pod = &spec["template"]["spec"];
    assert_eq!(pod["restartPolicy"], "Never");
    let container = &pod["containers"][0];
    let words: Vec<&str> = ["command", "args"]
        .iter()
        .flat_map(|name| container[*name].as_array().unwrap())
        .map(|word| word.as_str().unwrap())
        .collect();
    check(&words, "JOB_COMPLETION_INDEX", u32::try_from(spec["completions"].as_u64().unwrap()).unwrap());
    // Every mounted volume is one of the pod.
    let named = |list: &Value| -> Vec<String> {
        list.as_array().unwrap().iter().map(|item| item["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(named(&container["volumeMounts"]), named(&pod["volumes"]));
}

#[test]
fn the_job_of_aws_batch_gives_each_child_its_share() {
    let read = |name: &str| serde_json::from_str::<Value>(&text_of(name)).unwrap();
    let definition = read("docs/cluster/aws-batch-definition.json");
    let job = read("docs/cluster/aws-batch-job.json");
    assert_eq!(job["jobDefinition"], definition["jobDefinitionName"]);
    let command = definition["containerProperties"]["command"].as_array().unwrap();
    let words: Vec<&str> = command.iter().map(|word| word.as_str().unwrap()).collect();
    // The folder of the data is not here.
    let script = words[2].strip_prefix("cd /shared/data && ").unwrap();
    let size = job["arrayProperties"]["size"].as_u64().unwrap();
    check(&[words[0], words[1], script], "AWS_BATCH_JOB_ARRAY_INDEX", u32::try_from(size).unwrap());
}

#[test]
fn gnu_parallel_builds_the_release_of_one_machine() {
    let known = Command::new("parallel").arg("--version").output();
    if !known.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).starts_with("GNU parallel")) {
        return not_run("GNU parallel is not installed");
    }
    let place = Workspace::new();
    for i in 0..SCENES {
        let mut recipe: Value = recipe(&format!("s{i}"));
        recipe["source"]["procedural"]["seed"] = json!(i);
        place.write(&format!("recipes/s{i}.yaml"), recipe.to_string());
    }
    let programs = Path::new(env!("CARGO_BIN_EXE_gs2e")).parent().unwrap();
    let mut shell = Command::new("sh");
    shell.arg(root().join("docs/cluster/parallel.sh")).arg("3").current_dir(place.path(""));
    shell.env("PATH", format!("{}:/usr/bin:/bin", programs.display()));
    let ended = hidden_gpus(shell).output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    assert!(["1", "2", "3"].iter().all(|share| place.path(&format!("stores/{share}")).is_dir()));
    place.ok("release --store alone --to one");
    let ended = place.ok("release --store new --shared-store shared --to two");
    assert!(ended.stderr.lines().any(|line| line.starts_with("0 steps built,")), "{}", ended.stderr);
    same_tree(&place.path("one"), &place.path("two"));
}
