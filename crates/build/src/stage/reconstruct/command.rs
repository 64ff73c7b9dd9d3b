//! A program that trains a scene on the capture.

use crate::stage::capture::{CaptureStage, SolvedInputs};
use crate::stage::fidelity::{FidelityStage, views_taken};
use crate::stage::{SourceFile, StageContext, StageError, StageFacts as _};
use gs2e_files as files;
use gs2e_files::{Removal, is_there};
use gs2e_render::RenderChoice;
use gs2e_render::backend::Backend;
use gs2e_scene::Gaussians;
use gs2e_source::Capture;
use gs2e_source::reconstruct::{LAYOUT, ProgramWorkspace, TrainedScene, TrainerCommand};
use gs2e_train::fidelity::HeldOutViews;
use gs2e_train::fidelity::sheet::ComparisonSheet;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;

/// Parameters: the program, and the form in which it gets the capture.
#[derive(Debug, Serialize)]
pub struct TrainingStage {
    /// The program.
    #[serde(flatten)]
    command: TrainerCommand,
    /// See [`LAYOUT`].
    layout: u32,
    /// Location of its photos and points.
    #[serde(skip)]
    source: CaptureStage,
    /// Rendering for the comparison with the photos.
    #[serde(skip)]
    render: RenderChoice,
}

impl TrainingStage {
    pub(super) fn new(command: &TrainerCommand, source: CaptureStage, render: RenderChoice) -> Self {
        Self { command: command.clone(), layout: LAYOUT, source, render }
    }

    pub(super) fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        let mut files = self.source.photos_and_points()?;
        for (name, path) in &self.command.files {
            if !is_there(path) {
                return Err(StageError::Missing { path: path.clone() });
            }
            // The prefix keeps a file of the command apart from a photo of the same name.
            files.push(SourceFile { name: format!("of the command: {name}"), path: path.clone() });
        }
        Ok(files)
    }

    pub(super) fn source_folders(&self) -> Vec<PathBuf> {
        self.source.source_folders()
    }

    pub(super) fn programs(&self) -> Vec<String> {
        self.command.lines()
    }

    pub(super) fn run(
        &self,
        capture: &Capture,
        solved: &SolvedInputs,
        cx: &mut StageContext<'_>,
    ) -> Result<Gaussians, StageError> {
        if !cx.allows_commands {
            return Err(StageError::Refused { programs: self.programs() });
        }
        let folder = cx.out.join("training");
        std::fs::create_dir(&folder).map_err(StageError::io_error(&folder))?;
        let log = cx.log.clone().unwrap_or_else(|| folder.join("log.txt"));
        let files = self.source.training_files(solved)?;
        let workspace = ProgramWorkspace {
            folder: &folder,
            log: &log,
            goes_on: &|| !cx.is_cancelled(),
            programs: &cx.programs,
        };
        let trained = self.command.train(capture, &files, workspace);
        let TrainedScene { gaussians, without_photo } = trained?;
        // Nothing in this folder is part of the product.
        files::remove(&folder, Removal::Tree).map_err(StageError::io_error(&folder))?;
        let gaussians = Arc::new(gaussians);
        self.hold(capture, solved, &gaussians, cx)?;
        if without_photo > 0 {
            cx.warnings
                .push(format!("{without_photo} views were not used for training: their photos are missing"));
        }
        Ok(Arc::unwrap_or_clone(gaussians))
    }

    /// Compares the scene with the photos of the views that trainers hold out by convention. It
    /// renders on the CPU, because the decision to keep a scene must not depend on the machine.
    fn hold(
        &self,
        capture: &Capture,
        solved: &SolvedInputs,
        gaussians: &Arc<Gaussians>,
        cx: &StageContext<'_>,
    ) -> Result<(), StageError> {
        let photos = self.source.all_photos(solved)?;
        let (render, capturing) = (self.render, self.source.clone());
        let comparison =
            FidelityStage { render, held_out: HeldOutViews::Unknown, capturing, backend: Backend::Cpu };
        let mut taken = views_taken(capture, &photos);
        taken.retain(|(i, ..)| comparison.held_out.holds_out(*i));
        let fidelity = comparison.measure(gaussians, &taken, &mut ComparisonSheet::default(), cx)?;
        let held = fidelity.hold(self.command.min_psnr);
        held.map_err(StageError::work_failed("compare the trained scene with its photos"))
    }
}
