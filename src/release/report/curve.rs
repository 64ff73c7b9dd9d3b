//! Small curves of event rates and speeds over time, and the data of strokes.

use super::html::HtmlFragment;
use std::fmt::Write as _;

/// Size of a curve's picture, px.
const SIZE: [i32; 2] = [480, 96];

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

    fn data(&self, highest: f64) -> String {
        let place = |[t, value]: [f64; 2]| {
            let y = if highest > 0.0 { value / highest } else { 0.0 };
            // 2 px above and below, so that no stroke is cut at the edge.
            [t * f64::from(SIZE[0]), (1.0 - y) * f64::from(SIZE[1] - 4) + 2.0]
        };
        stroke_path(self.points.iter().map(|point| place(*point)))
    }
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

/// Draws curves on one scale from 0 to the highest of them, each with the class that colours it.
/// The caption says what they are.
pub(super) fn draw_curves(html: &mut HtmlFragment, curves: &[(&'static str, &ReportCurve)]) {
    let highest = curves.iter().map(|(_, curve)| curve.highest()).fold(0.0, f64::max);
    let [width, height] = SIZE;
    let view = format!("0 0 {width} {height}");
    let attributes = [("class", "curve"), ("viewBox", view.as_str()), ("aria-hidden", "true")];
    html.within("svg", &attributes, |html| {
        for (class, curve) in curves {
            html.empty("path", &[("class", class), ("d", &curve.data(highest))]);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_drawn_in_steps() {
        let curve = ReportCurve::new(&[0.0, 1.0, 2.0, 2.0], &[1.0; 4], 10);
        // Middles of four equal parts of 480 px; 0 at the bottom (94), 2 at the top (2).
        assert_eq!(curve.data(2.0), "M60 94l120-46 120-46 120 0");
        assert_eq!(ReportCurve::new(&[], &[], 10).data(1.0), "");
        assert_eq!(ReportCurve::new(&[0.0], &[1.0], 10).data(0.0), "M240 94");
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
