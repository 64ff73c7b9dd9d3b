//! From a dataset on disk to recipes, and to a plan of them.

use crate::series::timed;
use crate::{AT_REST, Outcome};
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;

// The code that lays the dataset out belongs to the tests, which use all of it.
#[path = "../../tests/it/sources/datasets.rs"]
#[expect(dead_code, clippy::unwrap_used, reason = "it is the tests', which use the rest")]
mod datasets;

/// Number of new instances in the second run.
const MORE: u32 = 10;

/// Lays out `scenes` instances, makes recipes of them, plans them, and repeats all of it with a few
/// more.
pub(crate) fn measure(root: &Path, scenes: usize) -> Outcome {
    let dir = root.join("dataset");
    let count = u32::try_from(scenes).map_err(|e| e.to_string())?;
    let generator = datasets::Generator::new();
    // The file is never parsed here: a scene is only hashed.
    generator.mvimgnet(&dir.join("data"), 0, count, b"ply\n");
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
        command
            .args(arguments)
            .current_dir(&dir)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        timed(command).map(|ran| ran.seconds)
    };
    let init = ["init", "mvimgnet", "data", "--to", "recipes"];
    let plan = ["plan", "--json", "recipes"];
    let views = datasets::VIEWS;
    println!(
        "init     {scenes} instances of {views} photos: {:.2} s, again {:.2} s",
        run(&init)?,
        run(&init)?
    );
    println!("init     plan of nothing built: {:.2} s, again {:.2} s", run(&plan)?, run(&plan)?);
    generator.mvimgnet(&dir.join("data"), count, MORE, b"ply\n");
    println!("init     {MORE} instances more: {:.2} s, plan {:.2} s", run(&init)?, run(&plan)?);
    paths_alone(&dir.join("recipes")).map_err(|e| format!("the recipes: {e}"))?;
    let build = ["build", "-q", "recipes"];
    println!("init     build of their paths: {:.2} s", run(&build)?);
    // The first look at files at rest remembers their stat fields.
    sleep(AT_REST);
    run(&build)?;
    println!(
        "init     plan of what is built, 4 steps each: {:.2} s, again {:.2} s",
        run(&plan)?,
        run(&plan)?
    );
    Ok(())
}

/// Removes everything from these recipes that would be rendered.
fn paths_alone(recipes: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(recipes)? {
        let path = entry?.path();
        let text = std::fs::read_to_string(&path)?;
        if let Some((before, _)) = text.split_once("reconstruct:") {
            std::fs::write(path, before)?;
        }
    }
    std::fs::write(recipes.join("defaults.yaml"), "trajectories: [{ name: base, refine: {} }]\noutputs: []\n")
}
