//! Renderings that outlive their step, so that a sensor can be changed without a renderer.
//!
//! A [`KeptRenderer`] stands before a renderer. It keeps the images of the frames of a path, and shows them
//! again when a later step asks for the same view. The values of an image and its counts depend on nothing
//! else, so products have the same bytes. What fails here is rendered.

mod codec;
mod file;

use file::{EntryFile, EntryPlace, EntryWriter, KeptChannel, KeptView};
use gs2e_files as files;
use gs2e_files::Removal;
use gs2e_num::se3::Se3;
use gs2e_render::sample::TileSample;
use gs2e_render::{ChannelSet, OmissionPolicy, RenderError, RenderWork, RenderedImages, Renderer};
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};

/// The kept renderings of one scene, path and style.
#[derive(Debug)]
pub struct KeptFrames {
    state: Mutex<KeptState>,
}

#[derive(Debug)]
struct KeptState {
    files: Vec<EntryFile>,
    /// Entries by their view, with their file.
    places: BTreeMap<[u8; 32], Vec<(usize, EntryPlace)>>,
    /// Views that were written, with their images.
    written: BTreeSet<(KeptView, usize)>,
    /// The new file; `None` before its first entry, and after a failure.
    writer: Option<EntryWriter>,
    fresh: PathBuf,
    /// Maximum bytes of the new file.
    limit: u64,
    /// The reason why nothing more is kept.
    refused: Option<String>,
    reused: usize,
    rendered: usize,
}

/// The end of the work with kept renderings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeptSummary {
    /// Number of images that were shown again.
    pub reused: usize,
    /// Number of images that were rendered, of those that are kept.
    pub rendered: usize,
    /// Bytes of the new file; 0 without one.
    pub bytes: u64,
    /// The reason why the new images are not kept.
    pub refused: Option<String>,
}

impl KeptFrames {
    /// Opens the renderings in these files. New ones are written to `fresh`, at most `limit` bytes. A file
    /// that cannot be read is left out.
    #[must_use]
    pub fn open(paths: &[PathBuf], fresh: PathBuf, limit: u64) -> Self {
        let (mut files, mut places) = (Vec::new(), BTreeMap::<_, Vec<_>>::new());
        for (file, found) in paths.iter().filter_map(|path| EntryFile::open(path).ok()) {
            for place in found {
                places.entry(place.head.view.digest).or_default().push((files.len(), place));
            }
            files.push(file);
        }
        let (written, writer, refused, reused, rendered) = (BTreeSet::new(), None, None, 0, 0);
        let state = KeptState { files, places, written, writer, fresh, limit, refused, reused, rendered };
        Self { state: Mutex::new(state) }
    }

    /// Returns true if there are renderings to show.
    #[must_use]
    pub fn has_any(&self) -> bool {
        !self.state().places.is_empty()
    }

    /// Ends the new file. An empty one is not written.
    #[must_use]
    pub fn finish(&self) -> KeptSummary {
        let mut state = self.state();
        let bytes = match state.writer.take().map(EntryWriter::finish) {
            Some(Ok(bytes)) => bytes,
            Some(Err(error)) => {
                state.refuse(&error);
                0
            }
            None => 0,
        };
        let KeptState { reused, rendered, ref refused, .. } = *state;
        KeptSummary { reused, rendered, bytes, refused: refused.clone() }
    }

    fn state(&self) -> MutexGuard<'_, KeptState> {
        self.state.lock().expect("no holder panics")
    }
}

impl KeptState {
    /// Fills the wanted images of a view from the files.
    fn show(&mut self, view: &KeptView, want: ChannelSet, out: &mut RenderedImages) -> Option<RenderWork> {
        let known = self.places.get(&view.digest)?;
        let (file, place) = known.iter().find(|(_, place)| place.head.shows(view, want))?;
        // A file that was altered, or that cannot be read any more, holds nothing to show.
        self.files[*file].read(place, want, out).ok().flatten()?;
        out.clear_all_but(want);
        self.reused += 1;
        Some(place.head.work)
    }

    /// Writes the images of a view.
    fn keep(
        &mut self,
        view: KeptView,
        channels: Vec<KeptChannel>,
        images: &RenderedImages,
        work: RenderWork,
    ) {
        self.rendered += 1;
        let is_new = self.written.insert((view, channels.len()));
        if !is_new || self.refused.is_some() {
            return;
        }
        let write = || -> io::Result<u64> {
            let writer = match &mut self.writer {
                Some(writer) => writer,
                none => none.insert(EntryWriter::create(&self.fresh)?),
            };
            writer.write(view, channels, images, work)?;
            Ok(writer.bytes)
        };
        match write() {
            Ok(bytes) if bytes > self.limit => self.refuse(&"they exceed the space for kept frames"),
            Ok(_) => {}
            Err(error) => self.refuse(&error),
        }
    }

    /// Gives up the new file.
    fn refuse(&mut self, because: &dyn std::fmt::Display) {
        self.writer = None;
        // What stays is removed when the store is opened next.
        let _ = files::remove(&self.fresh, Removal::File);
        self.refused = Some(because.to_string());
    }
}

/// A renderer whose images are kept.
pub struct KeptRenderer {
    inner: Box<dyn Renderer>,
    kept: Arc<KeptFrames>,
    /// Images of frames that are kept.
    keeps: ChannelSet,
    /// The policy of the product, and whether it is in force. Renderings under another one only measure time.
    policy: OmissionPolicy,
    in_force: bool,
    /// True while only a sample of the pixels is rendered. Such images are not kept.
    is_sampled: bool,
    /// Digest of the promised poses, on which counts depend.
    promise: [u8; 32],
}

impl std::fmt::Debug for KeptRenderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KeptRenderer").field("inner", &self.inner.fingerprint()).finish_non_exhaustive()
    }
}

/// Images of the renderings that measure a path.
const MEASURED: ChannelSet = ChannelSet { depth: true, alpha: true, doubtful: true, ..ChannelSet::NONE };

impl KeptRenderer {
    /// Keeps the images of this renderer, which leaves out `policy`: of views with luminance those in
    /// `keeps`, and of others depth, opacity and doubt, if all three are rendered.
    #[must_use]
    pub fn new(
        inner: Box<dyn Renderer>,
        kept: Arc<KeptFrames>,
        keeps: ChannelSet,
        policy: OmissionPolicy,
    ) -> Self {
        Self { inner, kept, keeps, policy, in_force: true, is_sampled: false, promise: [0; 32] }
    }

    /// The images of a rendering that are kept.
    fn kept_of(&self, want: ChannelSet) -> Vec<KeptChannel> {
        if !self.in_force || self.is_sampled {
            return Vec::new();
        }
        if !want.luminance {
            return if want == MEASURED { KeptChannel::of(want) } else { Vec::new() };
        }
        let keeps = self.keeps;
        KeptChannel::of(ChannelSet {
            luminance: true,
            luminance_rate: want.luminance_rate && keeps.luminance_rate,
            rgb: want.rgb && keeps.rgb,
            ..ChannelSet::NONE
        })
    }

    fn view(&self, view: &CameraView) -> KeptView {
        let mut hasher = blake3::Hasher::new_derive_key("gs2e 2026 kept view v1");
        hasher.update(&self.promise);
        hash_camera(&mut hasher, &view.camera);
        hash_pose(&mut hasher, &view.world_from_camera);
        if !self.inner.motion_channels().is_empty() {
            // Only then does a view depend on its time.
            hash_numbers(&mut hasher, &[view.seconds]);
        }
        let ([a, b, c], [d, e, f]) = (view.velocity.linear.to_array(), view.velocity.angular.to_array());
        KeptView { digest: hasher.finalize().into(), velocity: [a, b, c, d, e, f].map(f64::to_bits) }
    }

    fn has(&self, view: &CameraView, want: ChannelSet) -> bool {
        let (state, view) = (self.kept.state(), self.view(view));
        let known = state.places.get(&view.digest);
        known.is_some_and(|known| known.iter().any(|(_, place)| place.head.shows(&view, want)))
    }
}

fn hash_camera(hasher: &mut blake3::Hasher, camera: &Camera) {
    hasher.update(&camera.size.width.to_le_bytes()).update(&camera.size.height.to_le_bytes());
    hash_numbers(hasher, &[camera.fx, camera.fy, camera.cx, camera.cy]);
    if let Some(lens) = camera.lens {
        hasher.update(lens.to_string().as_bytes());
    }
}

fn hash_pose(hasher: &mut blake3::Hasher, pose: &Se3) {
    hash_numbers(hasher, &pose.rotation.to_array());
    hash_numbers(hasher, &pose.translation.to_array());
}

fn hash_numbers(hasher: &mut blake3::Hasher, numbers: &[f64]) {
    for number in numbers {
        hasher.update(&number.to_bits().to_le_bytes());
    }
}

impl Renderer for KeptRenderer {
    fn fingerprint(&self) -> &str {
        self.inner.fingerprint()
    }

    fn omit(&mut self, omit: OmissionPolicy) {
        self.in_force = omit == self.policy;
        self.inner.omit(omit);
    }

    fn keep_to(&mut self, camera: &Camera, poses: &[Se3]) {
        let mut hasher = blake3::Hasher::new_derive_key("gs2e 2026 promised poses v1");
        hash_camera(&mut hasher, camera);
        poses.iter().for_each(|pose| hash_pose(&mut hasher, pose));
        self.promise = hasher.finalize().into();
        self.inner.keep_to(camera, poses);
    }

    fn motion_channels(&self) -> ChannelSet {
        self.inner.motion_channels()
    }

    fn object_views(&self, view: &CameraView) -> Vec<CameraView> {
        self.inner.object_views(view)
    }

    fn keep_also(&mut self, camera: &Camera, poses: &[Se3]) {
        self.inner.keep_also(camera, poses);
    }

    fn sample(&mut self, sample: Option<Arc<TileSample>>) {
        self.is_sampled = sample.is_some();
        self.inner.sample(sample);
    }

    fn work_within(&self, work: RenderWork) -> RenderWork {
        self.inner.work_within(work)
    }

    fn expect(&mut self, view: &CameraView, want: ChannelSet) {
        if !(self.in_force && self.has(view, want)) {
            self.inner.expect(view, want);
        }
    }

    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError> {
        let key = self.view(view);
        if self.in_force
            && let Some(work) = self.kept.state().show(&key, want, out)
        {
            return Ok(work);
        }
        let work = self.inner.render(view, want, out)?;
        let channels = self.kept_of(want);
        if !channels.is_empty() {
            self.kept.state().keep(key, channels, out, work);
        }
        Ok(work)
    }
}

#[cfg(test)]
mod tests;
