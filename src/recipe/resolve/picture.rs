//! Camera and rendering.

use super::Resolver;
use super::number::{Range, Whole};
use crate::camera::CameraChoice;
use crate::recipe::field::Field;
use crate::recipe::schema;
use crate::recipe::text::Place;
use crate::render::{Antialiased, RenderChoice, Rules};

/// Pixels on a side, far above any event sensor; events count them in 16 bits.
const SIDE: Whole = Whole::new(1, 16_384);

impl Resolver<'_> {
    pub(super) fn camera(&self, field: &Field<schema::Camera>) -> Option<Option<CameraChoice>> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        let help = "width and height are given together, in pixels";
        let [width, height] = [(&raw.width, "width"), (&raw.height, "height")].map(|(field, name)| {
            self.required(field, name, place, help)?;
            self.small(field, 1, SIDE)
        });
        let intrinsics = self.intrinsics(raw, place);
        Some(Some(CameraChoice { width: width?, height: height?, intrinsics: intrinsics? }))
    }

    fn intrinsics(&self, raw: &schema::Camera, camera: Place) -> Option<Option<[f64; 4]>> {
        let (length, point) = (Range::above(0.0, 1e6), Range::new(-1e6, 1e6));
        let fields = [
            (&raw.fx, "fx", length),
            (&raw.fy, "fy", length),
            (&raw.cx, "cx", point),
            (&raw.cy, "cy", point),
        ];
        if fields.iter().all(|(field, ..)| field.is_absent()) {
            return Some(None);
        }
        let help = "fx, fy, cx and cy are given together, in pixels, or not at all";
        let [fx, fy, cx, cy] = fields.map(|(field, name, range)| {
            self.required(field, name, camera, help)?;
            self.real(field, 0.0, range)
        });
        Some(Some([fx?, fy?, cx?, cy?]))
    }

    pub(super) fn render(&self, field: &Field<schema::Render>) -> Option<RenderChoice> {
        let absent = schema::Render::default();
        let raw = self.section(field, &absent)?;
        self.later(&raw.order, "this gs2e has no soft rules, and so no order of theirs");
        let rules = self.rules(&raw.rules);
        let antialiased = self.or(&raw.antialiased, schema::Antialiased::Auto);
        let background = self.background(&raw.background);
        Some(RenderChoice {
            rules: rules?,
            antialiased: match antialiased? {
                schema::Antialiased::Auto => Antialiased::Auto,
                schema::Antialiased::On => Antialiased::On,
                schema::Antialiased::Off => Antialiased::Off,
            },
            background: background?,
        })
    }

    fn rules(&self, field: &Field<schema::Rules>) -> Option<Rules> {
        let (rules, place) = match field {
            Field::Absent => return Some(Rules::Official),
            Field::Bad => return None,
            Field::Given(rules, place) => (rules, *place),
        };
        let help = "this gs2e renders with the rules official and exact";
        match rules {
            schema::Rules::Official => Some(Rules::Official),
            schema::Rules::Exact => Some(Rules::Exact),
            schema::Rules::Gsplat => self.word_later("gsplat", place, help),
            schema::Rules::Soft => self.word_later("soft", place, help),
        }
    }

    fn background(&self, field: &Field<[Field<f64>; 3]>) -> Option<[f64; 3]> {
        let Some((rgb, _)) = field.given() else { return field.is_absent().then_some([0.0; 3]) };
        let [r, g, b] = rgb.each_ref().map(|channel| self.real(channel, 0.0, Range::new(0.0, 1.0)));
        Some([r?, g?, b?])
    }
}
