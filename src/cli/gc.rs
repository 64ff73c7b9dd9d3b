//! `gs2e gc`: deletes everything that no recipe and no release refers to.

mod shared;

use super::build::{TrustOptions, open_store, read_store};
use super::{CommonArgs, Console, ExitKind, RecipeTargets, VerbError};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAction, StepAssessment, assess_plan};
use gs2e_build::plan::kept::kept_names;
use gs2e_files::is_there;
use gs2e_recipe as recipe;
use gs2e_store::gc::{GcSweep, SweepSummary};
use gs2e_store::{KeptFiles, Key, Store};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Arguments of `gc`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Keeps the results that these recipes need now, the last results of their stale steps, and the results that a release was \
    made from, as long as its folder exists. Scenes listed in takedown.txt are not kept. Name every recipe whose results must stay. \
    With --shared-store, age decides alone: files that no build has used for AGE and two hours go to the trash of the shared store, and \
    are deleted by a later run, after the same time again."
)]
pub(super) struct GcArgs {
    #[command(flatten)]
    targets: RecipeTargets,
    /// Keep files younger than this: 90s, 30m, 12h or 1d
    #[arg(long, value_name = "AGE", default_value = "1d", value_parser = parse_age)]
    min_age: Duration,
    /// Clean this folder, which the builds of several machines share, instead of the store
    #[arg(long, value_name = "DIR", requires = "older_than", conflicts_with_all = ["recipes", "min_age"])]
    shared_store: Option<PathBuf>,
    /// Time without use after which a file of the shared store goes. It must exceed the longest job
    #[arg(long, value_name = "AGE", value_parser = parse_age, requires = "shared_store")]
    older_than: Option<Duration>,
    /// Print the amounts that would be deleted, and delete nothing
    #[arg(long)]
    dry_run: bool,
}

impl GcArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        if let (Some(shared), Some(older_than)) = (&self.shared_store, self.older_than) {
            return shared::run(shared, older_than, self.dry_run, console);
        }
        let (recipes, renderers) = (recipe::read_all(&self.targets.recipes)?, common.renderers()?);
        // The products of a scene that was taken down are deleted too.
        let (recipes, taken_down) = recipe::read_takedown(&self.targets.recipes)?.keep(recipes);
        super::takedown::report_takedown(taken_down, console);
        // A dry run needs no lock, and creates no store.
        let store = if self.dry_run || !is_there(&common.store) {
            read_store(common)?
        } else {
            open_store(common, &TrustOptions::default(), console)?
        };
        let plan = Plan::new(recipes, &renderers.knowing(&store));
        let assessed = assess_plan(&plan, &store)?;
        let frames = kept_names(&plan, &assessed, &store).into_iter().flatten().collect();
        let mut marked = marks_of_recipes(&plan, &assessed, &store);
        marked.extend(self.marks_of_releases(&store, console)?);
        let until =
            SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().saturating_sub(self.min_age);
        let until_ns = i64::try_from(until.as_nanos()).unwrap_or(i64::MAX);
        let sweep = GcSweep { until_ns, dry_run: self.dry_run };
        let swept = store.sweep(&marked, sweep)?;
        let frames = store.sweep_frames(&frames, sweep)?;
        store.flush()?;
        self.report(&swept, frames, console);
        Ok(ExitKind::Done)
    }

    /// The keys of the existing releases. The roots of deleted releases are removed.
    fn marks_of_releases(&self, store: &Store, console: &Console) -> Result<BTreeSet<Key>, VerbError> {
        let mut marked = BTreeSet::new();
        for root in store.roots()? {
            if root.release.is_dir() {
                marked.extend(root.keys);
                continue;
            }
            let gone = root.release.display();
            console.note(&format!("the release {gone} no longer exists: its results are no longer kept"));
            if !self.dry_run {
                store.remove_root(&root)?;
            }
        }
        Ok(marked)
    }

    fn report(&self, swept: &SweepSummary, frames: KeptFiles, console: &Console) {
        let SweepSummary { records, blobs, bytes, kept_blobs, kept_bytes, trash, trash_bytes } = *swept;
        let done = if self.dry_run { "would delete" } else { "deleted" };
        let [size, kept, left, framed] =
            [bytes, kept_bytes, trash_bytes, frames.bytes].map(|bytes| bytes as f64 * 1e-6);
        console.note(&format!("{done} {blobs} blobs, {size:.1} MB, and {records} records"));
        if trash > 0 {
            console.note(&format!("{done} {trash} trash files, {left:.1} MB"));
        }
        if frames.files > 0 {
            console.note(&format!("{done} {} files of frames, {framed:.1} MB", frames.files));
        }
        console.note(&format!("kept {kept_blobs} blobs, {kept:.1} MB"));
        let mut record = json!(swept);
        record["dry_run"] = json!(self.dry_run);
        (record["frames"], record["frame_bytes"]) = (json!(frames.files), json!(frames.bytes));
        console.result(&record);
    }
}

/// The current key of each step, and for a step that is not up to date also its previous key.
fn marks_of_recipes(plan: &Plan, assessed: &[StepAssessment], store: &Store) -> BTreeSet<Key> {
    let mut marked = BTreeSet::new();
    for (step, assessed) in plan.steps().iter().zip(assessed) {
        marked.extend(assessed.key);
        if assessed.action != StepAction::Keep {
            // Until the step is made again, its last results are the only ones.
            marked.extend(store.last_key(plan.scene_of(step), &step.name));
        }
    }
    marked
}

fn parse_age(text: &str) -> Result<Duration, String> {
    let (number, unit) = text.split_at(text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len()));
    let seconds: u64 = match unit {
        "s" => 1,
        "m" => 60,
        "h" => 3600,
        "d" => 86_400,
        "" if number == "0" => 1,
        _ => return Err("wanted a whole number followed by s, m, h or d, such as 12h".to_owned()),
    };
    let number: u64 = number.parse().map_err(|e| format!("{number:?}: {e}"))?;
    number.checked_mul(seconds).map(Duration::from_secs).ok_or_else(|| "the duration is too long".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_are_numbers_with_a_unit() {
        let t = |text: &str, seconds: Option<u64>| {
            assert_eq!(parse_age(text).ok(), seconds.map(Duration::from_secs), "{text}");
        };
        t("0", Some(0));
        t("0s", Some(0));
        t("90s", Some(90));
        t("30m", Some(1800));
        t("12h", Some(43_200));
        t("1d", Some(86_400));
        for wrong in
            ["", "1", "d", "1w", "-1d", "1.5d", "1 d", "1d2h", "99999999999999999999d", "9999999999999999d"]
        {
            t(wrong, None);
        }
    }
}
