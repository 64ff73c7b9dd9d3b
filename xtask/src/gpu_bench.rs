//! The GPU: `gs2e doctor`, the renderer by the benchmark `gpu`, gsplat on the same views in the same run, and
//! the paper's scene from recipe to release.
//!
//! It is one command, so that an hour on a machine with a GPU is enough. What is absent is named and left
//! out.

use crate::check_bench::watch;
use crate::command::{Outcome, cargo, program, root, say};
use crate::options::Options;
use std::fs;
use std::path::{Path, PathBuf};

const REAL_SCENE: &str = "../shared/data/scenes";
const PEER: &str = "xtask/src/gpu_bench/gsplat_rate.py";

/// What was asked for.
struct GpuBench<'a> {
    is_quick: bool,
    /// Options of `gs2e` that choose the GPU.
    choice: Vec<&'a str>,
    python: &'a str,
    profile: &'a str,
    frames: &'a str,
    size: &'a str,
    scenes: Option<&'a str>,
    folder: PathBuf,
}

/// Measures: `--quick` (a small scene, for a GPU in software), `--gpu NAME`, `--gpu-without FEATURES`,
/// `--size WxH`, `--frames N`, `--scenes N`, `--python FILE` with torch and gsplat, `--profile NAME` of cargo
/// (`release`), `--program FILE`.
pub(crate) fn run(args: &[String]) -> Outcome {
    let value = |name: &str| Options(args).value(name);
    let is_quick = args.iter().any(|arg| arg == "--quick");
    let choice = ["--gpu", "--gpu-without"].into_iter().filter_map(|name| Some([name, value(name)?]));
    let bench = GpuBench {
        is_quick,
        choice: choice.flatten().collect(),
        python: value("--python").unwrap_or("python3"),
        profile: value("--profile").unwrap_or("release"),
        frames: value("--frames").unwrap_or(if is_quick { "6" } else { "120" }),
        size: value("--size").unwrap_or(if is_quick { "160x90" } else { "1280x720" }),
        scenes: value("--scenes"),
        folder: root().join("target/gpu-bench"),
    };
    fs::create_dir_all(&bench.folder).map_err(|e| format!("{}: {e}", bench.folder.display()))?;
    let gs2e = match value("--program") {
        Some(path) => PathBuf::from(path),
        None => bench.build()?,
    };
    say("# doctor\n");
    program(gs2e.as_os_str(), &["doctor"]).args(&bench.choice).run()?;
    say("\n# renderer\n");
    bench.renderer()?;
    say("\n# gsplat, the same views\n");
    bench.peer()?;
    say("\n# the paper's scene, from recipe to release\n");
    bench.paper_scene(&gs2e)
}

impl GpuBench<'_> {
    /// The program, built with the profile.
    fn build(&self) -> Outcome<PathBuf> {
        cargo(&["build", "--quiet", "--bin", "gs2e", "--profile", self.profile]).run()?;
        let target =
            std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
        // The profile `dev` has a folder of another name.
        let folder = if self.profile == "dev" { "debug" } else { self.profile };
        Ok(target.join(folder).join("gs2e"))
    }

    /// A captured scene with its views, if the machine has it.
    fn real_scene(&self) -> Option<[PathBuf; 2]> {
        let scenes = root().join(REAL_SCENE);
        let files = ["playbot.spz", "playbot.transforms.json"].map(|name| scenes.join(name));
        (!self.is_quick && files.iter().all(|file| file.is_file())).then_some(files)
    }

    /// The benchmark. It leaves the scene and the views for the peer.
    fn renderer(&self) -> Outcome {
        let mut task = cargo(&["bench", "--quiet", "--bench", "gpu", "--profile", self.profile, "--"]);
        if self.is_quick {
            task = task.args(["--quick"]);
        }
        task = task.args(&self.choice).args(["--size", self.size, "--frames", self.frames, "--export"]);
        task = task.args([&self.folder]);
        if let Some(scenes) = self.scenes {
            task = task.args(["--scenes", scenes]);
        }
        match self.real_scene() {
            Some([scene, views]) => {
                task = task.args(["--scene".into(), scene, "--views".into(), views]);
            }
            None => say(&format!("left out: {REAL_SCENE}: a still life takes the place of a captured scene")),
        }
        task.run()
    }

    /// The rate of gsplat, if it is there.
    fn peer(&self) -> Outcome {
        let task = program(self.python.as_ref(), &[PEER]).args([&self.folder]).args([self.frames]);
        let output = match task.any_code() {
            Ok(output) => output,
            Err(why) => {
                say(&format!("absent: gsplat: {why}"));
                return Ok(());
            }
        };
        let [out, err] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
        let (line, last) = (out.trim(), err.lines().last().unwrap_or_default());
        if !output.status.success() {
            say(&format!("absent: gsplat: {last}"));
        } else if line.contains("\"absent\"") {
            say(&format!("absent: gsplat: {line}"));
        } else {
            say(&format!(
                "frames/s of `rasterization`, packed=False, next to the row `rgb, rules gsplat`: {line}"
            ));
        }
        Ok(())
    }

    /// 150 poses at 1920x1080, events and sharp pictures: the scene of the paper's figure of 45 s.
    fn paper_scene(&self, gs2e: &Path) -> Outcome {
        let source = match self.real_scene() {
            // A path in Rust's quotes is a string of YAML too.
            Some([scene, views]) => format!(
                "source: {{ nerfstudio: {{ path: {views:?} }} }}\nreconstruct: {{ given: {{ path: {scene:?} }} }}\n"
            ),
            None => {
                let gaussians = if self.is_quick { 2000 } else { 500_000 };
                format!(
                    "source: {{ procedural: {{ kind: still-life, gaussians: {gaussians}, views: 30, seed: 1 }} }}\n"
                )
            }
        };
        let (width, height, factor) = if self.is_quick { (160, 90, 2) } else { (1920, 1080, 5) };
        let recipe = format!(
            "version: 1\nscene: paper\n{source}camera: {{ width: {width}, height: {height} }}\n\
             trajectories: [{{ name: base, refine: {{ window: 2, factor: {factor} }}, speed: {{ function: \
             \"0.25*sin(t) + 1.1\" }} }}]\n\
             outputs: [events, sharp]\nlicence: {{ expression: CC0-1.0, holder: a benchmark }}\n"
        );
        let [file, store, tree] = ["paper.yaml", "store", "paper"].map(|name| self.folder.join(name));
        fs::write(&file, recipe).map_err(|e| format!("{}: {e}", file.display()))?;
        let text = |path: &Path| path.to_string_lossy().into_owned();
        say("| renderer | seconds | CPU seconds | peak, MB |\n|---|---|---|---|");
        for backend in ["gpu", "cpu"] {
            for old in [&store, &tree] {
                if old.exists() {
                    fs::remove_dir_all(old).map_err(|e| format!("{}: {e}", old.display()))?;
                }
            }
            let paths = [&store, &tree, &file].map(|path| text(path));
            let [store, tree, file] = &paths;
            let mut args =
                vec!["release", "--copy", "-q", "--backend", backend, "--store", store, "--to", tree, file];
            if backend == "gpu" {
                args.extend(&self.choice);
            }
            let cost = watch(gs2e, &args, &[0])?;
            say(&format!(
                "| {backend} | {:.2} | {:.2} | {:.0} |",
                cost.seconds, cost.cpu_seconds, cost.peak_mb
            ));
        }
        Ok(())
    }
}
