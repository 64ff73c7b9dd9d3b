//! Scenes as SOG, version 2 (playcanvas/splat-transform, `read-sog.ts`): `meta.json` and lossless
//! WebP images with one pixel per Gaussian, in a zip archive (`.sog`) or in a folder.
//!
//! Positions have 16 bits on a logarithmic scale, in two images. Scales, colours and harmonics are
//! entries of codebooks; harmonics use a palette in addition. Rotations are three bytes and the
//! index of the largest component. Axes are those of `.ply`. In errors, offsets count bytes of the
//! named part; for images, bytes of the decoded image.
//!
//! # Examples
//!
//! ```
//! # use image_webp::{ColorType, WebPEncoder};
//! use gs2e_scene::sog;
//!
//! let folder = std::env::temp_dir().join(format!("gs2e-scene-sog-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let files = ["low", "high", "scales", "quats", "sh0"];
//! # for name in files {
//! #     let out = std::fs::File::create(folder.join(name))?;
//! #     WebPEncoder::new(out).encode(&[0, 0, 0, 252], 1, 1, ColorType::Rgba8)?;
//! # }
//! # let coded = |name| serde_json::json!({ "codebook": vec![-3.0; 256], "files": [name] });
//! # let means = serde_json::json!({ "mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["low", "high"] });
//! # let (scales, sh0, quats) = (coded("scales"), coded("sh0"), serde_json::json!({ "files": ["quats"] }));
//! # let meta = serde_json::json!({
//! #     "version": 2, "count": 1, "means": means, "scales": scales, "quats": quats, "sh0": sh0,
//! # });
//! # std::fs::write(folder.join(sog::META), meta.to_string())?;
//! // The folder has `meta.json`, and images of one pixel whose bytes are 0. Positions range from 0 to 1 on
//! // the logarithmic scale, and the codebooks have -3 at the place 0.
//! let scene = sog::read_sog_folder(&folder)?;
//! assert_eq!((scene.positions[0], scene.log_scales[0]), ([0.0; 3], [-3.0; 3]));
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod meta;
mod parts;
mod pixels;

use super::collector::{Gaussian, GaussianCollector};
use super::cursor::ByteCursor;
use super::opacity::logit_of_byte;
use super::{Gaussians, SceneError, sh};
use glam::DVec3;
use gs2e_files::budget::ByteBudget;
use meta::{Codebook, SogMeta};
use parts::{ArchiveParts, FolderParts, SogParts};
use pixels::{DecodedPixels, PixelRoom};
use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;

/// First bytes of a zip archive.
pub(crate) const ZIP_MAGIC: [u8; 4] = *b"PK\x03\x04";
/// Name of the file that describes the other files of a folder.
pub const META: &str = "meta.json";

/// Reads a `.sog` archive.
///
/// # Errors
/// Returns a [`SceneError`] if the bytes are not a `.sog` archive.
pub fn read_sog(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    read_parts(&mut ArchiveParts::open(bytes)?, ByteBudget::of(bytes.len()))
}

/// Reads a folder of `meta.json` and images.
///
/// # Errors
/// Returns a [`SceneError`] if a file cannot be read or is invalid.
pub fn read_sog_folder(folder: &Path) -> Result<Gaussians, SceneError> {
    read_parts(&mut FolderParts(folder), ByteBudget::of(0))
}

/// Reads the parts of a scene. `budget` is that of the archive, and grows with each file of a
/// folder.
fn read_parts(parts: &mut impl SogParts, mut budget: ByteBudget) -> Result<Gaussians, SceneError> {
    let meta = SogMeta::parse_meta(&parts.part(META, meta::PART, &mut budget)?)?;
    let files = SogFiles::read_all(&meta, parts, &mut budget)?;
    let images = SogImages::decode_all(&meta, &files, &mut budget)?;
    images.check(meta.count)?;
    let sh_degree = images.palette.as_ref().map_or(0, |palette| palette.sh_degree);
    let mut collector = GaussianCollector::new(sh_degree, meta.count)?;
    let mut coefficients = vec![[0.0; 3]; sh::function_count(sh_degree)];
    for i in 0..meta.count {
        let [r, g, b, alpha] = images.sh0.rgba(i);
        coefficients[0] = meta.sh0.codebook.of([r, g, b]);
        if let Some(palette) = &images.palette {
            palette.copy(i, &mut coefficients[1..])?;
        }
        collector.push(&Gaussian {
            position: images.position(i, &meta.means),
            log_scale: meta.scales.codebook.of(images.scales.rgb(i)),
            rotation: images.rotation(i)?,
            opacity_logit: logit_of_byte(alpha),
            sh: &coefficients,
        });
    }
    collector.finish(DVec3::ZERO, meta.antialiased())
}

/// The images as stored.
struct SogFiles {
    means: [Vec<u8>; 2],
    scales: Vec<u8>,
    quats: Vec<u8>,
    sh0: Vec<u8>,
    palette: Option<[Vec<u8>; 2]>,
}

impl SogFiles {
    fn read_all(
        meta: &SogMeta,
        parts: &mut impl SogParts,
        budget: &mut ByteBudget,
    ) -> Result<Self, SceneError> {
        let mut part = |name: &str, part| parts.part(name, part, budget);
        let [low, high] = &meta.means.files;
        let palette = match &meta.palette {
            None => None,
            Some(meta::PaletteMeta { files: [centroids, labels], .. }) => {
                Some([part(centroids, PALETTE)?, part(labels, ".sog (labels of harmonics)")?])
            }
        };
        Ok(Self {
            means: [part(low, ".sog (positions, low bytes)")?, part(high, ".sog (positions, high bytes)")?],
            scales: part(&meta.scales.files[0], ".sog (scales)")?,
            quats: part(&meta.quats.files[0], ROTATIONS)?,
            sh0: part(&meta.sh0.files[0], ".sog (colours)")?,
            palette,
        })
    }
}

const ROTATIONS: &str = ".sog (rotations)";
const PALETTE: &str = ".sog (palette of harmonics)";

/// The decoded images. Each except the palette has one pixel per Gaussian.
struct SogImages {
    means: [DecodedPixels; 2],
    scales: DecodedPixels,
    quats: DecodedPixels,
    sh0: DecodedPixels,
    palette: Option<HarmonicsPalette>,
}

impl SogImages {
    fn decode_all(meta: &SogMeta, files: &SogFiles, budget: &mut ByteBudget) -> Result<Self, SceneError> {
        // The palette is decoded by limits of its own: it has one pixel per function of each set.
        let palette = match (&meta.palette, &files.palette) {
            (Some(meta), Some([centroids, labels])) => Some((
                meta,
                DecodedPixels::decode_webp(centroids, PALETTE, PixelRoom::of_palette(meta), budget)?,
                labels,
            )),
            _ => None,
        };
        let one_each = PixelRoom::of_scene(meta.count);
        let mut decode =
            |bytes: &[u8], part: &'static str| DecodedPixels::decode_webp(bytes, part, one_each, budget);
        let palette = palette.map(|(meta, centroids, labels)| {
            HarmonicsPalette::new(meta, centroids, decode(labels, ".sog (labels of harmonics)")?)
        });
        let palette = palette.transpose()?;
        let [low, high] = &files.means;
        Ok(Self {
            means: [
                decode(low, ".sog (positions, low bytes)")?,
                decode(high, ".sog (positions, high bytes)")?,
            ],
            scales: decode(&files.scales, ".sog (scales)")?,
            quats: decode(&files.quats, ROTATIONS)?,
            sh0: decode(&files.sh0, ".sog (colours)")?,
            palette,
        })
    }

    /// Refuses invalid rotations and labels, before memory is taken for the scene.
    fn check(&self, count: usize) -> Result<(), SceneError> {
        for i in 0..count {
            self.rotation(i)?;
            self.palette.as_ref().map_or(Ok(0), |palette| palette.label(i))?;
        }
        Ok(())
    }

    #[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
    fn position(&self, i: usize, means: &meta::MeansMeta) -> [f32; 3] {
        let [low, high] = self.means.each_ref().map(|image| image.rgb(i));
        [0, 1, 2].map(|k| {
            let share = f64::from(u16::from_le_bytes([low[k], high[k]])) / 65535.0;
            let folded = means.mins[k] * (1.0 - share) + means.maxs[k] * share;
            // The inverse of `sign(x) ln(1 + |x|)`. `expm1` keeps the digits of positions near 0.
            libm::expm1(folded.abs()).copysign(folded) as f32
        })
    }

    /// Decodes the quaternion `w x y z`.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
    fn rotation(&self, i: usize) -> Result<[f32; 4], SceneError> {
        let [a, b, c, tag] = self.quats.rgba(i);
        let Some(largest) = tag.checked_sub(252).map(usize::from) else {
            let at = ByteCursor::new(ROTATIONS, &[]).at(4 * i + 3);
            let found = format!("the tag {tag} for the largest component of Gaussian {i}");
            return Err(at.malformed(found, "252 to 255"));
        };
        let mut components = [0.0; 4];
        for (k, byte) in (0..4).filter(|&k| k != largest).zip([a, b, c]) {
            // A component that is not the largest lies within `sqrt(1/2)` of 0.
            components[k] = (f64::from(byte) / 255.0 * 2.0 - 1.0) * FRAC_1_SQRT_2;
        }
        let squares: f64 = components.iter().map(|c| c * c).sum();
        // The three others can be longer than 1, by rounding or in a damaged file.
        components[largest] = (1.0 - squares).max(0.0).sqrt();
        Ok(components.map(|c| c as f32))
    }
}

/// Number of palette entries per row of the image.
const PALETTE_WIDTH: usize = 64;

/// Sets of harmonics, and the set of each Gaussian.
struct HarmonicsPalette {
    sh_degree: u8,
    /// Number of functions above degree 0.
    functions: usize,
    count: usize,
    codebook: Codebook,
    /// A row contains [`PALETTE_WIDTH`] sets; a set has one pixel per function.
    centroids: DecodedPixels,
    /// 16 bits per Gaussian, the low byte in red.
    labels: DecodedPixels,
}

impl HarmonicsPalette {
    fn new(
        meta: &meta::PaletteMeta,
        centroids: DecodedPixels,
        labels: DecodedPixels,
    ) -> Result<Self, SceneError> {
        let functions = sh::function_count(meta.bands) - 1;
        let wanted = PALETTE_WIDTH * functions;
        if centroids.width != wanted {
            let found = format!("an image {} pixels wide", centroids.width);
            return Err(centroids
                .at(0)
                .malformed(found, format!("{wanted} pixels for {} bands", meta.bands)));
        }
        // Writers round the stated count up. Entries outside the image cannot be referred to.
        let count = meta.count.min(PALETTE_WIDTH * centroids.height);
        Ok(Self {
            sh_degree: meta.bands,
            functions,
            count,
            codebook: meta.codebook.clone(),
            centroids,
            labels,
        })
    }

    /// The set of Gaussian `i`.
    fn label(&self, i: usize) -> Result<usize, SceneError> {
        let [low, high, _] = self.labels.rgb(i);
        let label = usize::from(u16::from_le_bytes([low, high]));
        if label < self.count {
            return Ok(label);
        }
        let found = format!("the label {label} of Gaussian {i}");
        Err(self
            .labels
            .at(i)
            .malformed(found, format!("a label below {}, the size of the palette", self.count)))
    }

    /// The harmonics of Gaussian `i` above degree 0.
    fn copy(&self, i: usize, coefficients: &mut [[f32; 3]]) -> Result<(), SceneError> {
        let label = self.label(i)?;
        for (k, coefficient) in coefficients.iter_mut().enumerate() {
            *coefficient = self.codebook.of(self.centroids.rgb(label * self.functions + k));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
