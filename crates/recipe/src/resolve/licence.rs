//! The owner's part of the licence, and the grant of an upstream.

use super::Resolver;
use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::text::TextSpan;
use crate::{LicenceChoice, SceneSource, forms, schema};
use gs2e_source::licence::{LedgerAsset, LicenceExpression, UpstreamGrant, ledger};

const HELP: &str = "write licence: { expression: CC0-1.0, holder: Example Lab }";

const GRANTED: &str = "remove upstream:, or write evidence: { granted_by: who granted what, url: where it can be read, \
                       date: 2025-06-01 } next to it";

impl Resolver<'_> {
    pub(super) fn licence(
        &self,
        field: &Field<schema::LicenceSection>,
        source: Option<&SceneSource>,
    ) -> Option<Option<LicenceChoice>> {
        let Some((raw, place)) = field.given() else { return field.is_absent().then_some(None) };
        let expression = self.required(&raw.expression, "expression", place, HELP);
        let holder = self.required(&raw.holder, "holder", place, HELP);
        resolved!(LicenceChoice {
            expression: expression.and_then(|(text, place)| self.spdx(text, place)),
            holder: holder.and_then(|(text, place)| self.filled(text, place)),
            grant: self.grant(raw, source),
        })
        .map(Some)
    }

    /// Resolves the upstream's grant. Terms that differ from the upstream's public terms need
    /// evidence.
    fn grant(
        &self,
        raw: &schema::LicenceSection,
        source: Option<&SceneSource>,
    ) -> Option<Option<UpstreamGrant>> {
        let Some((text, place)) = raw.upstream.given() else {
            if let Some(place) = raw.evidence.place() {
                let help = "name what was granted: upstream: CC-BY-4.0";
                return self.refuse(FieldProblem::of_key("is given without upstream").help(help).at(place));
            }
            return (raw.upstream.is_absent() && raw.evidence.is_absent()).then_some(None);
        };
        let expression = self.spdx(text, place)?;
        let Some(asset) = upstream_of(source?) else {
            let problem =
                FieldProblem::of_key("is not allowed: this source has no upstream with its own terms");
            return self.refuse(problem.help("state all terms in expression:").at(place));
        };
        let Some((evidence, within)) = raw.evidence.given() else {
            if raw.evidence.is_absent() {
                let found = quote_text(&expression);
                let message = format!(
                    "is {found}, but {} states {} for everybody (licence-forbidden without evidence)",
                    asset.name,
                    asset.expression()
                );
                return self.refuse(FieldProblem::of_field(message).help(GRANTED).at(place));
            }
            return None;
        };
        let granted_by = self.required(&evidence.granted_by, "granted_by", within, GRANTED);
        let granted_by = granted_by.and_then(|(text, place)| self.filled(text, place));
        let url = self.required(&evidence.url, "url", within, GRANTED);
        let url = url.and_then(|_| self.formed(&evidence.url, forms::URL));
        let date = self.required(&evidence.date, "date", within, GRANTED);
        let date = date.and_then(|_| self.formed(&evidence.date, forms::DAY));
        let expression = LicenceExpression::parse(&expression).ok()?.to_string();
        Some(Some(UpstreamGrant { expression, granted_by: granted_by?, url: url??, date: date?? }))
    }

    /// Returns the terms of a program. The terms of a known program must include its licence.
    pub(super) fn tool_terms(&self, program: &str, text: &str, place: TextSpan) -> Option<String> {
        let stated = self.spdx(text, place)?;
        let name = program.rsplit('/').next().unwrap_or(program);
        let Some(asset) = ledger::find_tool(name) else { return Some(stated) };
        let parsed = LicenceExpression::parse(&stated).ok();
        let lacks = asset.ids.iter().find(|id| !parsed.as_ref().is_some_and(|terms| terms.demands(id)));
        let Some(id) = lacks else { return Some(stated) };
        let message =
            format!("is {}, but {} is under {id} (licence-forbidden)", quote_text(&stated), asset.name);
        let help = asset.evidence.iter().map(|evidence| format!("read {}: {}", evidence.url, evidence.says));
        self.refuse(FieldProblem::of_field(message).help(help.collect::<Vec<_>>().join("; ")).at(place))
    }

    pub(super) fn spdx(&self, text: &str, place: TextSpan) -> Option<String> {
        const LICENCE_HELP: &str = "use ids from spdx.org/licenses, and LicenseRef-Name for other terms";
        if let Err(error) = spdx::Expression::parse(text) {
            let problem =
                FieldProblem::of_field(format!("is not an SPDX expression: {}", error.reason)).at(place);
            return self.refuse(problem.help(LICENCE_HELP).in_text(place, text, error.span));
        }
        // A valid SPDX expression may still be terms that no release can have.
        match LicenceExpression::parse(text) {
            Ok(_) => Some(text.to_owned()),
            Err(error) => {
                let problem = FieldProblem::of_field(format!("cannot be released: {}", error.because));
                self.refuse(problem.help(LICENCE_HELP).at(place))
            }
        }
    }
}

/// Returns the dataset of a source.
fn upstream_of(source: &SceneSource) -> Option<&'static LedgerAsset> {
    ledger::find_dataset(source.kind(), source.upstream().and_then(|upstream| upstream.url.as_deref()))
}
