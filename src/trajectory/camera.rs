//! The camera that a trajectory is rendered with.

use super::Warning;
use crate::camera::Camera;

/// Views whose focal lengths and principal points differ by no more than this share a camera, px.
const SHARED: f64 = 1.0;

/// The camera of a trajectory through views in path order: the first view's, with a warning where another's differs
/// from it by more than 1 px in fx, fy, cx or cy, or in size. `None` without views.
#[must_use]
pub fn of_views(cameras: &[Camera]) -> Option<(Camera, Option<Warning>)> {
    let first = *cameras.first()?;
    let differs = |c: &Camera| {
        let intrinsics = [c.fx - first.fx, c.fy - first.fy, c.cx - first.cx, c.cy - first.cy];
        let sizes = [
            f64::from(c.size.width) - f64::from(first.size.width),
            f64::from(c.size.height) - f64::from(first.size.height),
        ];
        intrinsics.into_iter().chain(sizes).fold(0.0, |most: f64, d| most.max(d.abs()))
    };
    let others = cameras.iter().filter(|c| differs(c) > SHARED).count();
    let most_px = cameras.iter().map(differs).fold(0.0, f64::max);
    Some((first, (others > 0).then_some(Warning::Cameras { others, most_px })))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    #[test]
    fn views_that_share_a_camera_give_it_silently() {
        let camera =
            Camera { size: Size { width: 640, height: 360 }, fx: 500.0, fy: 500.0, cx: 320.0, cy: 180.0 };
        let near = Camera { fx: 500.9, cy: 179.2, ..camera };
        let far = Camera { fx: 500.9, cy: 177.5, ..camera };
        let large = Camera { size: Size { width: 1280, height: 720 }, ..camera };
        assert_eq!(of_views(&[camera, near, camera]), Some((camera, None)));
        let t = |cameras: &[Camera], others, most_px| {
            assert_eq!(of_views(cameras), Some((camera, Some(Warning::Cameras { others, most_px }))));
        };
        t(&[camera, near, far], 1, 2.5);
        t(&[camera, large, far], 2, 640.0);
        assert_eq!(of_views(&[]), None);
    }
}
