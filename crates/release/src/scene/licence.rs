//! Licence terms of a scene, part by part.

use gs2e_recipe::Recipe;
use gs2e_source::licence::{
    ComposedTerms, HolderTerms, LicenceObligation, Redistributability, UpstreamGrant,
};
use serde::{Deserialize, Serialize};

/// Licence terms of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LicencePart {
    /// SPDX expression.
    pub expression: String,
    /// Terms of parts of the scene.
    pub parts: Vec<LicensedPart>,
    /// The tools that the scene was made with. Their licences are not part of the expression.
    pub tools: Vec<LicensedTool>,
    /// True if receivers must accept the upstream terms first.
    pub gated: bool,
    /// The releaser's reason to redistribute material that the upstream does not let everyone
    /// redistribute.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redistribution: Option<String>,
    /// True if the files that show the scene (events, pictures) are left out, because the upstream
    /// forbids their redistribution.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub withheld: bool,
    /// Names for attribution.
    pub attribution: String,
}

/// Name of the part that the owner of a scene added, in the place of a dataset's name.
pub const OWNER: &str = "owner";

/// Terms of a part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LicensedPart {
    /// Files, as a glob below the scene's folder.
    pub path: String,
    /// The dataset, or `owner` for the part that was added to it.
    pub asset: String,
    /// SPDX expression.
    pub expression: String,
    /// Name for attribution; empty if there is no name.
    pub attribution: String,
    /// Known obligations of receivers.
    pub obligations: Vec<LicenceObligation>,
    /// For a dataset: true if its terms were read in full at their holder's. Absent for the owner's
    /// part, whose terms are those of the recipe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verified: Option<bool>,
    /// For a dataset: addresses of the documents with its terms.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub evidence: Vec<String>,
    /// The grant, if the terms differ from the public terms of the dataset.
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

/// A tool with its licence.
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

/// All names for attribution.
fn attribution_names(licence: &ComposedTerms) -> String {
    let named = licence.parts.iter().map(|part| part.attribution.as_str());
    named.filter(|name| !name.is_empty()).collect::<Vec<_>>().join("; ")
}
