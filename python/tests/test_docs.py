"""The examples of docs/python.md that read files. pytest runs those with prompts itself."""

import importlib.util
import pathlib
import re
import shutil

import numpy as np
import pytest

import gs2e

PAGE = pathlib.Path(__file__).parents[2] / "docs/python.md"
TRANSFORMS = """{ "w": 64, "h": 48, "fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "frames": [
  { "file_path": "a.jpg", "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]] },
  { "file_path": "b.jpg", "transform_matrix": [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]] }] }
"""
RECIPE = """\
version: 1
scene: a/one
seed: 1
source: { procedural: { kind: still-life, gaussians: 500, views: 8, arc: 6, seed: 1 } }
trajectories: [{ name: base, refine: { window: 2, factor: 8 } }]
camera: { width: 48, height: 36 }
sampling: { rate: 1200 }
sensor: { voltmeter: { preset: dvs346, threshold: { on: 0.3, off: 0.3 }, labels: true } }
outputs: [events, sharp, depth, flow]
licence: { expression: CC0-1.0, holder: The gs2e authors }
"""


def blocks():
    """The blocks of Python without prompts, each with its line."""
    text = PAGE.read_text()
    found = re.finditer(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return [(text[: block.start()].count("\n") + 2, block[1]) for block in found]


@pytest.fixture
def place(program, clip, tmp_path, monkeypatch):
    """A folder with everything that the examples read."""
    monkeypatch.chdir(tmp_path)
    pathlib.Path("recipes").mkdir()
    pathlib.Path("recipes/one.yaml").write_text(RECIPE)
    pathlib.Path("recipes/release.yaml").write_text("splits: { by: object, shares: { train: 1.0 }, salt: x }\n")
    done = program("release", "--to", "out", "--store", "store", "recipes")
    assert done.returncode == 0, done.stderr
    # The Gaussians of the procedural source stand for a reconstruction.
    files = (path for path in pathlib.Path("store").rglob("*") if path.is_file())
    shutil.copy(next(path for path in files if path.open("rb").read(4) == b"ply\n"), "point_cloud.ply")
    gs2e.simulate_to_file("events.h5", *clip)
    pathlib.Path("transforms.json").write_text(TRANSFORMS)
    pathlib.Path("lab.yaml").write_text("version: 1\ntrajectories: [{ name: base, refine: { factor: 9 } }]\n")


def test_every_example_runs(place):
    has_torch = importlib.util.find_spec("torch") is not None
    names, ran = {}, 0
    for line, code in blocks():
        if "gs2e.torch" in code and not has_torch:
            continue
        if code.startswith(">>> "):
            # The names that these examples define are used by the others.
            rows = [row[4:] for row in code.split("\n") if row.startswith((">>> ", "... "))]
            code = "\n".join(row for row in rows if '"of"' not in row)
        exec(compile("\n" * (line - 1) + code, str(PAGE), "exec"), names)
        ran += 1
    assert ran >= 7 and len(names["events"].t) > 100 and np.isfinite(names["flow"]).any()
