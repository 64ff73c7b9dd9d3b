//! The recipes for other trainers in `docs/training.md` are valid.

use crate::support::workspace::Workspace;
use gs2e_recipe as recipe;
use gs2e_recipe::ReconstructMethod;
use std::fs;
use std::path::Path;

/// The YAML blocks of the page.
fn blocks() -> Vec<String> {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/training.md")).unwrap();
    let after = page.split("```yaml\n").skip(1);
    after.map(|rest| rest.split("```").next().unwrap().to_owned()).collect()
}

#[test]
fn every_template_is_a_recipe() {
    let place = Workspace::new();
    let mut programs = Vec::new();
    for (number, block) in blocks().into_iter().enumerate() {
        let file = format!("template-{number}.yaml");
        let head =
            format!("version: 1\nscene: template-{number}\nsource: {{ colmap: {{ path: capture }} }}\n");
        place.write(&file, format!("{head}{block}trajectories: [{{ name: base, refine: {{}} }}]\n"));
        let recipes = recipe::read_all(&[place.path(&file)]);
        let recipes = recipes.unwrap_or_else(|faults| panic!("{block}\n{}", faults.render_text()));
        let Some(ReconstructMethod::Command(command)) = &recipes[0].reconstruct else { panic!("{block}") };
        assert!(command.probe.is_some(), "a template asks for the version: {block}");
        let given = command.arguments.iter().any(|a| a.names("capture"));
        let out = command.arguments.iter().any(|a| a.names("out"));
        assert!(given && out, "it is given the capture, and message where to leave the scene: {block}");
        place.write("merged.yaml", recipes[0].meta.merged.to_string());
        let again = recipe::read_all(&[place.path("merged.yaml")]).map(|mut recipes| recipes.remove(0));
        let again = again.unwrap_or_else(|faults| panic!("{}", faults.render_text()));
        assert_eq!(
            (&again.reconstruct, &again.meta.merged),
            (&recipes[0].reconstruct, &recipes[0].meta.merged)
        );
        programs.push(format!("{} {}", command.name(), command.licence));
    }
    let wanted = [
        "opensplat AGPL-3.0-only",
        "python LicenseRef-Gaussian-Splatting",
        "python Apache-2.0",
        "brush-cli Apache-2.0",
    ];
    assert_eq!(programs, wanted);
}
