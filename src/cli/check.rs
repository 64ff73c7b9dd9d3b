//! `gs2e check`: the verdicts of the validation passes on built scenes, on a release tree, or on a
//! dataset of another program.

mod dataset;

use super::build::read_store;
use super::problem::not_built;
use super::verdicts::{count_line, findings_of_step, short_number};
use super::{CommonArgs, Console, ExitKind, RecipeTargets, VerbError, is_recipe_path, path};
use gs2e_audit::recheck::{RecheckError, recheck_tree};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::assess_plan;
use gs2e_build::stage::{checks, scene_checks};
use gs2e_check::{Finding, NAMES, Verdict};
use gs2e_recipe as recipe;
use gs2e_store::Store;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Arguments of `check`.
#[derive(Debug, clap::Args)]
pub(super) struct CheckArgs {
    /// Scene ids, recipes, or folders of recipes [default: all]
    #[arg(value_name = "SCENE, RECIPE or DIR")]
    scenes: Vec<String>,
    /// Recipes, or folders of recipes
    #[arg(long, value_name = "RECIPE or DIR", default_value = RecipeTargets::DEFAULT)]
    recipes: Vec<PathBuf>,
    /// Check the files of a release tree instead, without recipes or store
    #[arg(long, value_name = "DIR", conflicts_with = "recipes")]
    tree: Option<PathBuf>,
    #[command(flatten)]
    dataset: dataset::DatasetArgs,
    /// Count warnings as failed
    #[arg(long)]
    strict: bool,
    /// Count this check as failed if it was not run; may be repeated
    #[arg(long, value_name = "CHECK", value_parser = clap::builder::PossibleValuesParser::new(NAMES))]
    require: Vec<String>,
}

impl CheckArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        if self.tree.is_none() && self.dataset.events.is_none() {
            self.take_paths();
        }
        // A required check must have run here, and a release may state verdicts of its build.
        let mut measured = None;
        let findings = match (&self.tree, &self.dataset.events) {
            (_, Some(place)) => self.dataset.run(place, console)?.findings,
            (Some(tree), None) if !tree.is_dir() => {
                return Err(VerbError::usage("input-missing", format!("{} is not a folder", path(tree))));
            }
            (Some(tree), None) => {
                let found = recheck_tree(tree, &self.scenes).map_err(|error| of_tree(&error))?;
                measured = Some(found.measured);
                found.joined
            }
            (None, None) => self.of_built(common, console)?,
        };
        report_findings(&findings, common.verbose, console);
        let failed = [self.failed(&findings), self.not_run(measured.as_ref().unwrap_or(&findings))].concat();
        for line in &failed {
            console.note_always(&format!("error: {line}"));
        }
        Ok(if failed.is_empty() { ExitKind::Done } else { ExitKind::Fault })
    }

    /// Moves the words that are paths to the recipes.
    fn take_paths(&mut self) {
        let words = std::mem::take(&mut self.scenes).into_iter();
        let (paths, scenes): (Vec<String>, Vec<String>) =
            words.partition(|word| is_recipe_path(Path::new(word)));
        self.scenes = scenes;
        if !paths.is_empty() {
            // Named recipes take the place of the default folder.
            self.recipes.retain(|path| path != Path::new(RecipeTargets::DEFAULT));
            self.recipes.extend(paths.into_iter().map(PathBuf::from));
        }
    }

    /// Each check that failed.
    fn failed(&self, findings: &[Finding]) -> Vec<String> {
        let failed = |f: &Finding| match f.verdict {
            Verdict::Fail => Some(format!("{}: {} failed", f.subject, f.check)),
            Verdict::Warn if self.strict => Some(format!("{}: {} warned", f.subject, f.check)),
            _ => None,
        };
        findings.iter().filter_map(failed).collect()
    }

    /// Each required check that was not run, and each without a finding.
    fn not_run(&self, findings: &[Finding]) -> Vec<String> {
        let is_required = |f: &&Finding| f.verdict == Verdict::NotRun && self.require.contains(&f.check);
        let found = findings.iter().filter(is_required);
        let found = found.map(|f| format!("{}: {} was not run", f.subject, f.check));
        let absent = self.require.iter().filter(|name| findings.iter().all(|f| f.check != **name));
        found.chain(absent.map(|name| format!("{name} was not run at all"))).collect()
    }

    fn of_built(&self, common: &CommonArgs, console: &Console) -> Result<Vec<Finding>, VerbError> {
        let (recipes, renderers) = (recipe::read_all(&self.recipes)?, common.renderers()?);
        // Without this, a misspelt scene would have no findings and so no fault.
        if let Some(name) = self.scenes.iter().find(|name| recipes.iter().all(|r| r.scene != **name)) {
            return Err(VerbError::usage("no-scene", format!("no recipe makes a scene `{name}`")));
        }
        let (recipes, taken_down) = recipe::read_takedown(&self.recipes)?.keep(recipes);
        // The output is a list of findings, so programs get no other record.
        super::takedown::report_takedown(taken_down, &console.for_people());
        let store = read_store(common)?;
        let plan = Plan::new(recipes, &renderers.knowing(&store));
        built_findings(&plan, &store, &self.scenes)
    }
}

pub(super) fn of_tree(error: &RecheckError) -> VerbError {
    match error {
        RecheckError::NoScene(_) => VerbError::usage("no-scene", error.to_string()),
        _ => VerbError::failed("unreadable", error.to_string()).help("run gs2e audit DIR"),
    }
}

/// The findings on every built trajectory and scene among the named scenes, or among all if none is
/// named.
fn built_findings(plan: &Plan, store: &Store, scenes: &[String]) -> Result<Vec<Finding>, VerbError> {
    let assessed = assess_plan(plan, store)?;
    let mut findings = Vec::new();
    for (step, assessed) in plan.steps().iter().zip(&assessed) {
        let scene = plan.scene_of(step);
        let wanted = scenes.is_empty() || scenes.iter().any(|name| name == scene);
        if ![checks::NAME, scene_checks::NAME].contains(&step.step.stage()) || !wanted {
            continue;
        }
        // A missing verdict must not look like a pass.
        let outputs = assessed.outputs.as_ref().ok_or_else(|| not_built(scene, &step.name))?;
        findings.extend(findings_of_step(scene, &step.name, outputs, store)?);
    }
    Ok(findings)
}

/// Prints findings as the result: one record per finding for programs, or else a table with the
/// faults first.
fn report_findings(findings: &[Finding], verbose: bool, console: &Console) {
    if console.json {
        return records(findings, console);
    }
    table(findings, verbose).iter().for_each(|line| console.print(line));
    console.note(&count_line(findings, [0; 2]));
}

/// Prints one record per finding, for programs.
pub(super) fn records(findings: &[Finding], console: &Console) {
    findings.iter().for_each(|finding| console.result(&json!(finding)));
}

/// One line per finding, the faults first; with `verbose`, also the smallest fault that each would
/// have found.
fn table(findings: &[Finding], verbose: bool) -> Vec<String> {
    let mut sorted: Vec<&Finding> = findings.iter().collect();
    let ranked = |verdict| match verdict {
        Verdict::Fail => (0, "FAIL"),
        Verdict::Waived => (1, "waived"),
        Verdict::Warn => (2, "warn"),
        Verdict::NotRun => (3, "not run"),
        Verdict::Pass => (4, "pass"),
    };
    // Stable: findings of one verdict keep their order.
    sorted.sort_by_key(|f| ranked(f.verdict).0);
    let line = |f: &&Finding| {
        let verdict = ranked(f.verdict).1;
        let power = f.detects.as_ref().filter(|_| verbose).map_or_else(String::new, |fault| {
            let unit = if fault.unit == "1" { String::new() } else { format!(" {}", fault.unit) };
            format!(" (detects {}{unit})", short_number(fault.size))
        });
        format!("{verdict:7}  {:15}  {}: {}{power}", f.check, f.subject, f.because)
    };
    sorted.iter().map(line).collect()
}
