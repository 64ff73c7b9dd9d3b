//! Plots of event rates and speeds over time, and the data of strokes.

use gs2e_files::html::HtmlFragment;
use gs2e_trajectory::picture::{round_down, short_number};
use std::fmt::Write as _;

/// Size of a plot with its labels, px.
const SIZE: [i32; 2] = [320, 150];
/// Left, top, right and bottom edge of the area of the curves, px.
const AREA: [f64; 4] = [40.0, 18.0, 298.0, 128.0];

/// Values over time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReportCurve {
    /// Share of the whole time, 0 to 1, and value.
    points: Vec<[f64; 2]>,
}

impl ReportCurve {
    /// The curve through `values`, where each value holds for its own duration. Neighbours are
    /// averaged until there are at most `most` points.
    pub(super) fn new(values: &[f64], durations: &[f64], most: usize) -> Self {
        let whole: f64 = durations.iter().sum();
        let count = values.len().min(durations.len());
        let groups = count.min(most);
        let mut begin = 0.0;
        let point = |group: usize| {
            let held = group * count / groups..(group + 1) * count / groups;
            // Each value counts by its time, so a short step does not pull the mean.
            let time: f64 = durations[held.clone()].iter().sum();
            let sum: f64 = held.map(|i| values[i] * durations[i]).sum();
            let middle = begin + time / 2.0;
            begin += time;
            [middle / whole, sum / time]
        };
        let points: Vec<[f64; 2]> = (0..groups).map(point).collect();
        // Values that are not finite and groups without time make no points.
        Self { points: points.into_iter().filter(|p| p.iter().all(|v| v.is_finite())).collect() }
    }

    /// The curve divided by the mean of its points.
    pub(super) fn over_mean(mut self) -> Self {
        let mean = self.points.iter().map(|[_, v]| v).sum::<f64>() / self.points.len() as f64;
        self.points.iter_mut().for_each(|[_, value]| *value /= mean);
        // A mean of 0 leaves no point.
        self.points.retain(|p| p[1].is_finite());
        self
    }

    /// The highest value; 0 if there are no points.
    pub(super) fn highest(&self) -> f64 {
        self.points.iter().map(|[_, v]| *v).fold(0.0, f64::max)
    }
}

/// The axes of a plot. Plots that are compared have equal axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlotAxes<'a> {
    /// Value at the upper edge; the lower edge is 0.
    pub(super) highest: f64,
    /// Unit of the values.
    pub(super) unit: &'a str,
    /// Time at the right edge, ms; the left edge is 0.
    pub(super) duration_ms: f64,
    /// True if axes are drawn.
    pub(super) labelled: bool,
}

impl PlotAxes<'_> {
    /// The place of a point: its share of the time, and its value.
    fn place(&self, [share, value]: [f64; 2]) -> [f64; 2] {
        let [left, top, right, bottom] = AREA;
        let height = if self.highest > 0.0 { value / self.highest } else { 0.0 };
        [left + share * (right - left), bottom - height * (bottom - top)]
    }

    fn data(&self, curve: &ReportCurve) -> String {
        stroke_path(curve.points.iter().map(|point| self.place(*point)))
    }

    /// Draws the lines of the grid and the numbers at them.
    fn draw(&self, html: &mut HtmlFragment) {
        if !self.labelled {
            return;
        }
        let [left, top, right, bottom] = AREA;
        // Without a duration there is a tick at 0 alone.
        let share = |ms: f64| if ms > 0.0 { ms / self.duration_ms } else { 0.0 };
        let times = axis_ticks(self.duration_ms).map(|ms| (ms, self.place([share(ms), 0.0])));
        let values = axis_ticks(self.highest).map(|value| (value, self.place([0.0, value])));
        let [times, values]: [Vec<(f64, [f64; 2])>; 2] = [times.collect(), values.collect()];
        let lines = times.iter().map(|(_, [x, _])| [[*x, top], [*x, bottom]]);
        let lines = lines.chain(values.iter().map(|(_, [_, y])| [[left, *y], [right, *y]]));
        html.empty("path", &[("class", "grid"), ("d", &lines.map(stroke_path).collect::<String>())]);
        for (value, [x, y]) in &values {
            write_label(html, [*x - 4.0, *y + 4.0], "end", &short_number(*value));
        }
        let last = times.len().saturating_sub(1);
        for (number, (ms, [x, y])) in times.iter().enumerate() {
            let unit = if number == last { " ms" } else { "" };
            write_label(html, [*x, *y + 14.0], "middle", &format!("{}{unit}", short_number(*ms)));
        }
        write_label(html, [2.0, 10.0], "start", self.unit);
    }
}

/// The multiples of 1, 2 or 5 times a power of ten from 0 to `highest`, three to five of them; only 0
/// if this is not above 0.
fn axis_ticks(highest: f64) -> impl Iterator<Item = f64> {
    let step = if highest > 0.0 && highest.is_finite() { round_down(highest / 2.0) } else { f64::INFINITY };
    // The step is more than a fifth of the whole, so four of them are the most.
    let above = (1..=4).map(move |k| f64::from(k) * step).take_while(move |tick| *tick <= highest);
    std::iter::once(0.0).chain(above)
}

fn write_label(html: &mut HtmlFragment, place: [f64; 2], anchor: &str, words: &str) {
    let [x, y] = place.map(|v| format!("{v:.0}"));
    html.leaf("text", &[("x", &x), ("y", &y), ("text-anchor", anchor)], words);
}

/// The data of a path through points, in whole px, each relative to the point before it. Points
/// that are not finite are left out.
pub(super) fn stroke_path(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    #[expect(clippy::cast_possible_truncation, reason = "places in a picture; what is not in i64 is none")]
    let whole = |point: [f64; 2]| point.map(|v| v.round() as i64);
    let finite = points.into_iter().filter(|point| point.iter().all(|v| v.is_finite()));
    // Rounded before the differences are taken, so that errors of rounding do not add up.
    let places: Vec<[i64; 2]> = finite.map(whole).collect();
    let steps = places.windows(2).map(|pair| [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]]);
    let mut data = String::new();
    for (number, [x, y]) in places.first().copied().into_iter().chain(steps).enumerate() {
        // A sign separates numbers as well as a space does.
        let lead = match number {
            0 => "M",
            1 => "l",
            _ if x < 0 => "",
            _ => " ",
        };
        let gap = if y < 0 { "" } else { " " };
        write!(data, "{lead}{x}{gap}{y}").expect("a String takes any text");
    }
    data
}

/// Draws curves in one plot, each with the class that colours it. The caption says what they are.
pub(super) fn draw_curves(
    html: &mut HtmlFragment,
    axes: PlotAxes<'_>,
    curves: &[(&'static str, &ReportCurve)],
) {
    let [width, height] = SIZE;
    let view = format!("0 0 {width} {height}");
    let attributes = [("class", "curve"), ("viewBox", view.as_str()), ("aria-hidden", "true")];
    html.within("svg", &attributes, |html| {
        axes.draw(html);
        for (class, curve) in curves {
            html.empty("path", &[("class", class), ("d", &axes.data(curve))]);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes(highest: f64) -> PlotAxes<'static> {
        PlotAxes { highest, unit: "x", duration_ms: 40.0, labelled: true }
    }

    #[test]
    fn a_curve_is_drawn_in_steps() {
        let curve = ReportCurve::new(&[0.0, 1.0, 2.0, 2.0], &[1.0; 4], 10);
        // Middles of four equal parts of 258 px from 40; 0 at the bottom (128), 2 at the top (18).
        assert_eq!(axes(2.0).data(&curve), "M72 128l65-55 64-55 65 0");
        assert_eq!(axes(1.0).data(&ReportCurve::new(&[], &[], 10)), "");
        assert_eq!(axes(0.0).data(&ReportCurve::new(&[0.0], &[1.0], 10)), "M169 128");
    }

    #[test]
    fn axes_have_round_numbers() {
        for (highest, wanted) in [
            (40.0, vec![0.0, 20.0, 40.0]),
            (9.9, vec![0.0, 2.0, 4.0, 6.0, 8.0]),
            (0.5, vec![0.0, 0.2, 0.4]),
            (0.0, vec![0.0]),
            (f64::NAN, vec![0.0]),
        ] {
            let found: Vec<f64> = axis_ticks(highest).collect();
            assert_eq!(found, wanted, "{highest}");
        }
        let page = HtmlFragment::whole_page(|html| draw_curves(html, axes(300.0), &[]));
        for words in [">0<", ">100<", ">200<", ">20<", ">40 ms<", ">x<"] {
            assert!(page.contains(words), "{words} in {page}");
        }
    }

    #[test]
    fn strokes_end_where_they_should_whatever_is_rounded() {
        let points = [[0.4, 0.4], [1.4, 0.6], [2.4, -3.4], [f64::NAN, 1.0], [-1.6, 5.0], [-1.6, 5.2]];
        // to 0 0, 1 1, 2 -3, -2 5, -2 5
        assert_eq!(stroke_path(points), "M0 0l1 1 1-4-4 8 0 0");
    }

    #[test]
    fn neighbours_are_put_together_by_their_time() {
        let curve = ReportCurve::new(&[1.0, 3.0, 5.0, 9.0], &[1.0, 3.0, 2.0, 2.0], 2);
        assert_eq!(curve.points, [[0.25, 2.5], [0.75, 7.0]]);
        assert_eq!(curve.over_mean().points, [[0.25, 2.5 / 4.75], [0.75, 7.0 / 4.75]]);
    }

    #[test]
    fn what_has_no_value_is_not_drawn() {
        let curve = ReportCurve::new(&[1.0, f64::NAN, 2.0], &[1.0; 3], 9);
        assert_eq!(curve.points.len(), 2);
        assert!(ReportCurve::new(&[0.0, 0.0], &[1.0; 2], 9).over_mean().points.is_empty());
    }
}
