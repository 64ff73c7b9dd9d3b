//! Tasks of the repository: `cargo xtask ci | test | alone | faults | fuzz | bombs | bench | report |
//! power | sound | slurm | network | bucket | consumers | docs | man | manifest | python | container`.
//!
//! It uses the standard library only, so that building it takes a second and never a second copy of
//! the crate's dependencies.

mod alone;
mod bombs;
mod bucket;
mod changed;
mod check_bench;
mod ci;
mod command;
mod consumers;
mod container;
mod demo;
mod export_bench;
mod faults;
mod folder;
mod fuzz;
mod gpu_bench;
mod network;
mod options;
mod page;
mod pass_bench;
mod peers_bench;
mod power;
mod python;
mod report;
mod shards;
mod slurm;
mod sound;
mod suite;

use std::process::ExitCode;

const USAGE: &str = "\
usage: cargo xtask <task>

  ci                 what CI runs: formatting, clippy, tests, faults, fuzzing, bombs, Python, documentation, packages, licences;
                     `--long` adds slow tests and what takes a build in release mode: all fault tests, more fuzzing, the README's
                     first command, builds beside ninja
  test               tells in minutes whether this checkout is sound here: every crate's unit tests, pinned bytes, pictures, the
                     demo; names what is absent and left out
  test --all         all tests
  test --changed     the tests of what depends on the crates that differ from `main`
  test ARGS...       `cargo test` over the workspace with these arguments
  alone              builds and runs the examples of the crates for other programs, each as a package outside of this workspace
  faults [ARGS]...   kills, starves and damages the engine (`--long`, `--seconds N` each, `--only NAME`, `--seed N`)
  fuzz [ARGS]...     mutated files for every reader (`--seconds N` each, `--only READER`, `--seed N`, `--first N`, `--runs N`, `--jobs N`)
  bombs [ARGS]...    small files that ask for much memory, and the table of what the program takes for them (`--program FILE`;
                     NAMEs of bombs)
  bench [ARGS]...    throughput of each part; ARGS go to the benchmark (`--json`, `--runs N`, `--only TEXT`, names of parts)
  bench build [ARGS]...
                     builds of 2,000 scenes beside ninja (`--scenes N`, `--runs N`, `--long`, `--check`)
  bench report [ARGS]...
                     size of report.html of 2,000 scenes, and how long Chromium takes to open it (`--scenes N`, `--runs N`,
                     `--page FILE`: of a release that is there; `--keep FILE`)
  bench check [ARGS]...
                     time of `check --tree` next to that of the release, and its memory for streams of 10^6 to 10^8 events
                     (`--most N`, `--runs N`, `--program FILE`)
  bench export [ARGS]...
                     time and peak memory of every layout of `gs2e export` for a stream of 10^8 events, next to a plain copy of what
                     it wrote (`--events N`, `--only FORMAT,…`, `--program FILE`)
  bench gpu [ARGS]...
                     the GPU: frames/s, time and counted work by stage, likeness to the CPU, memory over 200 scenes, gsplat on the
                     same views, and the paper's scene from recipe to release (`--quick`, `--gpu NAME`, `--gpu-without FEATURES`,
                     `--size WxH`, `--frames N`, `--scenes N`, `--python FILE` with torch and gsplat, `--program FILE`,
                     `--profile NAME`)
  bench pass [ARGS]...
                     CPU time and peak memory of one pass of the renderer for all outputs, next to a step for each output
                     (`--runs N`, `-j N`, `--program FILE`)
  bench peers [ARGS]...
                     CPU time of the published programs DVS-Voltmeter and v2e, where they are installed, next to `gs2e simulate` on
                     the same frames (`--dvs-voltmeter DIR`, `--v2e DIR`, `--python FILE`, `--frames N`, `--runs N`, `--program FILE`)
  report [ARGS]...   studies of three scenes, and how run time grows, as work-precision.md (`--scene NAME`; `--quick` tries it); and
                     a tolerance against a rate, as tolerance.md (`report tolerance`: that alone), in crates/lab/results; a part
                     of them goes to target/report
  power [ARGS]...    the share of planted faults that the checks find from files, by size, as the table of crates/lab/results/checks.md
                     (`--releases N`, `--program FILE`; `--stated` plants the faults of the stated sizes alone)
  sound [ARGS]...    sound releases of many kinds: no check may fail, and release and check agree (`--scenes N`, `--first N`,
                     `--program FILE`)
  slurm [ARGS]...    `gs2e submit` on a private Slurm cluster, with tasks, daemons and the submitter killed (`--scenes N`,
                     `--tasks N`, `--program FILE`; needs Debian's slurm-wlm and munge)
  network [ARGS]...  eight processes with one shared store on two mounts of a network file system (`--scenes N`,
                     `--program FILE`, `--mounts A,B`; without mounts it needs Debian's sshfs and openssh-sftp-server)
  bucket [ARGS]...   eight processes with one shared store in a bucket, moto, whose requests fail in many ways (`--scenes N`,
                     `--program FILE` with the feature s3, `--python FILE` with `moto[server]`)
  consumers --with PATH [ARGS]...
                     reads an export of the demo with the loader of a clone that you have (`--as FORMAT`, `--release DIR` of a
                     release that is there, `--program FILE`, `--python FILE`)
  docs               rewrites the generated parts of docs/recipe.md and docs/cli.md from the program
  man DIR            writes the manual pages of the program and its commands to DIR
  manifest           builds the demo release and rewrites manifests/demo.json from it
  container [FILE]   builds the demo under a read-only root as an unknown user, as in a container; FILE is the program, by
                     default that of a release build
  python [ARGS]...   installs the wheel in target/python, and runs its tests and the examples of docs/python.md
                     (`--profile NAME` first; ARGS go to pytest; `--bench`: measures its throughput instead)
";

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let task = args.next();
    let rest: Vec<String> = args.collect();
    let done = match (task.as_deref(), rest.as_slice()) {
        (Some("ci"), []) => ci::run(false),
        (Some("ci"), [long]) if long == "--long" => ci::run(true),
        (Some("alone"), []) => alone::run(),
        (Some("test"), args) => suite::run(args),
        (Some("faults"), args) => faults::run(args),
        (Some("fuzz"), args) => fuzz::run(args),
        (Some("bombs"), args) => bombs::run(args),
        (Some("bench"), [part, args @ ..]) if part == "build" => {
            command::cargo(&["bench", "--quiet", "--bench", "build", "--"]).args(args).run()
        }
        (Some("bench"), [part, args @ ..]) if part == "check" => check_bench::run(args),
        (Some("bench"), [part, args @ ..]) if part == "export" => export_bench::run(args),
        (Some("bench"), [part, args @ ..]) if part == "gpu" => gpu_bench::run(args),
        (Some("bench"), [part, args @ ..]) if part == "pass" => pass_bench::run(args),
        (Some("bench"), [part, args @ ..]) if part == "peers" => peers_bench::run(args),
        (Some("bench"), [part, args @ ..]) if part == "report" => page::run(args),
        (Some("bench"), args) => {
            command::cargo(&["bench", "--quiet", "--bench", "throughput", "--"]).args(args).run()
        }
        (Some("report"), args) => report::run(args),
        (Some("power"), args) => power::run(args),
        (Some("slurm"), args) => slurm::run(args),
        (Some("network"), args) => network::run(args),
        (Some("bucket"), args) => bucket::run(args),
        (Some("consumers"), args) => consumers::run(args),
        (Some("sound"), args) => sound::run(args),
        (Some("docs"), []) => suite::rewrite_docs(),
        (Some("man"), [folder]) => man_pages(folder),
        (Some("manifest"), []) => demo::rewrite_manifest(),
        (Some("python"), args) => python::run(args),
        (Some("container"), args) => container::run(args),
        _ => return usage(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            command::say(&format!("error: {why}"));
            ExitCode::FAILURE
        }
    }
}

/// Writes the manual pages. An example does it, because only examples may use the program's library here.
fn man_pages(folder: &str) -> command::Outcome {
    // The example runs in the repository's root, and the folder is relative to the current one.
    let folder = std::path::absolute(folder).map_err(|e| format!("{folder}: {e}"))?;
    command::cargo(&["run", "--quiet", "--example", "man", "--"]).args([folder]).run()
}

fn usage() -> ExitCode {
    command::say(USAGE.trim_end());
    ExitCode::from(2)
}
