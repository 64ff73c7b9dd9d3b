//! Checkpoints: all that an iteration leaves behind, so that a resumed training makes the bytes of
//! an uninterrupted one.
//!
//! ```text
//! "gs2e training 2\n"   16 bytes
//! key                   32 bytes: BLAKE3 of settings, views, photos and the starting scene
//! iteration             u32
//! Gaussians             u64
//! origin                3 f64
//! losses                f64: their sum since the last report
//! course                u32 points of 28 bytes
//! arrays                positions, log scales, rotations, logits, harmonics, the means, ages, scores
//! digest                32 bytes: BLAKE3 of all before
//! ```
//!
//! Numbers are little endian. The file is written under another name and renamed when it is on the
//! disk, so a kill leaves the old one or the new one. Draws are functions of the seed and the
//! iteration, so none are kept. Both directions go through a small buffer: the file is nearly as
//! large as the state.
//!
//! The digest protects from damage, not from a stranger, who can compute it as well. All values are
//! therefore compared with the training before one of them becomes its state.

use super::adam::GEOMETRY;
use super::settings::{TrainingGoal, TrainingSettings};
use super::watch::CheckpointFile;
use super::{AdamMeans, CoursePoint, SceneTrainer, TrainingError};
use glam::DVec3;
use gs2e_files as files;
use gs2e_files::write_by_rename;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read as _, Seek as _, Write};
use std::path::Path;

const MAGIC: &[u8; 16] = b"gs2e training 2\n";
/// Bytes of the digest at the end.
const DIGEST: u64 = 32;

impl SceneTrainer<'_> {
    /// The digest of what a training is. An earlier end changes no iteration, so it is not part of
    /// it.
    pub(super) fn key(&self) -> blake3::Hash {
        let settings = TrainingSettings { until: TrainingGoal::default(), ..self.settings };
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{settings:?}").as_bytes());
        // The GPU and its driver decide the bytes. Those of the CPU are the same everywhere.
        if self.backend.takes_gpu() {
            hasher.update(self.backend.class().as_bytes());
        }
        for view in &self.views.training {
            let (at, photo) = view.at_level(0);
            hasher.update(format!("{} {at:?}", view.name).as_bytes());
            hasher.update(photo.colours.pixels().as_flattened());
        }
        let start = self.renderer.scene();
        let mut out = DigestWriter { hasher, out: io::sink() };
        let written = [start.positions.as_flattened(), start.log_scales.as_flattened()]
            .into_iter()
            .chain([start.sh.as_flattened()])
            .try_for_each(|values| write_floats(&mut out, values));
        written.expect("a sink takes everything");
        out.hasher.finalize()
    }

    /// Writes a checkpoint.
    pub(super) fn save(&self, path: &Path, key: blake3::Hash) -> Result<(), TrainingError> {
        let write = |part: &Path| -> io::Result<()> {
            let out = BufWriter::new(File::create_new(part)?);
            let mut out = DigestWriter { hasher: blake3::Hasher::new(), out };
            self.write_state(&mut out, key)?;
            let DigestWriter { hasher, mut out } = out;
            out.write_all(hasher.finalize().as_bytes())?;
            out.flush()
        };
        write_by_rename(path, write)
            .map_err(|e| TrainingError::Checkpoint { path: path.to_owned(), because: e.to_string() })
    }

    fn write_state(&self, out: &mut impl Write, key: blake3::Hash) -> io::Result<()> {
        let scene = self.renderer.scene();
        out.write_all(MAGIC)?;
        out.write_all(key.as_bytes())?;
        out.write_all(&self.iteration.to_le_bytes())?;
        out.write_all(&(scene.len() as u64).to_le_bytes())?;
        scene.origin.to_array().iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
        out.write_all(&self.losses.to_le_bytes())?;
        out.write_all(&u32::try_from(self.course.len()).unwrap_or(u32::MAX).to_le_bytes())?;
        for CoursePoint { iteration, loss, psnr, gaussians } in &self.course {
            out.write_all(&iteration.to_le_bytes())?;
            // A mean over views is never NaN, so NaN can mean that there are none.
            [*loss, psnr.unwrap_or(f64::NAN)].iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
            out.write_all(&gaussians.to_le_bytes())?;
        }
        write_floats(out, scene.positions.as_flattened())?;
        write_floats(out, scene.log_scales.as_flattened())?;
        write_floats(out, scene.rotations.as_flattened())?;
        write_floats(out, &scene.opacity_logits)?;
        write_floats(out, scene.sh.as_flattened())?;
        self.means.geometry.iter().try_for_each(|means| write_floats(out, means.as_flattened()))?;
        self.means.harmonics.iter().try_for_each(|means| write_floats(out, means.as_flattened()))?;
        self.means.ages.iter().try_for_each(|age| out.write_all(&age.to_le_bytes()))?;
        write_floats(out, &self.scores)
    }

    /// Goes on from a checkpoint, if there is one. Returns the problem with a file that is to be
    /// replaced.
    pub(super) fn resume(
        &mut self,
        CheckpointFile { path, replaces }: CheckpointFile<'_>,
        key: blake3::Hash,
    ) -> Result<Option<String>, TrainingError> {
        if !files::is_there(path) {
            return Ok(None);
        }
        let failed = |because: String| TrainingError::Checkpoint { path: path.to_owned(), because };
        match self.open_valid(path, key) {
            // From here on the state changes, so a disk that fails is an error in any case.
            Ok(state) => self.take_state(state).map(|()| None).map_err(failed),
            Err(because) if replaces => Ok(Some(because)),
            Err(because) => Err(failed(format!("{because}; delete it or name another file"))),
        }
    }

    /// Opens a checkpoint of this training whose values this training can have.
    fn open_valid(&self, path: &Path, key: blake3::Hash) -> Result<StoredState, String> {
        let words = |e: io::Error| e.to_string();
        let mut reader = CheckpointReader::open_sound(path, key)?;
        let head = reader.head()?;
        self.check_head(&head, reader.left)?;
        let (arrays, left) = (reader.file.stream_position().map_err(words)?, reader.left);
        // The arrays are read twice, so that a file with a wrong value changes nothing.
        reader.check_arrays(&head, self.renderer.scene().sh_len())?;
        reader.file.seek(io::SeekFrom::Start(arrays)).map_err(words)?;
        reader.left = left;
        Ok(StoredState { head, reader })
    }

    /// Compares the head of a checkpoint with this training. `left` is the length of the arrays.
    fn check_head(&self, head: &StateHead, left: u64) -> Result<(), String> {
        let StateHead { iteration, count, origin, losses, course } = head;
        let last = self.settings.iterations;
        if *iteration > last {
            return Err(format!("it is at iteration {iteration} of {last}"));
        }
        let budget = self.settings.gaussians as usize;
        if !(1..=budget).contains(count) {
            return Err(format!("it has {count} Gaussians, wanted 1 to {budget}"));
        }
        let wanted = count.saturating_mul(4 * state_len(self.renderer.scene().sh_len()));
        if left != wanted as u64 {
            return Err(format!("it has {left} bytes for {count} Gaussians, wanted {wanted}"));
        }
        let reported: Vec<u32> = course.iter().map(|point| point.iteration).collect();
        if reported != self.reports_until(*iteration) {
            return Err(format!("its {} reports are not those of {iteration} iterations", reported.len()));
        }
        let finite = course.iter().map(|point| point.loss).chain(*origin).chain([*losses]);
        if finite.into_iter().all(f64::is_finite) { Ok(()) } else { Err(NOT_FINITE.to_owned()) }
    }

    fn take_state(&mut self, StoredState { head, mut reader }: StoredState) -> Result<(), String> {
        let StateHead { iteration, count, origin, losses, course } = head;
        let sh_len = self.renderer.scene().sh_len();
        let taken = self.renderer.rebuild(|scene| -> Result<(), String> {
            scene.origin = DVec3::from_array(origin);
            reader.rows(&mut scene.positions, count)?;
            reader.rows(&mut scene.log_scales, count)?;
            reader.rows(&mut scene.rotations, count)?;
            reader.floats(&mut scene.opacity_logits, count)?;
            reader.rows(&mut scene.sh, count * sh_len)
        });
        taken.map_err(|e| e.to_string())??;
        let AdamMeans { geometry, harmonics, ages } = &mut self.means;
        geometry.iter_mut().try_for_each(|means| reader.rows(means, count))?;
        harmonics.iter_mut().try_for_each(|means| reader.rows(means, count * sh_len))?;
        ages.clear();
        for _ in 0..count {
            ages.push(u32::from_le_bytes(reader.take()?));
        }
        reader.floats(&mut self.scores, count)?;
        (self.iteration, self.losses, self.course) = (iteration, losses, course);
        Ok(())
    }

    /// Stops a training whose state is not finite: it would be refused when it is resumed.
    pub(super) fn check_state(&self) -> Result<(), TrainingError> {
        let (scene, means) = (self.renderer.scene(), &self.means);
        let ([g0, g1], [h0, h1]) = (&means.geometry, &means.harmonics);
        let sh_len = scene.sh_len();
        let is_finite = |i: usize| {
            let harmonics = [&scene.sh, h0, h1].map(|sh| sh[i * sh_len..(i + 1) * sh_len].as_flattened());
            let geometry: [&[f32]; 5] =
                [&scene.positions[i], &scene.log_scales[i], &scene.rotations[i], &g0[i], &g1[i]];
            let single = [scene.opacity_logits[i], self.scores[i]];
            geometry.into_iter().chain(harmonics).flatten().chain(&single).all(|v| v.is_finite())
        };
        let Some(gaussian) = (0..scene.len()).find(|i| !is_finite(*i)) else { return Ok(()) };
        let view = self.draws.view(self.iteration.saturating_sub(1), self.views.training.len());
        Err(TrainingError::NotFinite {
            iteration: self.iteration,
            view: self.views.training[view].name.clone(),
            what: format!("state of Gaussian {gaussian}"),
        })
    }
}

/// The problem with a state that holds an infinite number or NaN.
const NOT_FINITE: &str = "it holds a number that is not finite";

/// Floats of a Gaussian in the arrays: parameters, two means, age and score.
const fn state_len(sh_len: usize) -> usize {
    3 * (GEOMETRY + 3 * sh_len) + 2
}

/// The values in front of the arrays.
struct StateHead {
    iteration: u32,
    count: usize,
    origin: [f64; 3],
    losses: f64,
    course: Vec<CoursePoint>,
}

/// A state that fits the training, with a reader that stands at its arrays.
struct StoredState {
    head: StateHead,
    reader: CheckpointReader,
}

/// Hashes what it passes on.
struct DigestWriter<W> {
    hasher: blake3::Hasher,
    out: W,
}

impl<W: Write> Write for DigestWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = self.out.write(bytes)?;
        self.hasher.update(&bytes[..taken]);
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Writes floats in blocks: a call per float would cost more than the disk.
fn write_floats(out: &mut impl Write, values: &[f32]) -> io::Result<()> {
    let mut block = Vec::with_capacity(4 * 1024);
    for values in values.chunks(1024) {
        block.clear();
        values.iter().for_each(|v| block.extend(v.to_le_bytes()));
        out.write_all(&block)?;
    }
    Ok(())
}

/// The rest of a checkpoint, up to its digest.
struct CheckpointReader {
    file: BufReader<File>,
    left: u64,
}

impl CheckpointReader {
    /// Opens a checkpoint of the training with this key, after its digest was found right.
    fn open_sound(path: &Path, key: blake3::Hash) -> Result<Self, String> {
        let words = |e: io::Error| e.to_string();
        let mut file = files::open_at_most(path, files::MAX_SCENE).map_err(words)?;
        let bytes = file.metadata().map_err(words)?.len();
        let mut head = [0; MAGIC.len()];
        let is_ours = bytes > DIGEST && file.read_exact(&mut head).is_ok() && head == *MAGIC;
        if !is_ours {
            return Err("it is not a checkpoint of this version".to_owned());
        }
        // The digest covers the mark as well.
        file.rewind().map_err(words)?;
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader((&mut file).take(bytes - DIGEST)).map_err(words)?;
        let mut digest = [0; 32];
        file.read_exact(&mut digest).map_err(words)?;
        if hasher.finalize() != digest {
            return Err("it is damaged: its digest differs from its content".to_owned());
        }
        file.seek(io::SeekFrom::Start(MAGIC.len() as u64)).map_err(words)?;
        let left = bytes - DIGEST - MAGIC.len() as u64;
        let mut reader = Self { file: BufReader::new(file), left };
        if reader.take::<32>()? != *key.as_bytes() {
            return Err("it belongs to another training: settings, photos or points differ".to_owned());
        }
        Ok(reader)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.left = self.left.checked_sub(N as u64).ok_or("it ends early")?;
        let mut bytes = [0; N];
        self.file.read_exact(&mut bytes).map_err(|e| e.to_string())?;
        Ok(bytes)
    }

    fn float64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.take()?))
    }

    fn course_point(&mut self) -> Result<CoursePoint, String> {
        let iteration = u32::from_le_bytes(self.take()?);
        let [loss, psnr] = [self.float64()?, self.float64()?];
        let gaussians = u64::from_le_bytes(self.take()?);
        Ok(CoursePoint { iteration, loss, psnr: Some(psnr).filter(|psnr| !psnr.is_nan()), gaussians })
    }

    fn head(&mut self) -> Result<StateHead, String> {
        let iteration = u32::from_le_bytes(self.take()?);
        let count = usize::try_from(u64::from_le_bytes(self.take()?)).map_err(|e| e.to_string())?;
        let origin = [self.float64()?, self.float64()?, self.float64()?];
        let losses = self.float64()?;
        let points = u32::from_le_bytes(self.take()?);
        let course = (0..points).map(|_| self.course_point()).collect::<Result<_, _>>()?;
        Ok(StateHead { iteration, count, origin, losses, course })
    }

    /// Reads the arrays, and refuses values that no training has.
    fn check_arrays(&mut self, head: &StateHead, sh_len: usize) -> Result<(), String> {
        let (count, harmonics) = (head.count, 3 * sh_len * head.count);
        // Parameters and means of any sign, then mean squares, for the geometry and the harmonics.
        self.check_floats(2 * GEOMETRY * count + harmonics, f32::MIN)?;
        self.check_floats(GEOMETRY * count, 0.0)?;
        self.check_floats(harmonics, f32::MIN)?;
        self.check_floats(harmonics, 0.0)?;
        for _ in 0..count {
            let age = u32::from_le_bytes(self.take()?);
            if age > head.iteration {
                return Err(format!("a Gaussian has taken {age} steps in {} iterations", head.iteration));
            }
        }
        self.check_floats(count, 0.0)
    }

    fn check_floats(&mut self, count: usize, least: f32) -> Result<(), String> {
        for _ in 0..count {
            let value = f32::from_le_bytes(self.take()?);
            if !value.is_finite() {
                return Err(NOT_FINITE.to_owned());
            }
            if value < least {
                return Err(format!("it holds {value} where no number below {least} can be"));
            }
        }
        Ok(())
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
