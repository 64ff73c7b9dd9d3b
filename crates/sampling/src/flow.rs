//! Image motion along a path, and moments between which the image moves equally far.
//!
//! The path is known, so a step is chosen by the highest flow within it, not only by the flow at
//! its start. Depth is rendered at some places. The flow between them follows from the depth and
//! from the camera's motion at each moment, so a burst of motion between two places is noticed.

use gs2e_image::{Image, Size};
use gs2e_num::stats::nearest_ranks;
use gs2e_render::lights::SceneLights;
use gs2e_render::{ChannelSet, RenderError, RenderedImages, Renderer};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::flow::{flow_of_objects, with_drift};
use gs2e_scene::camera::view::CameraView;
use gs2e_trajectory::sampled::SampledPath;
use rayon::prelude::*;

/// Bounds on the number of spans of a path, each with one flow. Within them it is the number of
/// steps between the poses.
const SPANS: [usize; 2] = [64, 2048];
/// Places at which depth is rendered: one per this many spans, within these bounds.
const SPANS_PER_PLACE: usize = 64;
const PLACES: [usize; 2] = [9, 33];
/// Width of the depth images, px. Enough for a quantile over their pixels.
const WIDTH: u32 = 40;
/// Percentage of pixels that move no faster than the flow of a moment.
const PERCENT: usize = 99;
/// The shortest step, us: 50,000 frames per second.
pub(super) const SHORTEST_US: i64 = 20;
/// Minimum number of steps of a path, however slowly the image moves.
const MIN_STEPS: i64 = 8;

/// The flow along a path.
#[derive(Debug, Clone, PartialEq)]
pub struct PathFlow {
    /// The highest flow in each of equal spans, px/s.
    px_s: Vec<f64>,
    end_us: i64,
}

impl PathFlow {
    /// Measures the flow seen by `camera` along a path with `intervals` steps between its poses
    /// that ends at `end_us`. Any promise of poses to the renderer is replaced.
    ///
    /// # Errors
    /// A place cannot be rendered.
    pub fn measure_path(
        path: &SampledPath,
        intervals: usize,
        end_us: i64,
        camera: Camera,
        renderer: &mut dyn Renderer,
    ) -> Result<Self, RenderError> {
        let Size { width, height } = camera.size;
        let columns = width.min(WIDTH);
        let rows = (u64::from(height) * u64::from(columns)).div_ceil(u64::from(width));
        let rows = u32::try_from(rows).unwrap_or(height);
        let small = camera.resized(Size { width: columns, height: rows });
        // The flow of the small image is in its own pixels. This factor converts it to the
        // camera's.
        let pixels = f64::from(width) / f64::from(columns);
        let spans = intervals.clamp(SPANS[0], SPANS[1]);
        let places = (spans / SPANS_PER_PLACE).clamp(PLACES[0], PLACES[1]);
        let time = |share: f64| share * path.seconds();
        let place = |k: usize| k as f64 / (places - 1) as f64;
        renderer.keep_to(&small, &[]);
        let (mut rendered, mut depths) = (RenderedImages::default(), Vec::with_capacity(places));
        for k in 0..places {
            let want = ChannelSet { depth: true, ..renderer.motion_channels() };
            let seconds = time(place(k));
            let view = CameraView::at_rest(small, path.at(seconds).0).at_time(seconds);
            renderer.render(&view, want, &mut rendered)?;
            let depth = rendered.depth.take().expect("depth was asked for");
            depths.push(PlaceDepth {
                depth,
                segmentation: rendered.segmentation.take(),
                drift: rendered.drift.take(),
            });
        }
        // At both ends and in the middle of each span.
        let views = (0..=2 * spans).map(|m| {
            let seconds = time(m as f64 / (2 * spans) as f64);
            let (world_from_camera, velocity) = path.at(seconds);
            let still = CameraView::at_rest(small, world_from_camera).at_time(seconds);
            renderer.object_views(&CameraView { velocity, ..still })
        });
        let views: Vec<Vec<CameraView>> = views.collect();
        let moments: Vec<f64> = views
            .into_par_iter()
            .enumerate()
            .map(|(m, views)| {
                // The place before the moment. The last place has none after it, so the last moment
                // counts to the pair before.
                let nearest = ((m * (places - 1)) / (2 * spans)).min(places - 2);
                pixels * quickest_flow(&depths[nearest..=nearest + 1], &views)
            })
            .collect();
        let highest = |span: usize| moments[2 * span..=2 * span + 2].iter().copied().fold(0.0, f64::max);
        Ok(Self { px_s: (0..spans).map(highest).collect(), end_us })
    }

    /// Adds the equivalent of light that changes, so that steps of equal motion follow it too.
    #[must_use]
    pub fn lit_by(mut self, lights: Option<&SceneLights>) -> Self {
        let Some(lights) = lights else { return self };
        let span_s = 1e-6 * self.span_us();
        for (span, px_s) in self.px_s.iter_mut().enumerate() {
            *px_s += lights.equivalent_px_s([span, span + 1].map(|border| border as f64 * span_s));
        }
        self
    }

    /// Length of a span, us.
    fn span_us(&self) -> f64 {
        self.end_us as f64 / self.px_s.len() as f64
    }

    /// The highest flow between two moments, px/us.
    fn highest(&self, from_us: f64, to_us: f64) -> f64 {
        let span = |us: f64| us / self.span_us();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate")]
        let first = (span(from_us).max(0.0) as usize).min(self.px_s.len() - 1);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate")]
        let after = (libm::ceil(span(to_us)).max(0.0) as usize).clamp(first + 1, self.px_s.len());
        1e-6 * self.px_s[first..after].iter().copied().fold(0.0, f64::max)
    }

    /// Image motion from the first pose to the last, px.
    #[must_use]
    pub fn total_px(&self) -> f64 {
        1e-6 * self.span_us() * self.px_s.iter().sum::<f64>()
    }

    /// The last moment, us.
    #[must_use]
    pub fn end_us(&self) -> i64 {
        self.end_us
    }

    /// The middle of the fastest span, us.
    pub(crate) fn fastest_us(&self) -> f64 {
        let highest = self.px_s.iter().copied().fold(0.0, f64::max);
        let span = self.px_s.iter().position(|flow| *flow >= highest).unwrap_or(0);
        (span as f64 + 0.5) * self.span_us()
    }

    /// The moment at which this share of the motion is over, us.
    pub(crate) fn past_us(&self, share: f64) -> f64 {
        let total: f64 = self.px_s.iter().sum();
        if total <= 0.0 {
            return share * self.end_us as f64;
        }
        let (mut before, wanted) = (0.0, share * total);
        // Spans without motion are skipped: a share of 0 falls where the motion begins, and nothing
        // is divided by 0.
        for (span, flow) in self.px_s.iter().enumerate() {
            if before + flow >= wanted && *flow > 0.0 {
                return (span as f64 + (wanted - before) / flow) * self.span_us();
            }
            before += flow;
        }
        self.end_us as f64
    }

    /// The length of the longest interval around a moment in which the image moves at most `px`,
    /// us.
    #[must_use]
    pub fn length_about(&self, at_us: f64, px: f64) -> f64 {
        // A longer interval contains the shorter one, so its motion is no less and halving finds
        // the limit.
        let fits = |h: f64| h * self.highest(at_us - h / 2.0, at_us + h / 2.0) <= px;
        let (mut low, mut high) = (0.0, 2.0 * self.end_us as f64);
        for _ in 0..60 {
            let middle = f64::midpoint(low, high);
            if fits(middle) { low = middle } else { high = middle }
        }
        low
    }

    /// The fewest moments from the first pose to the last, us, between which the image moves at
    /// most `px`; but at least 20 us apart, and at least eight steps.
    #[must_use]
    pub fn steps(&self, px: f64) -> Vec<i64> {
        let longest = (self.end_us / MIN_STEPS).max(1);
        let mut moments = vec![0];
        let mut at = 0;
        while at < self.end_us {
            // On a very short path the longest step is below the shortest, and `clamp` needs
            // ordered bounds.
            let step = self.step_from(at, px).clamp(SHORTEST_US.min(longest), longest);
            let left = self.end_us - at;
            // The rest at the end is divided, so that the last step is not tiny.
            at += if left <= step { left } else { step.min((left + 1) / 2) };
            moments.push(at);
        }
        moments
    }

    /// The longest step from a moment on, in whole us.
    fn step_from(&self, at_us: i64, px: f64) -> i64 {
        let (at, span) = (at_us as f64, self.span_us());
        let mut highest = 0.0f64;
        let mut end = at;
        while end < self.end_us as f64 {
            // Without the small addition, a border that is rounded down would be its own successor,
            // and the loop would not end.
            let next = (libm::floor(end / span + 1e-9) + 1.0) * span;
            // A thousandth of a microsecond inside, so that the spans next to this one do not
            // count.
            highest = highest.max(self.highest(end + 1e-3, next - 1e-3));
            if highest * (next - at) > px {
                // The step ends in this span, or at its start if its flow would make the step too
                // long.
                end = end.max(at + px / highest);
                break;
            }
            end = next;
        }
        // Cut off, not rounded: a longer step would move the image farther than was asked for.
        #[expect(clippy::cast_possible_truncation, reason = "a path ends within 2^53 us")]
        let step = (end - at) as i64;
        step
    }

    #[cfg(test)]
    pub(super) fn planted(px_s: Vec<f64>, end_us: i64) -> Self {
        Self { px_s, end_us }
    }
}

/// The depth at a place, with the objects and the velocities that its pixels show.
struct PlaceDepth {
    depth: Image<f32>,
    segmentation: Option<Image<u8>>,
    drift: Option<Image<[f32; 3]>>,
}

/// The flow of a moving camera, px/s of its own pixels, from the depths and objects of the places before
/// and after: the higher of both.
fn quickest_flow(depths: &[PlaceDepth], views: &[CameraView]) -> f64 {
    let of = |PlaceDepth { depth, segmentation, drift }: &PlaceDepth| {
        let flow = flow_of_objects(depth, segmentation.as_ref(), views);
        let flow = with_drift(flow, depth, drift.as_ref(), &views[0].camera);
        let speeds = flow.pixels().iter().map(|[x, y]| (x * x + y * y).sqrt()).collect();
        nearest_ranks(speeds, [PERCENT]).map_or(0.0, |[speed]| f64::from(speed))
    };
    depths.iter().map(of).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 s: slow, then eight times as fast.
    fn uneven() -> PathFlow {
        PathFlow::planted((0..100).map(|span| if span < 50 { 100.0 } else { 800.0 }).collect(), 1_000_000)
    }

    #[test]
    fn steps_go_by_the_highest_flow_within_them() {
        let flow = uneven();
        assert!((flow.total_px() - 450.0).abs() < 1e-9);
        // 8 px take 80 ms of the slow span and 10 ms of the fast span. No step reaches too far into
        // the fast span.
        let steps = flow.steps(8.0);
        for pair in steps.windows(2) {
            let highest = if pair[1] > 500_000 { 800.0 } else { 100.0 };
            assert!(highest * (pair[1] - pair[0]) as f64 * 1e-6 <= 8.0 + 1e-9, "{pair:?}");
        }
        assert_eq!((steps[0], steps[1], *steps.last().unwrap()), (0, 80_000, 1_000_000));
        // 6.25 slow steps of 80 ms, the seventh shortened, and 50 fast steps.
        assert!((57..=60).contains(&(steps.len() - 1)), "{}", steps.len());
        assert!(steps.windows(2).all(|pair| pair[1] - pair[0] > 4000), "no sliver: {steps:?}");
    }

    #[test]
    fn steps_have_their_bounds() {
        let still = PathFlow::planted(vec![0.0; 64], 90_000);
        assert_eq!(still.steps(0.5).len(), 9);
        assert!(still.total_px().abs() < 1e-12);
        let racing = PathFlow::planted(vec![1e9; 64], 1000);
        let steps = racing.steps(0.1);
        assert!(steps.windows(2).all(|pair| pair[1] - pair[0] >= 10), "{steps:?}");
        assert!((50..=52).contains(&steps.len()), "{}", steps.len());
    }

    #[test]
    fn moments_and_lengths_are_found() {
        let flow = uneven();
        assert!((flow.fastest_us() - 505_000.0).abs() < 1e-6);
        // 50 px in the slow half, 400 px in the fast half: half of all motion is over after 175 px
        // in the fast half.
        assert!((flow.past_us(0.5) - (500_000.0 + 175.0 / 800.0 * 1e6)).abs() < 1.0);
        assert!((flow.length_about(250_000.0, 10.0) - 100_000.0).abs() < 1.0);
        assert!((flow.length_about(750_000.0, 10.0) - 12_500.0).abs() < 1.0);
        // At the border, the fast span decides: half of 12.5 ms lies before it.
        assert!((flow.length_about(500_000.0, 10.0) - 12_500.0).abs() < 1.0);
    }
}
