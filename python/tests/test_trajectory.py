"""Trajectories of a recipe, compared with the command and with closed forms."""

import json
import pickle

import numpy as np
import pytest
import yaml

import gs2e

ORBIT = {
    "version": 1,
    "camera": {"width": 64, "height": 48, "fx": 60},
    "sampling": {"rate": 1000},
    "trajectories": [
        {"name": "round", "orbit": {"centre": [0, 0, 0], "from": [0, 0, -4], "up": [0, -1, 0], "frames": 101}},
    ],
}


def at(angle):
    """A view of the origin from a circle in the plane of x and z, camera to world, with OpenCV's axes."""
    centre = 4 * np.array([np.sin(angle), 0, -np.cos(angle)])
    forward = -centre / 4
    down = np.array([0.0, 1, 0])
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([np.cross(down, forward), down, forward])
    matrix[:3, 3] = centre
    return matrix


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A transforms.json of eight views, whose axes are those of OpenGL: y up and z back."""
    frames = [
        {"file_path": f"v{i}.jpg", "transform_matrix": (at(0.1 * i + 0.03 * (i % 3)) @ np.diag([1, -1, -1, 1])).tolist()}
        for i in range(8)
    ]
    path = tmp_path_factory.mktemp("capture") / "transforms.json"
    camera = {"w": 640, "h": 480, "fl_x": 500.0, "fl_y": 500.0, "cx": 320.0, "cy": 240.0}
    path.write_text(json.dumps({**camera, "frames": frames}))
    return path


@pytest.fixture(scope="module")
def splat(tmp_path_factory):
    """A .splat file of one white ball at the origin."""
    row = np.zeros(1, [("at", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("turn", "u1", 4)])
    row["scale"], row["rgba"], row["turn"] = 0.2, 255, (255, 128, 128, 128)
    path = tmp_path_factory.mktemp("ball") / "ball.splat"
    row.tofile(path)
    return path


CHAIN = [
    {"name": "base", "refine": {"window": 2, "factor": 4}, "speed": {"function": "1 + t"}},
    {"name": "mini", "novel": {"base": "base", "groups": 1, "keyframes": 3, "frames": 12}},
    {"name": "even", "refine": {"window": 2}, "speed": {"flow": {"px_s": 40}}},
]


@pytest.mark.parametrize("name", ["base", "mini-0", "even"])
def test_poses_are_those_of_the_command(name, program, capture, splat, tmp_path):
    recipe = tmp_path / "paths.yaml"
    fragment = {"version": 1, "seed": 5, "sampling": {"rate": 800}, "trajectories": CHAIN}
    recipe.write_text(yaml.safe_dump(fragment))
    words = ["--capture", capture, "--scene", splat, "--backend", "cpu", "--recipe", recipe, "--name", name]
    done = program("trajectory", *words, "--out", tmp_path / "poses.txt", "--report", tmp_path / "speed.json")
    assert done.returncode == 0, done.stderr
    rows = np.loadtxt(tmp_path / "poses.txt")
    for source in (recipe, fragment):
        path = gs2e.Trajectory.from_recipe(source, name, capture=capture, scene=splat)
        assert path.name == name and len(path) == len(rows) > 10
        assert path.stamps_us.dtype == np.int64 and np.array_equal(path.stamps_us, rows[:, 0])
        assert path.poses.dtype == np.float64 and np.array_equal(path.poses, rows[:, 1:])
        report = json.loads((tmp_path / "speed.json").read_text())
        assert path.report == report and list(path.linear_speeds) == report["linear_unit_s"]
        assert path.camera == {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240}


def test_a_circle_has_its_closed_form():
    path = gs2e.Trajectory.from_recipe(ORBIT)
    turn = 2 * np.pi / 100
    assert path.stamps_us.tolist() == list(range(0, 101_000, 1000))
    # Which way round is the recipe's convention; the first step shows it.
    way = np.sign(path.matrices[1][0, 3])
    for matrix, i in zip(path.matrices, range(101)):
        np.testing.assert_allclose(matrix, at(way * i * turn), atol=1e-12)
    # Chords and angles of a step of 1 ms.
    np.testing.assert_allclose(path.linear_speeds, 8 * np.sin(turn / 2) * 1000, rtol=1e-9)
    np.testing.assert_allclose(path.angular_speeds, turn * 1000, rtol=1e-9)
    # The camera moves along its x axis and turns about its y axis. A derivative through five poses departs by
    # step^4 / 30 inside, and by step^4 / 5 at the ends.
    wanted = np.zeros((101, 6))
    wanted[:, 0], wanted[:, 4] = way * 4 * turn * 1000, -way * turn * 1000
    np.testing.assert_allclose(path.velocities, wanted, atol=4 * turn * 1000 * turn**4 / 4)
    # Between two poses the centre is on the chord, and the rotation is half-way.
    half = path.pose(500)
    np.testing.assert_allclose(half[:3, :3], at(way * turn / 2)[:3, :3], atol=1e-12)
    np.testing.assert_allclose(half[:3, 3], (path.matrices[0] + path.matrices[1])[:3, 3] / 2, atol=1e-12)
    assert path.pose(path.stamps_us).shape == (101, 4, 4)
    with pytest.raises(ValueError, match="where the poses are"):
        path.pose(-1)


def test_a_scene_is_rendered_along_a_path(splat):
    scene = gs2e.SplatScene(splat)
    path = gs2e.Trajectory.from_recipe(ORBIT)
    y, x = np.mgrid[:48, :64] + 0.5
    for matrix, velocity in list(zip(path.matrices, path.velocities))[::25]:
        alpha = scene.render(path.camera, matrix, "alpha")
        # The ball is in the middle of every view, at the distance 4.
        assert (alpha * x).sum() / alpha.sum() == pytest.approx(32, abs=0.01)
        assert (alpha * y).sum() / alpha.sum() == pytest.approx(24, abs=0.01)
        assert scene.render(path.camera, matrix, "depth")[24, 32] == pytest.approx(4, abs=1e-3)
        # The circle is about the ball, so the ball's centre rests in the picture. The pixel beside the middle
        # is half a pixel off in both directions, and its point turns with the camera at its own depth.
        flow = scene.render(path.camera, matrix, "flow", velocity=velocity)
        assert np.abs(flow[23:25, 31:33]).max() < 0.05 * 60 * path.angular_speeds[0]


def test_a_path_is_pickled(tmp_path):
    path = gs2e.Trajectory.from_recipe(ORBIT)
    copy = pickle.loads(pickle.dumps(path))
    assert np.array_equal(copy.poses, path.poses) and copy.report == path.report and copy.camera == path.camera
    assert repr(copy) == "<Trajectory round, 101 poses over 100000 us>"


def change(**keys):
    return {**ORBIT, **keys}


def test_wrong_requests_are_refused(capture, splat, tmp_path):
    def t(kind, words, recipe, *args, **options):
        with pytest.raises(kind, match=words):
            gs2e.Trajectory.from_recipe(recipe, *args, **options)

    make = gs2e.Trajectory.from_recipe
    t(gs2e.RecipeError, r"recipe:1:\d+: unknown field \"orbt\"", change(trajectories=[{"name": "a", "orbt": {}}]))
    t(ValueError, "no trajectory `square`; its trajectories: round", ORBIT, "square")
    chain = {"version": 1, "trajectories": CHAIN}
    t(ValueError, "has the trajectories base, mini-0, even; name one of them", chain)
    t(ValueError, "`base` needs a capture; pass capture=", chain, "mini-0")
    t(ValueError, "`even` is in pixels per second; pass scene=", chain, "even", capture=capture)
    flow = [{**ORBIT["trajectories"][0], "speed": {"flow": {"px_s": 50}}}]
    del flow[0]["orbit"]["frames"]
    blind = change(trajectories=flow)
    assert len(make(blind, scene=splat)) > 2
    del blind["camera"]
    t(ValueError, "pass capture=, or write in the recipe camera", blind, scene=gs2e.SplatScene(splat))
    t(FileNotFoundError, "gone.yaml", tmp_path / "gone.yaml")
    t(FileNotFoundError, "gone", chain, "base", capture=tmp_path / "gone")
    t(ValueError, "capture: ", chain, "base", capture=tmp_path)
    t(FileNotFoundError, "gone.ply", chain, "even", capture=capture, scene=tmp_path / "gone.ply")
    t(TypeError, "expected str, bytes or os.PathLike", 5)


def test_a_forked_process_makes_paths_and_pictures(splat, in_fork):
    """The worker of a loader is a fork of a process that may have rendered before."""
    scene = gs2e.SplatScene(splat)
    path = gs2e.Trajectory.from_recipe(ORBIT)
    wanted = scene.render(path.camera, path.matrices[0])

    def again():
        path = gs2e.Trajectory.from_recipe(ORBIT)
        return np.array_equal(scene.render(path.camera, path.matrices[0]), wanted)

    in_fork(again)
