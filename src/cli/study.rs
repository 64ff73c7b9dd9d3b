//! `gs2e study`: measurements over one scene.

mod thresholds;

use super::Common;
use super::console::Console;
use super::problem::{Exit, Problem};

/// Arguments of `study`.
#[derive(Debug, clap::Args)]
pub(super) struct Study {
    #[command(subcommand)]
    of: Of,
}

#[derive(Debug, clap::Subcommand)]
enum Of {
    /// Sweep the contrast threshold: how many events each makes, and which of them come from the scene's smooth motion
    Thresholds(thresholds::Thresholds),
}

impl Study {
    pub(super) fn run(self, common: &Common, console: &Console) -> Result<Exit, Problem> {
        match self.of {
            Of::Thresholds(study) => study.run(common, console),
        }
    }
}
