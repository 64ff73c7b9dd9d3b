//! Resources that running steps share: cores, memory and GPUs.

use crate::stage::StepNeed;

/// The total for all running steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ResourceBudget {
    /// Threads, at least 1.
    pub cores: usize,
    /// Bytes of memory.
    pub memory: u64,
    /// Number of GPUs; each serves one step at a time.
    pub gpus: usize,
}

/// Resources that a running step holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct ResourceGrant {
    pub(super) cores: usize,
    pub(super) need: StepNeed,
}

impl ResourceBudget {
    /// The remaining resources.
    pub(super) fn left<'g>(mut self, granted: impl Iterator<Item = &'g ResourceGrant>) -> Self {
        for grant in granted {
            // A step that runs alone may have been granted more than the total.
            self.cores = self.cores.saturating_sub(grant.cores);
            self.memory = self.memory.saturating_sub(grant.need.memory);
            self.gpus = self.gpus.saturating_sub(usize::from(grant.need.gpu));
        }
        self
    }

    /// Returns true if a step may start with the remaining resources.
    pub(super) fn holds(&self, need: &StepNeed) -> bool {
        self.cores > 0 && self.memory >= need.memory && self.gpus >= usize::from(need.gpu)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_starts_when_all_it_needs_is_left() {
        let budget = ResourceBudget { cores: 4, memory: 100, gpus: 1 };
        let grant = |cores, memory, gpu| ResourceGrant { cores, need: StepNeed { memory, gpu } };
        let t = |running: &[ResourceGrant], memory, gpu, holds| {
            let left = budget.left(running.iter());
            assert_eq!(left.holds(&StepNeed { memory, gpu }), holds, "{running:?}, {memory}, {gpu}");
        };
        t(&[], 100, true, true);
        t(&[], 101, false, false);
        t(&[grant(1, 60, false)], 40, true, true);
        t(&[grant(1, 60, false)], 41, false, false);
        t(&[grant(1, 0, true)], 0, false, true);
        t(&[grant(1, 0, true)], 0, true, false);
        t(&[grant(3, 0, false), grant(1, 0, false)], 0, false, false);
        t(&[grant(4, 200, false)], 0, false, false);
    }
}
