//! The SVG picture of a trajectory: its path from above and from the side, with camera frusta
//! coloured by speed, and asked and achieved speed over time. Decimals are fixed, so the bytes are
//! the same on every machine.

mod chart;
mod path;
mod sketch;

pub use path::scale_rgb;
pub use sketch::{PathSketch, sketch};

use super::Trajectory;
use super::report::SpeedReport;
use std::fmt::Write as _;

/// Width of the picture, px.
const WIDTH: f64 = 960.0;
/// Height of the picture, px.
const HEIGHT: f64 = 780.0;
/// Margin between panels, px.
const MARGIN: f64 = 24.0;

/// A rectangle of the picture, px.
#[derive(Debug, Clone, Copy)]
pub struct PicturePanel {
    /// Left edge.
    pub left: f64,
    /// Upper edge.
    pub top: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

impl PicturePanel {
    /// The point at shares of the width and of the height, from the lower left corner.
    #[must_use]
    pub fn point(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.left + self.width * x, self.top + self.height * (1.0 - y)]
    }

    /// The lower edge, px.
    #[must_use]
    pub fn bottom(self) -> f64 {
        self.top + self.height
    }
}

/// The picture as SVG.
#[must_use]
pub fn trajectory_svg(trajectory: &Trajectory, report: &SpeedReport) -> String {
    let half = (WIDTH - 3.0 * MARGIN) / 2.0;
    let above = PicturePanel { left: MARGIN, top: MARGIN, width: half, height: 440.0 };
    let side = PicturePanel { left: above.left + half + MARGIN, ..above };
    let top = above.top + above.height + MARGIN;
    let chart =
        PicturePanel { left: MARGIN, top, width: WIDTH - 2.0 * MARGIN, height: HEIGHT - top - MARGIN };
    let mut out = SvgText::new([WIDTH, HEIGHT]);
    path::draw_path(&mut out, [above, side], &trajectory.world_from_camera, &report.linear_unit_s);
    let seconds = trajectory.stamps_us.last().copied().unwrap_or(0) as f64 * 1e-6;
    chart::draw_chart(&mut out, chart, seconds, report);
    out.finish()
}

/// SVG text under construction. Writing to a string cannot fail.
#[derive(Debug)]
pub struct SvgText(String);

impl SvgText {
    /// A white picture of this size, px.
    #[must_use]
    pub fn new([width, height]: [f64; 2]) -> Self {
        let mut svg = Self(String::new());
        svg.line(&format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" font-family=\"sans-serif\" font-size=\"12\" fill=\"none\" stroke-linejoin=\"round\">"
        ));
        svg.line(&format!("<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>"));
        svg
    }

    /// The whole text.
    #[must_use]
    pub fn finish(mut self) -> String {
        self.line("</svg>");
        self.0
    }

    /// Adds an element on a line of its own.
    pub fn line(&mut self, text: &str) {
        self.0.push_str(text);
        self.0.push('\n');
    }

    /// Draws the edge of a panel.
    pub fn frame(&mut self, panel: PicturePanel) {
        let PicturePanel { left, top, width, height } = panel;
        self.line(&format!(
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" stroke=\"#cccccc\"/>"
        ));
    }

    /// Text that starts (`anchor` "start"), is centred ("middle") or ends ("end") at a point.
    pub fn text(&mut self, [x, y]: [f64; 2], anchor: &str, colour: &str, words: &str) {
        // A quotation mark is harmless here: the words are never in an attribute.
        let words = words.replace('&', "&amp;").replace('<', "&lt;");
        self.line(&format!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{words}</text>"
        ));
    }

    /// A line through points. Points that are not finite are skipped.
    pub fn polyline(&mut self, points: impl IntoIterator<Item = [f64; 2]>, colour: &str, width: f64) {
        let mut d = String::new();
        for [x, y] in points.into_iter().filter(|p| p[0].is_finite() && p[1].is_finite()) {
            let _ = write!(d, "{}{x:.2} {y:.2}", if d.is_empty() { "M" } else { "L" });
        }
        if !d.is_empty() {
            self.line(&format!("<path d=\"{d}\" stroke=\"{colour}\" stroke-width=\"{width}\"/>"));
        }
    }
}

/// The largest of 1, 2 and 5 times a power of ten that is at most `limit > 0`.
pub fn round_down(limit: f64) -> f64 {
    let mut power = 1.0f64;
    // By division, because a rounded logarithm may be off by one at a power of ten. The second
    // condition ends the loop for a limit below the smallest normal number.
    while power > limit && power > f64::MIN_POSITIVE {
        power /= 10.0;
    }
    while power * 10.0 <= limit {
        power *= 10.0;
    }
    [5.0, 2.0].into_iter().map(|k| k * power).find(|step| *step <= limit).unwrap_or(power)
}

/// A number with about four digits.
pub fn short_number(number: f64) -> String {
    let fixed = match number.abs() {
        n if n != 0.0 && !(1e-3..1e6).contains(&n) => return format!("{number:.2e}"),
        n if n >= 1000.0 => return format!("{number:.0}"),
        n if n >= 10.0 => format!("{number:.1}"),
        _ => format!("{number:.3}"),
    };
    fixed.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// At most `count` indices of `0..len`, evenly spread, with both ends.
pub(crate) fn spread_indices(len: usize, count: usize) -> impl Iterator<Item = usize> {
    let shown = len.min(count);
    (0..shown).map(move |k| if shown < 2 { 0 } else { k * (len - 1) / (shown - 1) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_numbers_are_round() {
        for (limit, want) in
            [(1.0, "1"), (1.9, "1"), (2.0, "2"), (0.07, "0.05"), (730.0, "500"), (0.5, "0.5")]
        {
            assert_eq!(format!("{}", round_down(limit)), want);
        }
    }

    #[test]
    fn numbers_are_short() {
        for (number, want) in [
            (0.0, "0"),
            (1.2, "1.2"),
            (62.083, "62.1"),
            (100.0, "100"),
            (5432.1, "5432"),
            (1e9, "1.00e9"),
            (-0.25, "-0.25"),
        ] {
            assert_eq!(short_number(number), want);
        }
    }

    #[test]
    fn both_ends_are_shown() {
        assert_eq!(spread_indices(5, 10).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        assert_eq!(spread_indices(101, 3).collect::<Vec<_>>(), [0, 50, 100]);
        assert_eq!(spread_indices(1, 3).collect::<Vec<_>>(), [0]);
        assert_eq!(spread_indices(0, 3).count(), 0);
    }
}
