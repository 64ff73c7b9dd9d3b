//! Products of each trajectory and their spacing.

use super::Resolver;
use super::number::WholeRange;
use crate::image::light::MeanScale;
use crate::recipe::field::Field;
use crate::recipe::problem::FieldProblem;
use crate::recipe::{OutputKind, PictureSpacing, schema};
use crate::sampling::exposure::{FRAMES, ShutterSettings, SubframeRule};
use crate::trajectory::MAX_POSES;
use std::collections::BTreeSet;

/// Maximum number of exposed frames: four seconds at 2,400 frames per second.
const MAX_EXPOSED: u64 = 9_999;

impl Resolver<'_> {
    pub(super) fn outputs(&self, field: &Field<Vec<Field<OutputKind>>>) -> Option<BTreeSet<OutputKind>> {
        let list = match field {
            Field::Absent => return Some(BTreeSet::from(OutputKind::DEFAULT)),
            Field::Bad => return None,
            Field::Given(list, _) => list,
        };
        let found: Vec<_> = list.iter().map(Field::given).collect();
        let mut outputs = BTreeSet::new();
        for (output, place) in found.into_iter().collect::<Option<Vec<_>>>()? {
            if !outputs.insert(*output) {
                self.report(FieldProblem::of_field("names an output twice").at(place));
            }
        }
        Some(outputs)
    }

    pub(super) fn spacing(&self, raw: &schema::RecipeSchema) -> Option<PictureSpacing> {
        let absent = schema::EverySection::default();
        let every = |field: &Field<schema::EverySection>| {
            self.small(&self.section(field, &absent)?.every, 1, WholeRange::new(1, MAX_POSES))
        };
        let every = PictureSpacing::sections(raw).map(|(output, field)| (output, every(field)));
        // Every section reports its faults before the first faulty one ends this.
        let every = every.into_iter().map(|(output, every)| Some((output, every?)));
        Some(PictureSpacing::from_spacings(every.collect::<Option<_>>()?))
    }

    pub(super) fn shutter(&self, field: &Field<schema::BlurSection>) -> Option<ShutterSettings> {
        let absent = schema::BlurSection::default();
        let raw = self.section(field, &absent)?;
        let frames = self.small(&raw.frames, FRAMES, WholeRange::new(1, MAX_EXPOSED));
        if let (Some(frames), Some(place)) = (frames, raw.frames.place())
            && frames % 2 == 0
        {
            let problem = FieldProblem::of_field(format!("is {frames}, wanted an odd number"));
            return self.refuse(
                problem
                    .help("write an odd number, so that one frame is in the middle of an exposure")
                    .at(place),
            );
        }
        let subframes = self.or(&raw.subframes, SubframeRule::Auto);
        let mean = self.or(&raw.mean, MeanScale::Linear);
        Some(ShutterSettings { frames: frames?, subframes: subframes?, mean: mean? })
    }
}
