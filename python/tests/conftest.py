"""Inputs that several tests share: frames that move, and a small release."""

import os
import pathlib
import shutil
import signal
import subprocess
import sysconfig
import time

import numpy as np
import pytest

RECIPE = """\
version: 1
scene: {scene}
seed: 1
source: {{ procedural: {{ kind: still-life, gaussians: 500, views: 8, arc: 6, seed: {seed} }} }}
trajectories: [{{ name: base, refine: {{ window: 2, factor: 3 }} }}]
camera: {{ width: 48, height: 36 }}
sampling: {{ rate: 1200 }}
sensor: {{ voltmeter: {{ preset: dvs346, threshold: {{ on: 0.3, off: 0.3 }}, labels: true }} }}
outputs: [events, sharp, depth, flow]
licence: {{ expression: CC0-1.0, holder: The gs2e authors }}
"""


@pytest.fixture(scope="session")
def program():
    """The program that the wheel installed."""
    path = pathlib.Path(sysconfig.get_path("scripts"), "gs2e")
    assert path.exists(), "the wheel installs the program"
    return lambda *words, **options: subprocess.run(
        [path, *map(str, words)], capture_output=True, text=True, **options
    )


@pytest.fixture
def in_fork():
    """Runs a function in a forked process, and asserts that it returns a true value within a minute."""
    if not hasattr(os, "fork"):
        pytest.skip("needs fork")

    def run(act):
        child = os.fork()
        if child == 0:
            code = 1
            try:
                code = 0 if act() else 1
            finally:
                os._exit(code)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            pid, status = os.waitpid(child, os.WNOHANG)
            if pid:
                assert status == 0
                return
            time.sleep(0.01)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise AssertionError("the child hangs")

    return run


@pytest.fixture(scope="session")
def clip():
    """uint8 [12, 20, 30]: a grating that moves by a third of a pixel per frame; and stamps that are not equidistant."""
    i, y, x = np.ogrid[:12, :20, :30]
    frames = 128 + 100 * np.sin((x + 0.5 * y + i / 3) / 2)
    return frames.astype(np.uint8), np.cumsum([1_000_000] + [700, 1300] * 5 + [900])


@pytest.fixture(scope="session")
def release(program, tmp_path_factory):
    """A release of two scenes."""
    place = tmp_path_factory.mktemp("release")
    (place / "recipes").mkdir()
    for scene, seed in (("a/one", 1), ("b/two", 2)):
        name = scene.replace("/", "-") + ".yaml"
        (place / "recipes" / name).write_text(RECIPE.format(scene=scene, seed=seed))
    done = program("release", "--to", place / "out", "--store", place / "store", place / "recipes")
    assert done.returncode == 0, done.stderr
    yield place / "out"
    shutil.rmtree(place)
