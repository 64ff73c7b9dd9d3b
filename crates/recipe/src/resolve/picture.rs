//! Camera and rendering.

use super::Resolver;
use super::number::{RealRange, WholeRange};
use super::trajectory::Triple;
use crate::field::Field;
use crate::problem::FieldProblem;
use crate::text::TextSpan;
use crate::{SceneSource, schema};
use gs2e_image::Size;
use gs2e_render::{AntialiasMode, LayerOrder, RenderChoice, RenderRules};
use gs2e_scene::camera::lens::Distortion;
use gs2e_scene::camera::{CameraChoice, PrincipalPoint};

/// Pixels per side, far above any event sensor. Events store coordinates in 16 bits.
const SIDE: WholeRange = WholeRange::new(1, 16_384);

/// Coefficients of lenses. A coefficient of a high order may be large where the field is narrow.
const COEFFICIENT: RealRange = RealRange::new(-1e6, 1e6);

const WHOLE: &str = "without a source, write the camera: camera: { width: 640, height: 360, fov: 60 }";

impl Resolver<'_> {
    pub(super) fn camera(
        &self,
        field: &Field<schema::CameraSection>,
        source: Option<&SceneSource>,
    ) -> Option<Option<CameraChoice>> {
        let whole = source.is_some_and(|source| !source.has_views());
        if whole && field.is_absent() {
            return self.refuse(FieldProblem::missing_field("camera").help(WHOLE).at(self.root));
        }
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        let [width, height] = self.sides(raw, place);
        let intrinsics = self.intrinsics(raw, [width, height], place, whole);
        let principal = self.principal(raw, place);
        let lens = self.lens(&raw.lens);
        let size = Size { width: width?, height: height? };
        // Both sides may be in range, and their product still too large.
        if let Err(error) = size.check_sensor() {
            return self.refuse(FieldProblem::of_field(format!("is {error}")).at(place));
        }
        let Size { width, height } = size;
        let (intrinsics, principal, lens) = (intrinsics?, principal?, lens?);
        let choice = CameraChoice { width, height, intrinsics, principal, lens };
        // A camera whose focal length is that of the source is judged when it is known.
        if let Some(Err(because)) = choice.resolve(None).map(|camera| camera.check_lens()) {
            let place = raw.lens.place().unwrap_or(place);
            let help =
                "OpenCV fits a lens to the corners of a board: outside of them, its polynomial may turn back";
            return self.refuse(FieldProblem::of_field(because).help(help).at(place));
        }
        Some(Some(choice))
    }

    /// Resolves the lens; the inner `None` is a pinhole.
    fn lens(&self, field: &Field<schema::LensSection>) -> Option<Option<Distortion>> {
        let Some((lens, _)) = field.given() else { return field.is_absent().then_some(None) };
        let (model, field, wanted) = match lens {
            schema::LensSection::Opencv(field) => {
                ("opencv", field, "4, 5 or 8: k1, k2, p1, p2, k3, k4, k5, k6")
            }
            schema::LensSection::Fisheye(field) => ("fisheye", field, "4: k1, k2, k3, k4"),
        };
        let (list, place) = field.given()?;
        let numbers: Option<Vec<f64>> = list.iter().map(|item| self.real(item, 0.0, COEFFICIENT)).collect();
        match Distortion::from_parts(model, &numbers?) {
            Ok(lens) => Some(Some(lens)),
            Err(found) => self.refuse(FieldProblem::of_field(format!("{found}, wanted {wanted}")).at(place)),
        }
    }

    /// Resolves the size, by name or by its sides.
    fn sides(&self, raw: &schema::CameraSection, camera: TextSpan) -> [Option<u32>; 2] {
        if raw.size.is_absent() {
            let help = "give width and height together, in pixels, or a size by name";
            return [(&raw.width, "width"), (&raw.height, "height")].map(|(field, name)| {
                self.required(field, name, camera, help)?;
                self.small(field, 1, SIDE)
            });
        }
        if ![&raw.width, &raw.height].iter().all(|field| field.is_absent()) {
            let problem = FieldProblem::of_field("has both `size` and `width` or `height`");
            self.report(problem.help("keep one of them").at(camera));
            return [None; 2];
        }
        let size = raw.size.given().map(|(name, _)| name.size());
        [size.map(|size| size.width), size.map(|size| size.height)]
    }

    /// Resolves `principal`, which excludes the numbers of the same point.
    fn principal(&self, raw: &schema::CameraSection, camera: TextSpan) -> Option<PrincipalPoint> {
        let principal = raw.principal.or(PrincipalPoint::Given)?;
        if !principal.is_given() && ![&raw.cx, &raw.cy].iter().all(|field| field.is_absent()) {
            let problem = FieldProblem::of_field("has both `principal` and `cx` or `cy`");
            return self.refuse(problem.help("keep one of them").at(camera));
        }
        Some(principal)
    }

    /// Resolves fx, fy, cx and cy; the inner `None` means that the camera has no intrinsics of its
    /// own.
    fn intrinsics(
        &self,
        raw: &schema::CameraSection,
        sides: [Option<u32>; 2],
        camera: TextSpan,
        whole: bool,
    ) -> Option<Option<[f64; 4]>> {
        let fields = [&raw.fx, &raw.fy, &raw.cx, &raw.cy];
        let absent = fields.iter().all(|field| field.is_absent());
        if absent && (whole || !raw.fov.is_absent()) {
            return self.of_angle(&raw.fov, sides).map(Some);
        }
        if absent {
            return Some(None);
        }
        if let Some(at) = raw.fov.place() {
            let problem = FieldProblem::of_key("and fx, fy, cx, cy exclude each other");
            return self.refuse(problem.help("keep one of them: both set the field of view").at(at));
        }
        let help = "fy, cx and cy need fx, in pixels";
        let (length, point) = (RealRange::above(0.0, 1e6), RealRange::new(-1e6, 1e6));
        self.required(&raw.fx, "fx", camera, help);
        // If `fx` is absent, that was just reported, and its default reaches no recipe.
        let fx = self.real(&raw.fx, 1.0, length);
        let fy = self.real(&raw.fy, fx.unwrap_or(1.0), length);
        let [middle_x, middle_y] = sides.map(|side| f64::from(side.unwrap_or(0)) / 2.0);
        let (cx, cy) = (self.real(&raw.cx, middle_x, point), self.real(&raw.cy, middle_y, point));
        Some(Some([fx?, fy?, cx?, cy?]))
    }

    /// The intrinsics of an angle of view, with the principal point in the middle.
    fn of_angle(&self, fov: &Field<f64>, [width, height]: [Option<u32>; 2]) -> Option<[f64; 4]> {
        let half = self.real(fov, 60.0, RealRange::new(1.0, 170.0))?.to_radians() / 2.0;
        let [width, height] = [width?, height?].map(f64::from);
        // From `libm`, since the number enters keys: the tangent of the system's library differs between
        // machines.
        let focal = width / 2.0 / libm::tan(half);
        Some([focal, focal, width / 2.0, height / 2.0])
    }

    pub(super) fn render(
        &self,
        field: &Field<schema::RenderSection>,
        default: RenderRules,
    ) -> Option<RenderChoice> {
        let raw = field.or_default()?;
        resolved!(RenderChoice {
            rules: raw.rules.or(default),
            order: self.layering(&raw.order, rules),
            antialiased: raw.antialiased.or(schema::AntialiasedKey::Auto).map(|key| match key {
                schema::AntialiasedKey::Auto => AntialiasMode::Auto,
                schema::AntialiasedKey::On => AntialiasMode::On,
                schema::AntialiasedKey::Off => AntialiasMode::Off,
            }),
            background: self.background(&raw.background),
            near: raw.near.optional(|near| self.real(near, 0.0, RealRange::new(0.0, 1.0))),
        })
    }

    /// Resolves the order of the layers. Only the rules `soft` can blend them.
    fn layering(&self, field: &Field<LayerOrder>, rules: Option<RenderRules>) -> Option<LayerOrder> {
        let order = field.or(LayerOrder::Depth)?;
        if order == LayerOrder::Depth || matches!(rules, None | Some(RenderRules::Soft)) {
            return Some(order);
        }
        let place = field.given().map_or(self.root, |(_, place)| place);
        let problem = FieldProblem::new("order: blended needs rules: soft")
            .help("write rules: soft, or leave `order` out");
        self.refuse(problem.at(place))
    }

    fn background(&self, field: &Triple) -> Option<[f64; 3]> {
        let background = field.optional(|rgb| self.numbers(rgb.given()?.0, RealRange::new(0.0, 1.0)));
        background.map(Option::unwrap_or_default)
    }
}
