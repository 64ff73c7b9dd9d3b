//! `meta.json`: the names of the images, and the numbers that their bytes encode.

use crate::cursor::ByteCursor;
use crate::{SceneError, sh};
use gs2e_files::budget::check_json;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use serde_json::Value;

/// Name of this part in errors.
pub(super) const PART: &str = ".sog (meta.json)";

/// The content of version 2. Other fields are not read.
#[derive(Debug, Deserialize)]
pub(super) struct SogMeta {
    pub(super) count: usize,
    /// Flag of antialiasing in older files.
    antialias: Option<bool>,
    /// Flag of antialiasing in newer files.
    model: Option<TrainingModel>,
    pub(super) means: MeansMeta,
    pub(super) scales: CodedMeta,
    pub(super) quats: QuatsMeta,
    pub(super) sh0: CodedMeta,
    #[serde(rename = "shN")]
    pub(super) palette: Option<PaletteMeta>,
}

/// Training settings of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum TrainingModel {
    Default,
    Antialiased,
    #[serde(rename = "2dgs")]
    Surfels,
}

/// Positions: minimum and maximum of the 16-bit range, in `sign(x) ln(1 + |x|)`.
#[derive(Debug, Deserialize)]
pub(super) struct MeansMeta {
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
    /// Low bytes, then high bytes.
    #[serde(deserialize_with = "parse_names")]
    pub(super) files: [String; 2],
}

/// Bytes that are indices into a codebook.
#[derive(Debug, Deserialize)]
pub(super) struct CodedMeta {
    pub(super) codebook: Codebook,
    #[serde(deserialize_with = "parse_names")]
    pub(super) files: [String; 1],
}

#[derive(Debug, Deserialize)]
pub(super) struct QuatsMeta {
    #[serde(deserialize_with = "parse_names")]
    pub(super) files: [String; 1],
}

/// Palette of harmonics.
#[derive(Debug, Deserialize)]
pub(super) struct PaletteMeta {
    pub(super) count: usize,
    #[serde(deserialize_with = "parse_bands")]
    pub(super) bands: u8,
    pub(super) codebook: Codebook,
    /// Sets, then labels.
    #[serde(deserialize_with = "parse_names")]
    pub(super) files: [String; 2],
}

/// Values of the 256 bytes. They are finite, because JSON has only finite numbers.
#[derive(Debug, Clone)]
pub(super) struct Codebook(Vec<f32>);

impl Codebook {
    /// Returns the values of three bytes.
    pub(super) fn of(&self, bytes: [u8; 3]) -> [f32; 3] {
        bytes.map(|byte| self.0[usize::from(byte)])
    }
}

impl<'de> Deserialize<'de> for Codebook {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        const LEN: usize = 1 << u8::BITS;
        let entries = Vec::<f32>::deserialize(from)?;
        if entries.len() != LEN {
            return Err(D::Error::custom(format!("a codebook of {} entries, wanted {LEN}", entries.len())));
        }
        Ok(Self(entries))
    }
}

/// Reads names of files in the folder of `meta.json`; other folders are refused.
fn parse_names<'de, D: Deserializer<'de>, const N: usize>(from: D) -> Result<[String; N], D::Error> {
    let found = Vec::<String>::deserialize(from)?;
    // A separator or `..` would lead out of the folder.
    let foreign =
        |name: &&String| name.is_empty() || name.starts_with('.') || name.contains(['/', '\\', '\0']);
    if let Some(name) = found.iter().find(foreign) {
        return Err(D::Error::custom(format!("the file `{name}`, wanted a name without folders")));
    }
    <[String; N]>::try_from(found)
        .map_err(|found| D::Error::custom(format!("{} files, wanted {N}", found.len())))
}

fn parse_bands<'de, D: Deserializer<'de>>(from: D) -> Result<u8, D::Error> {
    let bands = u8::deserialize(from)?;
    if (1..=sh::MAX_DEGREE).contains(&bands) {
        return Ok(bands);
    }
    Err(D::Error::custom(format!("{bands} bands of harmonics, wanted 1 to {}", sh::MAX_DEGREE)))
}

impl SogMeta {
    /// Parses the content of the file.
    pub(super) fn parse_meta(json: &[u8]) -> Result<Self, SceneError> {
        let start = ByteCursor::new(PART, json);
        check_json(json).map_err(|e| start.malformed(e.to_string(), "`meta.json` of version 2"))?;
        // The version first: other versions have other fields.
        let value: Value = serde_json::from_slice(json).map_err(|e| meta_error(json, &e))?;
        match value.get("version") {
            Some(version) if *version == 2 => {}
            None => {
                let hint = "convert it with a current splat-transform, which reads version 1 and writes 2";
                return Err(start.unsupported("SOG version 1", hint));
            }
            Some(version) => return Err(start.malformed(format!("version {version}"), "version 2")),
        }
        let meta: Self = serde_json::from_slice(json).map_err(|e| meta_error(json, &e))?;
        if meta.model == Some(TrainingModel::Surfels) {
            return Err(start.unsupported("the model `2dgs`", "only Gaussians with three axes are rendered"));
        }
        let MeansMeta { mins, maxs, .. } = &meta.means;
        if let Some(k) = (0..3).find(|&k| mins[k] > maxs[k]) {
            let found = format!("positions from {} to {}", mins[k], maxs[k]);
            return Err(start.malformed(found, "`mins` below `maxs`"));
        }
        Ok(meta)
    }

    /// Returns true if the scene was trained with the antialiased rule; `None` if the file does not
    /// say.
    pub(super) fn antialiased(&self) -> Option<bool> {
        self.model.map(|model| model == TrainingModel::Antialiased).or(self.antialias)
    }
}

/// Creates the error with its offset in bytes.
fn meta_error(json: &[u8], because: &serde_json::Error) -> SceneError {
    // The parser counts lines and columns; errors of scenes count bytes.
    let before = json.split_inclusive(|&b| b == b'\n').take(because.line().saturating_sub(1));
    let offset = before.map(<[u8]>::len).sum::<usize>() + because.column().saturating_sub(1);
    let text = because.to_string();
    let found = text.split(" at line ").next().unwrap_or_default().to_owned();
    ByteCursor::new(PART, json).at(offset.min(json.len())).malformed(found, "`meta.json` of version 2")
}
