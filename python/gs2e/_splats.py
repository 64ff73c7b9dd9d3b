"""Scenes of 3D Gaussians: read from a file, and rendered on the CPU."""

from __future__ import annotations

import os
from typing import Literal, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from gs2e import _native

Channel = Literal["rgb", "alpha", "luminance", "depth", "doubtful", "luminance-rate", "flow"]
Rules = Literal["official", "exact", "gsplat", "soft"]


class SplatScene:
    """A scene of 3D Gaussians, from a .ply, .splat, .spz or .sog file.

    `len(scene)` is the number of Gaussians. Rendering uses all cores, and releases the lock of the interpreter.
    """

    def __init__(self, path: str | os.PathLike):
        self.path = os.fspath(path)
        # An absent file is the exception that Python has for it.
        os.stat(self.path)
        self._native = _native.SplatScene.open(self.path)

    @classmethod
    def open(cls, path: str | os.PathLike) -> SplatScene:
        """Reads a scene file; the same as `SplatScene(path)`."""
        return cls(path)

    def __len__(self) -> int:
        return len(self._native)

    def __repr__(self) -> str:
        return f"<SplatScene {self.path}, {len(self)} Gaussians>"

    @property
    def sh_degree(self) -> int:
        """The largest degree of the spherical harmonics, 0 to 3."""
        return self._native.sh_degree

    def render(
        self,
        camera: Mapping[str, float],
        pose: npt.ArrayLike,
        channel: Channel = "rgb",
        *,
        velocity: Sequence[float] | None = None,
        rules: Rules = "official",
        antialiased: bool | None = None,
        background: Sequence[float] = (0, 0, 0),
    ) -> npt.NDArray[np.float32]:
        """Renders one channel of a view: the numbers of `gs2e render --out FILE.npy`.

        `camera` has width, height and fx in px, and fy, cx and cy where they differ from fx and the centre: the
        `camera` of a scene.json is one. `pose` is the matrix [4, 4] from camera to world with OpenCV's axes (x right,
        y down, z forward), as `Scene.pose` returns it. `velocity` is the linear velocity in units/s and the angular
        velocity in rad/s, in camera axes; the channels luminance-rate and flow need it. Without `antialiased`, the
        scene file decides.

        Returns float32 [H, W, 3] for rgb, [H, W, 2] for flow, else [H, W].
        """
        width, height = int(camera["width"]), int(camera["height"])
        fx = float(camera["fx"])
        intrinsics = (
            width,
            height,
            fx,
            float(camera.get("fy", fx)),
            float(camera.get("cx", width / 2)),
            float(camera.get("cy", height / 2)),
        )
        matrix = np.asarray(pose, np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"pose has the shape {list(matrix.shape)}, wanted [4, 4]")
        view = _View(intrinsics, matrix.tolist(), None if velocity is None else [float(v) for v in velocity])
        return self._native.render(view, channel, (rules, antialiased, [float(c) for c in background]))


class _View:
    """What the compiled part reads of a view."""

    def __init__(self, camera, pose, velocity):
        self.camera, self.pose, self.velocity = camera, pose, velocity
