//! `gs2e completions`: the completions of a shell.

use super::console::Console;
use super::problem::ExitKind;
use clap_complete::Shell;

/// Arguments of `completions`.
#[derive(Debug, clap::Args)]
pub(super) struct CompletionsArgs {
    /// Shell
    #[arg(value_enum)]
    shell: CompletedShell,
}

/// The shells whose completions are tested.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum CompletedShell {
    Bash,
    Zsh,
    Fish,
}

impl CompletionsArgs {
    pub(super) fn run(&self, console: &Console) -> ExitKind {
        let shell = match self.shell {
            CompletedShell::Bash => Shell::Bash,
            CompletedShell::Zsh => Shell::Zsh,
            CompletedShell::Fish => Shell::Fish,
        };
        let mut script = Vec::new();
        clap_complete::generate(shell, &mut super::command_line(), "gs2e", &mut script);
        console.text(&String::from_utf8_lossy(&script));
        ExitKind::Done
    }
}
