//! The report on a rendering: the Gaussians drawn and left out, the work, and the time.

use crate::cli::Console;
use gs2e_image::Size;
use gs2e_render::RenderWork;
use gs2e_scene::SceneScreening;
use serde_json::{Value, json};
use std::time::Duration;

/// Share of the drawn Gaussians with an invalid approximation above which a warning is printed.
/// Every scene has a few, near the camera.
const MANY: f64 = 0.01;

/// The report on a rendering.
pub(super) struct RenderAccount {
    pub(super) channel: String,
    /// Class of the back end.
    pub(super) backend: String,
    /// Name of the view within its source.
    pub(super) view: String,
    pub(super) size: Size,
    pub(super) work: RenderWork,
    pub(super) screening: SceneScreening,
    pub(super) reading: Duration,
    pub(super) rendering: Duration,
    /// Warnings about the command line and the view.
    pub(super) warnings: Vec<String>,
}

impl RenderAccount {
    /// Prints the report for people.
    pub(super) fn report(&self, console: &Console) {
        let Self { channel, backend, view, size, work, .. } = self;
        let [reading, rendering] = [self.reading, self.rendering].map(|time| time.as_secs_f64());
        console.note(&format!(
            "{channel} of {view}, {size}: rendered by {backend} in {rendering:.3} s; read in {reading:.3} s"
        ));
        let hidden = match 100 * work.hidden / work.tile_pairs.max(1) {
            0 => String::new(),
            percent => format!(", {percent} % of them hidden"),
        };
        let pairs = match work.tile_pairs {
            0 => String::new(),
            pairs => format!("{pairs} splat-tile pairs{hidden}, "),
        };
        // Counts are per pixel of the whole picture, the empty ones included.
        let a_pixel = work.blended as f64 / size.pixels() as f64;
        let (drawn, all) = (work.drawn(), work.gaussians);
        console.note(&format!("{drawn} of {all} Gaussians drawn, {pairs}{a_pixel:.2} blended per pixel"));
        if work.zero_harmonics > 0 {
            let each = work.zero_harmonics / drawn.max(1);
            console.note(&format!("{each} harmonics per Gaussian are zero in the whole scene and left out"));
        }
        self.warnings().iter().for_each(|warning| console.note(&format!("warning: {warning}")));
    }

    fn warnings(&self) -> Vec<String> {
        let SceneScreening { read, non_finite, zero_quaternions } = self.screening;
        let RenderWork { gaussians, degenerate, affine_invalid, .. } = self.work;
        let drawn = self.work.drawn();
        let counted = [
            (non_finite > 0).then(|| {
                format!("{non_finite} of {read} Gaussians in the file hold a NaN or an infinity and are left out")
            }),
            (zero_quaternions > 0)
                .then(|| format!("{zero_quaternions} of {read} rotations in the file are zero: the identity is used")),
            (degenerate > 0).then(|| {
                format!("{degenerate} of {gaussians} Gaussians have a non-finite projection and are left out")
            }),
            (affine_invalid as f64 > MANY * drawn as f64).then(|| {
                let share = 100.0 * affine_invalid as f64 / drawn as f64;
                format!(
                    "{affine_invalid} of {drawn} Gaussians drawn ({share:.1} %) extend so far in depth, relative to their distance, that \
                     their projection is inaccurate"
                )
            }),
            (drawn == 0).then(|| "no Gaussian is in the picture: it shows only the background".to_owned()),
        ];
        self.warnings.iter().cloned().chain(counted.into_iter().flatten()).collect()
    }

    /// The report for programs.
    pub(super) fn to_json(&self) -> Value {
        json!({
            "channel": self.channel, "backend": self.backend, "view": self.view,
            "width": self.size.width, "height": self.size.height,
            "work": self.work, "screening": self.screening,
            "seconds": { "read": self.reading.as_secs_f64(), "render": self.rendering.as_secs_f64() },
            "warnings": self.warnings(),
        })
    }
}
