//! The distributions of the intervals between events as SVG: the recording and each sensor.

use super::RealStudy;
use super::profile::IntervalProfile;
use gs2e_trajectory::picture::{PicturePanel, SvgText};

const SIZE: [f64; 2] = [960.0, 480.0];
const INNER: PicturePanel = PicturePanel { left: 60.0, top: 40.0, width: 640.0, height: 370.0 };
const COLOURS: [&str; 8] =
    ["#d1495b", "#2a7fb8", "#3a8f4f", "#8a5fb0", "#c98a1b", "#2aa7a0", "#b86b9a", "#7a7a2a"];
const DARK: &str = "#222222";
/// Decades of the axis, in us: from 1 us to 100 s.
const DECADES: [f64; 2] = [0.0, 8.0];

/// The picture.
#[must_use]
pub fn intervals_svg(study: &RealStudy) -> String {
    let mut out = SvgText::new(SIZE);
    out.text([INNER.left, 26.0], "start", DARK, "Intervals between the events of a pixel: share below");
    out.frame(INNER);
    let names = ["1 us", "10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s", "10 s", "100 s"];
    for (decade, name) in names.into_iter().enumerate() {
        let [x, bottom] = chart_point(decade as f64, 0.0);
        out.polyline([[x, INNER.top], [x, bottom]], "#eeeeee", 1.0);
        out.text([x, bottom + 18.0], "middle", DARK, name);
    }
    for tenth in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let [_, y] = chart_point(0.0, tenth);
        out.polyline([[INNER.left, y], [INNER.left + INNER.width, y]], "#eeeeee", 1.0);
        out.text([INNER.left - 6.0, y + 4.0], "end", DARK, &tenth.to_string());
    }
    let sensors = study.rows.iter().zip(&study.profiles).enumerate();
    for (i, (row, profile)) in sensors {
        let curve =
            LegendCurve { colour: COLOURS[i % COLOURS.len()], width: 1.5, place: i + 1, name: &row.sensor };
        curve.draw(&mut out, profile.intervals());
    }
    let recording = LegendCurve { colour: DARK, width: 3.0, place: 0, name: "recording" };
    recording.draw(&mut out, study.real.intervals());
    out.finish()
}

fn chart_point(decade: f64, share: f64) -> [f64; 2] {
    INNER.point([(decade - DECADES[0]) / (DECADES[1] - DECADES[0]), share])
}

/// The look of a distribution, and its place in the legend.
struct LegendCurve<'a> {
    colour: &'a str,
    width: f64,
    place: usize,
    name: &'a str,
}

impl LegendCurve<'_> {
    fn draw(self, out: &mut SvgText, intervals: &IntervalProfile) {
        let Self { colour, width, place, name } = self;
        let points = intervals.distribution().map(|(us, share)| (libm::log10(us), share));
        let within = points.filter(|(decade, _)| (DECADES[0]..=DECADES[1]).contains(decade));
        if intervals.count() > 0 {
            out.polyline(within.map(|(decade, share)| chart_point(decade, share)), colour, width);
        }
        let y = INNER.top + 14.0 + 20.0 * place as f64;
        let left = INNER.left + INNER.width + 20.0;
        out.polyline([[left, y - 4.0], [left + 24.0, y - 4.0]], colour, width);
        out.text([left + 32.0, y], "start", DARK, name);
    }
}
