"""Trajectories of a recipe: the poses, stamps and speeds of a camera, without a build."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from typing import Any, Mapping

import numpy as np
import numpy.typing as npt

from gs2e import _native
from gs2e._reader import _matrix, _pose_at
from gs2e._splats import SplatScene


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """A camera path: M poses with their stamps.

    Poses are from camera to world. Camera axes are OpenCV's: x right, y down, z forward. World axes and the unit of
    length are those of the capture or of the recipe. Stamps are microseconds from the first pose.

    >>> fragment = {
    ...     "version": 1,
    ...     "camera": {"width": 64, "height": 48, "fx": 60},
    ...     "sampling": {"rate": 1000},
    ...     "trajectories": [
    ...         {
    ...             "name": "round",
    ...             "orbit": {"centre": [0, 0, 0], "from": [0, 0, -4], "up": [0, -1, 0], "duration": "20 ms"},
    ...         }
    ...     ],
    ... }
    >>> path = Trajectory.from_recipe(fragment)
    >>> path
    <Trajectory round, 21 poses over 20000 us>
    >>> path.matrices.shape, path.stamps_us[:3].tolist()
    ((21, 4, 4), [0, 1000, 2000])
    >>> path.camera["fx"]
    60.0
    """

    name: str
    """Its name in the recipe."""
    stamps_us: npt.NDArray[np.int64]
    """int64 [M]: microseconds, strictly increasing, from 0."""
    poses: npt.NDArray[np.float64]
    """float64 [M, 7]: tx ty tz qx qy qz qw, as in poses.txt; unit quaternions with w >= 0."""
    velocities: npt.NDArray[np.float64]
    """float64 [M, 6]: linear velocity in units/s and angular velocity in rad/s, in camera axes."""
    camera: dict[str, float] | None
    """width, height, fx, fy, cx and cy in px: the recipe's camera, or else the capture's; None without either."""
    report: dict[str, Any] = field(default_factory=dict)
    """The content of speed.json: requested and achieved speed."""
    warnings: tuple[str, ...] = ()
    """What the command `gs2e trajectory` warns about."""

    @classmethod
    def from_recipe(
        cls,
        recipe: str | os.PathLike | Mapping[str, Any],
        name: str | None = None,
        *,
        capture: str | os.PathLike | None = None,
        scene: str | os.PathLike | SplatScene | None = None,
    ) -> Trajectory:
        """Makes a trajectory of a recipe: the poses of `gs2e trajectory`, bit for bit.

        `recipe` is a YAML file or a dictionary: a recipe, or its keys `version` and `trajectories` alone, with
        `camera`, `sampling` and `render` if they are needed. `name` chooses one of several trajectories. `capture` is
        a COLMAP model, a transforms.json or a 3DGS model folder; paths along a capture need it. `scene` is needed for
        a speed in pixels, which is measured there.

        A wrong recipe raises `RecipeError`. A path that cannot be made raises `ValueError`.
        """
        parts = _native.make_trajectory(_Request(recipe, name, capture, scene))
        name, stamps_us, poses, velocities, report, warnings, camera = parts
        if camera is not None:
            camera = dict(zip(("width", "height", "fx", "fy", "cx", "cy"), camera))
        return cls(name, stamps_us, poses, velocities, camera, json.loads(report), tuple(warnings))

    def __len__(self) -> int:
        return len(self.stamps_us)

    def __repr__(self) -> str:
        return f"<Trajectory {self.name}, {len(self)} poses over {self.stamps_us[-1]} us>"

    @property
    def matrices(self) -> npt.NDArray[np.float64]:
        """float64 [M, 4, 4]: camera to world, as `SplatScene.render` takes them."""
        return _matrix(self.poses)

    def pose(self, t_us: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """float64 [4, 4]: camera to world at a time; [N, 4, 4] at N times. See `Scene.pose`."""
        return _pose_at(self.stamps_us, self.poses, t_us)

    @property
    def linear_speeds(self) -> npt.NDArray[np.float64]:
        """float64 [M - 1]: achieved speed of each step, in units/s."""
        return np.array(self.report["linear_unit_s"], np.float64)

    @property
    def angular_speeds(self) -> npt.NDArray[np.float64]:
        """float64 [M - 1]: achieved angular speed of each step, in rad/s."""
        return np.array(self.report["angular_rad_s"], np.float64)


class _Request:
    """What the compiled part reads of a request."""

    def __init__(self, recipe, name, capture, scene):
        is_mapping = isinstance(recipe, Mapping)
        # JSON is YAML, so a dictionary is read as the text of a recipe is.
        self.text = json.dumps(recipe) if is_mapping else None
        self.path = None if is_mapping else os.fspath(recipe)
        self.capture = None if capture is None else os.fspath(capture)
        for path in filter(None, (self.path, self.capture)):
            # An absent file is the exception that Python has for it.
            os.stat(path)
        self.name = name
        scene = SplatScene(scene) if isinstance(scene, (str, os.PathLike)) else scene
        self.scene = None if scene is None else scene._native
