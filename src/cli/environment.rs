//! The variables of the environment that the program itself reads. Libraries read others, such as
//! `NO_COLOR`.

use gs2e_store::BucketEnvironment;
use rustix::system::uname;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Values of the variables; `None` where one is not set.
#[derive(Debug, Clone, Default)]
pub struct Environment {
    /// `PATH`: the folders in which programs are found.
    pub path: Option<OsString>,
    /// `HOME`: the user's folder, which no release replaces.
    pub home: Option<OsString>,
    /// `XDG_CACHE_HOME`: folder of the index of a store on a remote disk.
    pub cache: Option<OsString>,
    /// The task of a batch system in which this process runs, by the variables of Slurm, Kubernetes or AWS
    /// Batch.
    pub job: Option<String>,
    /// `SLURMD_NODENAME`: the node of a task of Slurm. Several nodes may have one host name.
    pub node: Option<String>,
    /// `AWS_ACCESS_KEY_ID` and the others that begin so: keys and places of buckets.
    pub bucket: BucketEnvironment,
}

impl Environment {
    /// The environment of this process.
    #[must_use]
    pub fn of_process() -> Self {
        let [path, home, cache] = ["PATH", "HOME", "XDG_CACHE_HOME"].map(std::env::var_os);
        let text = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        // Keys and places are text; other variables are skipped.
        let pairs = std::env::vars_os()
            .filter_map(|(name, value)| name.into_string().ok().zip(value.into_string().ok()));
        let variables = pairs.filter(|(name, _)| name.starts_with("AWS_")).collect();
        let bucket = BucketEnvironment { variables, home: home.as_ref().map(PathBuf::from) };
        Self { path, home, cache, job: job_of(&text), node: text("SLURMD_NODENAME"), bucket }
    }

    /// Name of this machine.
    pub(super) fn host(&self) -> String {
        self.node.clone().unwrap_or_else(|| uname().nodename().to_string_lossy().into_owned())
    }

    pub(super) fn home(&self) -> Option<&Path> {
        self.home.as_deref().map(Path::new)
    }

    /// The user's cache folder: `XDG_CACHE_HOME`, else `.cache` in the home folder.
    pub(super) fn cache_folder(&self) -> Option<PathBuf> {
        let given = self.cache.as_ref().map(PathBuf::from);
        given.or_else(|| Some(self.home()?.join(".cache")))
    }
}

/// The path of this program, as other machines may find it.
pub(super) fn this_program() -> PathBuf {
    std::env::current_exe().unwrap_or_else(|_| PathBuf::from("gs2e"))
}

/// The task that these variables name.
fn job_of(value: &dyn Fn(&str) -> Option<String>) -> Option<String> {
    let of_array =
        |job: &str, task: &str, joint: char| Some(format!("{}{joint}{}", value(job)?, value(task)?));
    of_array("SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID", '_')
        .or_else(|| value("SLURM_JOB_ID"))
        // AWS Batch adds the index of the child itself. A pod of a Job has its name as host name.
        .or_else(|| value("AWS_BATCH_JOB_ID"))
        .or_else(|| of_array("HOSTNAME", "JOB_COMPLETION_INDEX", '/'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_named_by_the_variables_of_their_batch_system() {
        let t = |set: &[(&str, &str)], wanted: Option<&str>| {
            let value = |name: &str| Some(set.iter().find(|(known, _)| *known == name)?.1.to_owned());
            assert_eq!(job_of(&value).as_deref(), wanted, "{set:?}");
        };
        t(&[], None);
        t(
            &[("SLURM_JOB_ID", "13"), ("SLURM_ARRAY_JOB_ID", "12"), ("SLURM_ARRAY_TASK_ID", "3")],
            Some("12_3"),
        );
        t(&[("SLURM_JOB_ID", "13")], Some("13"));
        t(&[("AWS_BATCH_JOB_ID", "a-b:3"), ("AWS_BATCH_JOB_ARRAY_INDEX", "3")], Some("a-b:3"));
        t(&[("HOSTNAME", "gs2e-3-x"), ("JOB_COMPLETION_INDEX", "3")], Some("gs2e-3-x/3"));
        t(&[("HOSTNAME", "gs2e-3-x")], None);
    }
}
