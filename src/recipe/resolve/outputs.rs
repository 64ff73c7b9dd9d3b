//! Products of each trajectory and their spacing.

use super::number::Whole;
use super::{MAX_FRAMES, Resolver};
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::text::Place;
use crate::recipe::{Output, Spacing, schema};
use crate::sampling::exposure::{FRAMES, Shutter, Subframes};
use std::collections::BTreeSet;

/// Maximum number of exposed frames: four seconds at 2,400 frames per second.
const MOST_EXPOSED: u64 = 9_999;

impl Resolver<'_> {
    pub(super) fn outputs(&self, field: &Field<Vec<Field<schema::Output>>>) -> Option<BTreeSet<Output>> {
        let list = match field {
            Field::Absent => return Some(BTreeSet::from([Output::Events, Output::Sharp])),
            Field::Bad => return None,
            Field::Given(list, _) => list,
        };
        let found: Vec<Option<(Output, Place)>> = list.iter().map(resolve_output).collect();
        let mut outputs = BTreeSet::new();
        for (output, place) in found.into_iter().collect::<Option<Vec<_>>>()? {
            if !outputs.insert(output) {
                self.report(Problem::of_field("names an output for the second time").at(place));
            }
        }
        Some(outputs)
    }

    pub(super) fn spacing(&self, raw: &schema::Recipe) -> Option<Spacing> {
        let absent = schema::Every::default();
        let every = |field: &Field<schema::Every>| {
            self.small(&self.section(field, &absent)?.every, 1, Whole::new(1, MAX_FRAMES))
        };
        let (sharp, depth, flow) = (every(&raw.sharp), every(&raw.depth), every(&raw.flow));
        Some(Spacing { sharp: sharp?, depth: depth?, flow: flow? })
    }

    pub(super) fn shutter(&self, field: &Field<schema::Blur>) -> Option<Shutter> {
        let absent = schema::Blur::default();
        let raw = self.section(field, &absent)?;
        let frames = self.small(&raw.frames, FRAMES, Whole::new(1, MOST_EXPOSED));
        if let (Some(frames), Some(place)) = (frames, raw.frames.place())
            && frames % 2 == 0
        {
            let problem = Problem::of_field(format!("is {frames}, wanted an odd number"));
            return self.refuse(problem.help("so that one frame is in the middle of an exposure").at(place));
        }
        let subframes = match self.or(&raw.subframes, schema::Subframes::Auto)? {
            schema::Subframes::Auto => Subframes::Auto,
            schema::Subframes::Literal => Subframes::Literal,
        };
        Some(Shutter { frames: frames?, subframes })
    }
}

fn resolve_output(item: &Field<schema::Output>) -> Option<(Output, Place)> {
    let (output, place) = item.given()?;
    let output = match output {
        schema::Output::Events => Output::Events,
        schema::Output::Sharp => Output::Sharp,
        schema::Output::Blur => Output::Blur,
        schema::Output::Depth => Output::Depth,
        schema::Output::Flow => Output::Flow,
    };
    Some((output, place))
}
