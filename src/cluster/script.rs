//! The batch script of an array job of Slurm.

use super::submission::{RESULTS, Submission};
use crate::programs::quoted;
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
echo \"$code\" >>\"$out.end\"
";

impl BatchScript<'_> {
    /// The text of the script.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = self.head();
        let plan = quote(&self.submission.folder);
        let _ = write!(
            text,
            "\nplan={plan}\ntask=${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID\nout=$plan/{RESULTS}/$task\n\
             shard=$plan/shard-$(printf %04d \"$SLURM_ARRAY_TASK_ID\").json\n"
        );
        match &self.options.task_store {
            None => text.push_str("store=${TMPDIR:-/tmp}/gs2e-$task\n"),
            Some(folder) => {
                let _ = writeln!(text, "store={}/$SLURM_ARRAY_TASK_ID", quote(folder));
            }
        }
        let _ = writeln!(text, "{} >>\"$out.jsonl\" &", self.command());
        text.push_str(TAIL);
        if self.options.task_store.is_none() {
            text.push_str("rm -rf \"$store\"\n");
        }
        text + "exit \"$code\"\n"
    }

    /// The options of `sbatch`.
    fn head(&self) -> String {
        let Submission { name, plan, folder } = self.submission;
        let mut lines = vec![
            ("job-name", name.clone()),
            ("array", format!("1-{}", plan.tasks.len())),
            ("cpus-per-task", plan.cores.to_string()),
            ("mem", format!("{}M", plan.memory_mb)),
        ];
        lines.extend(self.options.slurm.iter().cloned());
        let log = folder.join(RESULTS).to_string_lossy().replace('%', "%%") + "/%A_%a.log";
        lines.extend([
            ("signal", format!("B:TERM@{SECONDS_TO_END}")),
            ("output", log),
            ("open-mode", "append".to_owned()),
            ("chdir", self.folder.to_string_lossy().into_owned()),
        ]);
        let mut text = "#!/bin/sh\n".to_owned();
        for (option, value) in lines {
            let _ = writeln!(text, "#SBATCH --{option}={}", quote(Path::new(&value)));
        }
        // The node failed, and not the work.
        text + "#SBATCH --requeue\n"
    }

    /// The program with its options.
    fn command(&self) -> String {
        let plan = &self.submission.plan;
        let mut command = match &self.options.container {
            None => quote(self.program),
            Some(image) => {
                let gpu = if self.options.gpu { " --nv" } else { "" };
                let [shared, folder, image] = [self.shared, self.folder, image.as_path()].map(quote);
                format!(
                    "apptainer exec{gpu} --bind {shared} --bind {folder} --bind \"${{TMPDIR:-/tmp}}\" {image} gs2e"
                )
            }
        };
        let memory = plan.memory_mb * STEP_MEMORY_PERCENT / 100;
        let _ = write!(
            command,
            " build --shard-file \"$shard\" --store \"$store\" --shared-store {} --keep-going --json --quiet \
             --jobs {} --memory {memory}MB",
            quote(self.shared),
            plan.cores,
        );
        self.words.iter().for_each(|word| command.push_str(&format!(" {}", quote(Path::new(word)))));
        command
    }
}

fn quote(path: &Path) -> String {
    quoted([path])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::submission::{SubmittedScene, TaskNeed};
    use crate::recipe::RecipeFile;
    use crate::store::Digest;
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
            "#SBATCH --chdir='/home of it/x'\n",
            "#SBATCH --requeue\n",
            "--jobs 2 --memory 3200MB --backend cpu >>\"$out.jsonl\" &\n",
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
