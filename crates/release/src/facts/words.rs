//! Values of the templates of card and datasheet that both have.

use super::ReleaseFacts;
use crate::markdown::markup;
use crate::published::PublishedScene;
use gs2e_recipe::SplitUnit;
use gs2e_source::licence::{LedgerAsset, LicenceObligation};
use minijinja::{Value, context};

impl ReleaseFacts<'_> {
    /// The values.
    pub(crate) fn values(&self) -> Value {
        let Self { info, licence, taken_down, .. } = *self;
        let (counts, provenance) = (self.counts(), self.provenance());
        let split_unit = info.splits.as_ref().map(|rule| match rule.by {
            SplitUnit::Capture => "capture",
            SplitUnit::Object => "object",
        });
        let splits = self.splits().into_iter().map(|(name, count)| [markup(name), count.into()]);
        let held_back = self.held_back.iter().map(|scene| [scene.id.clone(), scene.reasons().join("; ")]);
        let models = provenance.models().map(|(name, publication)| [markup(name), markup(publication)]);
        context! {
            name => &info.name, version => &info.version, contact => &info.contact, taken_down,
            scenes => counts.scenes, trajectories => counts.trajectories, withheld => counts.withheld,
            contents => markup(self.contents()), collection => markup(provenance.collection()),
            limits => markup(provenance.limits()), has_events => provenance.has_events(),
            has_labels => self.scenes.iter().any(has_labels), models => models.collect::<Value>(),
            split_unit, splits => splits.collect::<Value>(), held_back => held_back.collect::<Value>(),
            licence => markup(&licence.expression), gated => licence.gated,
            grants => self.grants().into_iter().map(markup).collect::<Value>(),
            assets => self.assets().into_iter().map(asset_values).collect::<Value>(),
        }
    }
}

/// Returns true if some streams of a scene have labels.
fn has_labels(scene: &PublishedScene) -> bool {
    let mut streams = scene.file.trajectories.iter().flat_map(|part| scene.streams(part));
    streams.any(|(_, sensor)| sensor.as_model().labels())
}

/// A row of the ledger.
fn asset_values(asset: &LedgerAsset) -> Value {
    let asked: Vec<&str> =
        asset.obligations.iter().map(|obligation| LicenceObligation::words(*obligation)).collect();
    let read: Vec<String> = asset.evidence.iter().map(|evidence| format!("<{}>", evidence.url)).collect();
    let said: Vec<&str> = asset.evidence.iter().map(|evidence| evidence.says).collect();
    context! {
        name => markup(asset.name), terms => markup(asset.expression()), obligations => markup(asked.join(", ")),
        urls => markup(read.join(", ")), statements => markup(said.join("; ")), verified => asset.verified,
    }
}
