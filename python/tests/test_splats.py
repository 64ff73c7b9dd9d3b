"""Scenes of Gaussians against the program, and recipes that are written."""

import json

import numpy as np
import pytest

import gs2e


@pytest.fixture(scope="module")
def splat(tmp_path_factory):
    """A .splat file of 40 Gaussians in front of the camera: position, scale, colour with opacity, rotation."""
    rng = np.random.default_rng(1)
    rows = np.zeros(40, [("at", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("turn", "u1", 4)])
    rows["at"] = rng.uniform([-1, -1, 2], [1, 1, 4], (40, 3))
    rows["scale"] = rng.uniform(0.05, 0.3, (40, 3))
    rows["rgba"] = rng.integers(60, 256, (40, 4))
    rows["turn"] = rng.integers(0, 256, (40, 4))
    path = tmp_path_factory.mktemp("splat") / "scene.splat"
    rows.tofile(path)
    return path


CAMERA = {"width": 48, "height": 36, "fx": 40.0, "fy": 41.0, "cx": 23.0, "cy": 18.5}
VELOCITY = (0.1, -0.2, 0.3, 0.02, 0.01, -0.03)


@pytest.mark.parametrize("channel", ["rgb", "alpha", "luminance", "depth", "doubtful", "luminance-rate", "flow"])
def test_rendering_has_the_numbers_of_the_program(program, splat, tmp_path, channel):
    pose = np.eye(4)
    pose[:3, 3] = (0.2, -0.1, 0.3)
    view = {"W": 48, "H": 36, "fx": 40.0, "fy": 41.0, "cx": 23.0, "cy": 18.5}
    view |= {"R": np.eye(3).tolist(), "t": (-pose[:3, 3]).tolist()}
    (tmp_path / "view.json").write_text(json.dumps(view))
    moves = channel in ("luminance-rate", "flow")
    motion = ["--velocity", ",".join(map(str, VELOCITY))] if moves else []
    out = tmp_path / "out.npy"
    words = ["--scene", splat, "--view", tmp_path / "view.json", "--channel", channel, "--backend", "cpu", "--out", out]
    done = program("render", *words, *motion)
    assert done.returncode == 0, done.stderr
    found = gs2e.SplatScene.open(splat).render(CAMERA, pose, channel, velocity=VELOCITY if moves else None)
    wanted = np.load(out)
    assert found.dtype == np.float32 and found.shape == wanted.shape
    np.testing.assert_array_equal(found, wanted)
    assert np.nanmax(np.abs(found)) > 0


def test_a_style_holds_for_its_call(splat):
    scene = gs2e.SplatScene(splat)
    assert len(scene) == 40 and "40 Gaussians" in repr(scene)
    first = scene.render(CAMERA, np.eye(4))
    white = scene.render(CAMERA, np.eye(4), rules="soft", background=(1, 1, 1))
    assert white.mean() > first.mean()
    np.testing.assert_array_equal(scene.render(CAMERA, np.eye(4)), first)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"channel": "color"}, "channel is"),
        ({"channel": "flow"}, "needs the velocity"),
        ({"rules": "cuda"}, "rules is"),
        ({"pose": np.eye(3)}, "wanted [4, 4]"),
        ({"pose": 2 * np.eye(4)}, "last row"),
        ({"pose": np.diag([1.0, 1, -1, 1])}, "pose: "),
        ({"camera": CAMERA | {"width": 0}}, "a picture of"),
        ({"camera": CAMERA | {"width": 10**6, "height": 10**6}}, "a picture of"),
        ({"camera": CAMERA | {"fx": -1.0}}, "f"),
    ],
)
def test_wrong_views_are_refused(splat, change, words):
    scene = gs2e.SplatScene(splat)
    with pytest.raises(ValueError) as error:
        scene.render(**({"camera": CAMERA, "pose": np.eye(4)} | change))
    assert words in str(error.value)


def test_absent_and_foreign_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="absent.ply"):
        gs2e.SplatScene(tmp_path / "absent.ply")
    (tmp_path / "x.ply").write_text("thesis")
    with pytest.raises(ValueError):
        gs2e.SplatScene(tmp_path / "x.ply")


RECIPE = {
    "version": 1,
    "scene": "a/one",
    "source": {"procedural": {"kind": "still-life", "gaussians": 500, "views": 8, "arc": 6, "seed": 1}},
    "trajectories": [{"name": "base", "refine": {"window": 2, "factor": 3}}],
    "camera": {"width": 48, "height": 36},
    "outputs": ["events"],
    "licence": {"expression": "CC0-1.0", "holder": "Zoë: \"quoted\" # and so on"},
}


def test_a_written_recipe_is_read_back(tmp_path):
    path = tmp_path / "one.yaml"
    full = gs2e.write_recipe(path, RECIPE)
    assert full == gs2e.read_recipes(path)[0]
    assert full["licence"]["holder"] == RECIPE["licence"]["holder"]
    assert [file.name for file in tmp_path.iterdir()] == ["one.yaml"]


def test_a_wrong_recipe_is_not_written(tmp_path):
    path = tmp_path / "one.yaml"
    path.write_text("mine")
    with pytest.raises(gs2e.RecipeError) as error:
        gs2e.write_recipe(path, RECIPE | {"senor": {}})
    assert "senor" in str(error.value)
    assert path.read_text() == "mine"
    assert [file.name for file in tmp_path.iterdir()] == ["one.yaml"]
