"""`gs2e.simulate` compared with the command, and its refusals."""

import pickle
import resource
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

import gs2e

FIELDS = "txyp"


def by_command(program, place, frames, stamps, *options):
    """The file of `gs2e simulate` on the same input."""
    np.save(place / "frames.npy", frames)
    np.save(place / "stamps.npy", stamps)
    out = place / "command.h5"
    inputs = ["--frames", place / "frames.npy", "--stamps", place / "stamps.npy"]
    done = program("simulate", *inputs, "--out", out, *options)
    assert done.returncode == 0, done.stderr
    return out


def same(events, others):
    for field in FIELDS:
        ours, theirs = getattr(events, field), getattr(others, field)
        assert ours.dtype == theirs.dtype and np.array_equal(ours, theirs), field


SENSORS = {
    "preset": ("dvs346", {}, ["--sensor", "dvs346", "--seed", "7"]),
    "noise": ("v2e-noisy", {}, ["--sensor", "v2e-noisy", "--seed", "7"]),
    "threshold": (gs2e.Sensor("esim", threshold=(0.3, 0.2)), {}, ["--sensor", "esim", "--threshold", "0.3,0.2"]),
    "between": ("dvs346", {"between": "catmull"}, ["--sensor", "dvs346", "--between", "catmull"]),
    "origin": ("dvs346", {"origin": (5, 9)}, ["--sensor", "dvs346", "--origin", "5,9"]),
}


@pytest.mark.parametrize("case", SENSORS)
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_events_equal_those_of_the_command(case, kind, clip, program, tmp_path):
    sensor, options, words = SENSORS[case]
    frames, stamps = clip
    frames = frames if kind is np.uint8 else frames.astype(np.float32) / 255
    out = by_command(program, tmp_path, frames, stamps, *words)
    if "--seed" in words:
        options = {**options, "seed": 7}
    events = gs2e.simulate(frames, stamps, sensor, **options)
    assert len(events.t) > 50 and events.t.dtype == np.int64 and events.p.dtype == np.uint8
    same(events, gs2e.open(out).events())
    ours = tmp_path / "ours.h5"
    account = gs2e.simulate_to_file(ours, (frame for frame in frames), stamps, sensor, **options)
    assert ours.read_bytes() == out.read_bytes() and account["events"] == len(events.t)


def test_rates_of_hermite_equal_those_of_the_command(clip, program, tmp_path):
    frames, stamps = clip
    rates = np.gradient(frames.astype(np.float32), stamps * np.float32(1e-6), axis=0).astype(np.float32)
    np.save(tmp_path / "rates.npy", rates)
    words = ["--sensor", "dvs346", "--between", "hermite", "--rates", tmp_path / "rates.npy"]
    out = by_command(program, tmp_path, frames, stamps, *words)
    same(gs2e.simulate(frames, stamps, sensor="dvs346", between="hermite", rates=rates), gs2e.open(out).events())
    with pytest.raises(ValueError, match="hermite needs rates"):
        gs2e.simulate(frames, stamps, between="hermite")
    with pytest.raises(ValueError, match="rates apply to"):
        gs2e.simulate(frames, stamps, rates=rates)


@pytest.mark.parametrize("change", ["fortran", "strided", "reversed", "readonly", "unaligned"])
def test_frames_may_lie_in_memory_in_any_way(change, clip):
    frames, stamps = clip
    wanted = gs2e.simulate(frames, stamps)
    if change == "fortran":
        frames = np.asfortranarray(frames)
    elif change == "strided":
        frames = np.repeat(frames, 2, axis=2)[:, :, ::2]
    elif change == "reversed":
        frames = frames[:, ::-1, ::-1].copy()[:, ::-1, ::-1]
    elif change == "readonly":
        frames = frames.copy()
        frames.flags.writeable = False
    else:
        floats = frames.astype(np.float32)
        bytes_ = np.zeros(floats.nbytes + 1, np.uint8)
        bytes_[1:] = floats.view(np.uint8).ravel()
        frames = bytes_[1:].view(np.float32).reshape(floats.shape)
        assert not frames.flags.aligned
    same(gs2e.simulate(frames, stamps), wanted)


def test_threads_change_nothing(clip):
    frames, stamps = clip
    wanted = gs2e.simulate(frames, stamps, "v2e-noisy", threads=1)
    same(gs2e.simulate(frames, stamps, "v2e-noisy", threads=3), wanted)


REFUSED = {
    "objects": (lambda f: f.astype(object), TypeError, r"frames\[0\] is object, wanted uint8 or float32"),
    "doubles": (lambda f: f.astype(np.float64), TypeError, r"frames\[0\] is float64"),
    "big endian": (lambda f: f.astype(">f4"), TypeError, r"frames\[0\] is >f4|wanted uint8 or float32"),
    "colours": (lambda f: np.stack([f] * 3, -1), ValueError, r"wanted \[N, H, W\]; convert colours to grey first"),
    "one frame": (lambda f: f[0], ValueError, r"frames has the shape \[20, 30\], wanted \[N, H, W\]"),
    "no frame": (lambda f: f[:0], ValueError, "frames has no frame"),
    "empty frames": (lambda f: f[:, :0], ValueError, "wanted 1 to 65536"),
    "number": (lambda f: 5, TypeError, "frames is a int, wanted an array"),
    "lists": (lambda f: f.tolist(), TypeError, r"frames\[0\] is a list, wanted a numpy array"),
    "too few": (lambda f: f[:7], ValueError, "7 frames, but 12 stamps_us"),
    "too many": (lambda f: np.concatenate([f, f]), ValueError, "more frames than stamps_us, which has 12"),
    "other size": (lambda f: [*f[:6], f[6, 1:], *f[7:]], ValueError, r"frames\[6\] is 30x19, wanted 30x20 like the first"),
    "other type": (lambda f: [*f[:6], *f[6:].astype(np.float32)], TypeError, r"frames\[6\] is float32, wanted uint8"),
    "colour inside": (lambda f: [*f[:6], np.stack([f[6]] * 3, -1)], ValueError, r"frames\[6\] has the shape \[20, 30, 3\]"),
    "nan": (lambda f: np.where(np.arange(12)[:, None, None] == 4, np.nan, f / 255).astype(np.float32), ValueError,
            r"frame 4: pixel \(0, 0\) is NaN"),
    "scale": (lambda f: f.astype(np.float32) / 64, ValueError, "full_scale=1 or full_scale=255"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_frames_are_refused_by_name(case, clip, tmp_path):
    frames, stamps = clip
    change, kind, words = REFUSED[case]
    with pytest.raises(kind, match=words):
        gs2e.simulate(change(frames), stamps)
    made = change(frames)
    # A list becomes an iterator, whose faults come while the sensor runs.
    made = iter(made) if isinstance(made, list) else made
    with pytest.raises(kind, match=words):
        gs2e.simulate_to_file(tmp_path / "out.h5", made, stamps)
    assert list(tmp_path.iterdir()) == [], "no file is left"


@pytest.mark.parametrize(
    ("stamps", "kind", "words"),
    [
        ([0, 5, 5, *range(9, 18)], ValueError, "stamp 2 is 5 us, not later than the previous one, 5 us"),
        ([0, 9, 4, *range(10, 19)], ValueError, "stamp 2 is 4 us, not later than the previous one, 9 us"),
        (np.arange(12).astype(object), TypeError, "stamps_us is object of shape"),
        (np.arange(12.0), TypeError, "stamps_us is float64 of shape"),
        (np.zeros((12, 1), int), TypeError, "wanted integers"),
        ([0], ValueError, "1 stamps, wanted at least 2"),
        ([0, 2**63 - 1], ValueError, "too far from the first"),
        (np.array([0, 2**63], np.uint64), ValueError, "64 bits"),
    ],
)
def test_stamps_are_refused_by_name(stamps, kind, words, clip, tmp_path):
    with pytest.raises(kind, match=words):
        gs2e.simulate(clip[0], stamps)
    with pytest.raises(kind, match=words):
        gs2e.simulate_to_file(tmp_path / "out.h5", iter(clip[0]), stamps)
    assert list(tmp_path.iterdir()) == [], "no file is left"


def test_an_exception_of_the_iterator_passes_through(clip, tmp_path):
    class Own(Exception):
        pass

    def frames():
        yield from clip[0][:5]
        raise own

    own = Own("camera unplugged")
    for act in (gs2e.simulate, lambda *a: gs2e.simulate_to_file(tmp_path / "out.h5", *a)):
        with pytest.raises(Own) as caught:
            act(frames(), clip[1])
        assert caught.value is own
    assert list(tmp_path.iterdir()) == []


def test_the_cap_is_an_error_unless_it_is_allowed():
    frames = np.array([[[0]], [[255]]], np.uint8)
    sensor = {"esim": {"threshold": {"on": 0.01, "off": 0.01}, "max_events_per_pixel_frame": 3}}
    with pytest.raises(RuntimeError, match="allow_cap=True"):
        gs2e.simulate(frames, [0, 1000], sensor)
    assert len(gs2e.simulate(frames, [0, 1000], sensor, allow_cap=True).t) == 3


def test_labels_come_with_the_events(clip, tmp_path):
    frames, stamps = clip
    events = gs2e.simulate(frames, stamps, "v2e-noisy", labels=True)
    assert events.label.dtype == np.uint8 and set(events.label) <= {0, 1}
    assert gs2e.simulate(frames, stamps, "v2e-noisy").label is None
    with pytest.raises(ValueError, match="cannot store the labels"):
        gs2e.simulate_to_file(tmp_path / "out.raw", frames, stamps, "v2e-noisy", labels=True)


def test_other_threads_run_meanwhile(clip):
    """A thread counts while the simulation runs: the lock of the interpreter is released."""
    frames = np.random.default_rng(1).integers(0, 255, (6, 200, 300), np.uint8)
    counted, stop = [0], threading.Event()

    def count():
        while not stop.wait(0.001):
            counted[0] += 1

    counter = threading.Thread(target=count)
    counter.start()
    gs2e.simulate(frames, np.arange(6) * 1000, "dvs346", threads=1, allow_cap=True)
    stop.set()
    counter.join()
    # The simulation takes at least a tenth of a second; a held lock would leave a few counts.
    assert counted[0] > 10


# A shell that starts the tests in the background has them ignore SIGINT, and their programs too.
ENDLESS = """
import signal, sys, numpy as np, gs2e
signal.signal(signal.SIGINT, signal.default_int_handler)
def frames():
    for i in range(10**6):
        if i == 50:
            print("running", flush=True)
        yield np.full((60, 80), i % 7 * 30, np.uint8)
gs2e.simulate_to_file(sys.argv[1], frames(), np.arange(10**6) * 1000, "v2e-noisy", allow_cap=True)
"""


def test_ctrl_c_stops_it_and_leaves_no_file(tmp_path):
    run = subprocess.Popen(
        [sys.executable, "-c", ENDLESS, tmp_path / "out.h5"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert run.stdout.readline() == "running\n"
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
    finally:
        run.kill()
    assert said.rstrip().endswith("KeyboardInterrupt") and run.returncode == -signal.SIGINT
    assert list(tmp_path.iterdir()) == []


MANY = """
import resource, numpy as np, gs2e, sys
frame = np.zeros((60, 80), np.uint8)
def frames(n):
    for i in range(n):
        frame[:] = 100 + i % 2
        yield frame
def run(n):
    gs2e.simulate_to_file(sys.argv[1], frames(n), np.arange(n) * 1000, "esim")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
print(run(200), run(10_000))
"""


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", MANY, tmp_path / "out.h5"], capture_output=True, text=True, check=True
    )
    few, many = map(int, done.stdout.split())
    # The frames take 46 MiB as bytes and 183 MiB as floats; the stamps take less than 1 MiB.
    assert many < few + 16, (few, many)


def test_a_forked_process_simulates_too(clip, in_fork):
    frames, stamps = clip
    wanted = gs2e.simulate(frames, stamps)
    in_fork(lambda: np.array_equal(gs2e.simulate(frames, stamps).t, wanted.t))


def test_sensors_come_from_names_dicts_and_files(tmp_path):
    file = tmp_path / "sensor.yaml"
    file.write_text("esim: { threshold: { on: 0.3, off: 0.2 } }\n")
    as_dict = gs2e.Sensor({"esim": {"threshold": {"on": 0.3, "off": 0.2}}})
    assert gs2e.Sensor(file) == gs2e.Sensor(str(file)) == as_dict != gs2e.Sensor("esim")
    assert as_dict.model == "esim" and as_dict.contrast == (0.3, 0.2)
    assert pickle.loads(pickle.dumps(as_dict)) == as_dict
    several = tmp_path / "recipe.yaml"
    several.write_text("sensors:\n  a: { esim: {} }\n  b: { v2e: { preset: noisy } }\n")
    assert gs2e.Sensor(several, name="b") == gs2e.Sensor(f"{several}:b") == gs2e.Sensor("v2e-noisy")
    with pytest.raises(gs2e.RecipeError, match="it has several sensors: a, b"):
        gs2e.Sensor(several)
    for name in gs2e.Sensor.NAMES:
        on, off = gs2e.Sensor(name, threshold=0.25).contrast
        assert on == pytest.approx(0.25, abs=1e-12) and off == pytest.approx(0.25, abs=1e-12)


def test_wrong_sensors_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="neither a file nor a preset: davis346"):
        gs2e.Sensor("dvs347")
    with pytest.raises(TypeError, match="sensor is a int"):
        gs2e.Sensor(5)
    with pytest.raises(ValueError, match="wanted numbers above 0"):
        gs2e.Sensor("esim", threshold=-1)
    with pytest.raises(ValueError, match="applies to the sensor voltmeter"):
        gs2e.Sensor("esim", between="catmull")
    with pytest.raises(ValueError, match="between is \"cubic\""):
        gs2e.Sensor("dvs346", between="cubic")
    file = tmp_path / "sensor.yaml"
    file.write_text("voltmeter:\n  preset: dvs346\n  presett: dvs346\n")
    with pytest.raises(gs2e.RecipeError) as caught:
        gs2e.Sensor(file)
    error = caught.value
    assert (error.file, error.line, error.column) == (str(file), 3, 3)
    assert "unknown field \"presett\"" in error.faults[0].message and "preset" in (error.help or "")
    assert str(error) == f"{file}:3:3: {error.faults[0].message}"


def test_recipes_are_read(tmp_path):
    file = tmp_path / "one.yaml"
    file.write_text("version: 1\nscene: a\nsource: { procedural: {} }\ntrajectories: [{ name: base, refine: {} }]\n")
    (recipe,) = gs2e.read_recipes(file)
    assert recipe["scene"] == "a" and recipe["sensor"]["voltmeter"]
    file.write_text(file.read_text() + "colour: red\n")
    with pytest.raises(gs2e.RecipeError) as caught:
        gs2e.read_recipes([file])
    assert (caught.value.line, caught.value.column) == (5, 1)
