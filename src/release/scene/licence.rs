//! Under which terms a scene is passed on, part by part.

use crate::licence::{ComposedTerms, HolderTerms, LicenceObligation, Redistributability, UpstreamGrant};
use crate::recipe::Recipe;
use serde::{Deserialize, Serialize};

/// Under which terms the scene is passed on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LicencePart {
    /// SPDX expression.
    pub expression: String,
    /// Terms of parts of the scene.
    pub parts: Vec<LicensedPart>,
    /// The tools that it was made with; their licences do not enter the expression.
    pub tools: Vec<LicensedTool>,
    /// True if receivers must accept the upstream terms first.
    pub gated: bool,
    /// Why the releaser may pass on what upstream does not let everyone pass on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redistribution: Option<String>,
    /// True if what shows the scene (events, pictures) is left out of the release, as upstream forbids to pass it on.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub withheld: bool,
    /// Who is to be named.
    pub attribution: String,
}

/// What stands in the place of a dataset for what its owner added.
pub(in crate::release) const OWNER: &str = "owner";

/// Terms of a part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LicensedPart {
    /// Files, as a glob below the scene's folder.
    pub path: String,
    /// The dataset, or `owner`: what was added to it.
    pub asset: String,
    /// SPDX expression.
    pub expression: String,
    /// Who is to be named; empty where nobody is stated.
    pub attribution: String,
    /// What is asked of whoever receives it, as far as it is known.
    pub obligations: Vec<LicenceObligation>,
    /// Of a dataset: whether its terms were read in full at their holder's. The owner's part is what the recipe says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verified: Option<bool>,
    /// Of a dataset: where its terms were read.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub evidence: Vec<String>,
    /// Why the terms are other than those that the dataset has for everybody, where they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grant: Option<UpstreamGrant>,
}

impl LicensedPart {
    fn from_terms(part: &HolderTerms) -> Self {
        let evidence = part.asset.iter().flat_map(|asset| asset.evidence);
        Self {
            path: "**".into(),
            asset: part.asset.map_or(OWNER, |asset| asset.name).into(),
            expression: part.expression.clone(),
            attribution: part.attribution.clone(),
            obligations: part.obligations.clone(),
            verified: part.asset.map(|asset| asset.verified),
            evidence: evidence.map(|evidence| evidence.url.to_owned()).collect(),
            grant: part.grant.clone(),
        }
    }
}

/// A tool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LicensedTool {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Its licence.
    pub licence: String,
}

/// The terms of a scene.
pub(super) fn licence_part(recipe: &Recipe, licence: &ComposedTerms) -> LicencePart {
    let tool = |name: &str, version: &str, licence: &str| LicensedTool {
        name: name.into(),
        version: version.into(),
        licence: licence.into(),
    };
    let trainer = super::training_command(recipe);
    let trainer = trainer.map(|own| tool(&own.name(), &own.version, &own.licence));
    LicencePart {
        expression: licence.expression.clone(),
        parts: licence.parts.iter().map(LicensedPart::from_terms).collect(),
        tools: [tool("gs2e", env!("CARGO_PKG_VERSION"), "MIT OR Apache-2.0")]
            .into_iter()
            .chain(trainer)
            .collect(),
        gated: licence.gated,
        redistribution: licence.passing.because().map(str::to_owned),
        withheld: licence.passing == Redistributability::Withheld,
        attribution: attribution_names(licence),
    }
}

/// Everybody who is to be named.
fn attribution_names(licence: &ComposedTerms) -> String {
    let named = licence.parts.iter().map(|part| part.attribution.as_str());
    named.filter(|name| !name.is_empty()).collect::<Vec<_>>().join("; ")
}
