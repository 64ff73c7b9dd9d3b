//! The audit finds each fault of a release under the right name, and finds none in a sound release.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod croissant;
mod parts;
mod rebuild;

use crate::release::small::{copy, edit, gs2e, read, release, reseal, resum};
use crate::support::absent::is_thorough;
use gs2e_audit::{AuditFault, AuditOptions, AuditPart, audit_release, audit_with};
use rand::{RngExt as _, SeedableRng as _};
use std::fs;
use std::path::Path;

pub(crate) const SCENE: &str = "small/one/scene.json";
pub(crate) const BASE: &str = "small/one/base";
/// Fault where a row of the index differs from the files that it repeats.
const INDEX: &str = "claims-disagree index.parquet";

/// `code file-or-scene` of each fault. An audit in parts finds the same.
fn found(folder: &Path) -> Vec<String> {
    let whole = audit_release(folder).unwrap().faults;
    let parts =
        audit_with(folder, AuditOptions::default(), Some(parts_of(folder, 3))).unwrap().unwrap().faults;
    assert_eq!(parts, whole, "in parts");
    let name = |f: AuditFault| format!("{} {}", f.code.name(), f.file.or(f.scene).unwrap_or_default());
    whole.into_iter().map(name).collect()
}

/// The parts of an audit, as they are read from their files.
fn parts_of(folder: &Path, of: u32) -> Vec<AuditPart> {
    let part = |number| {
        let text = serde_json::to_string(&AuditPart::audit(folder, number, of).unwrap()).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    (1..=of).map(part).collect()
}

/// Damages a release. The faults found must be exactly `wanted`.
fn check(damage: impl FnOnce(&Path), wanted: &[&str]) {
    let folder = copy();
    damage(folder.path());
    assert_eq!(found(folder.path()), wanted, "{:#?}", audit_release(folder.path()).unwrap().faults);
}

/// Damages a release and rewrites its sums, so that only the files' contents can show the damage.
fn check_resealed(damage: impl FnOnce(&Path), wanted: &[&str]) {
    check(
        |folder| {
            damage(folder);
            reseal(folder);
        },
        wanted,
    );
}

#[test]
fn a_sound_release_has_no_faults() {
    let report = audit_release(release()).unwrap();
    assert_eq!(report.faults, []);
    assert_eq!(report.files, read(release()).len());
    check(|_| (), &[]);
    check_resealed(|_| (), &[]);
}

#[test]
fn a_fault_names_its_scene_and_its_repair() {
    let folder = copy();
    fs::write(folder.path().join(BASE).join("speed.json"), "{}").unwrap();
    let faults = audit_release(folder.path()).unwrap().faults;
    assert_eq!(faults[0].scene.as_deref(), Some("small/one"));
    let text = faults[0].to_string();
    assert!(text.starts_with("altered: small/one/base/speed.json: its SHA-256 is 44136fa3"), "{text}");
    assert!(text.contains("; help: "), "{text}");
}

#[test]
fn missing_altered_and_unlisted_files_are_found() {
    let pose = format!("{BASE}/poses.txt");
    check(
        |f| fs::remove_file(f.join(&pose)).unwrap(),
        &[&format!("missing {pose}"), &format!("scene-incomplete {pose}")],
    );
    check(
        |f| fs::write(f.join(&pose), "").unwrap(),
        &[&format!("altered {pose}"), &format!("scene-incomplete {pose}")],
    );
    check(|f| fs::write(f.join("small/more.txt"), "").unwrap(), &["unlisted small/more.txt"]);
    check(|f| fs::create_dir(f.join("small/more")).unwrap(), &["unlisted small/more"]);
    check(|f| std::os::unix::fs::symlink("one", f.join("small/more")).unwrap(), &["unlisted small/more"]);
    let picture = format!("{BASE}/sharp/000004.png");
    check(
        |f| fs::rename(f.join(&picture), f.join(BASE).join("sharp/000005.png")).unwrap(),
        &[
            &format!("missing {picture}"),
            &format!("unlisted {BASE}/sharp/000005.png"),
            &format!("scene-incomplete {picture}"),
        ],
    );
}

#[test]
fn sums_have_one_form_and_agree() {
    let sums = |f: &Path, change: &dyn Fn(String) -> String| {
        let text = fs::read_to_string(f.join("SHA256SUMS")).unwrap();
        fs::write(f.join("SHA256SUMS"), change(text)).unwrap();
    };
    check(|f| fs::remove_file(f.join("SHA256SUMS")).unwrap(), &["missing SHA256SUMS"]);
    check(|f| sums(f, &|text| text + "\n"), &["altered SHA256SUMS"]);
    // A last line without a newline is ignored, so its file is unlisted.
    let last = read(release()).into_keys().next_back().unwrap();
    check(
        |f| sums(f, &|text| text.trim_end().to_owned()),
        &[
            "altered SHA256SUMS",
            &format!("unlisted {last}"),
            &format!("sums-disagree {last}"),
            &format!("scene-incomplete {last}"),
        ],
    );
    check(
        |f| sums(f, &|text| text + &format!("{}  ../outside\n", "0".repeat(64))),
        &["altered SHA256SUMS", "unsafe-path ../outside"],
    );
    let stamps = format!("{BASE}/timestamps_us.txt");
    check(
        |f| {
            fs::write(f.join(BASE).join("trajectory.svg"), "<svg/>").unwrap();
            resum(f);
        },
        &[&format!("sums-disagree {BASE}/trajectory.svg")],
    );
    check(
        |f| {
            sums(f, &|text| {
                text.lines().filter(|l| !l.ends_with(&stamps)).map(|l| l.to_owned() + "\n").collect()
            })
        },
        &[
            &format!("unlisted {stamps}"),
            &format!("sums-disagree {stamps}"),
            &format!("scene-incomplete {stamps}"),
        ],
    );
}

#[test]
fn the_second_list_of_sums_obeys_the_same_rules() {
    let stamps = format!("{BASE}/timestamps_us.txt");
    let path = stamps.as_str();
    // B3SUMS is changed and the change is hidden in SHA256SUMS: form, lines and digests of B3SUMS
    // are still compared with the files.
    let sums = |change: &dyn Fn(String) -> String, wanted: &[&str]| {
        let covered = |f: &Path| {
            let text = fs::read_to_string(f.join("B3SUMS")).unwrap();
            fs::write(f.join("B3SUMS"), change(text)).unwrap();
            resum(f);
        };
        check(covered, wanted);
    };
    let disagree = format!("sums-disagree {stamps}");
    sums(&|text| text, &[]);
    sums(&|text| text + "\n", &["altered B3SUMS"]);
    sums(
        &|text| {
            text.lines().filter(|line| !line.ends_with(path)).map(|line| line.to_owned() + "\n").collect()
        },
        &[&disagree],
    );
    let line = |text: &str| text.lines().find(|line| line.ends_with(path)).unwrap().to_owned();
    let other = |text: String| text.replace(&line(&text), &format!("{}  {path}", "0".repeat(64)));
    sums(&other, &[&disagree]);
    let upper = |text: String| text.replace(&line(&text)[..64], &line(&text)[..64].to_uppercase());
    sums(&upper, &["altered B3SUMS", &disagree]);
    sums(&|text| text + &format!("{}  z/outside\n", "0".repeat(64)), &["sums-disagree z/outside"]);
    sums(
        &|text| text + &format!("{}  ../outside\n", "0".repeat(64)),
        &["altered B3SUMS", "unsafe-path ../outside"],
    );
    // Without that cover, B3SUMS is checked like any other file.
    check(|f| fs::remove_file(f.join("B3SUMS")).unwrap(), &["missing B3SUMS"]);
    check(|f| fs::write(f.join("B3SUMS"), "").unwrap(), &["altered B3SUMS"]);
    check(
        |f| {
            fs::remove_file(f.join("B3SUMS")).unwrap();
            resum(f);
        },
        &["missing B3SUMS"],
    );
}

#[test]
fn unlawful_terms_are_found() {
    let scene = |f: &Path, key: &str, value: &str| {
        edit(f, SCENE, |v| *v.pointer_mut(key).unwrap() = value.into());
    };
    let both = |f: &Path, value: &str| {
        scene(f, "/licence/expression", value);
        scene(f, "/licence/parts/0/expression", value);
        edit(f, "manifest.json", |v| {
            v["licence"] = value.into();
            v["scenes"][0]["licence"] = value.into();
        });
        for name in ["README.md", "REUSE.toml", "DATASHEET.md"] {
            let text = fs::read_to_string(f.join(name)).unwrap();
            // Dataset hubs know CC0 by a name of theirs.
            let named = format!("license: other\nlicense_name: {value:?}");
            let text = text.replace("license: cc0-1.0", &named);
            fs::write(f.join(name), text.replace("CC0-1.0", value)).unwrap();
        }
        let address = if value == "ISC" { "https://spdx.org/licenses/ISC.html" } else { value };
        edit(f, "croissant.json", |v| v["license"] = address.into());
    };
    let unused = "licence-unused LICENSES/CC0-1.0.txt";
    let missing = ["licence-missing small/one", unused, "croissant-field croissant.json"];
    check_resealed(|f| both(f, ""), &[&[INDEX; 2], &missing[..]].concat());
    check_resealed(|f| both(f, "CC BY MIT"), &[INDEX, INDEX, "licence-invalid small/one", unused]);
    let composed = format!("not-composed {SCENE}");
    check_resealed(
        |f| both(f, "ISC"),
        &[INDEX, INDEX, "licence-text-missing LICENSES/ISC.txt", unused, &composed, &composed],
    );
    check_resealed(
        |f| fs::write(f.join("LICENSES/ISC.txt"), "").unwrap(),
        &["licence-unused LICENSES/ISC.txt"],
    );
    check_resealed(
        |f| scene(f, "/licence/expression", "MIT"),
        &[
            "claims-disagree REUSE.toml",
            INDEX,
            INDEX,
            &format!("claims-disagree {SCENE}"),
            &format!("claims-disagree {SCENE}"),
        ],
    );
    check_resealed(
        |f| edit(f, SCENE, |v| v["licence"]["parts"] = serde_json::json!([])),
        &["licence-missing small/one"],
    );
    check_resealed(
        |f| scene(f, "/licence/parts/0/asset", "MVImgNet"),
        &[&format!("claims-disagree {SCENE}")],
    );
    check_resealed(|f| scene(f, "/licence/parts/0/expression", "CC BY 4.0"), &["licence-invalid small/one"]);
    check_resealed(
        |f| {
            let card = fs::read_to_string(f.join("README.md")).unwrap();
            fs::write(f.join("README.md"), card.replace("license: cc0-1.0", "license: mit")).unwrap();
        },
        &["card-licence README.md"],
    );
}

#[test]
fn unlawful_terms_of_a_tool_are_found() {
    let tool = |f: &Path, name: &str, licence: &str| {
        edit(f, SCENE, |v| {
            *v.pointer_mut("/licence/tools/0/name").unwrap() = name.into();
            *v.pointer_mut("/licence/tools/0/licence").unwrap() = licence.into();
        });
    };
    let composed = format!("not-composed {SCENE}");
    check_resealed(|f| tool(f, "gaussian-splatting", "CC BY MIT"), &["licence-invalid small/one"]);
    check_resealed(|f| tool(f, "gaussian-splatting", "MIT"), &["licence-forbidden small/one"]);
    check_resealed(|f| tool(f, "gaussian-splatting", "LicenseRef-Inria-MPII-3DGS"), &[&composed, &composed]);
}

#[test]
fn restricted_material_is_found() {
    let folder = copy();
    let f = folder.path();
    edit(f, SCENE, |v| v["source"]["kind"] = "dl3dv".into());
    edit(f, "manifest.json", |v| v["scenes"][0]["source"] = "dl3dv".into());
    reseal(f);
    let mut faults = audit_release(f).unwrap().faults;
    faults.retain(|fault| fault.file.as_deref() != Some("index.parquet"));
    let count = |part: &str| faults.iter().filter(|fault| fault.message.contains(part)).count();
    assert!(faults.iter().all(|fault| fault.code.name() == "licence-forbidden"), "{faults:#?}");
    assert_eq!(count("requires LicenseRef-DL3DV-10K-ToU"), 1);
    assert_eq!(count("requires CC-BY-NC-4.0"), 1);
    assert_eq!(count("must be gated"), 1);
    // Two event streams; per trajectory 6 and 10 sharp pictures, 1 and 2 blurred, 2 and 3 of depth,
    // 2 and 3 of flow, and two pictures of checks.
    assert_eq!(count("no reason to redistribute it is stated"), 35, "{faults:#?}");
}

#[test]
fn an_upstream_photo_is_known_by_its_bytes() {
    // The first picture would not do: both trajectories begin with it.
    let photo = format!("{BASE}/sharp/000004.png");
    let folder = copy();
    let f = folder.path();
    let sums = fs::read_to_string(f.join("SHA256SUMS")).unwrap();
    let sum = sums.lines().find(|l| l.ends_with(&photo)).unwrap()[..64].to_owned();
    let image = serde_json::json!(
        { "name": "IMG_1.JPG", "sha256": sum, "width": 64, "height": 48, "used": true, "why_not": null }
    );
    edit(f, SCENE, |v| v["images"] = vec![image].into());
    reseal(f);
    // A photographed scene has findings about its photos. This scene was not photographed, and
    // lacks them.
    let wanted = [format!("licence-forbidden {photo}"), "scene-incomplete small/one/checks.json".to_owned()];
    assert_eq!(found(f), wanted);
}

#[test]
fn contradictory_claims_are_found() {
    let scene = |key: &'static str, value: serde_json::Value| {
        move |f: &Path| edit(f, SCENE, |v| *v.pointer_mut(key).unwrap() = value)
    };
    let disagrees = format!("claims-disagree {SCENE}");
    check_resealed(scene("/seed", 8.into()), &[INDEX, INDEX, &disagrees]);
    check_resealed(scene("/conventions/camera_axes", "opengl".into()), &[&disagrees]);
    check_resealed(scene("/recipe/seed", 8.into()), &[&disagrees, &disagrees]);
    check_resealed(scene("/gs2e_version", "9.9.9".into()), &[&format!("version-disagrees {SCENE}")]);
    check_resealed(
        scene("/trajectories/0/statistics/on", 1.into()),
        &[INDEX, &format!("claims-disagree {BASE}/events.h5")],
    );
    check_resealed(
        scene("/trajectories/0/rate", "1200/1".into()),
        &[INDEX, &format!("claims-disagree {BASE}/poses.txt")],
    );
    check_resealed(
        scene("/camera/fx", 1.0.into()),
        &[
            &format!("claims-disagree {BASE}/transforms.json"),
            "claims-disagree small/one/slow/transforms.json",
        ],
    );
    check_resealed(|f| edit(f, SCENE, |v| v["mood"] = "sunny".into()), &[&format!("unreadable {SCENE}")]);
}

#[test]
fn false_terms_in_other_files_are_found() {
    let replace = |name: &'static str, from: &'static str, to: &'static str| {
        move |f: &Path| {
            let text = fs::read_to_string(f.join(name)).unwrap();
            assert!(text.contains(from), "{text}");
            fs::write(f.join(name), text.replace(from, to)).unwrap();
        }
    };
    check_resealed(replace("REUSE.toml", "not stated", "Somebody"), &["claims-disagree REUSE.toml"]);
    check_resealed(replace("REUSE.toml", "MIT OR Apache-2.0", "CC0-1.0"), &["claims-disagree REUSE.toml"]);
    check_resealed(
        replace("DATASHEET.md", "whole: `CC0-1.0`", "whole: `MIT`"),
        &["claims-disagree DATASHEET.md"],
    );
    check_resealed(
        |f| {
            fs::remove_file(f.join("REUSE.toml")).unwrap();
            fs::remove_file(f.join("DATASHEET.md")).unwrap();
        },
        &["missing DATASHEET.md", "missing REUSE.toml"],
    );
    // The loader's licence texts are needed only together with the loader.
    check_resealed(
        |f| fs::remove_file(f.join("LICENSES/MIT.txt")).unwrap(),
        &["licence-text-missing LICENSES/MIT.txt"],
    );
    check_resealed(
        |f| fs::remove_file(f.join("gs2e.py")).unwrap(),
        &["missing gs2e.py", "licence-unused LICENSES/Apache-2.0.txt", "licence-unused LICENSES/MIT.txt"],
    );
}

#[test]
fn splits_without_a_rule_are_found() {
    let part = serde_json::json!({ "name": "train", "group": "mine" });
    let rule = serde_json::json!({ "by": "object", "shares": { "train": 0.5, "test": 0.5 }, "salt": "" });
    let dealt = "split-leak small/one";
    check_resealed(|f| edit(f, SCENE, |v| v["split"] = part), &[INDEX, INDEX, dealt]);
    check_resealed(
        |f| edit(f, "manifest.json", |v| v["splits"] = rule.clone()),
        &["claims-disagree croissant.json", dealt],
    );
    let mut short = rule.clone();
    short["shares"]["train"] = 0.1.into();
    check_resealed(
        |f| edit(f, "manifest.json", |v| v["splits"] = short),
        &["claims-disagree croissant.json", "split-leak manifest.json"],
    );
}

#[test]
fn an_incomplete_scene_is_found() {
    let lacks = |name: &str| {
        let path = format!("{BASE}/{name}");
        check_resealed(|f| fs::remove_file(f.join(&path)).unwrap(), &[&format!("scene-incomplete {path}")]);
    };
    lacks("events.h5");
    lacks("sharp/000008.png");
    lacks("checks.json");
    lacks("speed.json");
    check_resealed(
        |f| fs::remove_file(f.join(SCENE)).unwrap(),
        &["croissant-files croissant.json", "scene-incomplete small/one"],
    );
}

#[test]
fn a_failed_check_is_found() {
    check_resealed(
        |f| edit(f, &format!("{BASE}/checks.json"), |v| v[0]["verdict"] = "fail".into()),
        &[INDEX, &format!("check-failed-unwaived {BASE}/checks.json")],
    );
    check_resealed(
        |f| edit(f, &format!("{BASE}/checks.json"), |v| v[0]["verdict"] = "waived".into()),
        &[INDEX, "not-composed manifest.json", "not-composed manifest.json"],
    );
}

#[test]
fn unreadable_contents_are_found() {
    let damage = |name: &'static str, change: &dyn Fn(Vec<u8>) -> Vec<u8>, code: &str| {
        let path = format!("{BASE}/{name}");
        let folder = copy();
        let bytes = fs::read(folder.path().join(&path)).unwrap();
        fs::write(folder.path().join(&path), change(bytes)).unwrap();
        reseal(folder.path());
        assert_eq!(found(folder.path()), [format!("{code} {path}")]);
    };
    let text =
        |change: fn(String) -> String| move |bytes| change(String::from_utf8(bytes).unwrap()).into_bytes();
    damage(
        "events.h5",
        &|mut bytes| {
            bytes.truncate(bytes.len() / 2);
            bytes
        },
        "unreadable",
    );
    damage("events.h5", &|_| b"no events".to_vec(), "unreadable");
    damage("sharp/000004.png", &|_| fs::read(release().join("README.md")).unwrap(), "unreadable");
    damage("poses.txt", &text(|t| t.replacen(' ', " nan ", 1)), "unreadable");
    damage("timestamps_us.txt", &text(|t| t.replace("417\n", "418\n")), "claims-disagree");
    damage(
        "transforms.json",
        &text(|t| t.replacen("\"t_us\": 1667", "\"t_us\": 1668", 1)),
        "claims-disagree",
    );
    damage("checks.json", &text(|t| t.replacen("pass", "fine", 1)), "unreadable");
}

/// Flips random bits of random files and keeps the files' times: four hundred flips, or ten
/// thousand with slow tests. Four threads work at once, each on its own copy.
#[test]
fn every_single_bit_matters() {
    let flips = if is_thorough() { 10_000 } else { 400 };
    let missed: Vec<String> = std::thread::scope(|scope| {
        let hands: Vec<_> = (0..4).map(|hand| scope.spawn(move || missed(hand, flips / 4))).collect();
        hands.into_iter().flat_map(|hand| hand.join().unwrap()).collect()
    });
    assert_eq!(missed, [""; 0], "of {flips} flips");
}

/// Flips that the audit does not find.
fn missed(hand: u64, flips: usize) -> Vec<String> {
    let folder = copy();
    let paths: Vec<String> = read(release()).into_keys().collect();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(20_250_521 + hand);
    let mut missed = Vec::new();
    for _ in 0..flips {
        let path = &paths[random.random_range(0..paths.len())];
        let file = folder.path().join(path);
        let sound = fs::read(&file).unwrap();
        let (byte, bit) = (random.random_range(0..sound.len()), random.random_range(0..8));
        let mut flipped = sound.clone();
        flipped[byte] ^= 1 << bit;
        let before = fs::metadata(&file).unwrap().modified().unwrap();
        let write = |bytes: &[u8]| {
            fs::write(&file, bytes).unwrap();
            fs::File::open(&file).unwrap().set_modified(before).unwrap();
        };
        write(&flipped);
        if audit_release(folder.path()).unwrap().faults.is_empty() {
            missed.push(format!("bit {bit} of byte {byte} of {path}"));
        }
        write(&sound);
    }
    assert_eq!(audit_release(folder.path()).unwrap().faults, []);
    missed
}

#[test]
fn the_exit_code_of_the_verb_is_the_verdict() {
    let folder = copy();
    assert_eq!(gs2e(folder.path(), &["audit", "."]).status.code(), Some(0));
    fs::write(folder.path().join("more"), "").unwrap();
    let output = gs2e(folder.path(), &["audit", ".", "--json"]);
    assert_eq!(output.status.code(), Some(3));
    let first = String::from_utf8(output.stdout).unwrap();
    let fault: serde_json::Value = serde_json::from_str(first.lines().next().unwrap()).unwrap();
    assert_eq!((fault["code"].as_str(), fault["file"].as_str()), (Some("unlisted"), Some("more")));
    assert_eq!(gs2e(folder.path(), &["audit", "nowhere"]).status.code(), Some(2));
}
