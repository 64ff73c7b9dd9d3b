//! The path from above and from the side.
//!
//! A capture does not define up. The picture uses the mean of the cameras' up directions, and the
//! line from the first camera to the one farthest from it as its horizontal.

use super::{PicturePanel, SvgText, round_down, short_number, spread_indices};
use glam::DVec3;
use gs2e_num::se3::Se3;

/// Maximum number of frusta drawn.
const FRUSTA: usize = 19;
/// Maximum number of points of the path drawn.
const POINTS: usize = 1500;
/// Length of a frustum as a share of the panel.
const FRUSTUM: f64 = 0.07;
/// Margin around the path, px.
const INSET: f64 = 48.0;

/// Draws both views and the colour scale. `speeds` are those of the steps, units per second.
pub(super) fn draw_path(out: &mut SvgText, [above, side]: [PicturePanel; 2], poses: &[Se3], speeds: &[f64]) {
    let [along, across, up] = picture_axes(poses);
    let path = DrivenPath { poses, speeds };
    path.draw_view(out, above, "from above", [along, across]);
    path.draw_view(out, side, "from the side", [along, -up]);
    if !speeds.is_empty() {
        colour_scale(out, side, speeds);
    }
}

/// Orthonormal axes: along the path, across it, and up.
pub(super) fn picture_axes(poses: &[Se3]) -> [DVec3; 3] {
    let up =
        poses.iter().map(|p| p.rotation * DVec3::NEG_Y).sum::<DVec3>().try_normalize().unwrap_or(DVec3::Z);
    let from_first = poses.iter().map(|p| p.translation - poses[0].translation);
    let along = from_first.fold(DVec3::ZERO, |far, d| if d.length() > far.length() { d } else { far });
    let level = (along - up * along.dot(up)).try_normalize();
    // A path straight up, and one that stays in place, have no level direction.
    let along = level.unwrap_or_else(|| up.any_orthonormal_vector());
    [along, along.cross(up), up]
}

/// Poses, and the speeds of their steps, units per second.
struct DrivenPath<'a> {
    poses: &'a [Se3],
    speeds: &'a [f64],
}

impl DrivenPath<'_> {
    fn draw_view(&self, out: &mut SvgText, panel: PicturePanel, name: &str, plane: [DVec3; 2]) {
        let Self { poses, speeds } = *self;
        out.frame(panel);
        out.text([panel.left + 10.0, panel.top + 20.0], "start", "#333333", name);
        let Some(map) = PanelMap::fit_panel(panel, INSET, poses, plane) else { return };
        out.polyline(
            spread_indices(poses.len(), POINTS).map(|j| map.point(poses[j].translation)),
            "#999999",
            1.0,
        );
        let range = speed_range(speeds);
        for j in spread_indices(poses.len(), FRUSTA) {
            // The last pose has no step after it.
            let speed = speeds.get(j).or(speeds.last()).copied().unwrap_or(0.0);
            draw_frustum(out, &map, &poses[j], &scale_colour(range_share(speed, range)));
        }
        let [x, y] = map.point(poses[0].translation);
        out.line(&format!("<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"3.5\" fill=\"#000000\"/>"));
        let unit = round_down(panel.width / 4.0 / map.scale);
        let (left, y) = (panel.left + 12.0, panel.top + panel.height - 14.0);
        out.polyline([[left, y], [left + unit * map.scale, y]], "#333333", 2.0);
        out.text(
            [left, y - 6.0],
            "start",
            "#333333",
            &format!("{} {}", short_number(unit), if unit > 1.0 { "units" } else { "unit" }),
        );
    }
}

fn draw_frustum(out: &mut SvgText, map: &PanelMap, pose: &Se3, colour: &str) {
    out.polyline(frustum_stroke(map, pose), colour, 1.2);
}

/// The pyramid of a camera with a field of view of 53 degrees and aspect 4:3, as one stroke.
pub(super) fn frustum_stroke(map: &PanelMap, pose: &Se3) -> [[f64; 2]; 11] {
    let size = map.frustum;
    let corner =
        |x: f64, y: f64| map.point(pose.translation + pose.rotation * (DVec3::new(x, y, 1.0) * size));
    let corners = [corner(-0.5, -0.375), corner(0.5, -0.375), corner(0.5, 0.375), corner(-0.5, 0.375)];
    let apex = map.point(pose.translation);
    let [a, b, c, d] = corners;
    [a, b, c, d, a, apex, b, apex, c, apex, d]
}

/// Map from the world to a panel: an orthographic projection, to scale.
pub(super) struct PanelMap {
    origin: DVec3,
    plane: [DVec3; 2],
    centre: [f64; 2],
    /// px per unit.
    pub(super) scale: f64,
    /// Length of a frustum, units.
    frustum: f64,
}

impl PanelMap {
    /// The map that shows every pose with a margin of `inset` px; `None` without poses.
    pub(super) fn fit_panel(
        panel: PicturePanel,
        inset: f64,
        poses: &[Se3],
        plane: [DVec3; 2],
    ) -> Option<Self> {
        let origin = poses.first()?.translation;
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for pose in poses {
            for (bound, axis) in bounds.iter_mut().zip(plane) {
                let at = (pose.translation - origin).dot(axis);
                *bound = [bound[0].min(at), bound[1].max(at)];
            }
        }
        let extent = |k: usize, room: f64| (bounds[k][1] - bounds[k][0]) / (room - 2.0 * inset);
        let units_per_px = extent(0, panel.width).max(extent(1, panel.height));
        // A path that stays in place has no extent, so any scale will do.
        let scale = if units_per_px > f64::MIN_POSITIVE { 1.0 / units_per_px } else { panel.width / 4.0 };
        let middle = |k: usize| f64::midpoint(bounds[k][0], bounds[k][1]);
        let centre = [
            panel.left + panel.width / 2.0 - middle(0) * scale,
            panel.top + panel.height / 2.0 - middle(1) * scale,
        ];
        Some(Self { origin, plane, centre, scale, frustum: FRUSTUM * panel.width / scale })
    }

    pub(super) fn point(&self, world: DVec3) -> [f64; 2] {
        let from_origin = world - self.origin;
        [0, 1].map(|k| self.centre[k] + from_origin.dot(self.plane[k]) * self.scale)
    }
}

pub(super) fn speed_range(speeds: &[f64]) -> [f64; 2] {
    [speeds.iter().copied().fold(f64::INFINITY, f64::min), speeds.iter().copied().fold(0.0, f64::max)]
}

/// The position of a speed in its range, 0 to 1; 0 in a range that is empty except for rounding.
pub(super) fn range_share(speed: f64, [low, high]: [f64; 2]) -> f64 {
    const ROUNDING: f64 = 1e-6;
    let share = (speed - low) / (high - low);
    if share.is_finite() && high - low > ROUNDING * high { share.clamp(0.0, 1.0) } else { 0.0 }
}

/// Colours from slow to fast: viridis at five places, the last one darkened for white paper.
const COLOURS: [[f64; 3]; 5] =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 189.0, 80.0], [226.0, 190.0, 20.0]];

pub(super) fn scale_colour(share: f64) -> String {
    let [r, g, b] = scale_rgb(share);
    format!("rgb({r},{g},{b})")
}

/// The colour of a share, 0 (dark) to 1 (yellow).
pub fn scale_rgb(share: f64) -> [u8; 3] {
    let at = share * 4.0;
    // The number of the piece. A share of 1 belongs to the last of the four.
    let below = [3.0, 2.0, 1.0, 0.0].into_iter().find(|k| at >= *k).unwrap_or(0.0);
    let k = [0.0, 1.0, 2.0, 3.0].iter().position(|b| *b >= below).unwrap_or(0);
    let mix = |i: usize| (COLOURS[k][i] + (COLOURS[k + 1][i] - COLOURS[k][i]) * (at - below)).round();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "values from 0 to 255")]
    [0, 1, 2].map(|i| mix(i) as u8)
}

fn colour_scale(out: &mut SvgText, panel: PicturePanel, speeds: &[f64]) {
    let [low, high] = speed_range(speeds);
    let (width, y) = (120.0, panel.top + panel.height - 18.0);
    let left = panel.left + panel.width - width - 14.0;
    for k in 0..24 {
        let x = left + width * f64::from(k) / 24.0;
        let fill = scale_colour((f64::from(k) + 0.5) / 24.0);
        out.line(&format!("<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"5.1\" height=\"7\" fill=\"{fill}\"/>"));
    }
    let words = format!("{} to {} units/s", short_number(low), short_number(high));
    out.text([left + width, y - 6.0], "end", "#333333", &words);
}
