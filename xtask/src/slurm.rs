//! A build by `gs2e submit` on Slurm, with faults: tasks, daemons and the submitter are killed, and the
//! release must equal that of one machine.
//!
//! The cluster is private to this task: a controller and four `slurmd` on this host, with their ports,
//! keys and files in a temporary folder. Debian: `apt install slurm-wlm munge`.

use crate::command::{Outcome, program, say};
use crate::folder::Folder;
use crate::options::Options;
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
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
    let options = Options(args);
    let (scenes, tasks) = (options.number("--scenes", 200)?, options.number("--tasks", 8)?);
    let absent = PROGRAMS.iter().find(|name| !program(OsStr::new("which"), &[**name]).succeeds());
    if let Some(absent) = absent {
        return Err(format!("{absent} is not installed, and nothing ran: apt install slurm-wlm munge"));
    }
    let gs2e = options.program(&[])?;
    let folder = Folder::new("slurm")?;
    let cluster = Cluster::start(folder.path())?;
    let place = Place { folder: folder.path().to_owned(), gs2e, tasks };
    place.write_recipes(scenes)?;
    let started = Instant::now();
    place.gs2e("release recipes --store alone --to one")?;
    let steps = records(&place.folder.join("alone"));
    say(&format!("one machine: {scenes} scenes, {steps} steps, {:.1} s", started.elapsed().as_secs_f64()));
    place.faults(&cluster, steps)?;
    place.judge(&cluster, steps)
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
                format!(
                    "NodeName={name} NodeHostname={host} Port={} CPUs=2 RealMemory=4000 State=UNKNOWN\n",
                    PORT + i
                )
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
        for name in ["state", "spool"] {
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

    /// Names of the jobs with tasks that have not ended.
    fn jobs(&self) -> Outcome<BTreeSet<String>> {
        let jobs = self.slurm("squeue", &["--noheader", "--array", "--format=%F"])?;
        Ok(jobs.split_whitespace().map(str::to_owned).collect())
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

    fn gs2e(&self, args: &str) -> Outcome<String> {
        let output = self.command(args).output();
        let output = output.map_err(|e| format!("{}: {e}", self.gs2e.display()))?;
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.success() { Ok(text) } else { Err(format!("gs2e {args} failed:\n{text}")) }
    }

    fn command(&self, args: &str) -> Command {
        let mut command = Command::new(&self.gs2e);
        command.args(args.split(' ')).current_dir(&self.folder).stdin(Stdio::null());
        command.env("SLURM_CONF", self.folder.join("slurm.conf"));
        command
    }

    /// The command that submits what is not done, and waits.
    fn submission(&self) -> String {
        format!(
            "submit recipes --to slurm --store submitter --shared-store shared --tasks {} --cpus 1 --mem 500MB",
            self.tasks
        )
    }

    /// Starts to submit. Its words go to a file.
    fn submit(&self, name: &str) -> Outcome<Child> {
        let log = File::create(self.folder.join(name)).map_err(|e| format!("{name}: {e}"))?;
        let child = self.command(&self.submission()).stderr(log).spawn();
        child.map_err(|e| format!("{}: {e}", self.gs2e.display()))
    }

    /// Builds by an array job, with faults, until a second submitter says that all is done.
    fn faults(&self, cluster: &Cluster, steps: usize) -> Outcome {
        let started = Instant::now();
        let shared = self.folder.join("shared");
        let reached = |share: f64| {
            let wanted = steps as f64 * share;
            cluster.wait(&format!("{share} of the steps"), || records(&shared) as f64 >= wanted)
        };
        let there = || format!("with {} of {steps} steps in the shared store", records(&shared));
        let mut first = self.submit("first.log")?;
        reached(0.1)?;
        kill(&self.running_task()?)?;
        say(&format!("killed a task, {}", there()));
        reached(0.2)?;
        kill(&cluster.pid("n2.pid")?)?;
        say(&format!("killed a slurmd, {}", there()));
        reached(0.35)?;
        kill(&cluster.pid("controller.pid")?)?;
        sleep(Duration::from_secs(1));
        cluster.daemon("slurmctld", &[])?;
        say(&format!("killed and restarted slurmctld, {}", there()));
        cluster.daemon("slurmd", &["-N", "n2"])?;
        reached(0.5)?;
        kill(&first.id().to_string())?;
        first.wait().map_err(|e| e.to_string())?;
        say(&format!("killed the submitter, {}", there()));
        cluster.wait("the controller", || cluster.jobs().is_ok())?;
        let mut second = self.submit("second.log")?;
        cluster.wait("the second submitter", || {
            read(&self.folder.join("second.log")).is_ok_and(|text| text.contains("tasks running"))
        })?;
        self.nothing_is_submitted_twice()?;
        // The new controller may have forgotten the end of the first killed task, and run it again.
        reached(0.7)?;
        kill(&self.running_task()?)?;
        say(&format!("killed another task, {}", there()));
        let status = second.wait().map_err(|e| e.to_string())?;
        let words = read(&self.folder.join("second.log"))?;
        if !status.success() {
            return Err(format!("the second submitter ended with {status}:\n{words}"));
        }
        say(&format!(
            "all scenes are done after {:.1} s; the second submitter said:",
            started.elapsed().as_secs_f64()
        ));
        words.lines().for_each(|line| say(&format!("  {line}")));
        Ok(())
    }

    /// The second submitter must submit the scenes of dead tasks, and no others.
    fn nothing_is_submitted_twice(&self) -> Outcome {
        let words = read(&self.folder.join("second.log"))?;
        let number = |before: &str| {
            let rest = words.split(before).nth(1).unwrap_or_default();
            rest.split(|c: char| !c.is_ascii_digit()).next().and_then(|n| n.parse::<usize>().ok())
        };
        let wanted = number("failed ").unwrap_or(0) + number("open ").unwrap_or(0);
        let job = words.split("job ").nth(1).and_then(|rest| rest.split(": ").nth(1)).unwrap_or("0");
        let found = job.split(' ').next().and_then(|n| n.parse::<usize>().ok()).unwrap_or(0);
        if found != wanted {
            return Err(format!("{found} scenes were submitted again, wanted {wanted}:\n{words}"));
        }
        say(&format!("a second submitter submitted {found} scenes of dead tasks, and waits for the others"));
        Ok(())
    }

    /// A process of a task that runs.
    fn running_task(&self) -> Outcome<String> {
        let here = self.folder.display().to_string();
        let found = fs::read_dir("/proc").into_iter().flatten().flatten().find(|entry| {
            let words = fs::read(entry.path().join("cmdline")).unwrap_or_default();
            let words = String::from_utf8_lossy(&words).into_owned();
            words.contains(&here)
                && words.split('\0').any(|word| word == "--shard-file")
                && words.split('\0').next().is_some_and(|name| name.ends_with("gs2e"))
        });
        let found = found.ok_or("no task runs")?;
        Ok(found.file_name().to_string_lossy().into_owned())
    }

    /// The keys of the steps that tasks say they made, once for each time.
    fn made(&self) -> Vec<String> {
        let plans = fs::read_dir(self.folder.join("shared/gs2e-plans")).into_iter().flatten().flatten();
        let results = plans.flat_map(|plan| fs::read_dir(plan.path().join("results")).into_iter().flatten());
        let files = results.flatten().map(|run| run.path().join("steps.jsonl"));
        let text: String = files.filter_map(|path| read(&path).ok()).collect();
        let lines = text.lines().filter(|line| line.contains("\"state\":\"made\""));
        let key = |line: &str| Some(line.split("\"key\":\"").nth(1)?.split('"').next()?.to_owned());
        lines.filter_map(key).collect()
    }

    fn judge(&self, cluster: &Cluster, steps: usize) -> Outcome {
        let made = self.made();
        let once: BTreeSet<&String> = made.iter().collect();
        say(&format!("tasks made {} of {steps} steps; made twice: {}", once.len(), made.len() - once.len()));
        if made.len() > once.len() {
            return Err("a finished step was made again".to_owned());
        }
        let said = self.gs2e(&self.submission())?;
        if !cluster.jobs()?.is_empty() || said.contains("job ") {
            return Err(format!("a job was submitted although all scenes are done:\n{said}"));
        }
        let ended = self.gs2e("release recipes --store new --shared-store shared --to other")?;
        if !ended.lines().any(|line| line.starts_with("0 steps built,")) {
            return Err(format!("the release made steps that the shared store lacks:\n{ended}"));
        }
        let trees = ["one", "other"].map(|name| self.folder.join(name));
        let same = program(OsStr::new("diff"), &["-r".as_ref(), trees[0].as_os_str(), trees[1].as_os_str()]);
        if !same.succeeds() {
            return Err("the releases differ".to_owned());
        }
        say("the release from the shared store equals that of one machine");
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
