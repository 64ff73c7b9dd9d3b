//! The scenes of one process among several that share the work.
//!
//! Every process reads the same recipes and computes the same shares, so that none needs to know of the
//! others: not whether they run, on which machine, or how far they are. Costs are therefore expected from
//! the recipes alone. Earlier durations are known to one store only.

use gs2e_recipe::{Recipe, ReconstructMethod};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::str::FromStr;

/// One of several shares of the scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SceneShard {
    /// Number of this share, from 1.
    pub number: u32,
    /// Number of shares.
    pub of: u32,
}

impl FromStr for SceneShard {
    type Err = String;

    /// Reads `I/N`, with `I` from 1 to `N`.
    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err("wanted I/N, with I from 1 to N, such as 3/8".to_owned()),
        }
    }
}

impl SceneShard {
    /// The recipes of this share. The most expensive scene goes first, each to the share that has the least
    /// so far: no share costs more than 4/3 of the best possible (Graham, SIAM J. Appl. Math. 17, 1969), as
    /// far as the costs are right.
    #[must_use]
    pub fn choose(self, recipes: &[Recipe]) -> Vec<&Recipe> {
        let mut sorted: Vec<(u64, &Recipe)> =
            recipes.iter().map(|recipe| (expected_cost(recipe), recipe)).collect();
        sorted.sort_by(|(a, one), (b, other)| b.cmp(a).then_with(|| one.scene.cmp(&other.scene)));
        // Each scene has a cost, so the first ones go to a share of their own, and shares beyond the number
        // of scenes stay empty. The last field breaks ties, so that every process finds the same shares.
        let used = u32::try_from(sorted.len()).map_or(self.of, |scenes| scenes.min(self.of));
        let mut shares: BinaryHeap<Reverse<(u64, u32)>> =
            (1..=used).map(|number| Reverse((0, number))).collect();
        let mut chosen = Vec::new();
        for (cost, recipe) in sorted {
            let Some(mut least) = shares.peek_mut() else { break };
            let Reverse((sum, number)) = &mut *least;
            *sum = sum.saturating_add(cost);
            if *number == self.number {
                chosen.push(recipe);
            }
        }
        chosen
    }
}

/// Pixels that are rendered or fitted, in millions, as far as a recipe shows them. The length of a path is
/// not known yet, so each counts as 1,000 frames.
fn expected_cost(recipe: &Recipe) -> u64 {
    const FRAMES: u64 = 1000;
    /// Without a size in the recipe, the photos have about this many.
    const PIXELS: u64 = 1_000_000;
    let pixels = recipe.camera.map_or(PIXELS, |camera| u64::from(camera.width) * u64::from(camera.height));
    // Every output needs the frames, and a scene without trajectories is still read.
    let renderings = recipe.trajectories.len() as u64 * (1 + recipe.outputs.len() as u64) * FRAMES;
    let training = match &recipe.reconstruct {
        // The gradients take about twice the time of the picture.
        Some(ReconstructMethod::Builtin(training)) => 3 * u64::from(training.iterations),
        _ => 0,
    };
    1 + pixels.saturating_mul(renderings + training) / 1_000_000
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_recipe::read_recipe_text;
    use std::path::Path;

    fn scene(name: &str, width: u32) -> Recipe {
        let text = format!(
            "version: 1
scene: {name}
seed: 7
source: {{ procedural: {{ gaussians: 300, views: 6, arc: 0.5, seed: 1 }} }}
camera: {{ width: {width}, height: 100 }}
trajectories: [{{ name: base, refine: {{ factor: 2 }} }}]
sensor: {{ voltmeter: {{ preset: dvs346-paper }} }}
"
        );
        read_recipe_text(text, Path::new("test.yaml")).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn shards_are_read() {
        assert_eq!("3/8".parse(), Ok(SceneShard { number: 3, of: 8 }));
        for wrong in ["0/8", "9/8", "1/0", "8", "1/2/3", "-1/2", "a/b", ""] {
            assert!(wrong.parse::<SceneShard>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn every_scene_is_in_one_shard_and_shards_cost_about_the_same() {
        let recipes: Vec<Recipe> =
            (0..40).map(|i| scene(&format!("s{i:02}"), 100 + 37 * (i * i % 29))).collect();
        for of in [1, 2, 7, 50] {
            let shards: Vec<Vec<&Recipe>> =
                (1..=of).map(|number| SceneShard { number, of }.choose(&recipes)).collect();
            let mut names: Vec<&str> = shards.iter().flatten().map(|recipe| recipe.scene.as_str()).collect();
            names.sort_unstable();
            assert_eq!(names, recipes.iter().map(|recipe| recipe.scene.as_str()).collect::<Vec<_>>());
            let cost = |shard: &Vec<&Recipe>| shard.iter().map(|recipe| expected_cost(recipe)).sum::<u64>();
            let longest = shards.iter().map(cost).max().unwrap();
            let all: u64 = recipes.iter().map(expected_cost).sum();
            let largest = recipes.iter().map(expected_cost).max().unwrap();
            // The best is at least this long.
            let bound = largest.max(all.div_ceil(u64::from(of)));
            assert!(3 * longest <= 4 * bound, "{longest} of {bound} in {of}");
        }
    }

    #[test]
    fn shares_beyond_the_number_of_scenes_are_empty_and_need_no_memory() {
        let recipes = [scene("a", 100), scene("b", 200)];
        let share = |number| SceneShard { number, of: u32::MAX }.choose(&recipes);
        let names = |number| share(number).iter().map(|recipe| recipe.scene.as_str()).collect::<Vec<_>>();
        assert_eq!([names(1), names(2)], [["b"], ["a"]]);
        assert!(share(3).is_empty() && share(u32::MAX).is_empty());
    }
}
