//! The row of the table in which bytes change below the file system: no stat field shows the
//! change.

use super::{NONE, Workspace, built, made, recipe, stands_as_if_clean, steps};
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::{StepAction, assess_plan};
use gs2e_recipe::read_all;
use gs2e_render::backend::Backend;
use gs2e_store::fs::{Fs, SystemFs};
use gs2e_store::{Store, StoreAccess, StoreOptions};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

#[path = "../../faults/frozen.rs"]
mod frozen;

use frozen::Frozen;

/// Flips a bit in the middle of a file.
fn rot(path: &Path) {
    let mode = fs::metadata(path).unwrap().permissions();
    fs::set_permissions(path, fs::Permissions::from_mode(0o644)).unwrap();
    let at = fs::metadata(path).unwrap().len() / 2;
    let file = File::options().read(true).write(true).open(path).unwrap();
    let mut byte = [0];
    file.read_exact_at(&mut byte, at).unwrap();
    file.write_all_at(&[byte[0] ^ 1], at).unwrap();
    fs::set_permissions(path, mode).unwrap();
}

/// The steps that a build would run, as a read-only look over these file operations reports them.
fn stale(place: &Workspace, fs: &Arc<Frozen>, verify: bool) -> Vec<String> {
    let opening = StoreOptions { verify, fs: fs.clone(), ..StoreAccess::Read.into() };
    let store = Store::open(&place.path(".gs2e"), opening, &mut |_| {}).unwrap();
    let plan = Plan::new(
        read_all(&[place.path("recipes")]).unwrap_or_else(|faults| panic!("{faults:?}")),
        &Backend::Cpu,
    );
    let assessed = assess_plan(&plan, &store).unwrap();
    let steps = plan.steps().iter().zip(assessed).filter(|(_, a)| a.action == StepAction::Run);
    steps.map(|(step, _)| format!("{}/{}", plan.scene_of(step), step.name)).collect()
}

#[test]
fn an_output_rots() {
    let place = built();
    let store = place.path(".gs2e").display().to_string();
    // The store has the same path as in the look below, and is old enough to be trusted.
    std::thread::sleep(Duration::from_millis(2100));
    place.ok(&format!("build --store {store}"));
    let path = steps(&place, "recipes")["b/base/trajectory"].outputs["poses.txt"].clone();
    let frozen = Arc::new(Frozen::new(BTreeMap::from([(path.clone(), SystemFs.stat(&path).unwrap())])));
    rot(&path);
    assert_eq!(stale(&place, &frozen, false), NONE, "no stat field tells of it");
    assert_eq!(stale(&place, &frozen, true), ["b/base/trajectory"]);
    assert_eq!(place.build("--verify recipes"), ["b/base/trajectory"]);
    stands_as_if_clean(&place);
}

/// Verbs that read every byte find the change: `plan --verify`, `build --verify` and `audit`.
#[test]
fn rot_is_found_by_verbs_that_read_every_byte() {
    let place = Workspace::new();
    place.write("recipes/d.yaml", recipe("d").to_string());
    place.ok("release --copy --to out");
    assert_eq!(made(&place), NONE);
    rot(&place.path("out/d/base/poses.txt"));
    let audit = place.gs2e("audit out");
    assert_eq!(audit.code, 3, "{}{}", audit.stdout, audit.stderr);
    assert!((audit.stdout + &audit.stderr).contains("d/base/poses.txt"));
    rot(&steps(&place, "recipes")["d/base/trajectory"].outputs["poses.txt"]);
    assert!(place.ok("plan --verify").stdout.contains("altered"), "{}", place.ok("plan --verify").stdout);
    assert_eq!(place.build("--verify recipes"), ["d/base/trajectory"]);
    place.ok("release --copy --replace --to out");
    place.ok("audit out");
}
