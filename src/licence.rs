//! Under which terms a scene may be passed on (pipeline.md section 9).
//!
//! A scene's expression is the AND of what its upstream source demands and what its owner says of the part that was
//! added: never an OR, and never fewer ids than the sources have. Tools do not enter it. Where terms of one upstream
//! contradict each other the stricter binds. Nothing here guesses: whose terms are not stated, has
//! `LicenseRef-Unstated`.

pub mod expression;
mod text;

pub use expression::Expression;
pub use text::{is_listed, text};

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

    /// The ids that every scene of this source carries. `MVImgNet`: its README and LICENSE file. DL3DV-10K: its
    /// License.md. Both state terms of use beside CC BY-NC 4.0.
    #[must_use]
    pub fn upstream_ids(self) -> &'static [&'static str] {
        match self {
            Self::Procedural | Self::Colmap | Self::Nerfstudio | Self::Model | Self::None => &[],
            Self::Mvimgnet => &["LicenseRef-MVImgNet-ToU", "CC-BY-NC-4.0"],
            Self::Dl3dv => &["LicenseRef-DL3DV-10K-ToU", "CC-BY-NC-4.0"],
        }
    }

    /// Whether upstream forbids passing the material on, unless the releaser has the right to and says so.
    #[must_use]
    pub fn restricted(self) -> bool {
        matches!(self, Self::Mvimgnet | Self::Dl3dv)
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
    /// What the releaser should know, one sentence each.
    pub warnings: Vec<String>,
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
const METADATA: [&str; 7] = [
    "scene.json",
    "poses.txt",
    "timestamps_us.txt",
    "transforms.json",
    "speed.json",
    "trajectory.svg",
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

/// The terms of a scene of the source kind of this name, with the expression that its owner states. Without one, a
/// procedural scene is CC0-1.0, and any other says that nothing is stated. `redistribution` is the releaser's reason why
/// material of this source may be passed on, where upstream forbids it.
///
/// # Panics
/// If the kind is none of [`SourceKind`], or the owner's text no expression: recipes are read with both valid.
#[must_use]
pub fn compose(kind: &str, owner: Option<&str>, redistribution: Option<&str>) -> Composed {
    let kind = SourceKind::by_name(kind).expect("recipes are read with known sources");
    let mut warnings = Vec::new();
    let stated = match owner {
        Some(expression) => expression,
        None if kind == SourceKind::Procedural => "CC0-1.0",
        None => {
            warnings.push("no licence is stated, so the release says that all rights are reserved".into());
            text::UNSTATED
        }
    };
    let ids = kind.upstream_ids().iter().copied().chain([stated]);
    let parts = ids.map(|id| Expression::parse(id).expect("recipes are read with valid expressions"));
    let expression = Expression::all(parts);
    let ids = expression.ids().into_iter().collect();
    let passing = match redistribution {
        _ if !kind.restricted() => Passing::Free,
        Some(because) => Passing::Allowed(because.to_owned()),
        None => {
            let name = kind.name();
            warnings.push(format!(
                "{name} forbids passing on what is made from it: such scenes are released as recipe, poses and reports, \
                 unless sources.yaml says {name}: {{ redistribute: allowed, because: … }}"
            ));
            Passing::Withheld
        }
    };
    Composed { expression: expression.to_string(), ids, gated: kind.restricted(), passing, warnings }
}

/// The terms of several scenes together: of all of them at once, gated where one is. Warnings stay with the scenes.
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
    Composed { expression: expression.to_string(), ids, gated, passing, warnings: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

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
