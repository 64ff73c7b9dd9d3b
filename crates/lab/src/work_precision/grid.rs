//! The frames of a setting. Every grid is a part of one fine sequence, so that one rendering serves
//! all.

use serde::Serialize;

/// Choice of frame times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StepRule {
    /// At a frame rate.
    Uniform,
    /// Steps with equal image motion.
    Flow,
}

/// Some frames of a fine sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameGrid {
    /// The rule.
    pub steps: StepRule,
    /// Frames per second. For flow steps, the rate of the uniform grid with the same number of
    /// frames.
    pub rate: u32,
    /// Indices of the fine frames, ascending, including the first and the last of the sequence. The
    /// number of fine steps between two of them is even, so that each interval has a middle.
    pub places: Vec<usize>,
}

impl FrameGrid {
    /// Every n-th of `intervals + 1` fine frames.
    ///
    /// # Panics
    /// `rate` does not divide `finest` into an even number, or `intervals` is odd.
    #[must_use]
    pub(crate) fn uniform_steps(rate: u32, finest: u32, intervals: usize) -> Self {
        assert!(finest.is_multiple_of(2 * rate) && intervals.is_multiple_of(2), "intervals have a middle");
        let every = (finest / rate) as usize;
        let places = (0..intervals).step_by(every).chain([intervals]).collect();
        Self { steps: StepRule::Uniform, rate, places }
    }

    /// The grid with the shortest flow steps that has no more frames than a uniform one. `flows` is
    /// the image motion in each fine interval, px.
    #[must_use]
    pub(crate) fn flow_steps(flows: &[f64], uniform: &Self) -> Self {
        // With this bound, one step spans the whole clip. It is above 0 for a still picture, too.
        let most = flows.iter().copied().fold(f64::MIN_POSITIVE, f64::max) * flows.len() as f64;
        let (mut low, mut high) = (0.0, most);
        // 60 halvings exhaust the 53 bits of the bound.
        for _ in 0..60 {
            let middle = f64::midpoint(low, high);
            if step_places(flows, middle).len() <= uniform.places.len() {
                high = middle
            } else {
                low = middle
            }
        }
        // `high` has always had few enough frames.
        Self { steps: StepRule::Flow, rate: uniform.rate, places: step_places(flows, high) }
    }
}

/// The longest even steps for which the highest flow in them, over their whole length, moves the
/// image by at most `px`.
fn step_places(flows: &[f64], px: f64) -> Vec<usize> {
    let mut places = vec![0];
    let mut at = 0;
    while at < flows.len() {
        let mut highest = 0.0f64;
        let mut end = at;
        // Two fine intervals at a time, so that each step has a middle frame.
        for pair in flows[at..].chunks(2) {
            highest = pair.iter().copied().fold(highest, f64::max);
            let length = end + pair.len() - at;
            // A step has two intervals at least, however fast the picture moves.
            if end > at && highest * length as f64 > px {
                break;
            }
            end = at + length;
        }
        at = end;
        places.push(at);
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_grids_hold_both_ends() {
        assert_eq!(FrameGrid::uniform_steps(600, 2400, 12).places, [0, 4, 8, 12]);
        assert_eq!(FrameGrid::uniform_steps(600, 2400, 10).places, [0, 4, 8, 10]);
    }

    #[test]
    fn flow_steps_go_by_the_highest_flow_ahead() {
        // Slow, then eight times as fast.
        let flows: Vec<f64> = (0..32).map(|j| if j < 16 { 1.0 } else { 8.0 }).collect();
        assert_eq!(step_places(&flows, 16.0), [0, 16, 18, 20, 22, 24, 26, 28, 30, 32]);
        // A step does not extend into the fast part, where it would be too long.
        assert_eq!(step_places(&flows, 12.0)[..4], [0, 12, 16, 18]);
        let even = FrameGrid::flow_steps(&[1.0; 32], &FrameGrid::uniform_steps(100, 800, 32));
        assert_eq!(even.places, [0, 8, 16, 24, 32]);
    }

    #[test]
    fn flow_steps_have_no_more_frames_than_asked() {
        let flows: Vec<f64> = (0..960).map(|j| 1.0 + 0.9 * libm::sin(f64::from(j) * 0.02)).collect();
        for rate in [150, 300, 600, 1200, 2400] {
            let uniform = FrameGrid::uniform_steps(rate, 9600, 960);
            let flow = FrameGrid::flow_steps(&flows, &uniform);
            let (found, wanted) = (flow.places.len(), uniform.places.len());
            assert!(found <= wanted && found * 10 >= wanted * 7, "{rate}: {found} of {wanted}");
            assert!(flow.places.windows(2).all(|w| (w[1] - w[0]).is_multiple_of(2) && w[0] < w[1]));
        }
        let still = FrameGrid::flow_steps(&[0.0; 96], &FrameGrid::uniform_steps(150, 9600, 96));
        assert_eq!(still.places, [0, 96]);
    }
}
