//! Exports read by the programs that they are for: the loader of a clone that a person names, unchanged, on
//! an export of the demo's release.

use crate::command::{Outcome, program, say};
use crate::folder::Folder;
use crate::options::Options;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Calls the loaders.
const SCRIPT: &str = "xtask/src/consumers/load.py";

/// A program with a loader that the script calls.
#[derive(Debug, PartialEq, Eq)]
struct Consumer {
    /// Name of the export.
    format: &'static str,
    repository: &'static str,
    /// Files that only its clone has, all of them.
    files: &'static [&'static str],
    /// Packages of Python that its loader uses.
    packages: &'static str,
}

const fn consumer(
    format: &'static str,
    repository: &'static str,
    files: &'static [&'static str],
    packages: &'static str,
) -> Consumer {
    Consumer { format, repository, files, packages }
}

const CONSUMERS: [Consumer; 7] = [
    consumer(
        "robust-e-nerf",
        "wengflow/robust-e-nerf",
        &["robust_e_nerf/data/datasets.py"],
        "torch, numpy, easydict, tqdm, opencv-python",
    ),
    consumer(
        "e2nerf",
        "iCVTEAM/E2NeRF",
        &["load_blender.py", "event_loss_helpers.py"],
        "torch, numpy, imageio",
    ),
    consumer(
        "monash-h5",
        "TimoStoff/event_cnn_minimal",
        &["data_loader/dataset.py", "utils/henri_compatible.py"],
        "torch, numpy, h5py, pandas",
    ),
    consumer("e2vid", "uzh-rpg/rpg_e2vid", &["utils/event_readers.py"], "numpy, pandas below 3"),
    consumer("e2vid-zip", "uzh-rpg/rpg_e2vid", &["utils/event_readers.py"], "numpy, pandas below 3"),
    consumer("evreal", "ercanburak/EVREAL", &["dataset.py", "tools/bag_to_npy.py"], "torch, numpy"),
    consumer("dsec", "uzh-rpg/DSEC", &["scripts/utils/eventslicer.py"], "numpy, h5py, numba"),
];

/// Reads an export with a clone: `--with PATH`, `--as FORMAT` where the clone reads several, `--release DIR`
/// of a release that is there, `--program FILE` (built in release mode), `--python FILE`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let options = Options(args);
    let clone = options.path("--with")?;
    let clone = clone.ok_or("wanted --with PATH: the clone of a program that reads exports")?;
    // Before anything is built.
    let consumers = chosen(&clone, options.value("--as"))?;
    let python = options.value("--python").unwrap_or("python3");
    let gs2e = options.program(&[])?;
    let folder = Folder::new("consumers")?;
    let release = match options.path("--release")? {
        Some(path) => path,
        None => demo_release(&gs2e, folder.path())?,
    };
    for consumer in consumers {
        let export = folder.path().join(consumer.format);
        let args = [OsStr::new("export"), release.as_os_str(), OsStr::new("--to"), consumer.format.as_ref()];
        let out = [OsStr::new("--lossy"), OsStr::new("-q"), OsStr::new("--out"), export.as_os_str()];
        program(gs2e.as_os_str(), &args).args(out).run()?;
        let args = [SCRIPT.as_ref(), OsStr::new(consumer.format), clone.as_os_str(), export.as_os_str()];
        let read = program(python.as_ref(), &args).env("PYTHONDONTWRITEBYTECODE", "1").run();
        let help = |why| format!("{why}; {} needs {}", consumer.repository, consumer.packages);
        read.map_err(help)?;
        say(&format!("{}: read by the loader of {}", consumer.format, consumer.repository));
    }
    Ok(())
}

/// The demo's release, in a folder.
fn demo_release(gs2e: &Path, folder: &Path) -> Outcome<PathBuf> {
    let [out, store] = ["release", "store"].map(|name| folder.join(name));
    let args = ["release", "-q", "recipes/demo.yaml", "--to"].map(OsStr::new);
    let places = [out.as_os_str(), OsStr::new("--store"), store.as_os_str()];
    program(gs2e.as_os_str(), &args).args(places).run()?;
    Ok(out)
}

/// The programs whose loaders the clone has, or the one that was asked for.
fn chosen(clone: &Path, asked: Option<&str>) -> Outcome<Vec<&'static Consumer>> {
    let shown = clone.display();
    if !clone.is_dir() {
        return Err(format!("{shown}: found no folder, wanted the clone of a program that reads exports"));
    }
    let all = || {
        let line = |consumer: &Consumer| {
            format!("\n  {}: {}, with {}", consumer.format, consumer.repository, consumer.files.join(" and "))
        };
        CONSUMERS.iter().map(line).collect::<String>()
    };
    let lacking = |consumer: &Consumer| consumer.files.iter().find(|file| !clone.join(file).is_file());
    match asked {
        Some(asked) => {
            let named = CONSUMERS.iter().find(|consumer| consumer.format == asked);
            let named = named.ok_or_else(|| format!("--as: found {asked}, wanted one of:{}", all()))?;
            match lacking(named) {
                None => Ok(vec![named]),
                Some(file) => {
                    Err(format!("{shown}: found no {file}, wanted a clone of {}", named.repository))
                }
            }
        }
        None => {
            let found: Vec<_> = CONSUMERS.iter().filter(|consumer| lacking(consumer).is_none()).collect();
            if found.is_empty() {
                return Err(format!("{shown}: found the loader of no program, wanted one of:{}", all()));
            }
            Ok(found)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::root;

    /// The error of a choice.
    fn fault(clone: &Path, asked: Option<&str>) -> String {
        chosen(clone, asked).map(|found| found.len()).expect_err("there is no loader")
    }

    #[test]
    fn an_absent_loader_is_an_error_that_names_what_was_not_found() {
        let folder = Folder::new("consumers-test").expect("a folder can be made");
        let place = folder.path();
        let fault_of = |asked| fault(place, asked);
        assert!(fault(&place.join("absent"), None).contains("found no folder"));
        let none = fault_of(None);
        assert!(none.contains("found the loader of no program"), "{none}");
        assert!(none.contains("dsec: uzh-rpg/DSEC, with scripts/utils/eventslicer.py"), "{none}");
        assert!(fault_of(Some("nerf")).starts_with("--as: found nerf, wanted one of:"));
        let one = fault_of(Some("e2nerf"));
        assert!(one.ends_with("found no load_blender.py, wanted a clone of iCVTEAM/E2NeRF"), "{one}");

        std::fs::create_dir(place.join("utils")).expect("a folder can be made");
        std::fs::write(place.join("utils/event_readers.py"), "").expect("a file can be written");
        let formats = |asked| {
            let found = chosen(place, asked).expect("there is a loader");
            found.iter().map(|consumer| consumer.format).collect::<Vec<_>>()
        };
        assert_eq!(formats(None), ["e2vid", "e2vid-zip"]);
        assert_eq!(formats(Some("e2vid-zip")), ["e2vid-zip"]);
    }

    #[test]
    fn the_script_has_a_function_for_each_consumer() {
        let script = std::fs::read_to_string(root().join(SCRIPT)).expect("the script is there");
        for consumer in &CONSUMERS {
            let name = consumer.format.replace('-', "_");
            assert!(script.contains(&format!("\ndef {name}(export):")), "{name}");
        }
    }
}
