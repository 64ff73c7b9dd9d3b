//! Answers on the content of the dataset.

use super::{AnswerContext, SAMPLE, counted_list};
use crate::datasheet::{DatasheetEntry, UNKNOWN};
use crate::facts::FileCounts;
use crate::products::{ReleaseProduct, products};
use crate::published::PublishedScene;
use std::fmt::Write as _;

impl AnswerContext<'_> {
    pub(in crate::datasheet) fn composition(&self) -> Vec<DatasheetEntry> {
        let none = "No.".to_owned();
        vec![
            ("What do the instances represent?", self.instances()),
            ("How many instances are there?", self.how_many()),
            ("Is it all possible instances, or a sample?", SAMPLE.to_owned()),
            ("What data does each instance consist of?", self.each_instance()),
            ("Is there a label or target with each instance?", self.labels()),
            ("Is any information missing from instances?", self.missing()),
            ("Are relationships between instances made explicit?", self.relationships()),
            ("Are there recommended splits?", self.splits()),
            ("Are there errors, noise or redundancies?", self.errors()),
            ("Is it self-contained, or does it rely on external resources?", self.self_contained()),
            ("Does it hold data that might be considered confidential?", self.of_captures(&none, UNKNOWN)),
            (
                "Does it hold data that might be offensive or cause anxiety?",
                self.of_captures(&none, "Not examined."),
            ),
            ("Does it identify subpopulations?", none.clone()),
            ("Can individuals be identified?", self.persons()),
            ("Does it hold sensitive data on persons?", self.persons()),
            ("Any other comments?", self.facts.provenance().limits()),
        ]
    }

    /// Words for the products of a trajectory, each if the release has it.
    pub(super) fn kinds(&self, words: fn(&ReleaseProduct) -> &'static str) -> String {
        let counts = self.facts.counts();
        products()
            .filter(|product| counts.has(product))
            .map(|product| format!(", {}", words(product)))
            .collect()
    }

    pub(super) fn instances(&self) -> String {
        let kinds = self.kinds(|product| product.instance);
        let scenes = if self.facts.provenance().is_static() { "static scenes" } else { "scenes" };
        format!("Camera trajectories through {scenes} of 3D Gaussians, each with exact poses{kinds}.")
    }

    pub(super) fn each_instance(&self) -> String {
        let kinds = self.kinds(|product| product.content);
        format!(
            "Poses, time stamps, a speed report, verdicts of checks{kinds}. `scene.json` has the scene's source, camera, \
             recipe, seeds and statistics."
        )
    }

    pub(super) fn mechanisms(&self) -> String {
        let provenance = self.facts.provenance();
        let models: Vec<String> =
            provenance.models().map(|(name, publication)| format!("{name} ({publication})")).collect();
        let sensors = match models.as_slice() {
            [] => String::new(),
            models => format!(" and the event sensor models {}", models.join(" and ")),
        };
        format!(
            "One program, which implements a renderer of Gaussian splats{sensors}. Every trajectory was checked; the verdicts are in \
             `checks.json`."
        )
    }

    pub(super) fn preprocessing_words(&self) -> String {
        if self.facts.made_up() {
            "No; nothing was edited by hand.".to_owned()
        } else {
            "Captured poses were smoothed and resampled along curves, as each recipe states; nothing was edited by hand."
                .to_owned()
        }
    }

    pub(super) fn how_many(&self) -> String {
        let FileCounts { scenes, trajectories, withheld, .. } = self.facts.counts();
        let mut text = format!(
            "{scenes} scenes ({}) with {trajectories} trajectories: {}.",
            counted_list(&self.facts.sources()),
            self.facts.contents()
        );
        if withheld > 0 {
            let _ = write!(
                text,
                " For {withheld} scenes the release has only recipe, poses and reports, because the terms of their upstream \
                 do not allow everyone to redistribute derived data."
            );
        }
        text
    }

    pub(super) fn labels(&self) -> String {
        let of = |scene: &PublishedScene| {
            let mut streams = scene.file.trajectories.iter().flat_map(|part| scene.streams(part));
            streams.any(|(_, sensor)| sensor.as_model().labels())
        };
        if self.facts.scenes.iter().any(of) {
            "Exact camera poses; `events/label`, where a stream has it, marks each event as signal or noise."
                .to_owned()
        } else {
            match self.facts.provenance().has_events() {
                true => "Exact camera poses; events have no labels.".to_owned(),
                false => "Exact camera poses.".to_owned(),
            }
        }
    }
}
