//! A build by an array job of Slurm, with faults: tasks and daemons are killed, and the release must equal
//! that of one machine.
//!
//! The cluster is private to this task: a controller and four `slurmd` on this host, with their ports,
//! keys and files in a temporary folder. Debian: `apt install slurm-wlm munge`.

use crate::command::{Outcome, cargo, program, root, say};
use crate::folder::Folder;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const PROGRAMS: [&str; 7] = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "sinfo", "scontrol"];
const NODES: [&str; 4] = ["n1", "n2", "n3", "n4"];
/// The controller's port; the nodes have the next ones.
const PORT: usize = 17_000;
/// Longest time of a job.
const PATIENCE: Duration = Duration::from_secs(1800);

/// Runs it: `--scenes N` (200), `--tasks N` (8), `--program FILE` (built in release mode).
pub(crate) fn run(args: &[String]) -> Outcome {
    let value = |name: &str| args.iter().position(|arg| arg == name).and_then(|at| args.get(at + 1));
    let number = |name: &str, default: usize| {
        value(name).map_or(Ok(default), |text| text.parse().map_err(|_| format!("{name} takes a number")))
    };
    let (scenes, tasks) = (number("--scenes", 200)?, number("--tasks", 8)?);
    let absent = PROGRAMS.iter().find(|name| !program(OsStr::new("which"), &[**name]).succeeds());
    if let Some(absent) = absent {
        return Err(format!("{absent} is not installed, and nothing ran: apt install slurm-wlm munge"));
    }
    let gs2e = match value("--program") {
        Some(path) => std::path::absolute(path).map_err(|e| format!("{path}: {e}"))?,
        None => {
            cargo(&["build", "--release", "--quiet"]).run()?;
            root().join("target/release/gs2e")
        }
    };
    let folder = Folder::new("slurm")?;
    let cluster = Cluster::start(folder.path())?;
    let place = Place { folder: folder.path().to_owned(), gs2e, tasks };
    place.write_recipes(scenes)?;
    let started = Instant::now();
    place.gs2e("release recipes --store alone --to one")?;
    let steps = records(&place.folder.join("alone"));
    say(&format!("one machine: {scenes} scenes, {steps} steps, {:.1} s", started.elapsed().as_secs_f64()));

    let started = Instant::now();
    let first = cluster.submit(&place)?;
    let shared = place.folder.join("shared");
    let reached = |share: f64| {
        let wanted = steps as f64 * share;
        cluster.wait(&format!("{share} of the steps"), || records(&shared) as f64 >= wanted)
    };
    reached(0.1)?;
    let task = place.running_task(&first)?;
    kill(&task)?;
    say(&format!("killed a task, with {} steps in the shared store", records(&shared)));
    reached(0.2)?;
    kill(&cluster.pid("n2.pid")?)?;
    say(&format!("killed a slurmd, with {} steps in the shared store", records(&shared)));
    reached(0.35)?;
    kill(&cluster.pid("controller.pid")?)?;
    sleep(Duration::from_secs(1));
    cluster.daemon("slurmctld", &[])?;
    say(&format!("killed and restarted slurmctld, with {} steps in the shared store", records(&shared)));
    cluster.daemon("slurmd", &["-N", "n2"])?;
    // The new controller may have forgotten the end of the first killed task, and run it again.
    reached(0.7)?;
    kill(&place.running_task(&first)?)?;
    say(&format!("killed another task, with {} steps in the shared store", records(&shared)));
    cluster.finish(&first)?;
    let after_first = records(&shared);
    say(&format!("first array: {after_first} of {steps} steps, {:.1} s", started.elapsed().as_secs_f64()));
    let second = cluster.submit(&place)?;
    cluster.finish(&second)?;
    let failed = place.failed_tasks(&second)?;
    if !failed.is_empty() {
        return Err(format!("tasks of the second array failed: {}", failed.join(", ")));
    }
    let [made, again] = [&first, &second].map(|job| place.states(job).get("made").copied().unwrap_or(0));
    place.judge(steps, (made, again), after_first)
}

/// The daemons, stopped on drop.
struct Cluster {
    folder: PathBuf,
}

impl Cluster {
    fn start(folder: &Path) -> Outcome<Self> {
        let cluster = Self { folder: folder.to_owned() };
        let host = first_line(&program(OsStr::new("hostname"), &["-s"]).capture()?.stdout);
        let user = first_line(&program(OsStr::new("id"), &["-un"]).capture()?.stdout);
        let here = folder.display();
        let nodes: String = (1..)
            .zip(NODES)
            .map(|(i, name)| {
                format!("NodeName={name} NodeHostname={host} Port={} CPUs=2 State=UNKNOWN\n", PORT + i)
            })
            .collect();
        let settings = format!(
            "ClusterName=gs2e\nSlurmctldHost={host}\nSlurmctldPort={PORT}\nSlurmUser={user}\nSlurmdUser={user}\n\
             AuthType=auth/munge\nAuthInfo=socket={here}/munge.socket\nStateSaveLocation={here}/state\n\
             SlurmdSpoolDir={here}/spool/%n\nSlurmctldPidFile={here}/controller.pid\n\
             SlurmdPidFile={here}/%n.pid\nSlurmctldLogFile={here}/controller.log\nSlurmdLogFile={here}/%n.log\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSelectType=select/cons_tres\n\
             SelectTypeParameters=CR_CPU\nMpiDefault=none\nReturnToService=2\nSlurmdTimeout=10\nKillWait=2\n\
             JobRequeue=1\n{nodes}PartitionName=all Nodes=n[1-4] Default=YES MaxTime=INFINITE State=UP\n"
        );
        for name in ["state", "spool", "out"] {
            create(&folder.join(name))?;
        }
        write(&folder.join("slurm.conf"), &settings)?;
        // The key protects nothing but this cluster, and munged insists on its permissions.
        let key = folder.join("munge.key");
        write(&key, &format!("{:x<64}", std::process::id()))?;
        for (mode, path) in [("0400", &key), ("0711", &cluster.folder)] {
            program(OsStr::new("chmod"), &[OsStr::new(mode), path.as_os_str()]).run()?;
        }
        let option = |name: &str, file: &str| format!("--{name}={here}/{file}");
        let options = [
            "--force".to_owned(),
            option("key-file", "munge.key"),
            option("socket", "munge.socket"),
            option("pid-file", "munged.pid"),
            option("log-file", "munged.log"),
            option("seed-file", "munge.seed"),
        ];
        program(OsStr::new("munged"), &options).run()?;
        cluster.daemon("slurmctld", &[])?;
        for node in NODES {
            cluster.daemon("slurmd", &["-N", node])?;
        }
        cluster.wait("four idle nodes", || {
            let nodes = cluster.slurm("sinfo", &["-h", "-o", "%D %t"]);
            nodes.is_ok_and(|nodes| nodes.trim() == "4 idle")
        })?;
        Ok(cluster)
    }

    fn command(&self, name: &str) -> Command {
        let mut command = Command::new(name);
        command.env("SLURM_CONF", self.folder.join("slurm.conf")).current_dir(&self.folder);
        command.stdin(Stdio::null());
        command
    }

    fn daemon(&self, name: &str, args: &[&str]) -> Outcome {
        let status = self.command(name).args(args).status().map_err(|e| format!("{name}: {e}"))?;
        if status.success() { Ok(()) } else { Err(format!("{name} ended with {status}")) }
    }

    /// The stdout of a command of Slurm.
    fn slurm(&self, name: &str, args: &[&str]) -> Outcome<String> {
        let output = self.command(name).args(args).output().map_err(|e| format!("{name}: {e}"))?;
        if output.status.success() {
            return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
        }
        Err(format!("{name} ended with {}: {}", output.status, String::from_utf8_lossy(&output.stderr)))
    }

    fn pid(&self, file: &str) -> Outcome<String> {
        read(&self.folder.join(file)).map(|text| text.trim().to_owned())
    }

    fn wait(&self, what: &str, done: impl Fn() -> bool) -> Outcome {
        let started = Instant::now();
        while !done() {
            if started.elapsed() > PATIENCE {
                return Err(format!("waited in vain for {what}"));
            }
            sleep(Duration::from_millis(20));
        }
        Ok(())
    }

    /// Submits the array, and returns its number.
    fn submit(&self, place: &Place) -> Outcome<String> {
        let script = self.folder.join("task.sh");
        write(&script, &place.script())?;
        let array = format!("--array=1-{}", place.tasks);
        let script = script.to_string_lossy().into_owned();
        let options = ["--parsable", "--requeue", "--output=/dev/null", array.as_str(), script.as_str()];
        self.slurm("sbatch", &options).map(|job| job.trim().to_owned())
    }

    /// Waits until no task of a job is queued or running.
    fn finish(&self, job: &str) -> Outcome {
        self.wait(&format!("the end of job {job}"), || {
            sleep(Duration::from_millis(500));
            // The controller may be starting.
            self.slurm("squeue", &["-h", "-j", job]).is_ok_and(|tasks| tasks.trim().is_empty())
        })
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let nodes = NODES.map(|node| format!("{node}.pid"));
        let files = nodes.iter().map(String::as_str).chain(["controller.pid", "munged.pid"]);
        let pids: Vec<String> = files.filter_map(|file| self.pid(file).ok()).collect();
        let signal = |name: &str, pid: &String| program(OsStr::new("kill"), &[name, pid.as_str()]).succeeds();
        // A daemon may have ended before.
        pids.iter().for_each(|pid| _ = signal("-TERM", pid));
        // They write into the folder to the end.
        let started = Instant::now();
        while pids.iter().any(|pid| signal("-0", pid)) && started.elapsed() < Duration::from_secs(20) {
            sleep(Duration::from_millis(100));
        }
    }
}

/// The recipes, stores and releases.
struct Place {
    folder: PathBuf,
    gs2e: PathBuf,
    tasks: usize,
}

impl Place {
    fn write_recipes(&self, scenes: usize) -> Outcome {
        create(&self.folder.join("recipes"))?;
        for i in 0..scenes {
            let recipe = format!(
                "version: 1\nscene: s{i:04}\nseed: 7\n\
                 source: {{ procedural: {{ gaussians: 300, views: 6, arc: 0.5, seed: {i} }} }}\n\
                 camera: {{ width: 48, height: 32 }}\ntrajectories: [{{ name: base, refine: {{ factor: 2 }} }}]\n\
                 sensor: {{ voltmeter: {{ preset: dvs346-paper }} }}\n\
                 licence: {{ expression: CC0-1.0, holder: a test }}\n"
            );
            write(&self.folder.join(format!("recipes/s{i:04}.yaml")), &recipe)?;
        }
        Ok(())
    }

    /// The script of a task. A task that runs again writes other files.
    fn script(&self) -> String {
        format!(
            "#!/bin/sh\ncd {here:?}\nname=out/$SLURM_ARRAY_JOB_ID.$SLURM_ARRAY_TASK_ID.${{SLURM_RESTART_COUNT:-0}}\n\
             {gs2e:?} build recipes --json --keep-going -j 1 --shard $SLURM_ARRAY_TASK_ID/{tasks} \
             --store stores/$SLURM_ARRAY_TASK_ID --shared-store shared >$name.json 2>$name.log &\n\
             echo $! >$name.pid\nwait $!\necho $? >$name.code\n",
            here = self.folder,
            gs2e = self.gs2e,
            tasks = self.tasks
        )
    }

    fn gs2e(&self, args: &str) -> Outcome<String> {
        let output = Command::new(&self.gs2e).args(args.split(' ')).current_dir(&self.folder).output();
        let output = output.map_err(|e| format!("{}: {e}", self.gs2e.display()))?;
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.success() { Ok(text) } else { Err(format!("gs2e {args} failed:\n{text}")) }
    }

    fn outputs(&self, job: &str, end: &str) -> Vec<PathBuf> {
        let files = fs::read_dir(self.folder.join("out")).into_iter().flatten().flatten();
        let named = files.map(|file| file.path()).filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            name.starts_with(&format!("{job}.")) && name.ends_with(end)
        });
        named.collect()
    }

    /// The process of a task that has not ended.
    fn running_task(&self, job: &str) -> Outcome<String> {
        let running =
            self.outputs(job, ".pid").into_iter().find(|path| !path.with_extension("code").exists());
        let running = running.ok_or_else(|| format!("no task of job {job} runs"))?;
        Ok(read(&running)?.trim().to_owned())
    }

    fn failed_tasks(&self, job: &str) -> Outcome<Vec<String>> {
        let codes = self.outputs(job, ".code");
        if codes.len() < self.tasks {
            return Err(format!("{} of {} tasks of job {job} ended", codes.len(), self.tasks));
        }
        let failed = codes.into_iter().filter(|path| read(path).is_ok_and(|code| code.trim() != "0"));
        Ok(failed.map(|path| path.display().to_string()).collect())
    }

    /// Number of steps of a job by their state.
    fn states(&self, job: &str) -> BTreeMap<String, usize> {
        let mut states = BTreeMap::new();
        for text in self.outputs(job, ".json").iter().filter_map(|path| read(path).ok()) {
            for line in text.lines() {
                let state = line.split("\"state\":\"").nth(1).and_then(|rest| rest.split('"').next());
                state.into_iter().for_each(|state| *states.entry(state.to_owned()).or_default() += 1);
            }
        }
        states
    }

    fn judge(&self, steps: usize, (made, again): (usize, usize), after_first: usize) -> Outcome {
        let ended = self.gs2e("release recipes --store new --shared-store shared --to other")?;
        if !ended.contains("made 0, ") {
            return Err(format!("the release made steps that the shared store lacks:\n{ended}"));
        }
        let trees = ["one", "other"].map(|name| self.folder.join(name));
        if !program(OsStr::new("diff"), &["-r".as_ref(), trees[0].as_os_str(), trees[1].as_os_str()])
            .succeeds()
        {
            return Err("the releases differ".to_owned());
        }
        // What the first array finished must not be made by the second.
        let missing = steps - after_first;
        say(&format!(
            "second array: {again} steps made, {missing} were missing\nsteps made twice: {} of {steps}\n\
             the release from the shared store equals that of one machine",
            (made + again).saturating_sub(steps)
        ));
        if again > missing {
            return Err(format!("the second array made {} steps that were there", again - missing));
        }
        Ok(())
    }
}

/// Number of records of a store.
fn records(store: &Path) -> usize {
    let folders = fs::read_dir(store.join("ac")).into_iter().flatten().flatten();
    folders.map(|folder| fs::read_dir(folder.path()).into_iter().flatten().count()).sum()
}

fn kill(pid: &str) -> Outcome {
    program(OsStr::new("kill"), &["-9", pid]).run()
}

fn first_line(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).lines().next().unwrap_or_default().to_owned()
}

fn create(path: &Path) -> Outcome {
    fs::create_dir_all(path).map_err(|e| format!("{}: {e}", path.display()))
}

fn write(path: &Path, text: &str) -> Outcome {
    fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

fn read(path: &Path) -> Outcome<String> {
    fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}
