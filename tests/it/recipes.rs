//! Recipes: what they mean, and what is said when they are wrong.

use gs2e::recipe::read_all;
use std::path::PathBuf;

fn bundled() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("recipes")
}

#[test]
fn the_bundled_recipes_are_read() {
    let recipes = read_all(&[bundled()]).unwrap_or_else(|faults| panic!("{}", faults.render_text()));
    assert!(recipes.iter().any(|r| r.scene == "procedural/still-life"));
}
