//! Known terms of each asset that scenes are made from or with. Composition, audit, card and
//! datasheet read this one table (docs/design/pipeline.md, "Licences").
//!
//! An entry lists the evidence with its address, the resulting obligations, and if the entry covers
//! all terms. Unverified entries are marked as unverified wherever they are used. No entry relies
//! on a paper that only repeats an upstream.

use crate::kind::{CaptureKind, SourceKind};
use serde::{Deserialize, Serialize};

/// Obligations of users and redistributors of the material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LicenceObligation {
    /// Its makers must be named.
    Attribution,
    /// No commercial use.
    NonCommercial,
    /// Derived material has the same terms.
    ShareAlike,
    /// It must not be redistributed to anyone who has not accepted the terms.
    NoRedistribution,
    /// Receivers must accept the terms first.
    Gating,
    /// Data on persons are deleted on request.
    DeletionOnRequest,
}

impl LicenceObligation {
    /// Returns the obligation in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Attribution => "attribution",
            Self::NonCommercial => "no commercial use",
            Self::ShareAlike => "share alike",
            Self::NoRedistribution => "no redistribution",
            Self::Gating => "recipients accept the terms first",
            Self::DeletionOnRequest => "deletion on request",
        }
    }

    /// Returns the obligations that follow from Creative Commons ids, and attribution for
    /// permissive licences that require their notice to be kept. Other ids add no obligations;
    /// their texts bind.
    #[must_use]
    pub(crate) fn of_ids(ids: &[&str]) -> Vec<Self> {
        let has = |part: &str| ids.iter().any(|id| id.starts_with("CC-BY") && id.contains(part));
        let kept = ["MIT", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause"];
        let stated = [
            (Self::Attribution, has("CC-BY") || ids.iter().any(|id| kept.contains(id))),
            (Self::NonCommercial, has("-NC")),
            (Self::ShareAlike, has("-SA")),
        ];
        stated.into_iter().filter(|(_, is)| *is).map(|(obligation, _)| obligation).collect()
    }
}

/// Role of an asset for a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AssetRole {
    /// A dataset. Its terms bind derived material. It is identified by the kind of source whose
    /// dataset has its name, if there is one.
    Source,
    /// A program with these names. Its licence is reported but binds no scene.
    Tool(&'static [&'static str]),
}

/// Evidence from a public document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TermsEvidence {
    /// Address of the document.
    pub url: &'static str,
    /// Content of the document.
    pub says: &'static str,
}

/// An asset with its terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LedgerAsset {
    /// Its name.
    pub name: &'static str,
    /// Role for a scene.
    pub role: AssetRole,
    /// Parts of addresses, in lower case, that identify it in a recipe's `upstream_url`.
    addresses: &'static [&'static str],
    /// SPDX and `LicenseRef-` ids. All of them bind.
    pub ids: &'static [&'static str],
    /// Attribution and citation.
    pub attribution: &'static str,
    /// The evidence.
    pub evidence: &'static [TermsEvidence],
    /// The resulting obligations.
    pub obligations: &'static [LicenceObligation],
    /// True if the holder's terms were read in full.
    pub verified: bool,
    /// Differing terms in the paper on GS2E (arXiv 2505.15287, appendix F).
    pub paper: Option<&'static str>,
}

use LicenceObligation::{Attribution, DeletionOnRequest, Gating, NoRedistribution, NonCommercial};

/// All known assets.
pub const LEDGER: [LedgerAsset; 8] = [
    LedgerAsset {
        name: "MVImgNet",
        role: AssetRole::Source,
        addresses: &["gap-lab-cuhk-sz/mvimgnet", "gaplab.cuhk.edu.cn/projects/mvimgnet"],
        ids: &["LicenseRef-MVImgNet-ToU", "CC-BY-NC-4.0"],
        attribution: "MVImgNet (Yu et al., CVPR 2023)",
        evidence: &[TermsEvidence {
            url: "https://github.com/GAP-LAB-CUHK-SZ/MVImgNet#license",
            says: "the data is released under the MVImgNet Terms of Use, the code under CC BY-NC 4.0; the text of the \
                   terms is part of the access request form, and was not seen",
        }],
        obligations: &[Attribution, NonCommercial, NoRedistribution, Gating],
        verified: false,
        paper: Some("CC BY 4.0"),
    },
    LedgerAsset {
        name: "DL3DV-10K",
        role: AssetRole::Source,
        addresses: &["dl3dv"],
        ids: &["LicenseRef-DL3DV-10K-ToU", "CC-BY-NC-4.0"],
        attribution: "DL3DV-10K (Ling et al., CVPR 2024)",
        evidence: &[TermsEvidence {
            url: "https://github.com/DL3DV-10K/Dataset/blob/main/License.md",
            says: "terms of use and CC BY-NC 4.0: non-commercial research and education; others get access after they \
                   sign, other sharing is prohibited; the terms mention 3D models made from the data; data on persons \
                   are deleted on request; access may be ended",
        }],
        obligations: &[Attribution, NonCommercial, NoRedistribution, Gating, DeletionOnRequest],
        verified: true,
        paper: Some("CC BY 4.0"),
    },
    LedgerAsset {
        name: "Tanks and Temples",
        role: AssetRole::Source,
        addresses: &["tanksandtemples.org"],
        ids: &["LicenseRef-TanksAndTemples"],
        attribution: "Tanks and Temples (Knapitsch et al., SIGGRAPH 2017)",
        evidence: &[TermsEvidence {
            url: "https://www.tanksandtemples.org/",
            says: "its statements on the terms disagree",
        }],
        obligations: &[Attribution, NonCommercial, NoRedistribution],
        verified: false,
        paper: None,
    },
    LedgerAsset {
        name: "Mip-NeRF 360",
        role: AssetRole::Source,
        addresses: &["jonbarron.info/mipnerf360", "storage.googleapis.com/gresearch/refraw360"],
        ids: &[super::text::UNSTATED],
        attribution: "Mip-NeRF 360 (Barron et al., CVPR 2022)",
        evidence: &[TermsEvidence { url: "https://jonbarron.info/mipnerf360/", says: "no terms were found" }],
        obligations: &[NoRedistribution],
        verified: false,
        paper: None,
    },
    LedgerAsset {
        name: "3D Gaussian Splatting",
        role: AssetRole::Tool(&["gaussian-splatting", "3dgs"]),
        addresses: &["graphdeco-inria/gaussian-splatting"],
        ids: &["LicenseRef-Inria-MPII-3DGS"],
        attribution: "3D Gaussian Splatting (Kerbl et al., SIGGRAPH 2023)",
        evidence: &[TermsEvidence {
            url: "https://github.com/graphdeco-inria/gaussian-splatting/blob/main/LICENSE.md",
            says: "research and evaluation, no commercial use, no right to sublicense; it covers the software \
                   and its derivatives, and does not state whether it covers scenes and pictures made with it",
        }],
        obligations: &[Attribution, NonCommercial],
        verified: true,
        paper: Some("CC BY MIT"),
    },
    LedgerAsset {
        name: "DVS-Voltmeter",
        role: AssetRole::Tool(&["dvs-voltmeter"]),
        addresses: &["lynn0306/dvs-voltmeter"],
        ids: &["MIT"],
        attribution: "DVS-Voltmeter (Lin et al., ECCV 2022)",
        evidence: &[TermsEvidence {
            url: "https://github.com/Lynn0306/DVS-Voltmeter/blob/main/LICENSE.md",
            says: "MIT; gs2e implements the law in its own code",
        }],
        obligations: &[Attribution],
        verified: true,
        paper: None,
    },
    LedgerAsset {
        name: "GS-Blur",
        role: AssetRole::Tool(&["gs-blur"]),
        addresses: &["dongwoohhh/gs-blur"],
        ids: &["LicenseRef-Inria-MPII-3DGS"],
        attribution: "GS-Blur (Lee et al., NeurIPS 2024)",
        evidence: &[TermsEvidence {
            url: "https://github.com/dongwoohhh/GS-Blur",
            says: "it has the licence file of 3D Gaussian Splatting",
        }],
        obligations: &[Attribution, NonCommercial],
        verified: false,
        paper: None,
    },
    LedgerAsset {
        name: "GS2E",
        role: AssetRole::Tool(&[]),
        addresses: &["pku-yuangroup/gs2e"],
        ids: &["MIT", "Apache-2.0"],
        attribution: "GS2E (arXiv 2505.15287)",
        evidence: &[TermsEvidence {
            url: "https://github.com/PKU-YuanGroup/GS2E",
            says: "a badge says MIT, the licence file Apache 2.0; it has no code, and gs2e uses nothing from it",
        }],
        obligations: &[Attribution],
        verified: false,
        paper: Some("CC BY MIT"),
    },
];

/// Returns the dataset of a source, by kind or by address.
#[must_use]
pub fn find_dataset(kind: SourceKind, url: Option<&str>) -> Option<&'static LedgerAsset> {
    let url = url.unwrap_or_default().to_lowercase();
    let by_kind = |asset: &&LedgerAsset| kind.dataset().is_some_and(|dataset| dataset.name == asset.name);
    let by_address = |asset: &&LedgerAsset| asset.addresses.iter().any(|address| url.contains(address));
    // The stated kind decides first: a mirror of one dataset may have an address that mentions
    // another.
    let sources = || LEDGER.iter().filter(|asset| asset.is_dataset());
    sources().find(by_kind).or_else(|| sources().find(by_address))
}

/// Returns the kind of source that a capture comes from: the kind of the dataset at its address, or
/// otherwise the kind of its reader.
#[must_use]
pub fn find_origin(kind: SourceKind, url: Option<&str>) -> SourceKind {
    let Some(asset) = find_dataset(kind, url) else { return kind };
    let is_of = |kind: &CaptureKind| kind.dataset().is_some_and(|dataset| dataset.name == asset.name);
    CaptureKind::ALL.into_iter().find(is_of).map_or(kind, SourceKind::Captured)
}

/// Returns the program with this name.
#[must_use]
pub fn find_tool(name: &str) -> Option<&'static LedgerAsset> {
    let name = name.to_lowercase();
    LEDGER.iter().find(|asset| matches!(asset.role, AssetRole::Tool(names) if names.contains(&name.as_str())))
}

/// Returns the asset with this name.
#[must_use]
pub fn by_name(name: &str) -> Option<&'static LedgerAsset> {
    LEDGER.iter().find(|asset| asset.name == name)
}

impl LedgerAsset {
    /// Returns true if the asset must not be redistributed without a statement of the releaser's
    /// right.
    #[must_use]
    pub fn restricted(&self) -> bool {
        self.obligations.contains(&NoRedistribution)
    }

    /// Returns true if the asset is a dataset, whose terms bind.
    #[must_use]
    pub fn is_dataset(&self) -> bool {
        self.role == AssetRole::Source
    }

    /// Returns its ids as one expression.
    #[must_use]
    pub fn expression(&self) -> String {
        let mut ids = self.ids.to_vec();
        ids.sort_unstable();
        ids.join(" AND ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::licence::LicenceExpression;
    use std::collections::BTreeSet;

    #[test]
    fn every_entry_says_what_was_read_and_where() {
        let names: BTreeSet<&str> = LEDGER.iter().map(|asset| asset.name).collect();
        assert_eq!(names.len(), LEDGER.len());
        for asset in &LEDGER {
            let expression = LicenceExpression::parse(&asset.expression()).unwrap();
            assert_eq!(expression.to_string(), asset.expression(), "{}", asset.name);
            assert!(!asset.evidence.is_empty() && !asset.attribution.is_empty(), "{}", asset.name);
            for evidence in asset.evidence {
                assert!(evidence.url.starts_with("https://") && !evidence.says.is_empty(), "{}", asset.name);
            }
            assert!(asset.addresses.iter().all(|a| *a == a.to_lowercase()), "{}", asset.name);
        }
    }

    #[test]
    fn no_claim_of_the_paper_is_what_upstream_says() {
        let claimed = LEDGER.iter().filter_map(|asset| Some((asset, asset.paper?)));
        for (asset, paper) in claimed {
            let said = LicenceExpression::parse(&paper.replace(' ', "-")).map(|e| e.to_string());
            assert_ne!(said, Ok(asset.expression()), "{}", asset.name);
        }
    }

    #[test]
    fn a_dataset_is_known_by_kind_and_by_address() {
        let t = |kind: CaptureKind, url, wanted: Option<&str>| {
            let kind = SourceKind::Captured(kind);
            assert_eq!(find_dataset(kind, url).map(|asset| asset.name), wanted, "{kind:?} {url:?}");
        };
        t(CaptureKind::Dl3dv, None, Some("DL3DV-10K"));
        t(CaptureKind::Colmap, None, None);
        t(
            CaptureKind::Colmap,
            Some("https://huggingface.co/datasets/DL3DV/DL3DV-ALL-480P"),
            Some("DL3DV-10K"),
        );
        t(CaptureKind::Mvimgnet, Some("https://mirror.example/dl3dv"), Some("MVImgNet"));
        t(CaptureKind::Colmap, Some("https://github.com/GAP-LAB-CUHK-SZ/MVImgNet"), Some("MVImgNet"));
        t(CaptureKind::Nerfstudio, Some("https://jonbarron.info/mipnerf360/"), Some("Mip-NeRF 360"));
        t(CaptureKind::Colmap, Some("https://example.org/lab"), None);
        let origin = |url| find_origin(SourceKind::Captured(CaptureKind::Colmap), Some(url)).name();
        assert_eq!(origin("https://github.com/GAP-LAB-CUHK-SZ/MVImgNet"), "mvimgnet");
        assert_eq!(origin("https://jonbarron.info/mipnerf360/"), "colmap");
        // A program is not a dataset.
        t(CaptureKind::Colmap, Some("https://github.com/graphdeco-inria/gaussian-splatting"), None);
        assert_eq!(find_tool("3DGS").map(|asset| asset.name), Some("3D Gaussian Splatting"));
        assert!(find_tool("opensplat").is_none());
    }

    #[test]
    fn ids_name_some_obligations() {
        let t = |ids: &[&str], wanted: &[LicenceObligation]| {
            assert_eq!(LicenceObligation::of_ids(ids), wanted, "{ids:?}")
        };
        t(&["CC0-1.0"], &[]);
        t(&["CC-BY-4.0"], &[Attribution]);
        t(&["CC-BY-NC-SA-4.0"], &[Attribution, NonCommercial, LicenceObligation::ShareAlike]);
        t(&["MIT", "LicenseRef-Ours"], &[Attribution]);
    }
}
