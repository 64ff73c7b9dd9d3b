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
    /// What the releaser should know, one sentence each.
    pub warnings: Vec<String>,
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
/// procedural scene is CC0-1.0, and any other says that nothing is stated.
///
/// # Panics
/// If the kind is none of [`SourceKind`], or the owner's text no expression: recipes are read with both valid.
#[must_use]
pub fn compose(kind: &str, owner: Option<&str>) -> Composed {
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
    Composed { expression: expression.to_string(), ids, gated: kind.restricted(), warnings }
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
    Composed { expression: expression.to_string(), ids, gated, warnings: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upstream_terms_are_never_lost() {
        let t = |kind, owner, wanted: &str| assert_eq!(compose(kind, owner).expression, wanted);
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
        assert_eq!(compose("procedural", None).warnings, [""; 0]);
        assert_eq!(compose("colmap", None).warnings.len(), 1);
        assert!(compose("dl3dv", None).gated);
        assert!(!compose("colmap", None).gated);
    }

    #[test]
    fn a_dataset_is_under_the_terms_of_all_its_scenes() {
        let scenes = [
            compose("colmap", Some("MIT")),
            compose("dl3dv", Some("CC-BY-4.0")),
            compose("procedural", None),
            compose("colmap", Some("MIT")),
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
