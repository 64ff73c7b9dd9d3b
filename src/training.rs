//! Training of a scene from photos with known poses, on the CPU.
//!
//! ```text
//! photos, poses, points -> starting scene
//! each iteration: one view -> render -> loss and gradient -> gradients -> Adam
//! now and then:   split the Gaussians where the images are wrong; judge the held-out views
//! ```
//!
//! The rendering that is trained is the rendering that is used: the rules, the background and
//! antialiasing are those of [`TrainingSettings`]. The result has the same bits with any number of
//! threads and any instruction set, and after any number of interruptions: every draw is a function
//! of the seed and its place, and a checkpoint holds all that an iteration leaves behind.
//! `docs/training.md` has the laws, their sources and the trials.

mod adam;
mod checkpoint;
mod draws;
mod judge;
pub mod loss;
mod nearest;
pub mod photos;
mod placement;
mod schedule;
mod start;

pub use judge::{HeldOutFigures, HeldOutView};

use crate::image::Size;
use crate::render::cpu::backward::{GradientRenderer, MAX_GAUSSIANS, ViewGradients};
use crate::render::shared::least_alpha;
use crate::render::{LayerOrder, RenderChoice, RenderError, RenderRules, RenderStyle};
use crate::scene::Gaussians;
use crate::seed::Seed;
use crate::source::colmap::ColmapPoint;
use adam::{AdamMeans, BiasTable};
use draws::TrainingDraws;
use loss::ImageLoss;
use photos::TrainingViews;
use schedule::TrainingSchedule;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Parameters of a training. All of them may change the result.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrainingSettings {
    /// Number of Gaussians, at most.
    pub gaussians: u32,
    /// Number of iterations.
    pub iterations: u32,
    /// Width of the photos, px, at most.
    pub resolution: u32,
    /// Seed of all draws.
    pub seed: u64,
    /// Every n-th view is held out, the first included; 0 holds out none.
    pub hold_out: u32,
    /// Rendering rules.
    pub rules: RenderRules,
    /// True if opacity is compensated for the screen-space dilation.
    pub antialiased: bool,
    /// Colour behind the scene, 0..1.
    pub background: [f32; 3],
}

impl Default for TrainingSettings {
    fn default() -> Self {
        Self {
            gaussians: 200_000,
            iterations: 7000,
            resolution: 640,
            seed: 0,
            hold_out: 8,
            rules: RenderRules::Soft,
            antialiased: false,
            background: [0.0; 3],
        }
    }
}

impl TrainingSettings {
    /// This training, of another rendering.
    #[must_use]
    pub fn with_render(self, render: &RenderChoice) -> Self {
        // A scene that is trained says nothing yet, so `auto` is off.
        let RenderStyle { rules, antialiased, background, .. } = render.resolve(None);
        Self { rules, antialiased, background, ..self }
    }

    fn style(&self) -> RenderStyle {
        RenderStyle {
            rules: self.rules,
            order: LayerOrder::Depth,
            antialiased: self.antialiased,
            background: self.background,
        }
    }
}

/// The reason why a training failed. The texts complete the phrase "failed to ".
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// The training was asked to stop.
    #[error("finish: it was interrupted")]
    Stopped,
    /// Too few views are left to train on.
    #[error(
        "find photos to train on: of {views} views, {without_photo} have no photo and {held_out} are held out, \
         wanted at least {wanted} others"
    )]
    FewViews {
        /// Number of all views.
        views: usize,
        /// Number of views without a photo.
        without_photo: usize,
        /// Number of held-out views.
        held_out: usize,
        /// Smallest number.
        wanted: usize,
    },
    /// A photo cannot be used.
    #[error("read the photo {}: {because}", path.display())]
    Photo {
        /// The photo.
        path: PathBuf,
        /// The problem.
        because: String,
    },
    /// No view sees a point.
    #[error(
        "find a point in front of a camera: none of {points} points is in any photo; do poses and points share a world?"
    )]
    PointsUnseen {
        /// Number of points.
        points: usize,
    },
    /// The views have nothing in common, and the capture has no points.
    #[error(
        "place the first Gaussians: the capture has no points, and its {views} views show nothing in common"
    )]
    NoCommonView {
        /// Number of views.
        views: usize,
    },
    /// A value is not finite.
    #[error("train: iteration {iteration}, view `{view}`: the {what} is not finite")]
    NotFinite {
        /// The iteration, from 1.
        iteration: u32,
        /// Name of the view.
        view: String,
        /// The loss, or the gradient of a Gaussian.
        what: String,
    },
    /// A view cannot be rendered.
    #[error("render `{view}`: {cause}")]
    Render {
        /// Name of the view.
        view: String,
        /// The reason.
        cause: RenderError,
    },
    /// The settings cannot be trained.
    #[error("start: {0}")]
    Settings(String),
    /// A checkpoint cannot be read or written.
    #[error("use the checkpoint {}: {because}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The problem.
        because: String,
    },
}

/// The state of a training, for people.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainingReport {
    /// Finished iterations.
    pub iteration: u32,
    /// Iterations in all.
    pub iterations: u32,
    /// Mean loss since the last report.
    pub loss: f64,
    /// Mean PSNR of the held-out views, dB; `None` without held-out views.
    pub psnr: Option<f64>,
    /// Number of Gaussians.
    pub gaussians: usize,
}

/// Callbacks of a training, and its checkpoint.
pub struct TrainingWatch<'a> {
    /// Asked before every iteration. The training stops when it returns false.
    pub goes_on: &'a (dyn Fn() -> bool + Sync),
    /// Called about twenty times.
    pub report: &'a mut dyn FnMut(&TrainingReport),
    /// The checkpoint: read if it exists, and written with every report and when the training is
    /// stopped.
    pub checkpoint: Option<&'a Path>,
}

impl std::fmt::Debug for TrainingWatch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TrainingWatch").field("checkpoint", &self.checkpoint).finish_non_exhaustive()
    }
}

/// Number of reports of a training.
const REPORTS: u32 = 20;

/// A trained scene, and how well it shows the views that were held out.
#[derive(Debug)]
pub struct TrainedGaussians {
    /// The scene.
    pub scene: Gaussians,
    /// The held-out views.
    pub figures: HeldOutFigures,
}

/// Memory of a training, bytes: each Gaussian with its gradients, means and lists; the photos; the
/// buffers of one image. `views` are the sizes of the photos at the size of training.
#[must_use]
pub fn memory_needed(gaussians: u32, views: impl IntoIterator<Item = Size>) -> u64 {
    // Parameters, two means, the activated form, the splat, its sums and gradients, and six tiles of
    // 52 bytes.
    const BYTES_A_GAUSSIAN: u64 = 1300;
    // Three levels of a photo of 3 bytes.
    const BYTES_A_PHOTO_PIXEL: u64 = 4;
    // The image, its gradient, the slopes of the loss, the traced tiles.
    const BYTES_A_PIXEL: u64 = 96;
    let pixels = |size: Size| u64::from(size.width) * u64::from(size.height);
    let sum =
        |(sum, most): (u64, u64), size: Size| (sum.saturating_add(pixels(size)), most.max(pixels(size)));
    let (all, most) = views.into_iter().fold((0, 0), sum);
    let parts = [(u64::from(gaussians), BYTES_A_GAUSSIAN), (all, BYTES_A_PHOTO_PIXEL), (most, BYTES_A_PIXEL)];
    parts.into_iter().fold(0, |sum: u64, (count, bytes)| sum.saturating_add(count.saturating_mul(bytes)))
}

/// Trains a scene. `points` are those of the capture's model; without any, the start is drawn.
///
/// # Errors
/// See [`TrainingError`]. A stopped training has written its checkpoint.
pub fn train(
    views: &TrainingViews,
    points: &[ColmapPoint],
    settings: &TrainingSettings,
    watch: TrainingWatch<'_>,
) -> Result<TrainedGaussians, TrainingError> {
    let mut trainer = SceneTrainer::new(views, points, settings)?;
    let TrainingWatch { goes_on, report, checkpoint } = watch;
    let key = checkpoint::training_key(views, settings, trainer.renderer.scene());
    if let Some(path) = checkpoint {
        trainer.load(path, key)?;
    }
    let every = (settings.iterations / REPORTS).max(1);
    let mut sum = 0.0;
    while trainer.iteration < settings.iterations {
        if !goes_on() {
            checkpoint.map_or(Ok(()), |path| trainer.save(path, key))?;
            return Err(TrainingError::Stopped);
        }
        sum += trainer.step()?;
        if trainer.iteration.is_multiple_of(every) || trainer.iteration == settings.iterations {
            report(&trainer.report(sum / f64::from(every))?);
            sum = 0.0;
            checkpoint.map_or(Ok(()), |path| trainer.save(path, key))?;
        }
    }
    trainer.finish()
}

/// A training between two iterations.
struct SceneTrainer<'a> {
    views: &'a TrainingViews,
    settings: TrainingSettings,
    schedule: TrainingSchedule,
    draws: TrainingDraws,
    renderer: GradientRenderer,
    means: AdamMeans,
    /// Errors seen since the last placement, by Gaussian.
    scores: Vec<f32>,
    /// Finished iterations.
    iteration: u32,
    bias: BiasTable,
    loss: ImageLoss,
    found: ViewGradients,
}

impl<'a> SceneTrainer<'a> {
    fn new(
        views: &'a TrainingViews,
        points: &[ColmapPoint],
        settings: &TrainingSettings,
    ) -> Result<Self, TrainingError> {
        let budget = settings.gaussians as usize;
        if budget == 0 || budget > MAX_GAUSSIANS {
            return Err(TrainingError::Settings(format!("{budget} Gaussians, wanted 1 to {MAX_GAUSSIANS}")));
        }
        let draws = TrainingDraws::new(Seed(settings.seed));
        let mut scene = start::starting_scene(points, &views.shown, budget, &draws)?;
        scene.antialiased = settings.antialiased.then_some(true);
        let extent = start::CameraSpread::new(&views.shown).extent;
        let schedule =
            TrainingSchedule { iterations: settings.iterations, gaussians: [scene.len(), budget], extent };
        let mut means = AdamMeans::default();
        means.reserve(budget, scene.sh_len());
        means.resize(scene.len(), scene.sh_len());
        let scores = vec![0.0; scene.len()];
        reserve(&mut scene, budget);
        let renderer = GradientRenderer::new(scene, settings.style());
        let renderer = renderer.map_err(|e| TrainingError::Settings(e.to_string()))?;
        Ok(Self {
            views,
            settings: *settings,
            schedule,
            draws,
            renderer,
            means,
            scores,
            iteration: 0,
            bias: BiasTable::new(),
            loss: ImageLoss::default(),
            found: ViewGradients::default(),
        })
    }

    /// One iteration. Returns its loss.
    fn step(&mut self) -> Result<f64, TrainingError> {
        let view = &self.views.shown[self.draws.view(self.iteration, self.views.shown.len())];
        let (at, photo) = view.at_level(self.schedule.level(self.iteration));
        let not_finite = |what: String| TrainingError::NotFinite {
            iteration: self.iteration + 1,
            view: view.name.clone(),
            what,
        };
        let degree = self.schedule.degree(self.iteration);
        self.renderer.set_degree(degree);
        let rendered = self.renderer.render(&at);
        let (image, _) =
            rendered.map_err(|cause| TrainingError::Render { view: view.name.clone(), cause })?;
        let loss = self.loss.compare(image, photo);
        if !loss.is_finite() {
            return Err(not_finite("loss".to_owned()));
        }
        self.renderer.gradients(&self.loss.gradient, &self.loss.residual, &mut self.found);
        for (&number, gradient) in self.found.numbers.iter().zip(&self.found.gradients) {
            self.scores[number as usize] += gradient.score;
        }
        let rates = self.schedule.rates(self.iteration);
        let (means, found, bias) = (&mut self.means, &self.found, &self.bias);
        let stepped =
            self.renderer.change(&found.numbers, |scene| means.step(scene, found, (&rates, degree), bias));
        stepped
            .map_err(|adam::NotFinite { gaussian }| not_finite(format!("gradient of Gaussian {gaussian}")))?;
        self.iteration += 1;
        if self.schedule.places(self.iteration) {
            self.place();
        }
        Ok(loss)
    }

    /// Moves the dead Gaussians and adds others.
    fn place(&mut self) {
        let count = self.schedule.count_after(self.iteration, self.renderer.scene().len());
        let draws = self.draws.placement(self.iteration);
        let (means, scores) = (&mut self.means, &mut self.scores);
        self.renderer.rebuild(|scene| placement::place_gaussians(scene, means, scores, count, &draws));
    }

    fn report(&mut self, loss: f64) -> Result<TrainingReport, TrainingError> {
        let psnr = judge::mean_psnr(&mut self.renderer, &self.views.held_out)?;
        Ok(TrainingReport {
            iteration: self.iteration,
            iterations: self.settings.iterations,
            loss,
            psnr,
            gaussians: self.renderer.scene().len(),
        })
    }

    /// The scene without the Gaussians that no view would show, and its figures.
    fn finish(mut self) -> Result<TrainedGaussians, TrainingError> {
        self.renderer.set_degree(crate::scene::sh::MAX_DEGREE);
        let figures = judge::held_out_figures(&mut self.renderer, &self.views.held_out)?;
        let scene = without_invisible(self.renderer.into_scene(), self.settings.rules);
        Ok(TrainedGaussians { scene, figures })
    }
}

/// Room for `count` Gaussians, so that growth moves no array.
fn reserve(scene: &mut Gaussians, count: usize) {
    let more = count.saturating_sub(scene.len());
    scene.positions.reserve_exact(more);
    scene.log_scales.reserve_exact(more);
    scene.rotations.reserve_exact(more);
    scene.opacity_logits.reserve_exact(more);
    scene.sh.reserve_exact(more * scene.sh_len());
}

/// The scene without Gaussians that are not finite, or below the smallest opacity of the rules.
fn without_invisible(mut scene: Gaussians, rules: RenderRules) -> Gaussians {
    let least = f64::from(least_alpha(rules));
    let opacity = |logit: f32| 1.0 / (1.0 + libm::exp(-f64::from(logit)));
    let is_finite = |i: usize| {
        let geometry = scene.positions[i].iter().chain(&scene.log_scales[i]).chain(&scene.rotations[i]);
        geometry.chain(scene.sh_of(i).as_flattened()).all(|v| v.is_finite())
    };
    let kept: Vec<usize> =
        (0..scene.len()).filter(|&i| opacity(scene.opacity_logits[i]) >= least && is_finite(i)).collect();
    let functions = scene.sh_len();
    scene.positions = kept.iter().map(|&i| scene.positions[i]).collect();
    scene.log_scales = kept.iter().map(|&i| scene.log_scales[i]).collect();
    scene.rotations = kept.iter().map(|&i| scene.rotations[i]).collect();
    scene.opacity_logits = kept.iter().map(|&i| scene.opacity_logits[i]).collect();
    let harmonics = kept.iter().flat_map(|&i| &scene.sh[i * functions..(i + 1) * functions]);
    scene.sh = harmonics.copied().collect();
    scene.screening.read = kept.len() as u64;
    scene
}
