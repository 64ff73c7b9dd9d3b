//! The row of the table in which an input is edited while its step reads it. The step is a training
//! whose program edits the input, so each time the edit falls between the engine's hash and the end
//! of the step.

use super::Workspace;
use crate::command::{COPY, trained_by, write_script};
use crate::support::given::ply;
use crate::support::steps::{products, steps};

const BUILD: &str = "build --allow-commands recipe.yaml";

fn shifted(by: f32) -> Vec<u8> {
    ply(|_, value| value + by)
}

#[test]
fn an_input_is_edited_while_its_step_reads_it() {
    let place = trained_by(COPY);
    place.ok(BUILD);
    place.write("planted.ply", shifted(1.0));
    place.write("third.ply", shifted(2.0));
    write_script(&place, &format!("{COPY}; cp \"$beside/third.ply\" \"$3\""));
    let ended = place.gs2e(BUILD);
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("changed while it was read; nothing was recorded"), "{}", ended.stderr);

    write_script(&place, COPY);
    let plan = steps(&place, "recipe.yaml");
    assert_eq!(plan["trained/reconstruct"].action, "run", "{plan:?}");
    place.ok(BUILD);
    let clean: Workspace = trained_by(COPY);
    clean.write("planted.ply", shifted(2.0));
    clean.ok(BUILD);
    assert_eq!(products(&place, "recipe.yaml"), products(&clean, "recipe.yaml"));
}
