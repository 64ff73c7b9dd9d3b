//! Recipes for new scenes: one short file per scene, over one `defaults.yaml` with the values that
//! all scenes share.

use super::find::DEFAULTS;
use super::load::RecipeParts;
use super::{RecipeFaults, names, preset};
use gs2e_files::escape::{is_hidden, quoted};
use gs2e_files::is_there;
use gs2e_source::DiskCapture;
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use unicode_normalization::is_nfc;

/// The content of a scene's recipe.
#[derive(Debug)]
pub struct RecipeDraft<'a> {
    /// Scene id.
    pub scene: &'a str,
    /// The capture. The path is written unchanged: relative to the recipe's folder, or absolute.
    pub captured: &'a DiskCapture,
    /// The scene file, likewise, if the recipe names one.
    pub given: Option<&'a Path>,
    /// True if the recipe asks for a training on its photos.
    pub trained: bool,
}

/// Camera speed in the words of the paper's table 1. The paper gives no numbers; the values are
/// this program's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraPace {
    /// Half of the usual speed.
    Mild,
    /// The usual speed.
    Medium,
    /// Double the usual speed.
    Strong,
}

impl CameraPace {
    /// Median optical flow, pixels per second.
    fn px_s(self) -> u32 {
        match self {
            Self::Mild => 200,
            Self::Medium => 400,
            Self::Strong => 800,
        }
    }

    /// Number of poses per view. Five are those of the paper's appendix C.
    fn factor(self) -> &'static str {
        match self {
            Self::Mild => "10",
            Self::Medium => "5",
            Self::Strong => "5/2",
        }
    }
}

/// Checks a scene's id or a path.
///
/// # Errors
/// The id or path is not usable. The message continues a sentence that starts with the id or path.
pub fn screen_text(scene: &str, paths: &[&Path]) -> Result<(), String> {
    names::scene_id(scene).map_err(|because| format!("its id would be `{scene}`, {because}"))?;
    for path in paths {
        let text = path.to_str().ok_or_else(|| format!("the path {} is not UTF-8", path.display()))?;
        if text.contains(|c| is_hidden(c) || c == '\\') || !is_nfc(text) {
            let wanted = "wanted composed letters (Unicode NFC), no hidden character and no backslash";
            return Err(format!("the path {text:?} cannot be written in a recipe: {wanted}"));
        }
    }
    Ok(())
}

impl RecipeDraft<'_> {
    /// The recipe, every text of it in quotes.
    #[must_use]
    pub fn text(&self) -> String {
        let path = |path: &Path| quoted(&path.to_string_lossy());
        let DiskCapture { kind, path: place, selection, .. } = self.captured;
        let mut fields = format!("path: {}", path(place));
        if let Some(views) = selection.views {
            let _ = write!(fields, ", views: {views}");
        }
        if !selection.exclude.is_empty() {
            let patterns: Vec<String> = selection.exclude.iter().map(|text| quoted(text)).collect();
            let _ = write!(fields, ", exclude: [{}]", patterns.join(", "));
        }
        let (scene, kind) = (self.scene, kind.name());
        let mut text = format!("version: 1\nscene: {}\nsource:\n  {kind}: {{ {fields} }}\n", quoted(scene));
        if let Some(given) = self.given {
            let _ = writeln!(text, "reconstruct:\n  given: {{ path: {} }}", path(given));
        } else if self.trained {
            text.push_str("reconstruct:\n  builtin: {}\n");
        }
        text
    }
}

/// Returns the values that all drafts of a folder share: a speed of the picture, and as many frames as
/// the sensor needs for it.
#[must_use]
pub fn defaults_text(pace: CameraPace) -> String {
    let px_s = pace.px_s();
    format!(
        "\
# Values that all recipes in this folder and below share. A recipe's own values win.
seed: 20250521
trajectories:
  - name: base
    refine: {{ window: 2, curve: cubic }}
    speed: {{ flow: {{ px_s: {px_s} }} }}      # median optical flow, pixels per second
  - name: mini
    novel: {{ groups: 3, keyframes: 5, curve: any }}
    speed: {{ flow: {{ px_s: {px_s} }} }}
sampling: {{ tolerance: 0.1 }}             # interpolation error between frames, in contrast thresholds
sensor:
  voltmeter: {{ preset: davis346 }}
outputs: [events, sharp]
sharp: {{ fps: 30 }}                       # pictures per second
"
    )
}

/// Returns the same with the settings of the paper (3.5.1, 3.5.2, appendices A and C).
#[must_use]
pub fn paper_defaults_text(pace: CameraPace) -> String {
    // The preset must contain this text: without it, nothing is replaced and no error is shown.
    let settings = preset::PAPER.replacen("factor: 5", &format!("factor: {}", pace.factor()), 1);
    format!(
        "# Values that all recipes in this folder and below share. A recipe's own values win.\nseed: 20250521\n{settings}"
    )
}

/// Returns true if the `defaults.yaml` of a folder of recipes names the source of the Gaussians;
/// `None` if the file is absent.
///
/// # Errors
/// The file cannot be read.
pub fn defaults_reconstruct(folder: &Path) -> Result<Option<bool>, RecipeFaults> {
    let path = defaults_in(folder);
    if !is_there(&path) {
        return Ok(None);
    }
    let parts = RecipeParts::without_defaults(&path).map_err(RecipeFaults::new)?;
    Ok(Some(parts.has("reconstruct")))
}

/// Scene id of a recipe; `None` if the recipe cannot be read or has no scene id.
#[must_use]
pub fn scene_of(recipe: &Path) -> Option<String> {
    RecipeParts::without_defaults(recipe).ok()?.text("scene").map(str::to_owned)
}

/// Path of the defaults file of a folder of recipes.
#[must_use]
pub fn defaults_in(folder: &Path) -> PathBuf {
    folder.join(DEFAULTS)
}

/// Returns the path from a folder to a place, both as the user named them. The result is absolute
/// if the place is given by an absolute path, and otherwise relative.
///
/// # Errors
/// One of the two does not exist.
pub fn relative_path(from_folder: &Path, to: &Path) -> io::Result<PathBuf> {
    if to.is_absolute() {
        return Ok(to.to_owned());
    }
    // Links are resolved first, because `..` of a linked folder leads elsewhere.
    let (from, to) = (from_folder.canonicalize()?, to.canonicalize()?);
    let shared = from.iter().zip(to.iter()).take_while(|(a, b)| a == b).count();
    let up = from.iter().skip(shared).map(|_| "..");
    let way: PathBuf = up.map(Path::new).chain(to.iter().skip(shared).map(Path::new)).collect();
    Ok(if way.as_os_str().is_empty() { PathBuf::from(".") } else { way })
}
