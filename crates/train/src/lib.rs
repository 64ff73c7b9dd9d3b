//! Training of a scene from photos with known poses, on the CPU or with the gradients of a GPU.
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
//! of the seed and its place, and a checkpoint holds all that an iteration leaves behind. A GPU and its
//! driver have bytes of their own.
//! `docs/design/numerics-rendering.md`, "Training" has the laws and their sources,
//! `crates/lab/results/training.md` the trials.
//!
//! It takes photos, poses and points from `gs2e-source` and renders with `gs2e-render`; the result is a
//! scene of `gs2e-scene`. Seeds come from `gs2e-num`, images and their likeness from `gs2e-image`, and
//! `gs2e-files` writes checkpoints. `gs2e-recipe` reads the settings and `gs2e-build` runs the training.
//! `gs2e-check` judges the held-out views, and `gs2e-release` contains the record.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::Size;
//! use gs2e_train::{TrainingGoal, TrainingSettings, fidelity::HeldOutViews, photos::trained_size};
//!
//! let until = TrainingGoal { minutes: Some(10.0), ..TrainingGoal::default() };
//! let settings = TrainingSettings { resolution: 320, hold_out: 4, until, ..TrainingSettings::default() };
//! // A photo of 1280x720 is trained on at a quarter of its width.
//! let size = trained_size(Size { width: 1280, height: 720 }, settings.resolution);
//! assert_eq!(size, Size { width: 320, height: 180 });
//! // The first of every four views only judges.
//! let held_out = HeldOutViews::by_training(settings.hold_out);
//! assert!(held_out.holds_out(4) && !held_out.holds_out(5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod adam;
mod checkpoint;
mod draws;
mod error;
pub mod fidelity;
mod judge;
mod loss;
mod memory;
mod nearest;
pub mod photos;
mod placement;
mod reach;
mod record;
mod renderer;
mod schedule;
mod settings;
mod start;
mod sweep;
#[cfg(test)]
mod tests;
mod watch;

pub use error::TrainingError;
pub use memory::memory_needed;
pub use record::{CoursePoint, HeldOutView, TrainingEnd, TrainingRecord};
pub use settings::{TrainingGoal, TrainingSettings};
pub use watch::{CheckpointFile, TrainingNews, TrainingReport, TrainingWatch};

use adam::{AdamMeans, BiasTable};
use draws::TrainingDraws;
use glam::DVec3;
use gs2e_num::seed::Seed;
use gs2e_render::backend::Backend;
use gs2e_render::cpu::backward::{MAX_GAUSSIANS, ViewGradients};
use gs2e_render::shared::least_alpha;
use gs2e_render::{RenderError, RenderRules};
use gs2e_scene::Gaussians;
use gs2e_source::Capture;
use gs2e_source::colmap::ColmapPoint;
use gs2e_source::reconstruct::model_points;
use loss::ImageLoss;
use photos::TrainingViews;
use renderer::TrainingRenderer;
use schedule::TrainingSchedule;
use std::path::PathBuf;
use watch::TrainingPace;

/// Number of the laws of training. Raise it when equal settings and photos make other bytes: it is
/// part of a step's key.
pub const LAWS: u32 = 5;

/// Number of reports of a training.
const REPORTS: u32 = 20;

/// A trained scene, and its record.
#[derive(Debug)]
pub struct TrainedGaussians {
    /// The scene.
    pub scene: Gaussians,
    /// The record of the training.
    pub record: TrainingRecord,
    /// Number of views without a photo.
    pub without_photo: usize,
}

/// Reads the photos and the points of a capture, and trains a scene. `files` are the files of the
/// capture's source, by their names in the source. Without points, the start is drawn. `backend`
/// renders and computes the gradients: the CPU or a GPU.
///
/// # Errors
/// See [`TrainingError`]. A training that is stopped, or ended by the clock, has written its
/// checkpoint.
pub fn train_capture(
    capture: &Capture,
    files: &[(String, PathBuf)],
    settings: &TrainingSettings,
    backend: &Backend,
    watch: TrainingWatch<'_>,
) -> Result<TrainedGaussians, TrainingError> {
    let views = TrainingViews::read(capture, files, settings.resolution, settings.hold_out, watch.goes_on)?;
    let points = model_points(files).map_err(|cause| TrainingError::Points(Box::new(cause)))?;
    let [training, held_out] = [views.training.len(), views.held_out.len()];
    (watch.news)(&TrainingNews::Read { training, held_out, points: points.len() });
    let mut trainer = SceneTrainer::new(&views, &points, settings, backend)?;
    let ended = trainer.run(watch)?;
    trainer.finish(ended)
}

/// A training between two iterations.
struct SceneTrainer<'a> {
    views: &'a TrainingViews,
    settings: TrainingSettings,
    schedule: TrainingSchedule,
    draws: TrainingDraws,
    backend: Backend,
    renderer: TrainingRenderer,
    means: AdamMeans,
    /// Errors seen since the last placement, by Gaussian.
    scores: Vec<f32>,
    /// Finished iterations.
    iteration: u32,
    /// Sum of the losses since the last report.
    losses: f64,
    course: Vec<CoursePoint>,
    bias: BiasTable,
    loss: ImageLoss,
    found: ViewGradients,
}

impl<'a> SceneTrainer<'a> {
    fn new(
        views: &'a TrainingViews,
        points: &[ColmapPoint],
        settings: &TrainingSettings,
        backend: &Backend,
    ) -> Result<Self, TrainingError> {
        let budget = settings.gaussians as usize;
        if budget == 0 || budget > MAX_GAUSSIANS {
            return Err(TrainingError::Settings(format!("{budget} Gaussians, wanted 1 to {MAX_GAUSSIANS}")));
        }
        let draws = TrainingDraws::new(Seed(settings.seed));
        let mut scene = start::starting_scene(points, &views.training, budget, &draws)?;
        scene.antialiased = settings.antialiased.then_some(true);
        let extent = start::CameraSpread::new(&views.training).extent;
        let sizes = views.training.iter().map(|view| view.at_level(0).0.camera.size.pixels());
        let pixels = sizes.sum::<usize>() as f64 / views.training.len() as f64;
        let gaussians = [scene.len(), budget];
        let schedule = TrainingSchedule { iterations: settings.iterations, gaussians, extent, pixels };
        let mut means = AdamMeans::default();
        means.reserve(budget, scene.sh_len());
        means.resize(scene.len(), scene.sh_len());
        let scores = vec![0.0; scene.len()];
        reserve(&mut scene, budget);
        let renderer = TrainingRenderer::new(backend, scene, settings.style());
        let renderer = renderer.map_err(|e| TrainingError::Settings(e.to_string()))?;
        Ok(Self {
            views,
            settings: *settings,
            schedule,
            draws,
            backend: backend.clone(),
            renderer,
            means,
            scores,
            iteration: 0,
            losses: 0.0,
            course: Vec::new(),
            bias: BiasTable::new(),
            loss: ImageLoss::default(),
            found: ViewGradients::default(),
        })
    }

    /// One iteration. Returns its loss.
    fn step(&mut self) -> Result<f64, TrainingError> {
        let view = &self.views.training[self.draws.view(self.iteration, self.views.training.len())];
        let (at, photo) = view.at_level(self.schedule.level(self.iteration));
        let not_finite = |what: String| TrainingError::NotFinite {
            iteration: self.iteration + 1,
            view: view.name.clone(),
            what,
        };
        let degree = self.schedule.degree(self.iteration);
        self.renderer.set_degree(degree);
        let not_rendered = |cause| TrainingError::Render { view: view.name.clone(), cause };
        let (image, _) = self.renderer.render(&at).map_err(not_rendered)?;
        let loss = self.loss.compare(image, photo);
        if !loss.is_finite() {
            return Err(not_finite("loss".to_owned()));
        }
        let gradients = self.renderer.gradients(&self.loss.gradient, &self.loss.residual, &mut self.found);
        gradients.map_err(not_rendered)?;
        for (&number, gradient) in self.found.numbers.iter().zip(&self.found.gradients) {
            self.scores[number as usize] += gradient.score;
        }
        let rates = self.schedule.rates(self.iteration);
        let steps = adam::StepSizes { rates: &rates, degree, bias: &self.bias };
        let (means, found) = (&mut self.means, &self.found);
        let stepped = self.renderer.change(&found.numbers, |scene| means.step(scene, found, &steps));
        stepped
            .map_err(|adam::NotFinite { gaussian }| not_finite(format!("gradient of Gaussian {gaussian}")))?;
        self.iteration += 1;
        if self.schedule.places(self.iteration) {
            self.place().map_err(not_rendered)?;
        }
        if self.schedule.limits(self.iteration) {
            let centres: Vec<DVec3> =
                self.views.training.iter().map(|view| view.world_from_camera.translation).collect();
            self.renderer.rebuild(|scene| reach::limit_sizes(scene, &centres)).map_err(not_rendered)?;
        }
        Ok(loss)
    }

    /// Moves the dead Gaussians and adds others.
    fn place(&mut self) -> Result<(), RenderError> {
        let count = self.schedule.count_after(self.iteration, self.renderer.scene().len());
        let draws = self.draws.placement(self.iteration);
        let (means, scores) = (&mut self.means, &mut self.scores);
        let place = |scene: &mut Gaussians| placement::place_gaussians(scene, means, scores, count, &draws);
        self.renderer.rebuild(place).map(drop)
    }

    /// Adds a point to the course, and reports it.
    fn report(&mut self, pace: &TrainingPace) -> Result<TrainingReport, TrainingError> {
        let point = CoursePoint {
            iteration: self.iteration,
            loss: self.losses / f64::from(self.iterations_per_report()),
            psnr: judge::mean_psnr(&mut self.renderer, &self.views.held_out)?,
            gaussians: self.renderer.scene().len() as u64,
        };
        self.losses = 0.0;
        self.course.push(point);
        let seconds_left = pace.seconds_left(&self.schedule, self.iteration);
        Ok(TrainingReport { point, iterations: self.settings.iterations, seconds_left })
    }

    fn iterations_per_report(&self) -> u32 {
        (self.settings.iterations / REPORTS).max(1)
    }

    /// Returns true if a report follows this iteration.
    fn reports_at(&self, iteration: u32) -> bool {
        iteration.is_multiple_of(self.iterations_per_report()) || iteration == self.settings.iterations
    }

    /// The iterations up to this one that a report follows.
    fn reports_until(&self, iteration: u32) -> Vec<u32> {
        (1..=iteration).filter(|iteration| self.reports_at(*iteration)).collect()
    }

    /// The reason to end now, if there is one. After a resumption it is the same as before.
    fn ends(&self, pace: &TrainingPace) -> Option<TrainingEnd> {
        let TrainingGoal { psnr, minutes } = self.settings.until;
        let last = self.course.last().filter(|point| point.iteration == self.iteration);
        let exceeds = |value: Option<f64>, limit: Option<f64>| value.zip(limit).is_some_and(|(v, l)| v >= l);
        if self.iteration == self.settings.iterations {
            Some(TrainingEnd::Iterations)
        } else if exceeds(last.and_then(|point| point.psnr), psnr) {
            Some(TrainingEnd::Psnr)
        } else if exceeds(pace.seconds(), minutes.map(|minutes| 60.0 * minutes)) {
            Some(TrainingEnd::Minutes)
        } else {
            None
        }
    }

    /// All iterations that are left.
    fn run(&mut self, watch: TrainingWatch<'_>) -> Result<TrainingEnd, TrainingError> {
        let TrainingWatch { goes_on, news, clock, checkpoint } = watch;
        let key = self.key();
        if let Some(file) = checkpoint
            && let Some(because) = self.resume(file, key)?
        {
            news(&TrainingNews::Restarted { because });
        }
        let keep = |trainer: &Self| {
            trainer.check_state()?;
            checkpoint.map_or(Ok(()), |file| trainer.save(file.path, key))
        };
        let pace = TrainingPace::new(clock, self.iteration);
        loop {
            if let Some(ended) = self.ends(&pace) {
                // Between two reports, only the clock ends a training. A later one may go on.
                (ended == TrainingEnd::Minutes).then(|| keep(self)).transpose()?;
                return Ok(ended);
            }
            if !goes_on() {
                keep(self)?;
                return Err(TrainingError::Stopped);
            }
            self.losses += self.step()?;
            if self.reports_at(self.iteration) {
                news(&TrainingNews::Report(self.report(&pace)?));
                keep(self)?;
            }
        }
    }

    /// The scene without the Gaussians that no view would show, and its record.
    fn finish(mut self, ended: TrainingEnd) -> Result<TrainedGaussians, TrainingError> {
        self.renderer.set_degree(gs2e_scene::sh::MAX_DEGREE);
        let record = TrainingRecord {
            iterations: self.iteration,
            ended,
            photos: self.views.training.len(),
            held_out: judge::held_out_figures(&mut self.renderer, &self.views.held_out)?,
            course: self.course,
        };
        let scene = without_invisible(self.renderer.into_scene(), self.settings.rules);
        Ok(TrainedGaussians { scene, record, without_photo: self.views.without_photo })
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
