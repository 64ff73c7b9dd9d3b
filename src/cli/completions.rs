//! `gs2e completions`: the completions of a shell.

use super::words::{Word, one_of};
use super::{Console, ExitKind};
use clap_complete::Shell;

/// Arguments of `completions`.
#[derive(Debug, clap::Args)]
pub(super) struct CompletionsArgs {
    /// Shell
    #[arg(value_parser = one_of(&SHELLS))]
    shell: Shell,
}

/// The shells whose completions are tested.
const SHELLS: [Word<Shell>; 3] =
    [("bash", "", Shell::Bash), ("zsh", "", Shell::Zsh), ("fish", "", Shell::Fish)];

impl CompletionsArgs {
    pub(super) fn run(&self, console: &Console) -> ExitKind {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut super::command_line(), "gs2e", &mut script);
        console.text(&String::from_utf8_lossy(&script));
        ExitKind::Done
    }
}
