//! `gs2e open`: the paths of what was built.

use super::build::store_options;
use super::console::{Console, path};
use super::problem::{ExitKind, VerbError};
use super::{CommonArgs, RecipeTargets};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::assess_plan;
use gs2e_recipe as recipe;
use gs2e_store::{Store, StoreAccess};
use serde_json::json;

/// Arguments of `open`.
#[derive(Debug, clap::Args)]
pub(super) struct OpenArgs {
    #[command(flatten)]
    targets: RecipeTargets,
}

impl OpenArgs {
    pub(super) fn run(mut self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        self.targets.resolve()?;
        let (recipes, renderers) = (recipe::read_all(&self.targets.recipes)?, common.renderers()?);
        let store = Store::open(&common.store, store_options(common, StoreAccess::Read), &mut |_| {})?;
        let plan = Plan::new(recipes, &renderers.knowing(&store));
        let assessed = assess_plan(&plan, &store)?;
        let (mut shown, mut absent) = (0, 0);
        for (step, assessed) in plan.steps().iter().zip(&assessed) {
            let Some(outputs) = &assessed.outputs else {
                absent += 1;
                continue;
            };
            let name = format!("{}/{}", plan.scene_of(step), step.name);
            for output in outputs {
                let place = path(store.path_of(&output.digest));
                if console.json {
                    console.result(&json!({ "step": name, "role": output.name, "path": place }));
                } else {
                    console.print(&format!("{name}  {}  {place}", output.name));
                }
                shown += 1;
            }
        }
        if absent > 0 {
            console.say(&format!("{absent} steps are not built, or no longer up to date: gs2e build"));
        }
        console.say(&format!(
            "{shown} files; do not change them: the store compares them with their digests. `gs2e release --to DIR` copies them"
        ));
        Ok(ExitKind::Done)
    }
}
