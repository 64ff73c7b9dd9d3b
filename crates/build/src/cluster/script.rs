//! The batch script of an array job of Slurm.

use super::shell::shell_word;
use super::submission::{RESULTS, Submission};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Requests of the user to Slurm.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BatchOptions {
    /// Options of `sbatch` with their values, such as `account`.
    pub slurm: Vec<(&'static str, String)>,
    /// Image of Apptainer in which the program runs.
    pub container: Option<PathBuf>,
    /// True if tasks use a GPU.
    pub gpu: bool,
    /// Folder for the stores of tasks, if they must outlive their tasks.
    pub task_store: Option<PathBuf>,
}

/// An array job as it is submitted. All paths are absolute.
#[derive(Debug, Clone, Copy)]
pub struct BatchScript<'a> {
    /// The plan.
    pub submission: &'a Submission,
    /// Requests of the user to Slurm.
    pub options: &'a BatchOptions,
    /// The program on the nodes. In a container, it is `gs2e`.
    pub program: &'a Path,
    /// The shared store.
    pub shared: &'a Path,
    /// The current folder of tasks.
    pub folder: &'a Path,
    /// Further options of `gs2e build`.
    pub words: &'a [String],
}

/// Share of the memory of a task that its steps may use. The rest is for the program and its files.
const STEP_MEMORY_PERCENT: u64 = 80;
/// Seconds before the time limit at which a task is asked to end.
const SECONDS_TO_END: u32 = 60;

/// Exit code of a task whose results have no safe place, as of `sysexits.h`: a file cannot be created.
const NO_PLACE: u8 = 73;

/// Gives the results a folder of their own. `$shared` is the shared store, and `$below` the plan in it.
///
/// Other people can write to the shared store, so a link may have taken the place of any folder. The shell
/// enters each, and only then compares its path, which no one can change any more. No one else can write to
/// the new folder.
const RESULT_FOLDER: &str = "\
task=${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID
run=$task${SLURM_RESTART_COUNT:+.$SLURM_RESTART_COUNT}
shard=$shared/$below/shard-$(printf %04d \"$SLURM_ARRAY_TASK_ID\").json
# The results are in a new folder that only this user can write to, and no link leads there.
cd -P \"$shared\" && root=$(pwd -P) && cd -P \"./$below/$results\" && [ \"$(pwd -P)\" = \"$root/$below/$results\" ] &&
    mkdir -m 755 \"$run\" && cd -P \"./$run\" && [ \"$(pwd -P)\" = \"$root/$below/$results/$run\" ] || exit \"$no_place\"
mask=$(umask)
umask 022
exec 3>steps.jsonl 4>end >log 2>&1
umask \"$mask\"
";

/// The end of every script. `$work` is the program.
const TAIL: &str = "\
work=$!
# Slurm asks the script to end before the time limit. The program then keeps what it can continue from.
trap 'kill -TERM \"$work\"' TERM
wait \"$work\"
code=$?
# A signal ends the first wait before the program ends.
while kill -0 \"$work\" 2>/dev/null; do
    wait \"$work\"
    code=$?
done
echo \"$code\" >&4
# Others may delete these results when they are old.
chmod g+w .
";

impl BatchScript<'_> {
    /// The text of the script.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = self.head();
        let [shared, folder] = [self.shared, self.folder].map(shell_word);
        let below = shell_word(&self.submission.below());
        let _ = write!(text, "\nshared={shared}\nbelow={below}\nresults={RESULTS}\nno_place={NO_PLACE}\n");
        text.push_str(RESULT_FOLDER);
        match &self.options.task_store {
            None => {
                text.push_str("store=$(mktemp -d \"${TMPDIR:-/tmp}/gs2e-XXXXXXXX\") || exit \"$no_place\"\n");
            }
            Some(folder) => {
                let _ = writeln!(text, "store={}/$SLURM_ARRAY_TASK_ID", shell_word(folder));
            }
        }
        // Stdout of the program is the file of steps. Descriptor 4 is closed for it: only the script writes
        // `end`.
        let _ = writeln!(text, "(cd {folder} && exec {} >&3 3>&- 4>&-) &", self.command());
        text.push_str(TAIL);
        if self.options.task_store.is_none() {
            text.push_str("rm -rf \"$store\"\n");
        }
        text + "exit \"$code\"\n"
    }

    /// The options of `sbatch`.
    fn head(&self) -> String {
        let Submission { plan, .. } = self.submission;
        let mut lines = vec![
            ("job-name", self.submission.name()),
            ("array", format!("1-{}", plan.tasks.len())),
            ("cpus-per-task", plan.cores.to_string()),
            ("mem", format!("{}M", plan.memory_mb)),
        ];
        lines.extend(self.options.slurm.iter().cloned());
        lines.extend([
            // `B:` signals the script alone, whose trap passes the signal on. Otherwise the program would get
            // it twice.
            ("signal", format!("B:TERM@{SECONDS_TO_END}")),
            // Slurm follows links when it opens this file, so no other user may be able to replace it.
            ("output", "/dev/null".to_owned()),
        ]);
        let mut text = "#!/bin/sh\n".to_owned();
        for (option, value) in lines {
            let _ = writeln!(text, "#SBATCH --{option}={}", shell_word(Path::new(&value)));
        }
        // The node failed, and not the work.
        text + "#SBATCH --requeue\n"
    }

    /// The program with its options.
    fn command(&self) -> String {
        let plan = &self.submission.plan;
        let mut command = match &self.options.container {
            None => shell_word(self.program),
            Some(image) => {
                let gpu = if self.options.gpu { " --nv" } else { "" };
                let [shared, folder, image] = [self.shared, self.folder, image.as_path()].map(shell_word);
                format!(
                    "apptainer exec{gpu} --bind {shared} --bind {folder} --bind \"${{TMPDIR:-/tmp}}\" {image} gs2e"
                )
            }
        };
        let memory = plan.memory_mb * STEP_MEMORY_PERCENT / 100;
        let _ = write!(
            command,
            " build --shard-file \"$shard\" --plan-digest {} --store \"$store\" --shared-store {} --keep-going --json \
             --quiet --jobs {} --memory {memory}MB",
            self.submission.digest,
            shell_word(self.shared),
            plan.cores,
        );
        self.words.iter().for_each(|word| command.push_str(&format!(" {}", shell_word(Path::new(word)))));
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::submission::{SubmittedScene, TaskNeed};
    use gs2e_recipe::RecipeFile;
    use gs2e_store::Digest;
    use std::process::Command;

    fn script(options: &BatchOptions, folder: &str) -> String {
        let scene = SubmittedScene { scene: "a".into(), recipe: Digest::of_bytes(b"a") };
        let tasks = [vec![(scene.clone(), RecipeFile::default())], vec![(scene, RecipeFile::default())]];
        let need = TaskNeed { memory_mb: 4000, cores: 2, gpu: false };
        let submission = Submission::plan(Path::new("/lab/shared"), need, &tasks);
        let words = ["--backend".to_owned(), "cpu".to_owned()];
        BatchScript {
            submission: &submission,
            options,
            program: Path::new("/opt/gs2e"),
            shared: Path::new("/lab/shared"),
            folder: Path::new(folder),
            words: &words,
        }
        .text()
    }

    #[test]
    fn the_script_says_what_was_asked() {
        let options = BatchOptions { slurm: vec![("account", "lab 7".into())], ..BatchOptions::default() };
        let text = script(&options, "/home of it/x");
        let wanted = [
            "#SBATCH --array=1-2\n",
            "#SBATCH --mem=4000M\n",
            "#SBATCH --account='lab 7'\n",
            "#SBATCH --output=/dev/null\n",
            "#SBATCH --requeue\n",
            "(cd '/home of it/x' && exec /opt/gs2e build ",
            "--jobs 2 --memory 3200MB --backend cpu >&3 3>&- 4>&-) &\n",
            "rm -rf \"$store\"\n",
        ];
        wanted.iter().for_each(|line| assert!(text.contains(line), "{line}\n{text}"));
        let image = BatchOptions {
            container: Some("/lab/gs2e.sif".into()),
            gpu: true,
            task_store: Some("/scratch/x".into()),
            ..BatchOptions::default()
        };
        let text = script(&image, "/x");
        assert!(text.contains("apptainer exec --nv --bind /lab/shared --bind /x "), "{text}");
        assert!(text.contains(" /lab/gs2e.sif gs2e build "), "{text}");
        assert!(
            text.contains("store=/scratch/x/$SLURM_ARRAY_TASK_ID\n") && !text.contains("rm -rf"),
            "{text}"
        );
    }

    #[test]
    fn the_shell_accepts_the_script() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("task.sh");
        std::fs::write(&path, script(&BatchOptions::default(), "/it's")).unwrap();
        assert!(Command::new("sh").arg("-n").arg(path).status().unwrap().success());
    }
}
