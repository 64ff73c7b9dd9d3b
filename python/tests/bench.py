"""Throughput of the module: windows per second, pictures per second, and simulation compared with the command.

    cargo xtask python --profile release --bench [windows] [pictures] [simulation]

It makes its own inputs in a temporary folder. `torch` and Pillow are measured where they are installed. Times are wall
times, so the machine should be idle; the last line has its load.
"""

import os
import pathlib
import resource
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time

import numpy as np

import gs2e

PROGRAM = pathlib.Path(sysconfig.get_path("scripts"), "gs2e")
SECONDS = 3.0
"""Time that each rate is measured over."""

RECIPE = """\
version: 1
scene: bench/{name}
source: {{ procedural: {{ kind: still-life, gaussians: 3000, views: 30, arc: 40, seed: 1 }} }}
trajectories: [{{ name: base, refine: {{ window: 2, duration: 400 ms }} }}]
licence: {{ expression: CC0-1.0, holder: The gs2e authors }}
{rest}
"""
SENSOR = "sensor: { voltmeter: { preset: davis346, threshold: { on: 0.5, off: 0.5 } } }"
SCENES = {
    "events": f"camera: {{ width: 160, height: 90 }}\nsampling: {{ rate: 1200 }}\n{SENSOR}\noutputs: [events]",
    "frames": "camera: { width: 320, height: 180 }\nsampling: { rate: 60 }\noutputs: [sharp]",
}


def main(parts):
    measures = {"windows": measure_windows, "pictures": measure_pictures, "simulation": measure_simulation}
    row("what", "per second", "wanted")
    row("---", "---", "---")
    for part in parts or measures:
        with tempfile.TemporaryDirectory() as place:
            measures[part](pathlib.Path(place))
    print(f"\n{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")


def row(*cells):
    print("|", " | ".join(cells), "|", flush=True)


def rate(act):
    """Calls of `act` per second; each returns the number of its items."""
    act()
    begin, done = time.perf_counter(), 0
    while time.perf_counter() - begin < SECONDS:
        done += act()
    return done / (time.perf_counter() - begin)


def make_scene(place, name):
    """Makes a release of one scene in `place`, and opens it."""
    (place / "recipes").mkdir()
    (place / "recipes" / f"{name}.yaml").write_text(RECIPE.format(name=name, rest=SCENES[name]))
    words = ["-C", place, "--backend", "cpu", "release", "--to", "out", "recipes"]
    done = subprocess.run([PROGRAM, *words], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    return gs2e.open(place / "out/bench" / name)


def measure_windows(place):
    scene = make_scene(place, "events")
    cut = gs2e.Windows(scene, 20_000, bins=5, stride_us=1_000)
    mean = np.mean([len(scene.events(i * 1_000, i * 1_000 + 20_000).t) for i in range(len(cut))])
    what = f"windows of {mean:.0f} events, 160x90, 5 bins"
    row(f"{what}, without torch", f"{rate(lambda: sum(1 for _ in cut)):.0f}", "")
    try:
        import torch

        from gs2e.torch import EventWindows
    except ImportError:
        row("torch is not installed", "", "")
        return
    windows = EventWindows(scene, length_us=20_000, bins=5, stride_us=1_000)
    # Long enough that the start of the workers does not count.
    many = torch.utils.data.ConcatDataset([windows] * 200)
    for workers in (1, 2):
        batches = iter(torch.utils.data.DataLoader(many, batch_size=8, num_workers=workers))
        found = rate(lambda: len(next(batches)["t0_us"]))
        row(f"{what}, torch, {workers} worker(s)", f"{found:.0f}", f"{500 * workers}")


def measure_pictures(place):
    frames = make_scene(place, "frames").frames
    for decoder, wanted in (("pillow", "200"), ("opencv", ""), ("numpy", "")):
        try:
            gs2e.read_png(frames[0].path, decoder)
        except ImportError:
            continue
        read = lambda: sum(1 for frame in frames[:4] if gs2e.read_png(frame.path, decoder) is not None)  # noqa: E731
        row(f"pictures of 320x180 by {decoder}", f"{rate(read):.0f}", wanted)


def measure_simulation(place):
    """100 frames of 640x480, alternately by the command and by the module; both write the same file."""
    y, x = np.mgrid[:480, :640].astype(np.float32)
    frames = (128 + 100 * np.sin((x + y / 2 + i / 4) / 6) for i in range(100))
    np.save(place / "frames.npy", np.stack([frame.astype(np.uint8) for frame in frames]))
    stamps = np.arange(100, dtype=np.int64) * 1000
    np.save(place / "stamps.npy", stamps)
    words = ["simulate", "--frames", "frames.npy", "--stamps", "stamps.npy", "--sensor", "davis346", "--seed", "1"]

    def by_command():
        subprocess.run([PROGRAM, *words, "--out", "command.h5"], cwd=place, check=True, capture_output=True)

    def by_module():
        frames = np.load(place / "frames.npy", mmap_mode="r")
        gs2e.simulate_to_file(place / "module.h5", frames, stamps, "davis346", seed=1)

    seconds = {"command": [], "module": []}
    for _ in range(5):
        for name, act, who in (
            ("command", by_command, resource.RUSAGE_CHILDREN),
            ("module", by_module, resource.RUSAGE_SELF),
        ):
            begin = time.perf_counter(), cpu_seconds(who)
            act()
            seconds[name].append((time.perf_counter() - begin[0], cpu_seconds(who) - begin[1]))
    if (place / "command.h5").read_bytes() != (place / "module.h5").read_bytes():
        raise SystemExit("the files of the command and of the module differ")
    for kind, per in enumerate(("second", "CPU second")):
        command, module = (statistics.median(run[kind] for run in seconds[name]) for name in ("command", "module"))
        row(f"frames of 640x480 simulated by the command, per {per}", f"{100 / command:.1f}", "")
        row(f"frames of 640x480 simulated by the module, per {per}", f"{100 / module:.1f}", f"{90 / command:.1f}")


def cpu_seconds(who):
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main(sys.argv[1:])
