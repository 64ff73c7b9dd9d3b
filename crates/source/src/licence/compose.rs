//! The terms of a release, composed from those of its parts.

use super::expression::LicenceExpression;
use super::ledger::{LedgerAsset, LicenceObligation};
use super::{ComposedTerms, HolderTerms, Redistributability, StatedTerms, UpstreamGrant, ledger, text};
use crate::kind::SourceKind;

/// Holder in the recipe of the README.
const PLACEHOLDER: &str = "Your Lab";

/// Composes the terms of a scene. Without an owner's expression, a procedural scene is CC0-1.0, and
/// any other scene gets the id for unstated terms. A grant replaces the ledger's ids of the
/// upstream. It does not permit redistribution; that still needs the releaser's reason.
///
/// # Panics
/// A text is not an expression. Recipes are validated for that when they are read.
#[must_use]
pub fn compose_terms(stated: &StatedTerms<'_>) -> ComposedTerms {
    let kind = stated.kind;
    // By address too: the terms of a dataset bind however its captures are read.
    let upstream = ledger::find_dataset(kind, stated.url);
    let mut warnings = Vec::new();
    let parts: Vec<HolderTerms> = upstream
        .map(|asset| of_upstream(asset, stated.grant))
        .into_iter()
        .chain([of_owner(kind, stated)])
        .collect();
    if parts.iter().any(|part| part.asset.is_none() && part.expression == text::UNSTATED) {
        warnings.push("no licence is stated, so the release says that all rights are reserved".into());
    }
    if stated.owner.is_some_and(|(_, holder)| holder == PLACEHOLDER) {
        warnings
            .push(format!("the holder `{PLACEHOLDER}` is that of an example: write your own into `licence`"));
    }
    let terms = parts.iter().map(|part| LicenceExpression::parse(&part.expression));
    let expression = LicenceExpression::conjunction_of(
        terms.map(|term| term.expect("recipes are read with valid expressions")),
    );
    let ids = expression.ids().into_iter().collect();
    let restricted = upstream.filter(|asset| asset.restricted());
    let passing = match (restricted, stated.redistribution) {
        (None, _) => Redistributability::Free,
        (Some(_), Some(because)) => Redistributability::Allowed(because.to_owned()),
        (Some(asset), None) => {
            let (kind, name) = (kind.name(), asset.name);
            let who =
                if name.eq_ignore_ascii_case(kind) { kind.to_owned() } else { format!("{kind} ({name})") };
            warnings.push(format!(
                "{who} forbids redistribution of derived data: such scenes are released as recipe, poses and reports, \
                 unless sources.yaml says {kind}: {{ redistribute: allowed, because: … }}"
            ));
            Redistributability::Withheld
        }
    };
    // A grant or a reason to redistribute does not lift the gate for receivers.
    let expression = expression.to_string();
    ComposedTerms { expression, ids, gated: restricted.is_some(), passing, parts, warnings }
}

fn of_upstream(asset: &'static LedgerAsset, grant: Option<&UpstreamGrant>) -> HolderTerms {
    let expression = grant.map_or_else(|| asset.expression(), |grant| grant.expression.clone());
    HolderTerms {
        asset: Some(asset),
        expression,
        attribution: asset.attribution.to_owned(),
        obligations: asset.obligations.to_vec(),
        grant: grant.cloned(),
    }
}

fn of_owner(kind: SourceKind, stated: &StatedTerms<'_>) -> HolderTerms {
    let (expression, holder) = match stated.owner {
        Some(owner) => owner,
        None if kind.is_made_up() => ("CC0-1.0", ""),
        None => (text::UNSTATED, ""),
    };
    let parsed = LicenceExpression::parse(expression).expect("recipes are read with valid expressions");
    let ids = parsed.ids();
    // An id in one alternative only (`MIT OR CC-BY-NC-4.0`) obliges no receiver: another
    // alternative can be chosen.
    let demanded: Vec<&str> = ids.iter().map(String::as_str).filter(|id| parsed.demands(id)).collect();
    HolderTerms {
        asset: None,
        expression: parsed.to_string(),
        attribution: holder.to_owned(),
        obligations: LicenceObligation::of_ids(&demanded),
        grant: None,
    }
}

/// Composes the terms of several scenes: the AND of all expressions, gated if one scene is gated.
/// Warnings stay with the scenes.
///
/// # Panics
/// There is no scene.
#[must_use]
pub fn compose_all<'a>(scenes: impl Iterator<Item = &'a ComposedTerms>) -> ComposedTerms {
    let (mut parts, mut gated) = (Vec::new(), false);
    for scene in scenes {
        parts.push(LicenceExpression::parse(&scene.expression).expect("a composed expression is one"));
        gated |= scene.gated;
    }
    let expression = LicenceExpression::conjunction_of(parts);
    let ids = expression.ids().into_iter().collect();
    // The permission is decided for each scene separately.
    let passing = Redistributability::Free;
    let (parts, warnings) = (Vec::new(), Vec::new());
    ComposedTerms { expression: expression.to_string(), ids, gated, passing, parts, warnings }
}
