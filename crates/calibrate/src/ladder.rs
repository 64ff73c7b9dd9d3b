//! Contrasts from the frames that events anchor.
//!
//! The grey that a frame shows is
//!
//! ```text
//! F = black - offset + exp(a + C_on n_on - C_off n_off + tau V' - leak t + blur (V'' + V'^2))
//! ```
//!
//! with the steps `n` of the pixel up to the frame: events, and what dead times swallow. `tau V'` is the lead
//! of the light over the voltage behind a low-pass of first order, exactly; `tau` falls as a power of the
//! light. `blur` comes from the length of the exposure: a mean over it exceeds the middle by its square times
//! the curvature over 24. The counts have no error, and the error of `F` is that of the frame: no error
//! attenuates a slope.
//!
//! Each stretch of a pixel has its own `a` and its own contrasts, normal around the common ones: a contrast
//! that is off adds up over all events of the stretch, not over their balance. The common parameters are
//! those of largest likelihood with these integrated out, by Gauss-Newton steps with bounded weights (Huber).
//! Standard errors are a jackknife over tiles of pixels.

mod rungs;

pub use rungs::Rung;

use crate::anchor::Anchor;
use crate::estimate::median;
use crate::linear::{MOST, Square, inverse_of_three, solve};

/// Common parameters, by place.
pub(crate) const ON: usize = 0;
pub(crate) const OFF: usize = 1;
/// Black level less offset, grey.
pub(crate) const BLACK: usize = 2;
/// Time constant of the low-pass at the mean grey, us.
pub(crate) const LAG: usize = 3;
/// Exponent of the light in the bandwidth.
pub(crate) const SLOPE: usize = 4;
/// Leak of the voltage, 1/us.
pub(crate) const LEAK: usize = 5;
/// Square of the exposure over 24, ms^2.
pub(crate) const BLUR: usize = 6;
/// How far the voltage at an event is beyond that between events, in its direction: noise makes events at its
/// peaks.
pub(crate) const PEAK: usize = 7;

/// Longest change in one step.
const LIMITS: [f64; MOST] = [0.1, 0.1, 4.0, 3e3, 0.3, 1e-6, 2.0, 0.05];
/// Bounds.
const BOUNDS: [[f64; 2]; MOST] = [
    [0.01, 5.0],
    [0.01, 5.0],
    [-60.0, 60.0],
    [-1e5, 1e5],
    [0.0, 1.2],
    [-1e-5, 1e-5],
    [0.0, 6.0],
    [-0.1, 0.1],
];
/// Fewest anchors of a stretch: it has three numbers of its own.
const FEWEST: usize = 3;
/// Growth of the error of the parabola with the gap, contrasts per us.
const ERROR_GROWTH: f64 = 0.3 / 50_000.0;
/// Darkest grey above the offset that counts, and the range of greys that no clipping touches.
const DARKEST: f64 = 4.0;
const UNCLIPPED: [f64; 2] = [4.0, 250.0];
/// Tiles of the jackknife, and their side in pixels.
const TILES: usize = 24;
const TILE_PX: usize = 4;
const STEPS: usize = 16;
/// Steps in which only the contrasts, the black level and the lag move.
const FIRST_STEPS: usize = 3;
/// What is known of the exposure before: the square over 24 of 6 ms, and as much for its deviation, ms^2. It
/// is what a curvature of the path that the parabola misses would be taken for.
const BLUR_PRIOR: [f64; 2] = [1.5, 1.2];
/// Gap between events in which half of the peaks are waited for, us.
const WAIT_US: f64 = 20_000.0;
/// What is known of the peaks of the noise before: mean and deviation.
const PEAK_PRIOR: [f64; 2] = [0.0, 0.02];
/// What an anchor adds to the misfit at most.
const LARGEST_SQUARE: f64 = 9.0;
/// Error of the first contrasts, per event.
const START_ERROR: f64 = 0.03;
/// Largest own deviation of a contrast.
const OWN: f64 = 0.4;
/// Square microseconds in a square millisecond.
const NANO: f64 = 1e6;

/// Variance of a frame's noise in grey^2: a constant, and a part per grey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FrameNoise {
    pub constant: f64,
    pub per_grey: f64,
}

/// What a fit expects of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FitForm {
    /// Length of a stretch, us: errors of the counts add up over longer ones.
    pub stretch_us: f64,
    /// Error of the voltage at an anchor in contrasts, without that of the parabola.
    pub error: f64,
}

/// Counts that are exact.
pub(crate) const FINE: FitForm = FitForm { stretch_us: 1.2e6, error: 0.02 };
/// Counts of a camera that misses events, or makes them by itself.
pub(crate) const COARSE: FitForm = FitForm { stretch_us: 0.4e6, error: 0.3 };

/// What a fit expects of frames and of counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Expected {
    pub noise: FrameNoise,
    pub form: FitForm,
}

/// Where a fit starts, and the parameters that move.
#[derive(Debug, Clone)]
pub(crate) struct Start {
    pub value: [f64; MOST],
    pub free: Vec<usize>,
}

/// The result of a fit.
#[derive(Debug, Clone)]
pub(crate) struct LadderFit {
    pub value: [f64; MOST],
    pub se: [f64; MOST],
    /// Spread of the contrasts over the pixels, ON and OFF, by the contrast.
    pub spread: [f64; 2],
    /// Mean of the squared errors by their variance, each at most 9.
    pub misfit: f64,
    pub anchors: usize,
    pub stretches: usize,
    /// Mean grey above the offset at the anchors.
    pub grey: f64,
    /// Mean change of the logarithm of the grey between neighbouring anchors of a pixel, by the rounded
    /// change of the counts.
    pub rungs: Vec<Rung>,
}

/// The own numbers of a stretch of a pixel: logarithm of its grey, and the deviations of its contrasts.
#[derive(Debug, Clone, Default)]
struct Stretch {
    first: usize,
    last: usize,
    tile: usize,
    own: [f64; 3],
    /// Of the last step: gain of the common parameters, remainder, and variances.
    gain: [[f64; MOST]; 3],
    rest: [f64; 3],
    variance: [f64; 3],
    used: bool,
}

/// Sums of the normal equations.
#[derive(Debug, Clone, Copy)]
struct Normal {
    matrix: Square,
    right: [f64; MOST],
}

impl Default for Normal {
    fn default() -> Self {
        Self { matrix: [[0.0; MOST]; MOST], right: [0.0; MOST] }
    }
}

/// One anchor under the present parameters.
struct Residual {
    /// Grey above the offset that is expected.
    grey: f64,
    error: f64,
    variance: f64,
    /// Derivatives by the common parameters and by the own ones.
    common: [f64; MOST],
    own: [f64; 3],
    counts: bool,
    /// True if the frame is bright, where the anchor does not count.
    is_missed: bool,
}

/// A fit under way.
pub(crate) struct Ladder<'a> {
    anchors: &'a [Anchor],
    noise: FrameNoise,
    form: FitForm,
    free: Vec<usize>,
    value: [f64; MOST],
    spread: [f64; 2],
    stretches: Vec<Stretch>,
    /// Grey above the offset that was last expected at each anchor.
    expected: Vec<f64>,
    mean_grey: f64,
    /// Typical size of an error in standard deviations, which bounds the weights.
    scale: f64,
}

impl<'a> Ladder<'a> {
    /// A fit from `value`, in which the parameters `free` move. `width` is that of the frames.
    pub(crate) fn new(anchors: &'a [Anchor], width: usize, expected: Expected, start: Start) -> Self {
        let (Expected { noise, form }, Start { value, free }) = (expected, start);
        let stretches = stretches(anchors, width, form.stretch_us);
        let expected: Vec<f64> = anchors.iter().map(|a| (a.grey - value[BLACK]).max(1.0)).collect();
        let mean_grey = expected.iter().sum::<f64>() / expected.len().max(1) as f64;
        Self {
            anchors,
            noise,
            form,
            free,
            value,
            spread: [0.05; 2],
            stretches,
            expected,
            mean_grey: mean_grey.max(1.0),
            scale: 1.0,
        }
    }

    /// Runs all steps. `None` if the anchors do not determine the free parameters.
    pub(crate) fn fit(mut self) -> Option<LadderFit> {
        if self.stretches.len() < 2 * TILES {
            return None;
        }
        self.start();
        (0..self.stretches.len()).for_each(|i| self.place(i));
        let mut last = None;
        let (all, error) = (self.free.clone(), self.form.error);
        for step in 0..STEPS {
            // From far, what bends the voltage would be taken for contrast.
            self.free.clone_from(&all);
            if step < FIRST_STEPS {
                self.free.retain(|of| *of <= LAG);
            }
            self.form.error = error.max(COARSE.error * libm::exp2(-(step as f64)));
            let (all, tiles, misfit) = self.sum();
            let change = solve(&all.matrix, &all.right, self.free.len())?;
            let errors = if step + 1 == STEPS { self.jackknife(&all, &tiles) } else { [0.0; MOST] };
            self.go(&change);
            if step >= FIRST_STEPS {
                self.widen();
            }
            last = Some((errors, misfit));
        }
        let (se, misfit) = last?;
        let used = self.stretches.iter().filter(|s| s.used);
        let anchors = used.clone().map(|s| s.last - s.first).sum();
        let stretches = used.count();
        let grey = self.mean_grey;
        let rungs = self.rungs();
        Some(LadderFit {
            value: self.value,
            se,
            spread: self.spread,
            misfit,
            anchors,
            stretches,
            grey,
            rungs,
        })
    }

    /// First contrasts, by the changes of `ln F` since the first anchor of each stretch. From a wrong ratio
    /// of the contrasts, the steps would not find the way.
    fn start(&mut self) {
        let mut normal = Normal::default();
        for stretch in &self.stretches {
            let first = &self.anchors[stretch.first];
            for anchor in &self.anchors[stretch.first + 1..stretch.last] {
                if first.grey.min(anchor.grey) < 2.0 * DARKEST || !is_unclipped(first.grey.max(anchor.grey)) {
                    continue;
                }
                let [on, off] = [0, 1].map(|side| anchor.steps[side] - first.steps[side]);
                let terms = [on, -off];
                let [noisy, other] =
                    [first.grey, anchor.grey].map(|grey| self.variance(grey, 0.0) / (grey * grey));
                let weight = 1.0 / (noisy + other + START_ERROR * START_ERROR * (on + off));
                for i in 0..2 {
                    (0..2).for_each(|j| normal.matrix[i][j] += weight * terms[i] * terms[j]);
                    normal.right[i] += weight * terms[i] * libm::log(anchor.grey / first.grey);
                }
            }
        }
        let Some(found) = solve(&normal.matrix, &normal.right, 2) else { return };
        for of in [ON, OFF] {
            let [low, high] = BOUNDS[of];
            self.value[of] = found[of].clamp(low, high);
        }
    }

    fn contrast(&self, anchor: &Anchor, own: &[f64; 3]) -> f64 {
        let side = usize::from(!anchor.on);
        self.value[side] * (1.0 + own[1 + side])
    }

    /// How often the lag at the mean grey the lag of this grey is.
    fn lag_share(&self, grey: f64) -> f64 {
        libm::exp(-self.value[SLOPE] * libm::log(grey.max(1.0) / self.mean_grey))
    }

    /// What the contrasts are multiplied with, ON and OFF.
    fn steps(&self, anchor: &Anchor, lag_us: f64) -> [f64; 2] {
        let lead = lag_us * anchor.rate;
        let lead = if anchor.on { [lead, 0.0] } else { [0.0, lead] };
        [anchor.steps[0] + lead[0], -anchor.steps[1] + lead[1]]
    }

    /// Expected logarithm of the grey above that of the stretch, and the steps and the blur in it.
    fn logarithm(&self, i: usize, own: &[f64; 3]) -> (f64, [f64; 2], f64) {
        let anchor = &self.anchors[i];
        let contrast = self.contrast(anchor, own);
        let steps = self.steps(anchor, self.value[LAG] * self.lag_share(self.expected[i]));
        let slope = contrast * anchor.rate;
        let blur = NANO * (contrast * anchor.bend + slope * slope);
        let [on, off] = [0, 1].map(|side| self.value[side] * (1.0 + own[1 + side]) * steps[side]);
        (
            on + off - self.value[LEAK] * anchor.since_us + self.value[BLUR] * blur
                - self.value[PEAK] * peak(anchor),
            steps,
            blur,
        )
    }

    fn variance(&self, grey: f64, gap_us: f64) -> f64 {
        let contrast = 0.5 * (self.value[ON] + self.value[OFF]);
        let parabola = contrast * grey;
        let error = self.form.error * self.form.error + (ERROR_GROWTH * gap_us) * (ERROR_GROWTH * gap_us);
        self.noise.constant + self.noise.per_grey * grey + parabola * parabola * error
    }

    /// The first logarithm of a stretch: the mean that its greys ask for.
    fn place(&mut self, i: usize) {
        let Stretch { first, last, .. } = self.stretches[i];
        let (mut sum, mut weights) = (0.0, 0.0);
        for k in first..last {
            let weight = self.expected[k];
            sum += weight * (libm::log(self.expected[k]) - self.logarithm(k, &[0.0; 3]).0);
            weights += weight;
        }
        self.stretches[i].own[0] = sum / weights;
    }

    /// Moves the logarithm of a stretch to its optimum: the other steps then start from small errors.
    fn level(&self, stretch: &Stretch, logarithms: &[f64]) -> f64 {
        let mut own = stretch.own[0];
        for _ in 0..4 {
            let (mut up, mut down) = (0.0, 1e-9);
            for (k, x) in (stretch.first..stretch.last).zip(logarithms) {
                let grey = libm::exp((own + x).clamp(-10.0, 8.0));
                let weight = grey / self.variance(grey, self.anchors[k].gap_us);
                up += weight * (self.anchors[k].grey - self.value[BLACK] - grey);
                down += weight * grey;
            }
            own += (up / down).clamp(-0.5, 0.5);
        }
        own
    }

    fn residual(&self, k: usize, own: &[f64; 3]) -> Residual {
        let anchor = &self.anchors[k];
        let (x, steps, blur) = self.logarithm(k, own);
        let grey = libm::exp((own[0] + x).clamp(-10.0, 8.0));
        let shown = grey + self.value[BLACK];
        let share = self.lag_share(self.expected[k]);
        let lead = share * self.contrast(anchor, own) * anchor.rate;
        let ln = libm::log(self.expected[k].max(1.0) / self.mean_grey);
        let mut common = [
            steps[0] * (1.0 + own[1]),
            steps[1] * (1.0 + own[2]),
            1.0 / grey,
            lead,
            -self.value[LAG] * ln * lead,
            -anchor.since_us,
            blur,
            -peak(anchor),
        ];
        common.iter_mut().for_each(|d| *d *= grey);
        Residual {
            grey,
            error: anchor.grey - shown,
            variance: self.variance(grey, anchor.gap_us),
            common,
            own: [grey, grey * self.value[ON] * steps[0], grey * self.value[OFF] * steps[1]],
            counts: grey > DARKEST && is_unclipped(shown),
            // A fit that expects nothing of most frames would have no errors.
            is_missed: is_unclipped(anchor.grey) && anchor.grey - self.value[BLACK] > 2.0 * DARKEST,
        }
    }

    /// The normal equations with the own numbers integrated out: of all, and of each tile.
    fn sum(&mut self) -> (Normal, Vec<Normal>, f64) {
        let mut tiles = vec![Normal::default(); TILES];
        let (mut sizes, mut misfit, mut count) = (Vec::new(), 0.0, 0_usize);
        for i in 0..self.stretches.len() {
            let mut stretch = std::mem::take(&mut self.stretches[i]);
            let own = stretch.own;
            let logarithms: Vec<f64> =
                (stretch.first..stretch.last).map(|k| self.logarithm(k, &own).0).collect();
            stretch.own[0] = self.level(&stretch, &logarithms);
            let residuals: Vec<Residual> =
                (stretch.first..stretch.last).map(|k| self.residual(k, &stretch.own)).collect();
            (stretch.first..stretch.last)
                .zip(&residuals)
                .for_each(|(k, s)| self.expected[k] = s.grey.max(1.0));
            stretch.used = residuals.iter().filter(|s| s.counts).count() >= FEWEST;
            if stretch.used {
                for s in residuals.iter().filter(|s| s.counts) {
                    let square = s.error * s.error / s.variance;
                    sizes.push(square.sqrt());
                    misfit += square.min(LARGEST_SQUARE);
                    count += 1;
                }
                let missed = residuals.iter().filter(|s| !s.counts && s.is_missed).count();
                misfit += LARGEST_SQUARE * missed as f64;
                count += missed;
                self.own_part(&mut stretch, &residuals);
                let part = self.reduced(&stretch, &residuals);
                add_to(&mut tiles[stretch.tile], &part, 1.0);
            }
            self.stretches[i] = stretch;
        }
        self.scale = (1.4826 * median(&mut sizes)).max(0.3);
        let mut all = Normal::default();
        tiles.iter().for_each(|tile| add_to(&mut all, tile, 1.0));
        for (of, [mean, deviation]) in [(BLUR, BLUR_PRIOR), (PEAK, PEAK_PRIOR)] {
            let Some(place) = self.free.iter().position(|free| *free == of) else { continue };
            let weight = 1.0 / (deviation * deviation);
            all.matrix[place][place] += weight;
            all.right[place] += weight * (mean - self.value[of]);
        }
        (all, tiles, misfit / count.max(1) as f64)
    }

    /// Weight of an anchor: an error far beyond the typical size pulls no harder than one of 2.5 sizes.
    fn weight(&self, residual: &Residual) -> f64 {
        if !residual.counts {
            return 0.0;
        }
        let size = residual.error.abs() / residual.variance.sqrt();
        (2.5 * self.scale / size.max(1e-9)).min(1.0) / (residual.variance * self.scale * self.scale)
    }

    fn prior(&self) -> [f64; 3] {
        let [on, off] = self.spread.map(|s| 1.0 / (s * s));
        [1e-6, on, off]
    }

    /// Solves the own numbers of a stretch for any step of the common ones.
    fn own_part(&self, stretch: &mut Stretch, residuals: &[Residual]) {
        let n = self.free.len();
        let prior = self.prior();
        let (mut square, mut cross, mut right) = ([[0.0; 3]; 3], [[0.0; MOST]; 3], [0.0; 3]);
        for s in residuals {
            let weight = self.weight(s);
            for i in 0..3 {
                (0..3).for_each(|j| square[i][j] += weight * s.own[i] * s.own[j]);
                (0..n).for_each(|j| cross[i][j] += weight * s.own[i] * s.common[self.free[j]]);
                right[i] += weight * s.own[i] * s.error;
            }
        }
        for i in 0..3 {
            square[i][i] += prior[i];
            // The logarithm has no prior; its place in the array only keeps the matrix regular.
            if i > 0 {
                right[i] -= prior[i] * stretch.own[i];
            }
        }
        let Some(inverse) = inverse_of_three(&square) else {
            stretch.used = false;
            return;
        };
        for (i, row) in inverse.iter().enumerate() {
            let times = |column: [f64; 3]| row.iter().zip(column).map(|(a, b)| a * b).sum();
            for (j, gain) in stretch.gain[i].iter_mut().enumerate().take(n) {
                *gain = times([cross[0][j], cross[1][j], cross[2][j]]);
            }
            stretch.rest[i] = times(right);
            stretch.variance[i] = row[i];
        }
    }

    /// The part of a stretch in the normal equations of the common parameters.
    fn reduced(&self, stretch: &Stretch, residuals: &[Residual]) -> Normal {
        let n = self.free.len();
        let mut part = Normal::default();
        if !stretch.used {
            return part;
        }
        for s in residuals {
            let weight = self.weight(s);
            // What is left of a derivative and of the error after the own numbers have moved along.
            let left = |j: usize| {
                s.common[self.free[j]] - (0..3).map(|i| s.own[i] * stretch.gain[i][j]).sum::<f64>()
            };
            let rest = s.error - (0..3).map(|i| s.own[i] * stretch.rest[i]).sum::<f64>();
            for i in 0..n {
                let scaled = weight * s.common[self.free[i]];
                (0..n).for_each(|j| part.matrix[i][j] += scaled * left(j));
                part.right[i] += scaled * rest;
            }
        }
        part
    }

    /// Takes a step, shortened where a parameter would go too far at once.
    fn go(&mut self, change: &[f64; MOST]) {
        let ratio = |(j, of): (usize, &usize)| LIMITS[*of] / change[j].abs().max(1e-30);
        let share = self.free.iter().enumerate().map(ratio).fold(1.0, f64::min);
        for (j, of) in self.free.iter().enumerate() {
            let [low, high] = BOUNDS[*of];
            self.value[*of] = (self.value[*of] + share * change[j]).clamp(low, high);
        }
        let n = self.free.len();
        for stretch in self.stretches.iter_mut().filter(|s| s.used) {
            for i in 0..3 {
                let along: f64 = (0..n).map(|j| stretch.gain[i][j] * share * change[j]).sum();
                let step = stretch.rest[i] - along;
                let bound = if i == 0 { 50.0 } else { OWN };
                stretch.own[i] = (stretch.own[i] + step.clamp(-0.5, 0.5)).clamp(-bound, bound);
            }
        }
    }

    /// The spread that the own contrasts have, with their uncertainty (a step of EM).
    fn widen(&mut self) {
        let used: Vec<&Stretch> = self.stretches.iter().filter(|s| s.used).collect();
        self.spread = [1, 2].map(|i| {
            let sum: f64 = used.iter().map(|s| s.own[i] * s.own[i] + s.variance[i]).sum();
            (sum / used.len().max(1) as f64).max(1e-5).sqrt()
        });
    }

    /// Standard errors: how far the last step would differ without each tile.
    fn jackknife(&self, all: &Normal, tiles: &[Normal]) -> [f64; MOST] {
        let n = self.free.len();
        let without = tiles.iter().filter_map(|tile| {
            let mut rest = *all;
            add_to(&mut rest, tile, -1.0);
            solve(&rest.matrix, &rest.right, n)
        });
        let steps: Vec<[f64; MOST]> = without.collect();
        let count = steps.len() as f64;
        let mut se = [0.0; MOST];
        for (j, of) in self.free.iter().enumerate() {
            let mean = steps.iter().map(|s| s[j]).sum::<f64>() / count;
            let sum: f64 = steps.iter().map(|s| (s[j] - mean) * (s[j] - mean)).sum();
            se[*of] = ((count - 1.0) / count * sum).sqrt();
        }
        se
    }
}

/// The share of the peak of the noise at an anchor, in the direction of its run: a slow voltage waits for a
/// peak to make its event, and a fast one does not.
fn peak(anchor: &Anchor) -> f64 {
    let share = anchor.gap_us / (anchor.gap_us + WAIT_US);
    if anchor.on { share } else { -share }
}

fn is_unclipped(grey: f64) -> bool {
    grey > UNCLIPPED[0] && grey < UNCLIPPED[1]
}

fn add_to(sum: &mut Normal, part: &Normal, sign: f64) {
    for i in 0..MOST {
        (0..MOST).for_each(|j| sum.matrix[i][j] += sign * part.matrix[i][j]);
        sum.right[i] += sign * part.right[i];
    }
}

/// The stretches of the pixels that have enough anchors.
fn stretches(anchors: &[Anchor], width: usize, stretch_us: f64) -> Vec<Stretch> {
    let mut found = Vec::new();
    let mut first = 0;
    while first < anchors.len() {
        let begin = &anchors[first];
        let same = |a: &Anchor| a.pixel == begin.pixel && a.since_us < begin.since_us + stretch_us;
        let last = first + anchors[first..].iter().take_while(|a| same(a)).count();
        if last - first >= FEWEST {
            let [x, y] = [begin.pixel % width / TILE_PX, begin.pixel / width / TILE_PX];
            // Tiles of a group lie all over the picture.
            let tile = (x * 7 + y * 13 + x * y % 5) % TILES;
            found.push(Stretch { first, last, tile, ..Stretch::default() });
        }
        first = last;
    }
    found
}
