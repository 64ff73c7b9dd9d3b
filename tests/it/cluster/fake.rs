//! A Slurm of shell scripts. `sbatch` runs the tasks at once, or queues them; the other programs answer from
//! files.

use crate::support::workspace::{RunOutcome, Workspace, hidden_gpus};
use serde_json::Value;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// Runs, queues or spoils the tasks of a script, as the file `mode` says.
const SBATCH: &str = r#"#!/bin/sh
for script in "$@"; do :; done
mode=$(cat "$FAKE/mode")
[ "$mode" = refuse ] && { echo "sbatch: error: invalid account" >&2; exit 1; }
job=$(($(cat "$FAKE/jobs" 2>/dev/null || echo 100) + 1))
echo "$job" >"$FAKE/jobs"
echo "sbatch: warning: this is a fake" >&2
name=$(sed -n 's/^#SBATCH --job-name=//p' "$script")
tasks=$(sed -n 's/^#SBATCH --array=1-//p' "$script")
# Where the script says that results go. The last script is kept, as Slurm keeps its own copy.
eval "$(sed -n '/^shared=/,/^results=/p' "$script")"
results=$shared/$below/$results
cp "$script" "$FAKE/script"
for task in $(seq "$tasks"); do
    out=$results/${job}_$task
    case $mode in
    run) SLURM_ARRAY_JOB_ID=$job SLURM_ARRAY_TASK_ID=$task sh "$script" >>"$FAKE/output" 2>&1 ;;
    queue) echo "$job|$task|PENDING||$name|Priority" >>"$FAKE/queue" ;;
    # As the first run of a task whose node is lost, or that the kernel kills.
    lose) mkdir "$out"; echo "the node burns" >"$out/log" ;;
    kill) mkdir "$out"; echo 137 >"$out/end"; echo "Killed" >"$out/log" ;;
    fail) mkdir "$out"; cat "$FAKE/steps" >"$out/steps.jsonl"; echo 1 >"$out/end"; echo "see the steps" >"$out/log" ;;
    esac
done
# What follows happens to the next job.
[ -f "$FAKE/next" ] && mv "$FAKE/next" "$FAKE/mode"
echo "$job"
"#;

const SQUEUE: &str = r#"#!/bin/sh
[ -f "$FAKE/down" ] && { echo "slurm_load_jobs error: Unable to contact slurm controller" >&2; exit 1; }
for word in "$@"; do case $word in --name=*) names=${word#--name=} ;; esac; done
touch "$FAKE/queue"
while IFS= read -r line; do
    case ",$names," in *",$(echo "$line" | cut -d'|' -f5),"*) echo "$line" ;; esac
done <"$FAKE/queue"
"#;

const SCONTROL: &str = r#"#!/bin/sh
for job in "$@"; do :; done
cat "$FAKE/ends.$job" 2>/dev/null && exit
echo "slurm_load_jobs error: Invalid job id specified" >&2
exit 1
"#;

const SCANCEL: &str = r#"#!/bin/sh
for id in "$@"; do
    job=${id%_*} task=${id#*_}
    grep -v "^$job|$task|" "$FAKE/queue" >"$FAKE/left"
    mv "$FAKE/left" "$FAKE/queue"
done
"#;

/// A workspace with the fake Slurm in its folder `slurm`.
pub(super) struct FakeSlurm {
    pub(super) place: Workspace,
}

impl FakeSlurm {
    pub(super) fn new(place: Workspace, mode: &str) -> Self {
        let programs = [("sbatch", SBATCH), ("squeue", SQUEUE), ("scontrol", SCONTROL), ("scancel", SCANCEL)];
        for (name, text) in programs {
            place.write(&format!("slurm/{name}"), text);
            let path = place.path(&format!("slurm/{name}"));
            fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
        }
        let fake = Self { place };
        fake.set("mode", mode);
        fake
    }

    /// Writes a file of the fake.
    pub(super) fn set(&self, name: &str, text: &str) {
        self.place.write(&format!("slurm/{name}"), text);
    }

    /// Number of jobs that were submitted.
    pub(super) fn jobs(&self) -> u32 {
        let text = fs::read_to_string(self.place.path("slurm/jobs")).unwrap_or_else(|_| "100".to_owned());
        text.trim().parse::<u32>().unwrap() - 100
    }

    pub(super) fn command(&self, args: &str) -> Command {
        let mut command = hidden_gpus(self.place.command(args));
        let fake = self.place.path("slurm");
        command.env("PATH", format!("{}:/usr/bin:/bin", fake.display())).env("FAKE", fake);
        command.env("TMPDIR", self.place.path(""));
        command
    }

    pub(super) fn gs2e(&self, args: &str) -> RunOutcome {
        let output = self.command(args).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        RunOutcome {
            code: output.status.code().unwrap(),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }

    /// Runs `gs2e`, which must end with this code.
    pub(super) fn ends(&self, code: i32, args: &str) -> RunOutcome {
        let ended = self.gs2e(args);
        assert_eq!(ended.code, code, "gs2e {args}\n{}{}", ended.stdout, ended.stderr);
        ended
    }

    pub(super) fn submit(&self, code: i32, options: &str) -> RunOutcome {
        self.ends(code, &format!("submit {SUBMIT} {options}"))
    }

    pub(super) fn spawn_submit(&self) -> Child {
        let mut command = self.command(&format!("submit {SUBMIT}"));
        command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// The lines of `status --json`.
    pub(super) fn status(&self, recipes: &str) -> Vec<Value> {
        let ended = self.ends(0, &format!("status --json --shared-store shared {recipes}"));
        ended.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// The states of the scenes, in order.
    pub(super) fn states(&self) -> Vec<String> {
        self.status("").iter().map(|line| line["state"].as_str().unwrap().to_owned()).collect()
    }

    /// Runs a task of the last script, as Slurm would. Returns its exit code.
    pub(super) fn run_task(&self, job: u32, task: u32) -> i32 {
        let fake = self.place.path("slurm");
        let mut shell = Command::new("sh");
        shell.arg(fake.join("script")).current_dir("/").stdin(Stdio::null()).stderr(Stdio::null());
        shell.env("SLURM_ARRAY_JOB_ID", job.to_string()).env("SLURM_ARRAY_TASK_ID", task.to_string());
        shell.env("TMPDIR", self.place.path(""));
        hidden_gpus(shell).status().unwrap().code().unwrap()
    }

    /// The folders of the plans.
    pub(super) fn plans(&self) -> Vec<PathBuf> {
        let plans = fs::read_dir(self.place.path("shared/gs2e-plans")).unwrap();
        plans.map(|plan| plan.unwrap().path()).collect()
    }
}

/// Three tasks.
const SUBMIT: &str = "--to slurm --shared-store shared --tasks 3 --cpus 1 --mem 1GB";
