//! A capture on disk as a recipe names it: kind, path, and selection of views.

use super::colmap::ColmapModel;
use super::kind::CaptureKind;
use super::photo::{self, PhotoScrutiny};
use super::solving::PoseSolving;
use super::{Capture, CapturedView, SourceError, SourceWarning, UnusedPhoto, UnusedReason};
use glob::Pattern;
use serde::{Deserialize, Serialize, Serializer};
use std::path::PathBuf;

/// A capture on disk. Only the kind and the selection are serialised, because they change the
/// meaning of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct DiskCapture {
    /// Layout of its files.
    pub kind: CaptureKind,
    /// The folder or file.
    pub path: PathBuf,
    /// The views in use.
    pub selection: ViewSelection,
    /// The search for the poses, if the kind has none of its own.
    pub solving: Option<PoseSolving>,
}

/// Selection of views; all views by default.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct ViewSelection {
    /// Number of views, picked evenly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub views: Option<u32>,
    /// Patterns of names of excluded photos, in the syntax of [`Pattern`]. Each pattern is compared
    /// with the whole name and with its last part.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<String>,
    /// The source of the poses, if a layout has two. `None` is the COLMAP model, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<PoseFile>,
}

/// Files that can contain poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseFile {
    /// A COLMAP model.
    Colmap,
    /// A `transforms.json`.
    Transforms,
}

impl Serialize for DiskCapture {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_newtype_variant("Captured", 0, self.kind.name(), &self.selection)
    }
}

impl DiskCapture {
    /// Selects all views of the capture at `path`.
    #[must_use]
    pub fn all_views(kind: CaptureKind, path: PathBuf) -> Self {
        let solving = kind.needs_poses().then(PoseSolving::default);
        Self { kind, path, selection: ViewSelection::default(), solving }
    }

    /// Returns the id of the capture in its dataset, derived from its folders: `class/instance`, or
    /// 64 hexadecimal digits.
    #[must_use]
    pub fn upstream_id(&self) -> Option<String> {
        self.kind.as_layout().upstream_id(&self.path)
    }

    /// Reads the capture.
    ///
    /// # Errors
    /// The reader of its kind fails, or no view is left.
    pub fn read(&self) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        self.look(PhotoScrutiny::Bytes)
    }

    /// Reads the capture without the bytes of the photos. Their hashes are then unknown.
    ///
    /// # Errors
    /// The capture cannot be read; see [`DiskCapture::read`].
    pub fn glance(&self) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        self.look(PhotoScrutiny::Sizes)
    }

    fn look(&self, look: PhotoScrutiny) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        let (capture, mut warnings) = self.kind.as_layout().read(self, look)?;
        let capture = self.select(capture, &mut warnings)?;
        warnings.extend(capture.distortion());
        Ok((capture, warnings))
    }

    /// Returns the files that [`DiskCapture::read`] reads, each with its name within the source.
    ///
    /// # Errors
    /// The names of the photos are in a file that cannot be read; see [`DiskCapture::read`]. A photo
    /// exceeds the limit, which is found before anything hashes it.
    pub fn files(&self) -> Result<Vec<(String, PathBuf)>, SourceError> {
        let found = self.kind.as_layout().files(self)?;
        found.iter().try_for_each(|(_, path)| photo::check_length(path))?;
        Ok(found)
    }

    /// Returns the COLMAP model of its poses, if they come from a model.
    #[must_use]
    pub fn model(&self) -> Option<ColmapModel> {
        self.kind.as_layout().model(self)
    }

    /// Returns the existing folders whose listing determines [`DiskCapture::files`].
    #[must_use]
    pub fn folders(&self) -> Vec<PathBuf> {
        self.kind.as_layout().folders(self)
    }

    /// Moves views that are not selected to the unused photos.
    pub(super) fn select(
        &self,
        capture: Capture,
        warnings: &mut Vec<SourceWarning>,
    ) -> Result<Capture, SourceError> {
        let Capture { views, mut unused } = capture;
        let is_excluded = self.selection.excludes();
        // The choice of the user is the stronger reason, so it replaces the reason of the source.
        for photo in unused.iter_mut().filter(|photo| is_excluded(&photo.name)) {
            photo.why = UnusedReason::Excluded;
        }
        let (excluded, views): (Vec<CapturedView>, Vec<CapturedView>) =
            views.into_iter().partition(|v| is_excluded(&v.name));
        // Exclusion precedes picking, so that the picked views are even among the remaining views.
        unused.extend(excluded.into_iter().map(|view| UnusedPhoto::from_view(view, UnusedReason::Excluded)));
        if views.is_empty() {
            let because = "no view is left: all are excluded by their names".to_owned();
            return Err(SourceError::Absent { dir: self.path.clone(), because });
        }
        let mut capture = Capture { views: Vec::new(), unused };
        let wanted = self.selection.views;
        warnings.extend(
            wanted
                .filter(|&wanted| (wanted as usize) > views.len())
                .map(|wanted| SourceWarning::FewViews { found: views.len(), wanted }),
        );
        let picked = spread_evenly(views.len(), wanted.map_or(usize::MAX, |wanted| wanted as usize));
        for (i, view) in views.into_iter().enumerate() {
            if picked.binary_search(&i).is_ok() {
                capture.views.push(view);
            } else {
                capture.unused.push(UnusedPhoto::from_view(view, UnusedReason::NotPicked));
            }
        }
        capture.unused.sort_by(|a, b| gs2e_files::natural::compare_names(&a.name, &b.name));
        Ok(capture)
    }
}

impl ViewSelection {
    /// Returns a test for excluded names. Patterns are already validated; an invalid pattern
    /// matches nothing.
    pub(super) fn excludes(&self) -> impl Fn(&str) -> bool {
        let patterns: Vec<Pattern> = self.exclude.iter().filter_map(|text| Pattern::new(text).ok()).collect();
        move |name: &str| {
            let last = name.rsplit('/').next().unwrap_or(name);
            patterns.iter().any(|pattern| pattern.matches(name) || pattern.matches(last))
        }
    }
}

/// Validates a pattern of names.
///
/// # Errors
/// The pattern is invalid. The error says why.
pub fn check_pattern(text: &str) -> Result<(), String> {
    Pattern::new(text).map(drop).map_err(|e| e.msg.to_owned())
}

/// Picks `wanted` of `count` indices evenly: the i-th is `i (count - 1) / (wanted - 1)`, rounded
/// half up. Returns all indices if there are no more, and the first if one is wanted.
fn spread_evenly(count: usize, wanted: usize) -> Vec<usize> {
    if wanted >= count {
        return (0..count).collect();
    }
    // Rounded half up in integers: `floor((2 n + d) / (2 d))` for the fraction `n / d`.
    let gaps = wanted.saturating_sub(1);
    (0..wanted).map(|i| if gaps == 0 { 0 } else { (2 * i * (count - 1) + gaps) / (2 * gaps) }).collect()
}

impl UnusedPhoto {
    /// Converts a view that is not used.
    fn from_view(view: CapturedView, why: UnusedReason) -> Self {
        Self { name: view.name, sha256: view.sha256, size: Some(view.camera.size), why }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_picked_evenly() {
        let t = |count, wanted, indices: &[usize]| {
            assert_eq!(spread_evenly(count, wanted), indices, "{wanted} of {count}")
        };
        t(5, 9, &[0, 1, 2, 3, 4]);
        t(5, 5, &[0, 1, 2, 3, 4]);
        t(5, 1, &[0]);
        t(5, 2, &[0, 4]);
        t(5, 3, &[0, 2, 4]);
        // The exact values are 0, 4/3, 8/3, 4 and 0, 5/2, 5. Halves round up.
        t(5, 4, &[0, 1, 3, 4]);
        t(6, 3, &[0, 3, 5]);
        for (count, wanted) in [(300, 30), (31, 30), (1000, 999), (97, 2)] {
            let picked = spread_evenly(count, wanted);
            assert_eq!((picked.len(), picked[0], picked[wanted - 1]), (wanted, 0, count - 1));
            assert!(picked.array_windows().all(|[a, b]| a < b), "{wanted} of {count}");
        }
    }

    #[test]
    fn names_are_left_out_by_pattern() {
        let exclude = vec!["*_bg_removed.png".to_owned(), "left/*".to_owned()];
        let selection = ViewSelection { exclude, ..ViewSelection::default() };
        let is_excluded = selection.excludes();
        let t = |name, wanted| assert_eq!(is_excluded(name), wanted, "{name}");
        t("001_bg_removed.png", true);
        t("images/001_bg_removed.png", true);
        t("001_bg_removed.png.jpg", false);
        t("001.jpg", false);
        t("left/001.jpg", true);
        t("right/left/001.jpg", false);
        assert!(check_pattern("[").is_err() && check_pattern("a?[0-9]*").is_ok());
    }
}
