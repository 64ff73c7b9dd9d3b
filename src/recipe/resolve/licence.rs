//! The owner's part of the licence.

use super::Resolver;
use crate::recipe::field::Field;
use crate::recipe::problem::Problem;
use crate::recipe::text::Place;
use crate::recipe::{LicenceChoice, schema};

const HELP: &str = "write licence: { expression: CC0-1.0, holder: Example Lab }";

impl Resolver<'_> {
    pub(super) fn licence(&self, field: &Field<schema::Licence>) -> Option<Option<LicenceChoice>> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        self.later(&raw.evidence, "this gs2e composes licences without evidence");
        let expression = self.required(&raw.expression, "expression", place, HELP);
        let expression = expression.and_then(|(text, place)| self.spdx(text, place));
        let holder = self.required(&raw.holder, "holder", place, HELP);
        let holder = holder.and_then(|(text, place)| self.filled(text, place));
        Some(Some(LicenceChoice { expression: expression?, holder: holder? }))
    }

    pub(super) fn spdx(&self, text: &str, place: Place) -> Option<String> {
        let Err(error) = spdx::Expression::parse(text) else { return Some(text.to_owned()) };
        let problem = Problem::of_field(format!("is no SPDX expression: {}", error.reason)).at(place);
        let problem = problem.help("ids are those of spdx.org/licenses; own terms are LicenseRef-Name");
        self.refuse(problem.in_text(place, text, error.span))
    }
}
