//! The path from above and from the side as a simple sketch, for pages with many trajectories.

use super::path::{PanelMap, frustum_stroke, picture_axes, range_share, scale_colour, speed_range};
use super::{PicturePanel, round_down, short_number, spread_indices};
use glam::DVec3;
use gs2e_num::se3::Se3;

/// Margin around the path, px.
const INSET: f64 = 22.0;
/// The longest scale bar, as a share of the view's width.
const BAR: f64 = 0.25;

/// One view of a path. Places are px from the upper left corner.
#[derive(Debug, Clone, PartialEq)]
pub struct PathSketch {
    /// Name of the viewpoint.
    pub name: &'static str,
    /// The path, from the first pose.
    pub path: Vec<[f64; 2]>,
    /// Camera frusta, one stroke each, with the colour of their speed.
    pub frusta: Vec<([[f64; 2]; 11], String)>,
    /// Length of the scale bar, px.
    pub bar: f64,
    /// Label of the scale bar.
    pub bar_words: String,
}

/// The view from above and the view from the side, of [width, height] px each, with at most
/// [`points`, `frusta`] of the poses; `None` without poses. `speeds` are those of the steps, units
/// per second.
pub fn sketch(
    poses: &[Se3],
    speeds: &[f64],
    [width, height]: [f64; 2],
    [points, frusta]: [usize; 2],
) -> Option<[PathSketch; 2]> {
    if poses.is_empty() {
        return None;
    }
    let [along, across, up] = picture_axes(poses);
    let view = |name: &'static str, plane: [DVec3; 2]| {
        let map =
            PanelMap::fit_panel(PicturePanel { left: 0.0, top: 0.0, width, height }, INSET, poses, plane)?;
        let range = speed_range(speeds);
        // The last pose has no step after it.
        let speed = |j: usize| speeds.get(j).or(speeds.last()).copied().unwrap_or(0.0);
        let camera = |j: usize| (frustum_stroke(&map, &poses[j]), scale_colour(range_share(speed(j), range)));
        let unit = round_down(width * BAR / map.scale);
        Some(PathSketch {
            name,
            path: spread_indices(poses.len(), points).map(|j| map.point(poses[j].translation)).collect(),
            frusta: spread_indices(poses.len(), frusta).map(camera).collect(),
            bar: unit * map.scale,
            bar_words: format!("{} {}", short_number(unit), if unit > 1.0 { "units" } else { "unit" }),
        })
    };
    Some([view("from above", [along, across])?, view("from the side", [along, -up])?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn both_views_are_to_scale_and_inside() {
        // 4 units along x and 1 unit down (y is down for cameras that look along z), with level
        // cameras.
        let pose = |k: u32| Se3 {
            rotation: DQuat::IDENTITY,
            translation: DVec3::new(f64::from(k), f64::from(k) / 4.0, 0.0),
        };
        let poses: Vec<Se3> = (0..5).map(pose).collect();
        let [above, side] = sketch(&poses, &[1.0, 2.0, 3.0, 4.0], [160.0, 120.0], [3, 2]).unwrap();
        assert_eq!((above.path.len(), above.frusta.len()), (3, 2));
        for view in [&above, &side] {
            let inside = |p: &[f64; 2]| (0.0..=160.0).contains(&p[0]) && (0.0..=120.0).contains(&p[1]);
            assert!(view.path.iter().all(inside), "{view:?}");
            // 4 units take the whole width except for the margins, so a bar of 1 unit is a quarter
            // of that.
            let width = view.path[2][0] - view.path[0][0];
            assert!((width - 116.0).abs() < 1e-9 && (view.bar - width / 4.0).abs() < 1e-9, "{view:?}");
            assert_eq!(view.bar_words, "1 unit");
            assert_ne!(view.frusta[0].1, view.frusta[1].1, "speeds have colours");
        }
        assert!((above.path[2][1] - above.path[0][1]).abs() < 1e-9, "from above it is level");
        assert!((side.path[2][1] - side.path[0][1] - 29.0).abs() < 1e-9, "it sinks by a quarter of its way");
    }

    #[test]
    fn a_still_camera_and_none_at_all_are_told_apart() {
        assert!(sketch(&[], &[], [160.0, 120.0], [10, 3]).is_none());
        let [above, _] = sketch(&[Se3::IDENTITY], &[], [160.0, 120.0], [10, 3]).unwrap();
        assert_eq!((above.path.len(), above.frusta.len()), (1, 1));
    }
}
