//! `gs2e train`: trains a scene on the photos of a capture.

use super::words::{TRAINED, one_of};
use super::{CommonArgs, Console, ExitKind, VerbError, input, machine, output, path};
use gs2e_build::run;
use gs2e_num::units::format_amount;
use gs2e_render::RenderRules;
use gs2e_render::backend::Backend;
use gs2e_scene::ply::write_ply;
use gs2e_source::kind::CaptureKind;
use gs2e_source::{Capture, DiskCapture, SourceWarning};
use gs2e_train::{
    self as training, CheckpointFile, TrainedGaussians, TrainingEnd, TrainingError, TrainingGoal,
    TrainingSettings, TrainingWatch,
};
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Arguments of `train`.
#[derive(Debug, clap::Args)]
pub(super) struct TrainArgs {
    /// Capture with photos: a COLMAP model or a transforms.json
    #[arg(long, value_name = "FILE or DIR")]
    capture: PathBuf,
    /// File for the scene: a .ply
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Number of Gaussians, at most
    #[arg(long, value_name = "N", default_value_t = TrainingSettings::default().gaussians, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    gaussians: u32,
    /// Number of iterations; each shows one photo
    #[arg(long, value_name = "N", default_value_t = TrainingSettings::default().iterations, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    iterations: u32,
    /// Width of the photos in pixels; wider ones are scaled down
    #[arg(long, value_name = "PX", default_value_t = TrainingSettings::default().resolution, value_parser = clap::value_parser!(u32).range(16..=16_384))]
    resolution: u32,
    /// Seed of all draws
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Hold out every N-th photo, the first included, and judge the scene by them; 0 holds out none
    #[arg(long, value_name = "N", default_value_t = TrainingSettings::default().hold_out)]
    hold_out: u32,
    /// End when the held-out photos are shown this well in the mean
    #[arg(long, value_name = "DB", value_parser = positive)]
    until_psnr: Option<f64>,
    /// End after this time. The scene then depends on the speed of the machine
    #[arg(long, value_name = "MINUTES", value_parser = positive)]
    until_minutes: Option<f64>,
    /// Conventions of the renderings that are trained
    #[arg(long, value_parser = one_of(&TRAINED), default_value = "soft")]
    rule: RenderRules,
    /// File that keeps the state: an interrupted training goes on from it
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Memory for the training, as 8GB or 500MB [default: 80 % of the free memory]
    #[arg(long, value_name = "BYTES", value_parser = machine::parse_bytes)]
    memory: Option<u64>,
}

/// The back end of the training: the CPU unless a GPU is requested.
fn trained_backend(common: &CommonArgs) -> Result<Backend, VerbError> {
    match common.backend()? {
        Backend::Reference => {
            let what = "--backend reference has no gradients";
            Err(VerbError::usage("backend", what).help("train with --backend cpu or --backend gpu"))
        }
        backend => Ok(backend),
    }
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let wanted = || format!("`{text}` is not a number above 0");
    text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0).ok_or_else(wanted)
}

impl TrainArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        output::screen_outputs([self.out.as_path()], [self.capture.as_path()], console.json)?;
        self.check_names()?;
        let backend = trained_backend(common)?;
        common.limit_cores();
        let stop = super::on_interrupt()?;
        let began = Instant::now();
        let disk = self.disk()?;
        let (capture, warnings) = disk.read().map_err(|e| input::unreadable_file("capture", &e))?;
        // The photos are straightened here, so the warning about their distortion does not apply.
        for warning in warnings.iter().filter(|w| !matches!(w, SourceWarning::DistortionIgnored { .. })) {
            console.note(&format!("warning: {warning}"));
        }
        self.refuse_memory(&capture)?;
        let files = disk.files().map_err(|e| input::unreadable_file("capture", &e))?;
        let watch = TrainingWatch {
            goes_on: &|| !stop.load(Ordering::Relaxed),
            news: &mut |news| console.note(&news.to_string()),
            clock: Some(run::monotonic_seconds),
            checkpoint: self.checkpoint.as_deref().map(|path| CheckpointFile { path, replaces: false }),
        };
        let trained = training::train_capture(&capture, &files, &self.settings(), &backend, watch)
            .map_err(|e| self.to_error(&e))?;
        output::write_output(&self.out, |out| write_ply(&trained.scene, out))?;
        self.report(&trained, began, console);
        Ok(ExitKind::Done)
    }

    fn check_names(&self) -> Result<(), VerbError> {
        if self.out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
            let what = format!("{}: a trained scene is written as .ply", self.out.display());
            return Err(VerbError::usage("format", what).help("gs2e convert writes other formats"));
        }
        let Some(checkpoint) = &self.checkpoint else { return Ok(()) };
        output::screen_outputs([self.out.as_path(), checkpoint.as_path()], [], false)
    }

    /// The capture on disk.
    fn disk(&self) -> Result<DiskCapture, VerbError> {
        let place = &self.capture;
        let kind = CaptureKind::with_photos(place).map_err(|e| input::no_source("capture", &e, place))?;
        let Some(kind) = kind else {
            let what = format!("{} is a 3DGS model folder, which has no photos", place.display());
            return Err(VerbError::usage("no-photos", what).help("pass the capture that it was trained on"));
        };
        Ok(DiskCapture::all_views(kind, place.clone()))
    }

    /// Refuses a training that needs more memory than it may take.
    fn refuse_memory(&self, capture: &Capture) -> Result<(), VerbError> {
        let needed = training::memory_needed(&self.settings(), &capture.views);
        let budget = self.memory.unwrap_or_else(machine::free_memory);
        if needed <= budget {
            return Ok(());
        }
        let [needed, budget] = [needed, budget].map(|bytes| format_amount(bytes, "B"));
        let what = format!("the training needs about {needed} of memory, budget {budget}");
        Err(VerbError::usage("memory", what).help("lower --gaussians or --resolution"))
    }

    fn settings(&self) -> TrainingSettings {
        TrainingSettings {
            gaussians: self.gaussians,
            iterations: self.iterations,
            resolution: self.resolution,
            seed: self.seed,
            hold_out: self.hold_out,
            rules: self.rule,
            until: TrainingGoal { psnr: self.until_psnr, minutes: self.until_minutes },
            ..TrainingSettings::default()
        }
    }

    fn to_error(&self, error: &TrainingError) -> VerbError {
        let what = format!("failed to {error}");
        match error {
            TrainingError::Stopped => {
                let kept = match &self.checkpoint {
                    Some(file) => format!("the same command goes on from {}", file.display()),
                    None => "nothing was written; --checkpoint keeps the state".to_owned(),
                };
                VerbError::interrupted(format!("interrupted: {kept}"))
            }
            TrainingError::FewViews { .. }
            | TrainingError::PointsUnseen { .. }
            | TrainingError::NoCommonView { .. } => VerbError::usage("capture", what),
            TrainingError::Photo { .. } | TrainingError::Points(_) => {
                VerbError::failed("input-unreadable", what)
            }
            TrainingError::Settings(_) => VerbError::usage("training", what),
            TrainingError::Checkpoint { .. } => VerbError::failed("checkpoint", what),
            TrainingError::NotFinite { .. } | TrainingError::Render { .. } => {
                VerbError::failed("step-failed", what)
            }
        }
    }

    fn report(&self, trained: &TrainedGaussians, began: Instant, console: &Console) {
        let TrainedGaussians { scene, record, .. } = trained;
        let out = self.out.display();
        let seconds = began.elapsed().as_secs_f64();
        let means = record.means();
        let held = means.map_or_else(String::new, |[psnr, ssim]| {
            format!("; {} held-out photos: {psnr:.2} dB, SSIM {ssim:.4}", record.held_out.len())
        });
        let early = match record.ended {
            TrainingEnd::Iterations => String::new(),
            TrainingEnd::Psnr => format!(" and {} iterations: the PSNR is reached", record.iterations),
            TrainingEnd::Minutes => format!(" and {} iterations: the time is used up", record.iterations),
        };
        console.note(&format!("{out}: {} Gaussians in {seconds:.0} s{early}{held}", scene.len()));
        let [psnr, ssim] = means.map_or([None; 2], |means| means.map(Some));
        console.result(&json!({
            "file": path(&self.out), "gaussians": scene.len(), "iterations": record.iterations,
            "ended": record.ended, "seconds": seconds, "psnr": psnr, "ssim": ssim,
            "held_out": record.held_out,
        }));
    }
}
