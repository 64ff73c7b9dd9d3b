//! Checkpoints: all that an iteration leaves behind, so that a resumed training makes the bytes of
//! an uninterrupted one.
//!
//! ```text
//! "gs2e training 1\n"   16 bytes
//! key                   32 bytes: BLAKE3 of settings, views, photos and the starting scene
//! iteration             u32
//! Gaussians             u64
//! origin                3 f64
//! arrays                positions, log scales, rotations, logits, harmonics, the means, ages, scores
//! digest                32 bytes: BLAKE3 of all before
//! ```
//!
//! Numbers are little endian. The file is written under another name and renamed when it is on the
//! disk, so a kill leaves the old one or the new one. Draws are functions of the seed and the
//! iteration, so none are kept.

use super::photos::TrainingViews;
use super::{AdamMeans, SceneTrainer, TrainingError, TrainingSettings};
use crate::files;
use crate::scene::Gaussians;
use glam::DVec3;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;

const MAGIC: &[u8; 16] = b"gs2e training 1\n";
/// Bytes before the arrays.
const HEAD: usize = 16 + 32 + 4 + 8 + 24;

/// The digest of what a training is.
pub(super) fn training_key(
    views: &TrainingViews,
    settings: &TrainingSettings,
    start: &Gaussians,
) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{settings:?}").as_bytes());
    for view in &views.shown {
        let (at, photo) = view.at_level(0);
        hasher.update(format!("{} {at:?}", view.name).as_bytes());
        hasher.update(photo.colours.pixels().as_flattened());
    }
    let mut bytes = Vec::new();
    push_floats(&mut bytes, start.positions.as_flattened());
    push_floats(&mut bytes, start.log_scales.as_flattened());
    push_floats(&mut bytes, start.sh.as_flattened());
    hasher.update(&bytes).finalize()
}

fn push_floats(bytes: &mut Vec<u8>, values: &[f32]) {
    values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
}

impl SceneTrainer<'_> {
    /// Writes a checkpoint.
    pub(super) fn save(&self, path: &Path, key: blake3::Hash) -> Result<(), TrainingError> {
        let bytes = self.to_bytes(key);
        let part = path.with_extension("part");
        let write = || -> io::Result<()> {
            let mut file = File::create(&part)?;
            file.write_all(&bytes)?;
            file.write_all(blake3::hash(&bytes).as_bytes())?;
            file.sync_all()?;
            fs::rename(&part, path)
        };
        write().map_err(|e| TrainingError::Checkpoint { path: path.to_owned(), because: e.to_string() })
    }

    fn to_bytes(&self, key: blake3::Hash) -> Vec<u8> {
        let scene = self.renderer.scene();
        let mut bytes = Vec::with_capacity(HEAD + 760 * scene.len());
        bytes.extend(MAGIC);
        bytes.extend(key.as_bytes());
        bytes.extend(self.iteration.to_le_bytes());
        bytes.extend((scene.len() as u64).to_le_bytes());
        scene.origin.to_array().iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        push_floats(&mut bytes, scene.positions.as_flattened());
        push_floats(&mut bytes, scene.log_scales.as_flattened());
        push_floats(&mut bytes, scene.rotations.as_flattened());
        push_floats(&mut bytes, &scene.opacity_logits);
        push_floats(&mut bytes, scene.sh.as_flattened());
        self.means.geometry.iter().for_each(|means| push_floats(&mut bytes, means.as_flattened()));
        self.means.harmonics.iter().for_each(|means| push_floats(&mut bytes, means.as_flattened()));
        self.means.ages.iter().for_each(|age| bytes.extend(age.to_le_bytes()));
        push_floats(&mut bytes, &self.scores);
        bytes
    }

    /// Goes on from a checkpoint, if there is one.
    pub(super) fn load(&mut self, path: &Path, key: blake3::Hash) -> Result<(), TrainingError> {
        if !files::is_there(path) {
            return Ok(());
        }
        let failed = |because: String| TrainingError::Checkpoint { path: path.to_owned(), because };
        let bytes = files::read(path, files::MAX_SCENE).map_err(|e| failed(e.to_string()))?;
        self.take_bytes(&bytes, key).map_err(failed)
    }

    fn take_bytes(&mut self, bytes: &[u8], key: blake3::Hash) -> Result<(), String> {
        let (content, digest) = bytes
            .split_last_chunk::<32>()
            .ok_or_else(|| format!("{} bytes are no checkpoint", bytes.len()))?;
        if !content.starts_with(MAGIC) {
            return Err("it is not a checkpoint of this version".to_owned());
        }
        if blake3::hash(content) != *digest {
            return Err(
                "it is damaged: its digest differs from its content; delete it to start again".to_owned()
            );
        }
        let mut reader = CheckpointReader { rest: &content[MAGIC.len()..] };
        if reader.take::<32>()? != *key.as_bytes() {
            let because = "it belongs to another training: settings, photos or points differ";
            return Err(format!("{because}; name another file or delete it"));
        }
        let iteration = u32::from_le_bytes(reader.take()?);
        let count = usize::try_from(u64::from_le_bytes(reader.take()?)).map_err(|e| e.to_string())?;
        let origin = [reader.float64()?, reader.float64()?, reader.float64()?];
        let sh_len = self.renderer.scene().sh_len();
        let wanted = count.saturating_mul(4 * (3 * 11 + 3 * 3 * sh_len + 2));
        if reader.rest.len() != wanted || count > self.settings.gaussians as usize {
            return Err(format!("{} bytes for {count} Gaussians, wanted {wanted}", reader.rest.len()));
        }
        self.renderer.rebuild(|scene| -> Result<(), String> {
            scene.origin = DVec3::from_array(origin);
            reader.rows(&mut scene.positions, count)?;
            reader.rows(&mut scene.log_scales, count)?;
            reader.rows(&mut scene.rotations, count)?;
            reader.floats(&mut scene.opacity_logits, count)?;
            reader.rows(&mut scene.sh, count * sh_len)
        })?;
        let AdamMeans { geometry, harmonics, ages } = &mut self.means;
        geometry.iter_mut().try_for_each(|means| reader.rows(means, count))?;
        harmonics.iter_mut().try_for_each(|means| reader.rows(means, count * sh_len))?;
        ages.clear();
        for _ in 0..count {
            ages.push(u32::from_le_bytes(reader.take()?));
        }
        reader.floats(&mut self.scores, count)?;
        self.iteration = iteration;
        Ok(())
    }
}

/// The rest of a checkpoint.
struct CheckpointReader<'a> {
    rest: &'a [u8],
}

impl CheckpointReader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (first, rest) = self.rest.split_first_chunk::<N>().ok_or("it ends early")?;
        self.rest = rest;
        Ok(*first)
    }

    fn float64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.take()?))
    }

    fn floats(&mut self, to: &mut Vec<f32>, count: usize) -> Result<(), String> {
        to.clear();
        for _ in 0..count {
            to.push(f32::from_le_bytes(self.take()?));
        }
        Ok(())
    }

    /// `count` rows of `N` numbers.
    fn rows<const N: usize>(&mut self, to: &mut Vec<[f32; N]>, count: usize) -> Result<(), String> {
        to.clear();
        for _ in 0..count {
            let mut row = [0.0; N];
            for v in &mut row {
                *v = f32::from_le_bytes(self.take()?);
            }
            to.push(row);
        }
        Ok(())
    }
}
