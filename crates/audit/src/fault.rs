//! The faults that an audit finds.

use gs2e_release::manifest::FileOwners;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Kind of a fault. Codes are stable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultCode {
    /// A listed file is not there.
    Missing,
    /// Bytes that no list states; or a sums file that is not in its one form.
    Altered,
    /// A file that no list names, or a link, a special file or an empty folder.
    Unlisted,
    /// A path that would lead out of the tree, or that tools cannot carry.
    UnsafePath,
    /// `SHA256SUMS`, `B3SUMS`, `manifest.json` and the bytes do not agree on a file.
    SumsDisagree,
    /// Files that say the same thing say different things.
    ClaimsDisagree,
    /// Parts of the tree are of different program versions.
    VersionDisagrees,
    /// A scene states no terms.
    LicenceMissing,
    /// A scene states terms that are not a licence expression, or its source is of no known kind.
    LicenceInvalid,
    /// Terms or files that the scene's source does not allow.
    LicenceForbidden,
    /// A licence in use has no text in `LICENSES/`.
    LicenceTextMissing,
    /// A text in `LICENSES/` belongs to no licence in use.
    LicenceUnused,
    /// A scene is there that is on the takedown list.
    Takedown,
    /// A scene is not in the split that the rule of the release gives, or two splits share
    /// something.
    SplitLeak,
    /// The card states other terms than the scenes do.
    CardLicence,
    /// A field that `croissant.json` must have is absent, or has an impossible value.
    CroissantField,
    /// `croissant.json` has a field that its vocabulary does not define.
    CroissantUnknown,
    /// `croissant.json` states other terms than the scenes do.
    CroissantLicence,
    /// A file that `croissant.json` names is absent, or its size or SHA-256 differs.
    CroissantSum,
    /// A set of files in `croissant.json` is empty.
    CroissantFiles,
    /// An id in `croissant.json` names nothing, or names two things.
    CroissantReference,
    /// A column or path that `croissant.json` names does not exist, or holds another type.
    CroissantColumn,
    /// A file that the release format does not have.
    Stray,
    /// A file is not what this program composes from the other files.
    NotComposed,
    /// A step's key, inputs or outputs do not fit each other or the files.
    StepDisagrees,
    /// A scene lacks a file that its own description asks for.
    SceneIncomplete,
    /// A check failed, and no waiver says why that is accepted.
    CheckFailedUnwaived,
    /// A file does not hold what its format prescribes.
    Unreadable,
    /// A scene that is made again from its recipe has other bytes.
    RebuiltDiffers,
    /// The signature is absent, is not by the given key, or does not fit `SHA256SUMS`.
    SignatureInvalid,
}

impl FaultCode {
    /// Returns the name of the code.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Altered => "altered",
            Self::Unlisted => "unlisted",
            Self::UnsafePath => "unsafe-path",
            Self::SumsDisagree => "sums-disagree",
            Self::ClaimsDisagree => "claims-disagree",
            Self::VersionDisagrees => "version-disagrees",
            Self::LicenceMissing => "licence-missing",
            Self::LicenceInvalid => "licence-invalid",
            Self::LicenceForbidden => "licence-forbidden",
            Self::LicenceTextMissing => "licence-text-missing",
            Self::LicenceUnused => "licence-unused",
            Self::Takedown => "takedown",
            Self::SplitLeak => "split-leak",
            Self::CardLicence => "card-licence",
            Self::CroissantField => "croissant-field",
            Self::CroissantUnknown => "croissant-unknown",
            Self::CroissantLicence => "croissant-licence",
            Self::CroissantSum => "croissant-sum",
            Self::CroissantFiles => "croissant-files",
            Self::CroissantReference => "croissant-reference",
            Self::CroissantColumn => "croissant-column",
            Self::Stray => "stray",
            Self::NotComposed => "not-composed",
            Self::StepDisagrees => "step-disagrees",
            Self::SceneIncomplete => "scene-incomplete",
            Self::CheckFailedUnwaived => "check-failed-unwaived",
            Self::Unreadable => "unreadable",
            Self::RebuiltDiffers => "rebuilt-differs",
            Self::SignatureInvalid => "signature-invalid",
        }
    }

    fn help(self) -> &'static str {
        match self {
            Self::Unlisted | Self::Stray => "remove it, or keep it outside the release",
            Self::LicenceMissing | Self::LicenceInvalid | Self::LicenceForbidden => {
                "correct `licence:` or the source in the recipe, and release again"
            }
            Self::RebuiltDiffers => {
                "release it again; if all keys are the same, the program or the machine is not deterministic: report it"
            }
            Self::SignatureInvalid => {
                "ask the publisher for the public key, or for an intact copy; gs2e release --sign KEY signs a release"
            }
            Self::Takedown => {
                "release again with the list next to the recipes, and withdraw published copies"
            }
            Self::CheckFailedUnwaived => "fix the scene, or waive the check with a reason in its recipe",
            _ => {
                "copy the release again from an intact copy, or write it again: gs2e release --to DIR --replace"
            }
        }
    }
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct AuditFault {
    /// The kind of fault.
    pub code: FaultCode,
    /// Path below the release folder, if the fault concerns one file.
    pub file: Option<String>,
    /// Scene id, if the fault concerns one scene.
    pub scene: Option<String>,
    /// The found and the wanted content.
    pub message: String,
}

impl AuditFault {
    pub(super) fn of_file(code: FaultCode, file: &str, message: impl Into<String>) -> Self {
        Self { code, file: Some(file.to_owned()), scene: None, message: message.into() }
    }

    pub(super) fn of_scene(code: FaultCode, scene: &str, message: impl Into<String>) -> Self {
        Self { code, file: None, scene: Some(scene.to_owned()), message: message.into() }
    }

    /// The remedy.
    #[must_use]
    pub fn help(&self) -> &'static str {
        self.code.help()
    }

    pub(super) fn in_scene(self, scene: &str) -> Self {
        Self { scene: Some(scene.to_owned()), ..self }
    }

    /// Returns true if the fault concerns a scene or one of its files.
    pub(super) fn concerns(&self, scene: &str, owners: &FileOwners<'_>) -> bool {
        let is_owner = |file: &String| owners.of(file).is_some_and(|owner| owner.id == scene);
        self.scene.as_deref() == Some(scene) || self.file.as_ref().is_some_and(is_owner)
    }

    /// Returns the fault with the scene that its file belongs to: the longest id that the path
    /// begins with.
    pub(super) fn placed(self, owners: &FileOwners<'_>) -> Self {
        let Some(file) = self.file.as_deref().filter(|_| self.scene.is_none()) else { return self };
        let scene = owners.of(file).map(|scene| scene.id.clone());
        Self { scene, ..self }
    }
}

impl fmt::Display for AuditFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = self.file.as_ref().or(self.scene.as_ref()).map_or("the release", String::as_str);
        write!(f, "{}: {place}: {}; help: {}", self.code.name(), self.message, self.help())
    }
}
