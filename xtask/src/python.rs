//! The Python package: a wheel in a fresh virtual environment, and its tests.

use crate::command::{Outcome, program, root, say};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Folder of the virtual environment.
const PLACE: &str = "target/python";

/// What the tests need besides the wheel's own dependencies. torch is tested where it is installed.
const NEEDS: [&str; 9] = [
    "maturin>=1.9,<2",
    "pytest",
    "pyarrow",
    "pillow",
    "check-jsonschema",
    "pyyaml",
    "matplotlib",
    "nbclient",
    "ipykernel",
];

/// Builds the wheel, installs it, and runs the tests and the examples of the documentation, or with
/// `--bench` the measurements of throughput. `--profile NAME` chooses the profile of cargo; the other
/// arguments go to pytest.
pub(crate) fn run(args: &[String]) -> Outcome {
    let (profile, args) = match args {
        [option, profile, args @ ..] if option == "--profile" => (profile.as_str(), args),
        args => ("dev", args),
    };
    let begin = Instant::now();
    let python = install(profile)?;
    say(&format!("python: wheel installed, {:.1} s", begin.elapsed().as_secs_f64()));
    match args {
        [option, parts @ ..] if option == "--bench" => {
            program(python.as_os_str(), &["python/tests/bench.py"]).args(parts).run()
        }
        args => {
            run_tests(&python, args)?;
            say(&format!("python: ok, {:.1} s", begin.elapsed().as_secs_f64()));
            Ok(())
        }
    }
}

/// [`run`] with the library that the tests have compiled. Where the tools of Python cannot be installed, the
/// wheel is not tested, unless `REQUIRE_WHEEL` is set.
pub(crate) fn in_ci() -> Outcome {
    match (environment(), std::env::var_os("REQUIRE_WHEEL")) {
        (Err(why), None) => {
            say(&format!("absent: the tools of Python ({why}): the wheel is not tested"));
            Ok(())
        }
        (Err(why), Some(_)) => Err(why),
        (Ok(_), _) => run(&[]),
    }
}

/// Makes the virtual environment with what the tests need, and returns its Python.
fn environment() -> Outcome<PathBuf> {
    let place = root().join(PLACE);
    let python = place.join("bin/python");
    if !python.exists() {
        program(OsStr::new("python3"), &["-m", "venv", PLACE]).run()?;
    }
    pip(&python, &NEEDS)?;
    Ok(python)
}

/// Installs the wheel in the environment, and returns its Python.
fn install(profile: &str) -> Outcome<PathBuf> {
    let python = environment()?;
    // Without isolation, the backend is the maturin of this environment; without the index, an old wheel
    // of the same version is replaced.
    let build = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-build-isolation"];
    let again = ["--force-reinstall", "--no-deps", "."];
    let path = std::env::var("PATH").unwrap_or_default();
    let path = format!("{}:{path}", root().join(PLACE).join("bin").display());
    let arguments = format!("--profile {profile}");
    program(python.as_os_str(), &build)
        .args(again)
        .env("MATURIN_PEP517_ARGS", &arguments)
        .env("PATH", &path)
        .run()?;
    pip(&python, &["numpy", "h5py"])?;
    Ok(python)
}

fn run_tests(python: &Path, args: &[String]) -> Outcome {
    let tests = ["-m", "pytest", "--quiet", "-p", "no:cacheprovider", "--import-mode", "importlib"];
    let places = ["python/tests", "--doctest-glob", "python.md", "docs/python.md"];
    program(python.as_os_str(), &tests).args(places).args(args).env("PYTHONDONTWRITEBYTECODE", "1").run()?;
    let doctests = ["--doctest-modules", "--pyargs", "gs2e", "--ignore-glob", "*torch.py"];
    program(python.as_os_str(), &tests).args(doctests).env("PYTHONDONTWRITEBYTECODE", "1").run()?;
    run_notebook(python)
}

/// Runs the notebook from the first cell to the last; `target/quickstart.ipynb` has its pictures.
fn run_notebook(python: &Path) -> Outcome {
    let script = "import nbformat, nbclient; \
                  notebook = nbformat.read('examples/quickstart.ipynb', 4); \
                  nbclient.NotebookClient(notebook, timeout=600).execute(); \
                  nbformat.write(notebook, 'target/quickstart.ipynb')";
    program(python.as_os_str(), &["-c", script]).run()
}

fn pip(python: &Path, packages: &[&str]) -> Outcome {
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    program(python.as_os_str(), &install).args(packages).run()
}
