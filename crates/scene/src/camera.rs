//! Cameras: image size, intrinsics in pixels, and the lens.
//!
//! Pixel `(i, j)` covers `[i, i+1) x [j, j+1)`, and its centre is at `(i+0.5, j+0.5)`. A centred
//! camera has `cx = width / 2`. Camera axes are OpenCV's: x right, y down, z forward.
//!
//! # Examples
//!
//! ```
//! use glam::DVec3;
//! use gs2e_image::Size;
//! use gs2e_scene::camera::Camera;
//!
//! let camera = Camera::pinhole(Size { width: 64, height: 48 }, [100.0, 100.0, 32.0, 24.0]);
//! // Half a unit right of the axis per unit of depth: 100 / 2 px right of the middle.
//! let point = DVec3::new(1.0, 0.0, 2.0);
//! assert_eq!(camera.project(point), Some([82.0, 24.0]));
//! assert_eq!(camera.unproject([82.0, 24.0], 2.0), point);
//! assert_eq!(camera.project(-point), None);
//! ```

pub mod flow;
pub mod lens;
pub mod stereo;
pub mod view;

use glam::{DVec2, DVec3};
use gs2e_image::Size;
use lens::{Distortion, WIDEST};
use serde::{Deserialize, Serialize};

/// A camera: a pinhole, or one behind a lens that distorts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Width and height in pixels.
    #[serde(flatten)]
    pub size: Size,
    /// Horizontal focal length, px.
    pub fx: f64,
    /// Vertical focal length, px.
    pub fy: f64,
    /// Principal point, px from the image's left edge.
    pub cx: f64,
    /// Principal point, px from the image's top edge.
    pub cy: f64,
    /// The lens, if it distorts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<Distortion>,
}

impl Camera {
    /// A camera without a lens.
    #[must_use]
    pub const fn pinhole(size: Size, [fx, fy, cx, cy]: [f64; 4]) -> Self {
        Self { size, fx, fy, cx, cy, lens: None }
    }

    /// The ray of a place on the image: a point at depth 1, in camera axes. NaN if the lens shows no ray
    /// there.
    #[must_use]
    pub fn ray(&self, [x, y]: [f64; 2]) -> DVec2 {
        let flat = DVec2::new((x - self.cx) / self.fx, (y - self.cy) / self.fy);
        self.lens.map_or(flat, |lens| lens.undistort(flat).unwrap_or(DVec2::NAN))
    }

    /// The point at a place on the image, at this depth along the optical axis, in camera axes. NaN if the
    /// lens shows no ray there.
    #[must_use]
    pub fn unproject(&self, place: [f64; 2], z: f64) -> DVec3 {
        self.ray(place).extend(1.0) * z
    }

    /// The image position of a point in camera axes, px; `None` if the point is not in front of the
    /// camera, or the lens does not show it.
    #[must_use]
    pub fn project(&self, point: DVec3) -> Option<[f64; 2]> {
        if point.z <= 0.0 || point.z.is_nan() {
            return None;
        }
        let Some(lens) = self.lens else {
            return Some([self.fx * point.x / point.z + self.cx, self.fy * point.y / point.z + self.cy]);
        };
        let image = lens.image(point.truncate() / point.z)?;
        Some([self.fx * image.x + self.cx, self.fy * image.y + self.cy])
    }

    /// The pixels at the edge of the picture.
    pub fn edge(&self) -> impl Iterator<Item = [u32; 2]> {
        let Size { width, height } = self.size;
        let rows = (0..height).flat_map(move |y| [[0, y], [width.saturating_sub(1), y]]);
        rows.chain((0..width).flat_map(move |x| [[x, 0], [x, height.saturating_sub(1)]]))
    }

    /// The least and the largest slopes `x/z` and `y/z` of the rays that the picture holds. With a lens,
    /// those at the middles of the pixels at the edge.
    #[must_use]
    pub fn field(&self) -> [DVec2; 2] {
        let Size { width, height } = self.size;
        if self.lens.is_none() {
            let [one, other] = [[0, 0], [width, height]].map(|corner| self.ray(corner.map(f64::from)));
            return [one.min(other), one.max(other)];
        }
        let rays = self.edge().map(|pixel| self.ray(pixel.map(|at| f64::from(at) + 0.5)));
        rays.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], ray| [low.min(ray), high.max(ray)])
    }

    /// Checks that each pixel at the edge shows a ray, and that a pinhole image can hold the field.
    ///
    /// # Errors
    /// The pixel, and the fault of the lens there.
    pub fn check_lens(&self) -> Result<(), String> {
        let Some(lens) = self.lens else { return Ok(()) };
        for [x, y] in self.edge() {
            let ray = self.ray([x, y].map(|at| f64::from(at) + 0.5));
            if ray.is_nan() {
                return Err(format!(
                    "shows no ray at pixel ({x}, {y}): the lens {lens} folds, or bends by 90 degrees, before it"
                ));
            }
            if ray.length() > WIDEST {
                return Err(format!(
                    "reaches {:.1} degrees from the axis at pixel ({x}, {y}), wanted at most 76: no pinhole image holds it",
                    libm::atan(ray.length()).to_degrees()
                ));
            }
        }
        Ok(())
    }

    /// The image velocity of a point in camera axes that moves, px per unit of the velocity's time.
    #[must_use]
    pub fn velocity(&self, point: DVec3, moving: DVec3) -> DVec2 {
        // `d(x/z) = (dx - x dz/z) / z`. The form with `z^2` under the fraction overflows at far
        // depths first.
        let slope = (moving.truncate() - point.truncate() * (moving.z / point.z)) / point.z;
        let bent = self.lens.map_or(slope, |lens| lens.distort(point.truncate() / point.z).1 * slope);
        bent * DVec2::new(self.fx, self.fy)
    }

    /// The camera of another image size with the same horizontal field of view, cropped or extended
    /// in height about the centre: `f' = f W'/W`, `cx' = cx W'/W`,
    /// `cy' = cy W'/W + (H' - H W'/W) / 2`.
    #[must_use]
    pub fn resized(&self, size: Size) -> Self {
        // One scale for both axes keeps pixels square if they were.
        let k = f64::from(size.width) / f64::from(self.size.width);
        let crop = (f64::from(size.height) - f64::from(self.size.height) * k) / 2.0;
        let (fx, fy, cx, cy) = (self.fx * k, self.fy * k, self.cx * k, self.cy * k + crop);
        Self { size, fx, fy, cx, cy, lens: self.lens }
    }
}

/// A size of pictures by the name of the camera or of the dataset that has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NamedSize {
    /// 346x260, the DAVIS346. EventNeRF and E-3DGS have this size in their code.
    Davis346,
    /// 640x480, the events of DSEC. E-RAFT has this size in its code.
    Dsec,
    /// 800x800, the synthetic scenes of NeRF. E2NeRF has this size in its code.
    Blender,
    /// 1280x720, the Prophesee EVK4.
    Evk4,
}

impl NamedSize {
    /// Width and height.
    #[must_use]
    pub fn size(self) -> Size {
        let (width, height) = match self {
            Self::Davis346 => (346, 260),
            Self::Dsec => (640, 480),
            Self::Blender => (800, 800),
            Self::Evk4 => (1280, 720),
        };
        Size { width, height }
    }
}

/// Place of the principal point in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PrincipalPoint {
    /// The place that `cx` and `cy` give, or the source.
    #[default]
    Given,
    /// The middle of the picture. Most methods that read one focal length assume it.
    Middle,
    /// Half a pixel right of the middle and below it. It is exact for methods whose rays leave a pixel at its
    /// corner, such as E-NeRF and E2NeRF.
    CornerHalf,
}

impl PrincipalPoint {
    /// Returns true if this is the default.
    #[must_use]
    pub fn is_given(&self) -> bool {
        *self == Self::Given
    }

    /// The camera with its principal point at this place.
    fn place(self, camera: Camera) -> Camera {
        let from_middle = match self {
            Self::Given => return camera,
            Self::Middle => 0.0,
            Self::CornerHalf => 0.5,
        };
        let [cx, cy] =
            [camera.size.width, camera.size.height].map(|side| f64::from(side) / 2.0 + from_middle);
        Camera { cx, cy, ..camera }
    }
}

/// A recipe's choice of a camera that differs from the source's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraChoice {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// fx, fy, cx and cy in pixels. `None` keeps the horizontal field of view of the source.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intrinsics: Option<[f64; 4]>,
    /// The principal point. `Given` is that of `intrinsics` or of the source, and stays out of keys.
    #[serde(skip_serializing_if = "PrincipalPoint::is_given")]
    pub principal: PrincipalPoint,
    /// The lens, if it distorts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens: Option<Distortion>,
}

impl CameraChoice {
    /// Applies this choice to the camera of the source. `None` if it keeps the field of view and
    /// the source has no camera.
    #[must_use]
    pub fn resolve(&self, source: Option<&Camera>) -> Option<Camera> {
        let size = Size { width: self.width, height: self.height };
        let camera = match self.intrinsics {
            Some(intrinsics) => Some(Camera::pinhole(size, intrinsics)),
            None => source.map(|source| source.resized(size)),
        };
        camera.map(|camera| Camera { lens: self.lens, ..self.principal.place(camera) })
    }
}

/// The camera of a scene: the recipe's choice, otherwise the source's own. `None` if neither is
/// sufficient.
#[must_use]
pub fn choose_camera(choice: Option<CameraChoice>, source: Option<&Camera>) -> Option<Camera> {
    match choice {
        Some(choice) => choice.resolve(source),
        None => source.copied(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resizing_keeps_the_horizontal_field_of_view() {
        let full = Camera::pinhole(Size { width: 1920, height: 1080 }, [1500.0, 1500.0, 960.0, 540.0]);
        let small = full.resized(Size { width: 640, height: 480 });
        assert_eq!((small.fx, small.cx, small.cy), (500.0, 320.0, 240.0));
    }

    #[test]
    fn a_camera_is_chosen_and_what_it_leaves_open_is_the_sources() {
        let own = Camera::pinhole(Size { width: 64, height: 48 }, [60.0, 61.0, 32.0, 24.0]);
        let size = CameraChoice {
            width: 32,
            height: 24,
            intrinsics: None,
            principal: PrincipalPoint::Given,
            lens: None,
        };
        let whole = CameraChoice { intrinsics: Some([30.0, 31.0, 15.0, 12.0]), ..size };
        let fx = |choice, source| choose_camera(choice, source).map(|camera| camera.fx);
        assert_eq!(fx(None, Some(&own)), Some(60.0));
        assert_eq!(fx(Some(size), Some(&own)), Some(30.0));
        assert_eq!(choose_camera(Some(whole), Some(&own)), choose_camera(Some(whole), None));
        assert_eq!(fx(Some(whole), None), Some(30.0));
        assert_eq!((fx(Some(size), None), fx(None, None)), (None, None));
        let centre = |principal, choice: CameraChoice| {
            let camera = CameraChoice { principal, ..choice }.resolve(Some(&own)).unwrap();
            (camera.fx, camera.cx, camera.cy)
        };
        assert_eq!(centre(PrincipalPoint::CornerHalf, size), (30.0, 16.5, 12.5));
        assert_eq!(centre(PrincipalPoint::Middle, whole), (30.0, 16.0, 12.0));
        assert_eq!(centre(PrincipalPoint::Given, whole), (30.0, 15.0, 12.0));
    }
}
