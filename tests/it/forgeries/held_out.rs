//! Forgeries of `held_out.png`, the picture of a scene's held-out views: it is replaced by another
//! picture, or withheld. The forger rewrites the sums, the manifest, or the steps too.

use super::data;
use crate::fidelity::photographed;
use crate::release::forger::{read, reseal, reseal_sums};
use crate::support::workspace::Workspace;
use gs2e_audit::{audit_release, rebuilt};
use gs2e_release::{ManifestFile, ReleaseManifest};
use gs2e_store::Digest;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The picture in the release.
const PICTURE: &str = "given/held_out.png";

/// Parts of a release that the forger rewrites after the change.
#[derive(Debug, Clone, Copy)]
enum Rewritten {
    /// `SHA256SUMS` and `B3SUMS`.
    Sums,
    /// The listing of the files in `manifest.json` too.
    Listing,
    /// The outputs and keys of the steps too.
    Steps,
}

/// The codes of the faults that the audit finds, and the files that differ from the scene made again.
fn judged(honest: &Workspace, forge: fn(&Path), rewritten: Rewritten) -> [BTreeSet<String>; 2] {
    let folder = tempfile::tempdir().unwrap();
    for (path, bytes) in read(&honest.path("tree")) {
        let to = folder.path().join(path);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::write(to, bytes).unwrap();
    }
    forge(folder.path());
    match rewritten {
        Rewritten::Sums => {}
        Rewritten::Listing => relist(folder.path()),
        Rewritten::Steps => reseal(folder.path()),
    }
    reseal_sums(folder.path());
    let found = audit_release(folder.path()).unwrap().faults;
    let differ = rebuilt::compare_scenes(folder.path(), &honest.path("tree"), "given").unwrap();
    let codes = found.iter().map(|fault| fault.code.name().to_owned()).collect();
    [codes, differ.into_iter().filter_map(|fault| fault.file).collect()]
}

/// Lists the picture as it is now, and leaves the steps alone.
fn relist(folder: &Path) {
    let path = folder.join("manifest.json");
    let mut manifest: ReleaseManifest = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let files = &mut manifest.scenes[0].files;
    let place = files.iter().position(|file| file.path == PICTURE).unwrap();
    match fs::read(folder.join(PICTURE)) {
        Ok(bytes) => {
            let (size, blake3) = (bytes.len() as u64, Digest::of_bytes(&bytes));
            files[place] = ManifestFile { path: PICTURE.to_owned(), size, blake3 };
        }
        Err(_) => drop(files.remove(place)),
    }
    crate::release::forger::write_json(&path, &manifest);
}

/// The renderings equal the photos, and the differences are black: a scene without a fault.
fn flatter(folder: &Path) {
    data::picture(&folder.join(PICTURE), |pixels| {
        for row in pixels.chunks_mut(3 * 64 + 4) {
            row.copy_within(..64, 66);
            row[132..].fill([0; 3]);
        }
    });
}

fn withhold(folder: &Path) {
    fs::remove_file(folder.join(PICTURE)).unwrap();
}

#[test]
fn a_replaced_or_withheld_picture_of_held_out_views_is_found() {
    // The photo of the first view, which is held out, differs from its rendering.
    let honest = photographed(|view, v| if view == 0 { v / 2 + 60 } else { v });
    honest.ok("release --copy --to tree recipe.yaml");
    honest.ok("audit tree");

    let replaced: (&str, fn(&Path)) = ("replaced", flatter);
    for (name, forge) in [replaced, ("withheld", withhold)] {
        for (rewritten, code) in [
            // The manifest states other bytes, or a file that the sums do not list.
            (Rewritten::Sums, "sums-disagree"),
            // The step of the comparison made another picture.
            (Rewritten::Listing, "step-disagrees"),
            // The report shows the picture, so it follows from other bytes.
            (Rewritten::Steps, "not-composed"),
        ] {
            let [codes, differ] = judged(&honest, forge, rewritten);
            assert!(codes.contains(code), "{name}, {rewritten:?}: {codes:?}, wanted {code}");
            assert!(differ.contains(PICTURE), "{name}, {rewritten:?}: {differ:?}");
        }
    }
}
