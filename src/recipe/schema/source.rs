//! The source of poses as written.

use crate::recipe::field::Field;
use crate::source::PoseFile;
use crate::source::kind::CaptureKind;
use crate::source::solving::{PairRule, SolvedLens};
use serde::Deserialize;

/// Kind of the source, with its parameters.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum SourceSection {
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
    /// A folder of photos without poses, JPEG or PNG. COLMAP finds the poses.
    Photos(Field<FolderSection>),
    /// A video. ffmpeg takes frames from it, and COLMAP finds their poses.
    Video(Field<FolderSection>),
    /// No capture: `source: none`. The scene file, the camera, and an orbit or key poses come from
    /// the recipe.
    None,
}

/// Parameters of the embedded scene.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct ProceduralSection {
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
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum KindKey {
    /// Fruit, flowers, books and brass on a table.
    StillLife,
}

/// A capture on disk.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct FolderSection {
    /// Folder or file of the capture, relative to the recipe. Required.
    pub path: Field<String>,
    /// Number of views to use, picked evenly in natural order of the image names. Default: all.
    pub views: Field<u64>,
    /// Glob patterns of photos to leave out, compared with the whole name and with its last part.
    /// Default: `[]`, for `mvimgnet` `["*_bg_removed.png"]`.
    pub exclude: Field<Vec<Field<String>>>,
    /// Source of the poses; `dl3dv` only. Default: the COLMAP model if there is one.
    pub poses: Field<PoseFile>,
    /// Camera model that COLMAP fits; `photos` and `video` only. Default: `opencv`.
    pub lens: Field<SolvedLens>,
    /// Number of key points per photo, at most; `photos` and `video` only. Default: `4096`.
    pub features: Field<u64>,
    /// Pairs of photos that are matched; `photos` and `video` only. Default: all pairs of fewer than
    /// 200 photos; otherwise each photo with the 10 that follow it, and with others at distances
    /// that double.
    pub pairs: Field<PairRule>,
    /// Vocabulary tree of COLMAP, relative to the recipe; `photos` and `video` only. With it, COLMAP
    /// also matches photos of a place that is seen again later. Default: none.
    pub vocabulary: Field<String>,
    /// Minimum share of the photos that must get a pose; `photos` and `video` only. Default: `0.5`.
    pub registered: Field<f64>,
    /// Spacing of the frames that are taken: every n-th one; `video` only. Default: `10`.
    pub every: Field<u64>,
    /// Minimum sharpness of a frame, relative to the median of its neighbours; `video` only.
    /// Default: `0.5`.
    pub sharpness: Field<f64>,
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

impl SourceSection {
    /// Kind and section of a capture on disk, if the source is one.
    pub(in crate::recipe) fn capture(&self) -> Option<(CaptureKind, &Field<FolderSection>)> {
        Some(match self {
            Self::Colmap(folder) => (CaptureKind::Colmap, folder),
            Self::Nerfstudio(folder) => (CaptureKind::Nerfstudio, folder),
            Self::Mvimgnet(folder) => (CaptureKind::Mvimgnet, folder),
            Self::Dl3dv(folder) => (CaptureKind::Dl3dv, folder),
            Self::Model(folder) => (CaptureKind::Model, folder),
            Self::Photos(folder) => (CaptureKind::Photos, folder),
            Self::Video(folder) => (CaptureKind::Video, folder),
            Self::Procedural(_) | Self::None => return None,
        })
    }

    /// Path of a capture and of a vocabulary tree as written.
    pub(in crate::recipe) fn paths(&self) -> Option<(Option<&str>, Option<&str>)> {
        let (_, folder) = self.capture()?;
        let (folder, _) = folder.given()?;
        Some((text_of(&folder.path), text_of(&folder.vocabulary)))
    }
}

fn text_of(field: &Field<String>) -> Option<&str> {
    field.given().map(|(text, _)| text.as_str())
}
