//! The command line of the harness.

use std::path::PathBuf;

/// The parsed command line.
#[derive(Debug)]
pub(crate) struct Arguments {
    /// Time for each reader, s.
    pub(crate) seconds: u64,
    pub(crate) seed: u64,
    /// The number of the first run.
    pub(crate) first: u64,
    /// Maximum number of runs of each reader.
    pub(crate) runs: Option<u64>,
    /// Number of readers that run at a time.
    pub(crate) jobs: u64,
    /// The file to which a child writes its progress.
    pub(crate) progress: Option<PathBuf>,
    only: Vec<String>,
}

impl Arguments {
    /// Parses the arguments; `names` are the names of the readers.
    pub(crate) fn parse(mut args: impl Iterator<Item = String>, names: &[&str]) -> Result<Self, String> {
        let mut read =
            Self { seconds: 300, seed: 1, first: 0, runs: None, jobs: 1, progress: None, only: Vec::new() };
        while let Some(arg) = args.next() {
            let value = args.next().ok_or(format!("`{arg}` is unknown, or wants a value"))?;
            let number = || value.parse::<u64>().map_err(|e| format!("{arg}: {e}"));
            match arg.as_str() {
                "--seconds" => read.seconds = number()?,
                "--seed" => read.seed = number()?,
                "--first" => read.first = number()?,
                "--runs" => read.runs = Some(number()?),
                "--jobs" => read.jobs = number()?.max(1),
                "--progress" => read.progress = Some(value.into()),
                "--only" => read.only.push(value),
                _ => {
                    return Err(format!(
                        "unknown argument `{arg}`; there are --seconds N, --only READER, --seed N, --first N, --runs N, \
                         --jobs N"
                    ));
                }
            }
        }
        let unknown = read.only.iter().find(|name| !names.contains(&name.as_str()));
        match unknown {
            Some(name) => Err(format!("no reader `{name}`; there are {}", names.join(", "))),
            None => Ok(read),
        }
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|only| only == name)
    }
}
