//! Work left out for a trajectory, one row per kind: the kind of work, the amount, the total, and
//! the proof that nothing is lost, or else the loss.
//!
//! Rows with identical bytes are those that `--no-omit` computes after all. By construction, and by
//! tests that compare both, they change no bit. The other rows remain: they belong to the law of
//! the sensor or to the recipe.

use gs2e_build::artifact::{ArtifactError, ArtifactFiles, EventStream, SimulationRecord};
use gs2e_build::stage::Stage as _;
use gs2e_build::stage::events::EventsStage;
use gs2e_recipe::OutputKind;
use gs2e_render::RenderWork;
use gs2e_render::backend::Backend;
use gs2e_scene::sh;
use gs2e_sensor::QuietCells;
use serde::{Deserialize, Serialize};

/// One kind of omitted work.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OmissionRow {
    /// Stage that left it out.
    pub step: String,
    /// Kind of work.
    pub what: String,
    /// Amount over the whole trajectory; above 0.
    pub how_much: u64,
    /// Total; `None` if it is not known.
    pub of: Option<u64>,
    /// Unit of both numbers.
    pub unit: String,
    /// The reason why nothing is lost, or else the loss.
    pub proof: String,
}

/// Returns true if a stage renders frames, and can therefore leave work out: the stage of an output.
#[must_use]
pub fn is_rendering(stage: &str) -> bool {
    OutputKind::ALL.iter().any(|output| !output.is_measured() && output.name() == stage)
}

/// Proof of a row whose work does not change the output.
const IDENTICAL: &str = "identical bytes";

/// The rows of a step of this stage and numerical class, from the files that it wrote; empty if
/// nothing was left out.
///
/// # Errors
/// Its files cannot be read.
pub fn of_step(
    stage: &str,
    class: Option<&str>,
    files: &ArtifactFiles,
) -> Result<Vec<OmissionRow>, ArtifactError> {
    match stage {
        EventsStage::NAME => Ok(of_events(&files.json("simulation.json")?, class.unwrap_or_default())),
        // `work.json` does not have the degree of the scene, so the whole of the harmonics stays unknown.
        other if is_rendering(other) => Ok(of_work(stage, &files.json("work.json")?, None)),
        _ => Ok(Vec::new()),
    }
}

/// An amount of work, of a whole where that is known.
#[derive(Clone, Copy)]
struct WorkAmount {
    how_much: u64,
    of: Option<u64>,
    unit: &'static str,
}

fn omission_row(step: &str, what: &str, amount: WorkAmount, proof: &str) -> Option<OmissionRow> {
    let WorkAmount { how_much, of, unit } = amount;
    let [step, what, unit, proof] = [step, what, unit, proof].map(str::to_owned);
    (how_much > 0).then_some(OmissionRow { step, what, how_much, of, unit, proof })
}

/// Work that a renderer left out. `sh_degree` is the degree of the scene, if it is known.
fn of_work(step: &str, work: &RenderWork, sh_degree: Option<u8>) -> Vec<OmissionRow> {
    // Only drawn Gaussians evaluate harmonics.
    let harmonics = sh_degree.map(|degree| work.drawn() * sh::function_count(degree) as u64);
    [
        omission_row(
            step,
            "Gaussians that no pose sees",
            WorkAmount { how_much: work.unseen, of: Some(work.gaussians), unit: "Gaussian-frames" },
            IDENTICAL,
        ),
        omission_row(
            step,
            "harmonics that are zero in the whole scene",
            WorkAmount { how_much: work.zero_harmonics, of: harmonics, unit: "harmonics" },
            IDENTICAL,
        ),
        omission_row(
            step,
            "splat-tile pairs hidden behind opaque tiles",
            WorkAmount { how_much: work.hidden, of: Some(work.tile_pairs), unit: "pairs" },
            IDENTICAL,
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn of_events(simulation: &SimulationRecord, class: &str) -> Vec<OmissionRow> {
    let step = EventsStage::NAME;
    let mut rows = of_work(step, &simulation.work, Some(simulation.sh_degree));
    rows.extend(colour_row(simulation, class));
    for stream in &simulation.streams {
        let of = |what: &str| stream.name.as_ref().map_or(what.to_owned(), |name| format!("{what}, {name}"));
        if let Some(QuietCells { quiet, all, missed_ln }) = quiet_cells(simulation, stream) {
            let proof = format!("error: misses an event with probability below e^-{missed_ln} per cell");
            let what = of("time cells of pixels far from any threshold");
            rows.extend(omission_row(
                step,
                &what,
                WorkAmount { how_much: quiet, of: Some(all), unit: "cells" },
                &proof,
            ));
        }
        let (kept, capped) = (stream.account.events, stream.account.capped);
        // The account counts the written events apart from those beyond the cap, so the whole is their sum.
        let what = of("events beyond the cap");
        rows.extend(omission_row(
            step,
            &what,
            WorkAmount { how_much: capped, of: Some(kept + capped), unit: "events" },
            "error: these events are missing",
        ));
    }
    rows
}

/// Frames whose colours were not blended, because no sensor sees them. The reference back end
/// blends them nevertheless.
fn colour_row(simulation: &SimulationRecord, class: &str) -> Option<OmissionRow> {
    let seen = !simulation.omit.is_needless() || simulation.front_ends().iter().any(|f| f.needs_colour());
    let proof = match class {
        class if Backend::is_cpu(class) => IDENTICAL,
        class if Backend::is_gpu(class) => "error: GPU rounding",
        _ => return None,
    };
    // Gaussian-frames divided by Gaussians. Without Gaussians there is no row.
    let frames = simulation.work.gaussians.checked_div(simulation.gaussians as u64).filter(|_| !seen)?;
    omission_row(
        EventsStage::NAME,
        "colours that no sensor sees",
        WorkAmount { how_much: frames, of: Some(frames), unit: "frames" },
        proof,
    )
}

/// Cells of the clock of a stream's pixels.
fn quiet_cells(simulation: &SimulationRecord, stream: &EventStream) -> Option<QuietCells> {
    let stamps = &simulation.brightness_stamps_us;
    let span_us = stamps.last()? - stamps.first()?;
    stream.sensor.as_model().quiet_cells(&stream.account, simulation.camera.size, span_us)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_render_have_the_names_of_their_outputs() {
        assert!(is_rendering("flow") && !is_rendering("trajectory") && !is_rendering("imu"));
    }
}
