//! The source of poses as written.

use super::TimeSection;
use crate::field::Field;
use gs2e_source::PoseFile;
use gs2e_source::kind::CaptureKind;
use gs2e_source::solving::{PairRule, SolvedLens};
use serde::Deserialize;

/// Kind of the source, with its parameters.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SourceSection {
    /// The embedded scene, which needs no data: its own camera has 640x360 pixels.
    Procedural(Field<ProceduralSection>),
    /// A COLMAP model, binary or text.
    Colmap(Field<FolderSection>),
    /// A nerfstudio `transforms.json`.
    Nerfstudio(Field<FolderSection>),
    /// An instance of MVImgNet.
    Mvimgnet(Field<FolderSection>),
    /// A scene of DL3DV-10K.
    Dl3dv(Field<FolderSection>),
    /// A 3DGS model folder with a `cameras.json`.
    Model(Field<FolderSection>),
    /// A video. ffmpeg takes frames from it, and COLMAP finds their poses.
    Video(Field<UnposedSection>),
    /// A folder of photos without poses, JPEG or PNG. COLMAP finds the poses.
    Photos(Field<UnposedSection>),
    /// No capture: `source: none`. The scene file, the camera, and an orbit or key poses come from
    /// the recipe.
    None,
}

/// Parameters of the embedded scene.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ProceduralSection {
    /// Embedded scene to use. Default: `still-life`.
    pub kind: Field<KindKey>,
    /// Number of Gaussians. Default: `20000`.
    pub gaussians: Field<u64>,
    /// Number of captured views. Default: `30`.
    pub views: Field<u64>,
    /// Extent of the capture's arc; beyond about 80 the outer views see the ends of the room. Unit:
    /// degrees. Default: `20`.
    pub arc: Field<f64>,
    /// Seed of the scene and of its capture. Default: `1`.
    pub seed: Field<u64>,
    /// Drops of a fountain that spring from the table. Default: none.
    pub fountain: Field<FountainSection>,
}

/// A fountain: `fountain: { drops: 500, time: { duration: 2 } }`. See
/// [scene.md](scene.md#scenes-that-change-with-time).
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct FountainSection {
    /// Number of drops, in addition to the Gaussians of the table. Default: `500`.
    pub drops: Field<u64>,
    /// Time of the fountain; without `rate`. Default: `{}`.
    pub time: Field<TimeSection>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum KindKey {
    /// Fruit, flowers, books and brass on a table.
    StillLife,
}

/// A capture on disk.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct FolderSection {
    /// Folder or file of the capture, relative to the recipe. Required.
    pub path: Field<String>,
    /// Number of views to use, picked evenly in natural order of the image names. Default: all.
    pub views: Field<u64>,
    /// Glob patterns of photos to leave out, compared with the whole name and with its last part.
    /// Default: `[]`, for `mvimgnet` `["*_bg_removed.png"]`.
    pub exclude: Field<Vec<Field<String>>>,
    /// Source of the poses; `dl3dv` only. Default: the COLMAP model if there is one.
    pub poses: Field<PoseFile>,
    /// Name of the scene in its dataset; enters `scene.json`, and no key. Default: read from the
    /// folders for `mvimgnet` and `dl3dv`.
    pub upstream_id: Field<String>,
    /// Web address of the dataset; decides which upstream terms apply. Range: a URL. Default: known
    /// for `mvimgnet` and `dl3dv`.
    pub upstream_url: Field<String>,
    /// Day of the download. Range: `YYYY-MM-DD`. Default: none.
    pub accessed: Field<String>,
    /// True if you accepted the dataset's terms; recorded in `scene.json`. Default: none.
    pub terms_accepted: Field<bool>,
}

/// Photos without poses, or a video. See [photos.md](photos.md).
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct UnposedSection {
    /// Folder of the photos, or the video, relative to the recipe. Required.
    pub path: Field<String>,
    /// Number of views to use, picked evenly among the photos with a pose. Default: all.
    pub views: Field<u64>,
    /// Glob patterns of photos to leave out, compared with the whole name and with its last part.
    /// Default: `[]`.
    pub exclude: Field<Vec<Field<String>>>,
    /// Camera model that COLMAP fits. Default: `opencv`.
    pub lens: Field<SolvedLens>,
    /// Number of key points per photo, at most. Default: `4096`.
    pub features: Field<u64>,
    /// Pairs of photos that are matched. Default: all pairs of fewer than 200 photos, otherwise
    /// sequential.
    pub pairs: Field<PairRule>,
    /// Vocabulary tree of COLMAP, relative to the recipe. With it, COLMAP also matches photos of a
    /// place that is seen again later. Default: none.
    pub vocabulary: Field<String>,
    /// Minimum share of the photos that must get a pose. Default: `0.5`.
    pub registered: Field<f64>,
    /// Spacing of the frames that are taken: every n-th one; `video` only. Default: `10`.
    pub every: Field<u64>,
    /// Minimum sharpness of a frame, relative to the median of its neighbours; `video` only.
    /// Default: `0.5`.
    pub sharpness: Field<f64>,
    /// Name of the scene in its dataset; enters `scene.json`, and no key. Default: none.
    pub upstream_id: Field<String>,
    /// Web address of the dataset; decides which upstream terms apply. Range: a URL. Default: none.
    pub upstream_url: Field<String>,
    /// Day of the download. Range: `YYYY-MM-DD`. Default: none.
    pub accessed: Field<String>,
    /// True if you accepted the dataset's terms; recorded in `scene.json`. Default: none.
    pub terms_accepted: Field<bool>,
}

impl UnposedSection {
    /// The keys that all captures have.
    pub(crate) fn folder(&self) -> FolderSection {
        FolderSection {
            path: self.path.clone(),
            views: self.views.clone(),
            exclude: self.exclude.clone(),
            poses: Field::Absent,
            upstream_id: self.upstream_id.clone(),
            upstream_url: self.upstream_url.clone(),
            accessed: self.accessed.clone(),
            terms_accepted: self.terms_accepted.clone(),
        }
    }
}

/// The section of a capture on disk.
#[derive(Debug, Clone, Copy)]
pub(crate) enum CaptureSection<'a> {
    /// Its files have poses.
    Posed(&'a Field<FolderSection>),
    /// They have none.
    Unposed(&'a Field<UnposedSection>),
}

impl SourceSection {
    /// Kind and section of a capture on disk, if the source is one.
    pub(crate) fn capture(&self) -> Option<(CaptureKind, CaptureSection<'_>)> {
        Some(match self {
            Self::Colmap(folder) => (CaptureKind::Colmap, CaptureSection::Posed(folder)),
            Self::Nerfstudio(folder) => (CaptureKind::Nerfstudio, CaptureSection::Posed(folder)),
            Self::Mvimgnet(folder) => (CaptureKind::Mvimgnet, CaptureSection::Posed(folder)),
            Self::Dl3dv(folder) => (CaptureKind::Dl3dv, CaptureSection::Posed(folder)),
            Self::Model(folder) => (CaptureKind::Model, CaptureSection::Posed(folder)),
            Self::Photos(folder) => (CaptureKind::Photos, CaptureSection::Unposed(folder)),
            Self::Video(folder) => (CaptureKind::Video, CaptureSection::Unposed(folder)),
            Self::Procedural(_) | Self::None => return None,
        })
    }

    /// Path of a capture and of a vocabulary tree as written.
    pub(crate) fn paths(&self) -> Option<(Option<&str>, Option<&str>)> {
        match self.capture()?.1 {
            CaptureSection::Posed(folder) => Some((text_of(&folder.given()?.0.path), None)),
            CaptureSection::Unposed(folder) => {
                let (folder, _) = folder.given()?;
                Some((text_of(&folder.path), text_of(&folder.vocabulary)))
            }
        }
    }
}

fn text_of(field: &Field<String>) -> Option<&str> {
    field.given().map(|(text, _)| text.as_str())
}
