//! Under which terms a scene may be passed on (docs/design/pipeline.md, "Licences").
//!
//! A scene's expression is the AND of what its upstream source demands and what its owner says of the part
//! that was added: never an OR, and never fewer ids than the sources have. Tools do not enter it. Where
//! terms of one upstream contradict each other the stricter binds. Nothing here guesses: whose terms are
//! not stated, has `LicenseRef-Unstated`. What upstreams demand is in the [`ledger`]; a recipe departs from
//! it only with evidence.

pub mod expression;
pub mod ledger;
mod text;

pub use expression::Expression;
pub use ledger::{Asset, Obligation};
pub use text::{is_listed, text};

use serde::{Deserialize, Serialize};

/// The kinds of sources that poses and photos come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SourceKind {
    /// The embedded scene, which is this program's own.
    Procedural,
    /// A COLMAP model of the owner.
    Colmap,
    /// A `transforms.json` of the owner.
    Nerfstudio,
    /// A 3DGS model folder of the owner.
    Model,
    /// No source: a scene file of the owner, and poses from the recipe.
    None,
    /// `MVImgNet`.
    Mvimgnet,
    /// `DL3DV-10K`.
    Dl3dv,
}

impl SourceKind {
    /// Its name in recipes and in `scene.json`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Procedural => "procedural",
            Self::Colmap => "colmap",
            Self::Nerfstudio => "nerfstudio",
            Self::Model => "model",
            Self::None => "none",
            Self::Mvimgnet => "mvimgnet",
            Self::Dl3dv => "dl3dv",
        }
    }

    /// The kind of this name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        let own = [Self::Procedural, Self::Colmap, Self::Nerfstudio, Self::Model, Self::None];
        own.into_iter().chain([Self::Mvimgnet, Self::Dl3dv]).find(|kind| kind.name() == name)
    }
}

/// The terms of a scene, or of several together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Composed {
    /// SPDX expression of all that binds, in canonical form.
    pub expression: String,
    /// The ids in it, sorted: those whose texts are shipped.
    pub ids: Vec<String>,
    /// Whether receivers must accept the upstream terms first.
    pub gated: bool,
    /// Who may have what was made from the upstream material.
    pub passing: Passing,
    /// What it is made of: the upstream's part, where there is one, then the owner's.
    pub parts: Vec<Part>,
    /// What the releaser should know, one sentence each.
    pub warnings: Vec<String>,
}

/// What one holder's terms are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// The dataset; `None` for what the owner added.
    pub asset: Option<&'static Asset>,
    /// SPDX expression.
    pub expression: String,
    /// Who is to be named.
    pub attribution: String,
    /// What is asked of whoever receives it.
    pub obligations: Vec<Obligation>,
    /// Why the terms are other than those of the ledger, where they are.
    pub grant: Option<Grant>,
}

/// The evidence for terms that an upstream granted beside those that it states for everybody.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grant {
    /// The terms: SPDX expression.
    pub expression: String,
    /// Who granted them, and what.
    pub granted_by: String,
    /// Where that can be read.
    pub url: String,
    /// When, `YYYY-MM-DD`.
    pub date: String,
}

impl Grant {
    /// Which of its statements is empty.
    #[must_use]
    pub fn lacks(&self) -> Option<&'static str> {
        let stated = [("granted_by", &self.granted_by), ("url", &self.url), ("date", &self.date)];
        stated.into_iter().find(|(_, text)| text.trim().is_empty()).map(|(name, _)| name)
    }
}

/// What a recipe and what lies beside it say of a scene's terms.
#[derive(Debug, Clone, Copy, Default)]
pub struct Stated<'a> {
    /// Name of the kind of source.
    pub kind: &'a str,
    /// Where the upstream dataset is.
    pub url: Option<&'a str>,
    /// The expression of the owner of what was added, and the holder of these rights.
    pub owner: Option<(&'a str, &'a str)>,
    /// What the upstream granted instead of its usual terms.
    pub grant: Option<&'a Grant>,
    /// The releaser's reason why material of this source may be passed on, where upstream forbids it.
    pub redistribution: Option<&'a str>,
}

/// Whether what was made from upstream material is passed on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Passing {
    /// Nothing upstream speaks against it.
    Free,
    /// Upstream forbids it, and the releaser says why this release may all the same.
    Allowed(String),
    /// Upstream forbids it: recipe, poses and words are passed on, and nothing that shows the scene.
    Withheld,
}

impl Passing {
    /// The releaser's reason, where one is needed and given.
    #[must_use]
    pub fn because(&self) -> Option<&str> {
        match self {
            Self::Allowed(because) => Some(because),
            Self::Free | Self::Withheld => None,
        }
    }
}

/// Files of a scene that may be passed on whatever its source: words and numbers, no likeness.
const METADATA: [&str; 8] = [
    "scene.json",
    "poses.txt",
    "timestamps_us.txt",
    "transforms.json",
    "speed.json",
    "trajectory.svg",
    "trajectory.png",
    "checks.json",
];

/// Whether a file of a scene's folder shows nothing of the scene.
#[must_use]
pub fn is_metadata(path: &str) -> bool {
    METADATA.contains(&path.rsplit('/').next().unwrap_or(path))
}

/// Why a text is no licence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is no SPDX licence expression: {because}")]
pub struct LicenceError {
    /// The text.
    pub text: String,
    /// What was found and what was wanted.
    pub because: String,
}

/// The terms of a scene. Without an expression of its owner, a procedural scene is CC0-1.0, and any other
/// says that nothing is stated. A grant takes the place of the ids that the ledger has for the upstream;
/// that the material may be passed on is another matter, and takes the releaser's reason as ever.
///
/// # Panics
/// If the kind is none of [`SourceKind`], or a text no expression: recipes are read with all of them valid.
#[must_use]
pub fn compose(stated: &Stated<'_>) -> Composed {
    let kind = SourceKind::by_name(stated.kind).expect("recipes are read with known sources");
    let upstream = ledger::dataset(kind, stated.url);
    let mut warnings = Vec::new();
    let parts: Vec<Part> = upstream
        .map(|asset| of_upstream(asset, stated.grant))
        .into_iter()
        .chain([of_owner(kind, stated)])
        .collect();
    if parts.iter().any(|part| part.asset.is_none() && part.expression == text::UNSTATED) {
        warnings.push("no licence is stated, so the release says that all rights are reserved".into());
    }
    let terms = parts.iter().map(|part| Expression::parse(&part.expression));
    let expression =
        Expression::all(terms.map(|term| term.expect("recipes are read with valid expressions")));
    let ids = expression.ids().into_iter().collect();
    let restricted = upstream.filter(|asset| asset.restricted());
    let passing = match (restricted, stated.redistribution) {
        (None, _) => Passing::Free,
        (Some(_), Some(because)) => Passing::Allowed(because.to_owned()),
        (Some(asset), None) => {
            let (kind, name) = (kind.name(), asset.name);
            let who =
                if name.eq_ignore_ascii_case(kind) { kind.to_owned() } else { format!("{kind} ({name})") };
            warnings.push(format!(
                "{who} forbids passing on what is made from it: such scenes are released as recipe, poses and reports, \
                 unless sources.yaml says {kind}: {{ redistribute: allowed, because: … }}"
            ));
            Passing::Withheld
        }
    };
    let expression = expression.to_string();
    Composed { expression, ids, gated: restricted.is_some(), passing, parts, warnings }
}

fn of_upstream(asset: &'static Asset, grant: Option<&Grant>) -> Part {
    let expression = grant.map_or_else(|| asset.expression(), |grant| grant.expression.clone());
    Part {
        asset: Some(asset),
        expression,
        attribution: asset.attribution.to_owned(),
        obligations: asset.obligations.to_vec(),
        grant: grant.cloned(),
    }
}

fn of_owner(kind: SourceKind, stated: &Stated<'_>) -> Part {
    let (expression, holder) = match stated.owner {
        Some(owner) => owner,
        None if kind == SourceKind::Procedural => ("CC0-1.0", ""),
        None => (text::UNSTATED, ""),
    };
    let parsed = Expression::parse(expression).expect("recipes are read with valid expressions");
    let ids = parsed.ids();
    let demanded: Vec<&str> = ids.iter().map(String::as_str).filter(|id| parsed.demands(id)).collect();
    Part {
        asset: None,
        expression: parsed.to_string(),
        attribution: holder.to_owned(),
        obligations: Obligation::of_ids(&demanded),
        grant: None,
    }
}

/// The terms of several scenes together: of all of them at once, gated where one is. Warnings stay with the
/// scenes.
///
/// # Panics
/// If there is no scene.
#[must_use]
pub fn compose_all<'a>(scenes: impl Iterator<Item = &'a Composed>) -> Composed {
    let (mut parts, mut gated) = (Vec::new(), false);
    for scene in scenes {
        parts.push(Expression::parse(&scene.expression).expect("a composed expression is one"));
        gated |= scene.gated;
    }
    let expression = Expression::all(parts);
    let ids = expression.ids().into_iter().collect();
    // It is each scene's own.
    let passing = Passing::Free;
    let (parts, warnings) = (Vec::new(), Vec::new());
    Composed { expression: expression.to_string(), ids, gated, passing, parts, warnings }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compose(kind: &str, owner: Option<&str>, redistribution: Option<&str>) -> Composed {
        let owner = owner.map(|expression| (expression, "a test"));
        super::compose(&Stated { kind, owner, redistribution, ..Stated::default() })
    }

    #[test]
    fn an_address_binds_whatever_the_capture_is_read_as() {
        let url = Some("https://github.com/DL3DV-10K/Dataset");
        let composed =
            super::compose(&Stated { kind: "colmap", url, owner: Some(("MIT", "")), ..Stated::default() });
        assert_eq!(composed.expression, "CC-BY-NC-4.0 AND LicenseRef-DL3DV-10K-ToU AND MIT");
        assert!(composed.gated && composed.passing == Passing::Withheld);
        assert!(composed.warnings[0].starts_with("colmap (DL3DV-10K) forbids"), "{:?}", composed.warnings);
    }

    #[test]
    fn a_grant_takes_the_place_of_the_upstreams_ids_and_of_nothing_else() {
        let grant = Grant {
            expression: "CC-BY-4.0".into(),
            granted_by: "the project, for these scenes".into(),
            url: "https://example.org/letter".into(),
            date: "2025-06-01".into(),
        };
        let stated =
            Stated { kind: "dl3dv", owner: Some(("MIT", "")), grant: Some(&grant), ..Stated::default() };
        let composed = super::compose(&stated);
        assert_eq!(composed.expression, "CC-BY-4.0 AND MIT");
        assert!(composed.gated && composed.passing == Passing::Withheld);
        assert_eq!(grant.lacks(), None);
        assert_eq!(Grant { url: " ".into(), ..grant }.lacks(), Some("url"));
    }

    #[test]
    fn parts_name_who_is_to_be_named() {
        let parts = compose("mvimgnet", Some("CC-BY-4.0"), None).parts;
        let told: Vec<(&str, &str)> =
            parts.iter().map(|p| (p.attribution.as_str(), p.expression.as_str())).collect();
        let upstream = "CC-BY-NC-4.0 AND LicenseRef-MVImgNet-ToU";
        assert_eq!(told, [("MVImgNet (Yu et al., CVPR 2023)", upstream), ("a test", "CC-BY-4.0")]);
    }

    #[test]
    fn upstream_terms_are_never_lost() {
        let t = |kind, owner, wanted: &str| assert_eq!(compose(kind, owner, None).expression, wanted);
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
        assert_eq!(compose("procedural", None, None).warnings, [""; 0]);
        assert_eq!(compose("colmap", None, None).warnings.len(), 1);
        assert!(compose("dl3dv", None, None).gated);
        assert!(!compose("colmap", None, None).gated);
    }

    #[test]
    fn restricted_material_is_withheld_unless_the_releaser_says_why_not() {
        let t =
            |kind, because, wanted| assert_eq!(compose(kind, Some("MIT"), because).passing, wanted, "{kind}");
        t("mvimgnet", None, Passing::Withheld);
        t("dl3dv", None, Passing::Withheld);
        t("dl3dv", Some("a letter"), Passing::Allowed("a letter".into()));
        t("colmap", None, Passing::Free);
        t("colmap", Some("a letter"), Passing::Free);
        assert!(compose("dl3dv", Some("MIT"), Some("a letter")).gated);
        assert!(is_metadata("a/b/base/poses.txt") && is_metadata("scene.json"));
        assert!(!is_metadata("base/events.h5") && !is_metadata("base/sharp/000000.png"));
    }

    #[test]
    fn a_dataset_is_under_the_terms_of_all_its_scenes() {
        let scenes = [
            compose("colmap", Some("MIT"), None),
            compose("dl3dv", Some("CC-BY-4.0"), None),
            compose("procedural", None, None),
            compose("colmap", Some("MIT"), None),
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
