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
/// Accepted readouts: up to a second.
const READOUT_US: WholeRange = WholeRange::new(1, 1_000_000);

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
        let every = |field: Option<&Field<u64>>| self.small(field?, 1, WholeRange::new(1, MAX_POSES));
        let every = PictureSpacing::written(raw).map(|(output, field)| (output, every(field)));
        // Every section reports its faults before the first faulty one ends this.
        let every = every.into_iter().map(|(output, every)| Some((output, every?)));
        Some(PictureSpacing::from_spacings(every.collect::<Option<_>>()?))
    }

    /// Time from the first row of a sharp frame to the last, if the shutter rolls.
    pub(super) fn readout_us(&self, field: &Field<schema::SharpSection>) -> Option<Option<u32>> {
        let absent = schema::SharpSection::default();
        let field = &self.section(field, &absent)?.readout_us;
        if field.is_absent() {
            return Some(None);
        }
        self.small(field, 1, READOUT_US).map(Some)
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
