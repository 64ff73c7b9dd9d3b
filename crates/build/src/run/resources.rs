//! Resources that running steps share: cores, memory and GPUs.

use crate::stage::StepNeed;

/// The total for all running steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ResourceBudget {
    /// Threads of a step, and the number of steps that run at once. At least 1.
    pub cores: usize,
    /// Bytes of memory.
    pub memory: u64,
    /// Number of GPUs; each serves one step at a time.
    pub gpus: usize,
}

impl ResourceBudget {
    /// The remaining resources beside some running steps.
    pub(super) fn left<'g>(mut self, running: impl Iterator<Item = &'g StepNeed>) -> Self {
        for need in running {
            // A step on a GPU waits for it most of the time.
            self.cores = self.cores.saturating_sub(usize::from(!need.gpu));
            // A step that runs alone may have been granted more than the total.
            self.memory = self.memory.saturating_sub(need.memory);
            self.gpus = self.gpus.saturating_sub(usize::from(need.gpu));
        }
        self
    }

    /// Returns true if a step may start with the remaining resources.
    pub(super) fn holds(&self, need: &StepNeed) -> bool {
        let has_core = need.gpu || self.cores > 0;
        has_core && self.memory >= need.memory && self.gpus >= usize::from(need.gpu)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_starts_when_all_it_needs_is_left() {
        let budget = ResourceBudget { cores: 2, memory: 100, gpus: 1 };
        let need = |memory, gpu| StepNeed { memory, gpu };
        let t = |running: &[StepNeed], memory, gpu, holds| {
            let left = budget.left(running.iter());
            assert_eq!(left.holds(&need(memory, gpu)), holds, "{running:?}, {memory}, {gpu}");
        };
        t(&[], 100, true, true);
        t(&[], 101, false, false);
        t(&[need(60, false)], 40, true, true);
        t(&[need(60, false)], 41, false, false);
        t(&[need(0, true)], 0, false, true);
        t(&[need(0, true)], 0, true, false);
        t(&[need(0, true), need(0, false)], 0, false, true);
        t(&[need(0, false), need(0, false)], 0, false, false);
        t(&[need(0, false), need(0, false)], 0, true, true);
        t(&[need(200, false)], 0, false, true);
    }
}
