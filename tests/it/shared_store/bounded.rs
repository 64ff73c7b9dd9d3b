//! A store with a bound on its size, in front of a shared one.

use super::{SCENES, count, files_below, place, releases_equal, start, states};
use crate::support::workspace::Workspace;
use gs2e_store::{Store, StoreAccess};
use std::path::Path;

/// Below this size files stay.
const SMALL: u64 = 64 << 10;

/// Files of a store that can make room: their number and bytes.
fn large(store: &Path) -> (usize, u64) {
    let sizes = files_below(&store.join("cas")).into_iter().map(|path| path.metadata().unwrap().len());
    let sizes: Vec<u64> = sizes.filter(|size| *size >= SMALL).collect();
    (sizes.len(), sizes.iter().sum())
}

/// Scenes with files of 400 kB.
fn large_scenes() -> Workspace {
    let place = place();
    for i in 0..SCENES {
        let file = format!("recipes/lab/s{i}.yaml");
        let mut recipe: serde_json::Value =
            serde_json::from_slice(&std::fs::read(place.path(&file)).unwrap()).unwrap();
        recipe["source"]["procedural"]["gaussians"] = serde_json::json!(7000);
        place.write(&file, recipe.to_string());
    }
    place
}

#[test]
fn files_that_the_shared_store_has_make_room() {
    let place = large_scenes();
    place.ok("build --store whole");
    let (files, bytes) = large(&place.path("whole"));
    assert!(files >= 6 && bytes > 2_000_000, "{files} files, {bytes} bytes");
    let ended = place.ok("build -j 1 --store bounded --shared-store shared --cache-size 1MB");
    assert!(ended.stderr.contains("made room: the shared store has them"), "{}", ended.stderr);
    let (_, kept) = large(&place.path("bounded"));
    assert!(kept <= 1_000_000, "{kept} bytes");
    assert_eq!(large(&place.path("shared")), (files, bytes));
    // All of it is known, and what is gone is copied again.
    let again = states(start(&place, "bounded", "--cache-size 1MB"));
    assert_eq!(count(&again, "made"), 0, "{again:?}");
    assert!(count(&again, "adopted") > 0, "{again:?}");
    // Without a bound, everything stays.
    let whole = states(start(&place, "bounded", ""));
    assert_eq!(count(&whole, "made"), 0, "{whole:?}");
    assert_eq!(large(&place.path("bounded")), (files, bytes));
    // Files of earlier builds make room, too.
    let bounded = states(start(&place, "bounded", "--cache-size 1MB"));
    assert_eq!(count(&bounded, "made"), 0, "{bounded:?}");
    assert!(large(&place.path("bounded")).1 <= 1_000_000);
    releases_equal(&place);
}

#[test]
fn files_that_the_shared_store_lacks_stay() {
    let place = large_scenes();
    place.ok("build --store own");
    let (files, _) = large(&place.path("own"));
    // One scene is built with the shared store. The others were never offered to it.
    for i in 1..SCENES {
        std::fs::remove_file(place.path(&format!("recipes/lab/s{i}.yaml"))).unwrap();
    }
    place.ok("build --store own --shared-store shared --cache-size 1kB");
    let (left, _) = large(&place.path("own"));
    let (shared, _) = large(&place.path("shared"));
    assert!(shared > 0);
    assert_eq!(left, files - shared);
    let store = Store::open(&place.path("own"), StoreAccess::Read, &mut |_| {}).unwrap();
    for record in store.records() {
        for output in record.outputs.iter().filter(|output| output.size < SMALL) {
            assert!(store.path_of(&output.digest).is_file(), "{} is small and gone", output.name);
        }
    }
}

#[test]
fn a_bound_needs_a_shared_store() {
    let place = place();
    let ended = place.gs2e("build --cache-size 1GB");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("--shared-store"), "{}", ended.stderr);
}
