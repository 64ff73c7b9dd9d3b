//! Terms for the redistribution of a scene (docs/design/pipeline.md, "Licences").
//!
//! A scene's expression is the AND of the upstream source's terms and the owner's terms for the
//! added part. It is never an OR, and never has fewer ids than the sources. Tools do not affect it.
//! If the terms of one upstream contradict each other, the stricter terms bind. Nothing is guessed:
//! unstated terms become `LicenseRef-Unstated`. The [`ledger`] contains the terms of upstreams; a
//! recipe departs from it only with evidence.

mod compose;
pub mod expression;
pub mod ledger;
mod text;

pub use compose::{compose_all, compose_terms};

pub use expression::LicenceExpression;
pub use ledger::{LedgerAsset, LicenceObligation};
pub use text::{is_listed, licence_text};

use crate::kind::SourceKind;
use serde::{Deserialize, Serialize};

/// The terms of a scene, or of several together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ComposedTerms {
    /// SPDX expression of all binding terms, in canonical form.
    pub expression: String,
    /// The ids in it, sorted. Their texts are shipped.
    pub ids: Vec<String>,
    /// True if receivers must accept the upstream terms first.
    pub gated: bool,
    /// Permission to redistribute material made from the upstream material.
    pub passing: Redistributability,
    /// The parts of the scene: the upstream's part, if there is one, then the owner's.
    pub parts: Vec<HolderTerms>,
    /// Warnings for the releaser, one sentence each.
    pub warnings: Vec<String>,
}

/// The terms of one holder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HolderTerms {
    /// The dataset; `None` for the owner's own part.
    pub asset: Option<&'static LedgerAsset>,
    /// SPDX expression.
    pub expression: String,
    /// Attribution text.
    pub attribution: String,
    /// Obligations of receivers.
    pub obligations: Vec<LicenceObligation>,
    /// The grant, if the terms differ from those of the ledger.
    pub grant: Option<UpstreamGrant>,
}

/// Evidence for terms that an upstream granted in addition to its public terms.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UpstreamGrant {
    /// The terms, as an SPDX expression.
    pub expression: String,
    /// Grantor and content of the grant.
    pub granted_by: String,
    /// Address of the grant.
    pub url: String,
    /// Date, `YYYY-MM-DD`.
    pub date: String,
}

impl UpstreamGrant {
    /// Returns the name of an empty statement, if there is one.
    #[must_use]
    pub fn lacks(&self) -> Option<&'static str> {
        let stated = [("granted_by", &self.granted_by), ("url", &self.url), ("date", &self.date)];
        stated.into_iter().find(|(_, text)| text.trim().is_empty()).map(|(name, _)| name)
    }
}

/// Statements of a recipe and of the files next to it about a scene's terms.
#[derive(Debug, Clone, Copy)]
pub struct StatedTerms<'a> {
    /// The kind of source.
    pub kind: SourceKind,
    /// Address of the upstream dataset.
    pub url: Option<&'a str>,
    /// The owner's expression for the added part, and the holder of these rights.
    pub owner: Option<(&'a str, &'a str)>,
    /// Terms granted by the upstream instead of its usual terms.
    pub grant: Option<&'a UpstreamGrant>,
    /// The releaser's reason why material of this source may be redistributed although the upstream
    /// forbids it.
    pub redistribution: Option<&'a str>,
}

/// Permission to redistribute material made from upstream material.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Redistributability {
    /// The upstream does not restrict redistribution.
    Free,
    /// The upstream forbids it, and the releaser states a reason why this release may do it.
    Allowed(String),
    /// The upstream forbids it. The release contains recipe, poses and texts, but nothing that
    /// shows the scene.
    Withheld,
}

impl Redistributability {
    /// Returns the releaser's reason, if one is needed and given.
    #[must_use]
    pub fn because(&self) -> Option<&str> {
        match self {
            Self::Allowed(because) => Some(because),
            Self::Free | Self::Withheld => None,
        }
    }
}

/// The reason why a text is not a licence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is not an SPDX licence expression: {because}")]
pub struct LicenceError {
    /// The text.
    pub text: String,
    /// The found and the wanted content.
    pub because: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compose_terms(kind: &str, owner: Option<&str>, redistribution: Option<&str>) -> ComposedTerms {
        let owner = owner.map(|expression| (expression, "a test"));
        super::compose_terms(&StatedTerms { owner, redistribution, ..silent(kind) })
    }

    /// No statements about a source of this kind.
    fn silent(kind: &str) -> StatedTerms<'static> {
        let kind = SourceKind::by_name(kind).unwrap();
        StatedTerms { kind, url: None, owner: None, grant: None, redistribution: None }
    }

    #[test]
    fn an_address_binds_whatever_the_capture_is_read_as() {
        let url = Some("https://github.com/DL3DV-10K/Dataset");
        let composed =
            super::compose_terms(&StatedTerms { url, owner: Some(("MIT", "")), ..silent("colmap") });
        assert_eq!(composed.expression, "CC-BY-NC-4.0 AND LicenseRef-DL3DV-10K-ToU AND MIT");
        assert!(composed.gated && composed.passing == Redistributability::Withheld);
        assert!(composed.warnings[0].starts_with("colmap (DL3DV-10K) forbids"), "{:?}", composed.warnings);
    }

    #[test]
    fn a_grant_takes_the_place_of_the_upstreams_ids_and_of_nothing_else() {
        let grant = UpstreamGrant {
            expression: "CC-BY-4.0".into(),
            granted_by: "the project, for these scenes".into(),
            url: "https://example.org/letter".into(),
            date: "2025-06-01".into(),
        };
        let stated = StatedTerms { owner: Some(("MIT", "")), grant: Some(&grant), ..silent("dl3dv") };
        let composed = super::compose_terms(&stated);
        assert_eq!(composed.expression, "CC-BY-4.0 AND MIT");
        assert!(composed.gated && composed.passing == Redistributability::Withheld);
        assert_eq!(grant.lacks(), None);
        assert_eq!(UpstreamGrant { url: " ".into(), ..grant }.lacks(), Some("url"));
    }

    #[test]
    fn parts_name_who_is_to_be_named() {
        let parts = compose_terms("mvimgnet", Some("CC-BY-4.0"), None).parts;
        let found: Vec<(&str, &str)> =
            parts.iter().map(|p| (p.attribution.as_str(), p.expression.as_str())).collect();
        let upstream = "CC-BY-NC-4.0 AND LicenseRef-MVImgNet-ToU";
        assert_eq!(found, [("MVImgNet (Yu et al., CVPR 2023)", upstream), ("a test", "CC-BY-4.0")]);
    }

    #[test]
    fn upstream_terms_are_never_lost() {
        let t = |kind, owner, wanted: &str| assert_eq!(compose_terms(kind, owner, None).expression, wanted);
        t("procedural", None, "CC0-1.0");
        t("procedural", Some("MIT"), "MIT");
        t("colmap", None, "LicenseRef-Unstated");
        t("nerfstudio", Some("CC-BY-4.0"), "CC-BY-4.0");
        t("none", None, "LicenseRef-Unstated");
        t("dl3dv", None, "CC-BY-NC-4.0 AND LicenseRef-DL3DV-10K-ToU AND LicenseRef-Unstated");
        t("mvimgnet", Some("CC0-1.0"), "CC-BY-NC-4.0 AND CC0-1.0 AND LicenseRef-MVImgNet-ToU");
        t(
            "mvimgnet",
            Some("MIT OR Apache-2.0"),
            "(Apache-2.0 OR MIT) AND CC-BY-NC-4.0 AND LicenseRef-MVImgNet-ToU",
        );
    }

    #[test]
    fn silence_is_told_and_restricted_sources_are_gated() {
        assert_eq!(compose_terms("procedural", None, None).warnings, [""; 0]);
        assert_eq!(compose_terms("colmap", None, None).warnings.len(), 1);
        assert!(compose_terms("dl3dv", None, None).gated);
        assert!(!compose_terms("colmap", None, None).gated);
    }

    #[test]
    fn restricted_material_is_withheld_unless_the_releaser_says_why_not() {
        let t = |kind, because, wanted| {
            assert_eq!(compose_terms(kind, Some("MIT"), because).passing, wanted, "{kind}")
        };
        t("mvimgnet", None, Redistributability::Withheld);
        t("dl3dv", None, Redistributability::Withheld);
        t("dl3dv", Some("a letter"), Redistributability::Allowed("a letter".into()));
        t("colmap", None, Redistributability::Free);
        t("colmap", Some("a letter"), Redistributability::Free);
        assert!(compose_terms("dl3dv", Some("MIT"), Some("a letter")).gated);
    }

    #[test]
    fn a_dataset_is_under_the_terms_of_all_its_scenes() {
        let scenes = [
            compose_terms("colmap", Some("MIT"), None),
            compose_terms("dl3dv", Some("CC-BY-4.0"), None),
            compose_terms("procedural", None, None),
            compose_terms("colmap", Some("MIT"), None),
        ];
        let whole = compose_all(scenes.iter());
        assert_eq!(
            whole.expression,
            "CC-BY-4.0 AND CC-BY-NC-4.0 AND CC0-1.0 AND LicenseRef-DL3DV-10K-ToU AND MIT"
        );
        assert_eq!(whole.ids, ["CC-BY-4.0", "CC-BY-NC-4.0", "CC0-1.0", "LicenseRef-DL3DV-10K-ToU", "MIT"]);
        assert!(whole.gated);
    }
}
