//! The command line of the fault tests.

use crate::Size;

/// The parsed command line.
#[derive(Debug)]
pub(crate) struct Arguments {
    pub(crate) size: Size,
    only: Vec<String>,
}

impl Arguments {
    /// Parses `[--long] [--seconds N] [--only NAME]... [--seed N]`; `names` are the names of the
    /// tests.
    pub(crate) fn parse(args: impl Iterator<Item = String>, names: &[&str]) -> Result<Self, String> {
        let mut read = Self { size: Size { long: false, seed: 1, seconds: None }, only: Vec::new() };
        let mut args = args;
        while let Some(arg) = args.next() {
            let mut value = || args.next().ok_or(format!("{arg} wants a value"));
            match arg.as_str() {
                "--long" => read.size.long = true,
                "--seed" => read.size.seed = value()?.parse().map_err(|e| format!("--seed: {e}"))?,
                "--seconds" => {
                    read.size.seconds = Some(value()?.parse().map_err(|e| format!("--seconds: {e}"))?);
                }
                "--only" => read.only.push(value()?),
                _ => {
                    return Err(format!(
                        "unknown argument `{arg}`; there are --long, --seconds N, --only NAME, --seed N"
                    ));
                }
            }
        }
        let unknown = read.only.iter().find(|name| !names.contains(&name.as_str()));
        unknown.map_or(Ok(()), |name| Err(format!("no test `{name}`; there are {}", names.join(", "))))?;
        Ok(read)
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|only| only == name)
    }
}
