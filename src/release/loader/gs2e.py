# SPDX-FileCopyrightText: The gs2e authors
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Reads a release of gs2e: events, poses, camera and pictures of one trajectory. Needs numpy and h5py, nothing else.
Copy it beside your own code: where Python imports it from the release, it leaves a `__pycache__` that no release has.

    from gs2e import Scene

    scene = Scene("out/procedural/still-life", "base")
    t, x, y, p, label = scene.events(10_000, 20_000)   # of the window [10 ms, 20 ms)
    world_from_camera = scene.pose(15_000)             # [4, 4]
    voxel = scene.voxel(10_000, 20_000, bins=5)        # [5, H, W]
    for frame in scene.frames:
        image = frame.read()                           # [H, W, 3]
    for frame in scene.blurred:
        image = frame.read()                           # of the exposure [frame.t0_us, frame.t1_us]
    depth, flow = scene.depth(0), scene.flow(0)        # [H, W] unit, [H, W, 2] px/s, of pose 0; NaN: undefined

Times are microseconds from the first pose, and windows half open: [t0_us, t1_us). Camera axes are OpenCV's: x right, y
down, z forward. Pixel (i, j) has its centre at (i + 0.5, j + 0.5). Polarity 1 is brighter, 0 darker. Lengths are in the
unit of the scene's source.

No file of events is opened before it is needed, and each process opens its own: a Scene can be pickled, and the workers of
a torch DataLoader may share one. `Windows` is a data set for such a loader.
"""

import json
import math
import os
import zlib
from typing import NamedTuple, Optional

import h5py
import numpy as np


class Events(NamedTuple):
    """N events, sorted by time."""

    t: np.ndarray
    """int64 [N]: microseconds."""
    x: np.ndarray
    """uint16 [N]: column."""
    y: np.ndarray
    """uint16 [N]: row."""
    p: np.ndarray
    """uint8 [N]: 1 brighter, 0 darker."""
    label: Optional[np.ndarray]
    """uint8 [N]: 1 signal, 0 noise; None where the sensor of the recipe has no labels."""


class Frame(NamedTuple):
    """A sharp picture, rendered at a pose."""

    index: int
    """Number of the pose: row of `Scene.poses`, and the picture's name."""
    t_us: int
    """When, in microseconds."""
    path: str
    """A PNG."""

    def read(self):
        """uint8 [H, W, 3]: encoded sRGB."""
        return read_png(self.path)


class Blurred(NamedTuple):
    """A blurred picture: the mean of what the camera sees over an exposure, in linear light."""

    index: int
    """Number of the pose in the middle: row of `Scene.poses`, and the picture's name."""
    t_us: int
    """When that is, in microseconds."""
    t0_us: int
    """When the shutter opens."""
    t1_us: int
    """When it closes."""
    path: str
    """A PNG."""

    def read(self):
        """uint8 [H, W, 3]: encoded sRGB."""
        return read_png(self.path)


def trajectories(folder):
    """Names of the trajectories of a scene, in the order of its recipe. `folder` is the one that holds scene.json."""
    return [part["name"] for part in _description(folder)["trajectories"]]


def split(folder):
    """Name of the split that a scene is in, or None. `folder` is the one that holds scene.json."""
    return _description(folder).get("split", {}).get("name")


class Scene:
    """One trajectory of a scene, as one sensor saw it.

    `folder` is that of a scene, which holds scene.json, or that of a trajectory in it. `trajectory` and `sensor` are names,
    and can be left out where there is only one. What is read is kept, but for events and pictures.
    """

    def __init__(self, folder, trajectory=None, sensor=None):
        folder = os.path.abspath(os.fspath(folder))
        if trajectory is None and not os.path.exists(os.path.join(folder, "scene.json")):
            folder, trajectory = os.path.split(folder)
        self.description = _description(folder)
        """scene.json as it is: recipe, licence, statistics and more."""
        parts = {part["name"]: part for part in self.description["trajectories"]}
        trajectory = _chosen(trajectory, list(parts), "trajectories", folder)
        self.part = parts[trajectory]
        """What scene.json says of this trajectory."""
        sensors = list(self.part.get("sensors", {}))
        if sensors:
            sensor = _chosen(sensor, sensors, "sensors", os.path.join(folder, trajectory))
        elif sensor is not None:
            raise ValueError(f"{folder}/{trajectory} has one sensor, which has no name")
        self.trajectory = trajectory
        self.sensor = sensor
        self.folder = os.path.join(folder, trajectory)
        """The folder of the trajectory."""
        camera = self.description["camera"]
        self.width, self.height = camera["width"], camera["height"]
        self.duration_us = self.part["duration_us"]
        """Stamp of the last pose; the first one's is 0."""
        self._poses = self._stamps = None
        self._file = self._columns = self._index = self._offset_us = self._pid = None

    def __repr__(self):
        sensor = "" if self.sensor is None else f", sensor {self.sensor}"
        return f"<Scene {self.description['id']}/{self.trajectory}{sensor}: {self.width}x{self.height}>"

    def __reduce__(self):
        return Scene, (os.path.dirname(self.folder), self.trajectory, self.sensor)

    def close(self):
        """Closes the file of events; it is opened again when it is needed."""
        file, self._file, self._columns = self._file, None, None
        if file is not None:
            file.close()

    @property
    def K(self):
        """float64 [3, 3]: pixels from camera axes. The camera has no distortion."""
        camera = self.description["camera"]
        return np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]], np.float64)

    @property
    def stamps_us(self):
        """int64 [M]: microseconds of the poses, increasing."""
        self._read_poses()
        return self._stamps

    @property
    def poses(self):
        """float64 [M, 7]: tx ty tz qx qy qz qw, camera to world; unit quaternions with w >= 0."""
        self._read_poses()
        return self._poses

    def _read_poses(self):
        if self._poses is None:
            with open(os.path.join(self.folder, "poses.txt"), encoding="utf-8") as file:
                rows = [line.split() for line in file]
            self._stamps = np.array([row[0] for row in rows]).astype(np.int64)
            self._poses = np.array([[float(number) for number in row[1:]] for row in rows])

    def pose(self, t_us):
        """float64 [4, 4]: camera to world at a time; [N, 4, 4] at N times.

        Between two poses the camera's centre goes straight and its rotation the shortest way, both at a steady rate (lerp,
        slerp). Times before the first pose or after the last are refused.
        """
        t_us = np.asarray(t_us, np.float64)
        stamps = self.stamps_us
        outside = (t_us < stamps[0]) | (t_us > stamps[-1]) | np.isnan(t_us)
        if outside.any():
            raise ValueError(f"{t_us[outside].flat[0]} us is not within {stamps[0]}..{stamps[-1]} us, where the poses are")
        if len(stamps) == 1:
            return _matrix(np.broadcast_to(self.poses[0], (*t_us.shape, 7)))
        before = np.clip(np.searchsorted(stamps, t_us, side="right") - 1, 0, len(stamps) - 2)
        share = (t_us - stamps[before]) / (stamps[before + 1] - stamps[before])
        a, b = self.poses[before], self.poses[before + 1]
        centre = (1 - share)[..., None] * a[..., :3] + share[..., None] * b[..., :3]
        return _matrix(np.concatenate([centre, _slerp(a[..., 3:], b[..., 3:], share)], axis=-1))

    @property
    def frames(self):
        """The sharp pictures by time: a list of Frame; empty where the recipe asks for none."""
        folder = os.path.join(self.folder, "sharp")
        names = sorted(os.listdir(folder)) if os.path.isdir(folder) else []
        numbers = [int(name[:-4]) for name in names if name.endswith(".png")]
        return [Frame(j, int(self.stamps_us[j]), os.path.join(folder, f"{j:06d}.png")) for j in numbers]

    @property
    def blurred(self):
        """The blurred pictures by time: a list of Blurred; empty where the recipe asks for none."""
        with open(os.path.join(self.folder, "transforms.json"), encoding="utf-8") as file:
            frames = [frame for frame in json.load(file)["frames"] if "blur_file_path" in frame]
        found = []
        for frame in frames:
            path = os.path.join(self.folder, *frame["blur_file_path"].split("/"))
            number = int(os.path.basename(path)[:-4])
            found.append(
                Blurred(number, frame["t_us"], frame["exposure_start_us"], frame["exposure_end_us"], path)
            )
        return found

    def depth(self, index):
        """float32 [H, W]: depth at a pose, by its number, along the optical axis in the scene's unit; NaN: undefined."""
        return np.load(os.path.join(self.folder, "depth", f"{index:06d}.npy"))

    def flow(self, index):
        """float32 [H, W, 2]: optical flow at a pose, by its number: image velocity in px/s, right and down; NaN: undefined."""
        return np.load(os.path.join(self.folder, "flow", f"{index:06d}.npy"))

    def _open(self):
        """Has the file of events open; opens it anew in a process that was forked."""
        if self._pid != os.getpid():
            # What a fork inherits shares its parent's file descriptor: closing it here leaves the parent's open.
            self.close()
            self._pid = os.getpid()
        if self._file is None:
            name = "events.h5" if self.sensor is None else os.path.join("events", self.sensor + ".h5")
            self._file = h5py.File(os.path.join(self.folder, name), "r")
            # Kept open, since HDF5 keeps the chunks that it has unpacked with an open column.
            self._columns = dict(self._file["events"].items())
            self._index = self._file["ms_to_idx"][:].astype(np.int64)
            self._offset_us = int(self._file["t_offset"][()])

    def events(self, t0_us=None, t1_us=None):
        """Events with t0_us <= t < t1_us; from the first one and to the last one where a bound is left out."""
        self._open()
        columns, index, offset = self._columns, self._index, self._offset_us
        first, end = 0, len(columns["t"])
        # index[k] is the number of the first event with t >= 1000 k; its last entry lies behind the last event.
        last = len(index) - 1
        if t0_us is not None:
            first = index[min(max(math.floor((t0_us - offset) / 1000), 0), last)]
        if t1_us is not None:
            end = max(index[min(max(math.ceil((t1_us - offset) / 1000), 0), last)], first)
        t = columns["t"][first:end].astype(np.int64) + offset
        lo = 0 if t0_us is None else np.searchsorted(t, t0_us, side="left")
        hi = len(t) if t1_us is None else max(np.searchsorted(t, t1_us, side="left"), lo)
        rows = slice(first + lo, first + hi)
        label = columns["label"][rows] if "label" in columns else None
        return Events(t[lo:hi], columns["x"][rows], columns["y"][rows], columns["p"][rows], label)

    def event_frame(self, t0_us, t1_us):
        """int32 [2, H, W]: number of events in the window, by polarity: 0 darker, 1 brighter."""
        _, x, y, p, _ = self.events(t0_us, t1_us)
        shape = (2, self.height, self.width)
        counts = np.bincount(np.ravel_multi_index((p, y, x), shape), minlength=math.prod(shape))
        return counts.reshape(shape).astype(np.int32)

    def voxel(self, t0_us, t1_us, bins):
        """float32 [bins, H, W]: polarity, +1 or -1, shared out between the two nearest bins, linearly in time.

        The grid of Zhu et al. (CVPR 2019, eq. 1 and 2), which E2VID reads too: an event at t is at bin
        (bins - 1) (t - t0_us) / (t1_us - t0_us), where they have the stamps of the first and the last event in place of
        the window's ends. So a pixel's sum over the bins is the sum of its polarities. Nothing is normalised.
        """
        if bins < 1 or not t1_us > t0_us:
            raise ValueError(f"a grid of {bins} bins over [{t0_us}, {t1_us}) us holds nothing")
        t, x, y, p, _ = self.events(t0_us, t1_us)
        shape = (bins, self.height, self.width)
        sign = 2.0 * p - 1.0
        at = (bins - 1) * ((t - t0_us) / (t1_us - t0_us))
        lower = np.minimum(at.astype(np.int64), bins - 1)
        share = at - lower
        upper = np.minimum(lower + 1, bins - 1)
        cells = np.concatenate([np.ravel_multi_index((k, y, x), shape) for k in (lower, upper)])
        weights = np.concatenate([sign * (1 - share), sign * share])
        return np.bincount(cells, weights, math.prod(shape)).reshape(shape).astype(np.float32)


class Windows:
    """A scene cut into windows of equal length: a map-style data set, as torch.utils.data.DataLoader takes it.

    Entry i is of [i * stride_us, i * stride_us + length_us): a dictionary of `t0_us`, `t1_us`, `voxel` (see Scene.voxel) and
    `pose` (see Scene.pose) in the middle of it. Windows end by the last pose.
    """

    def __init__(self, scene, length_us, bins, stride_us=None):
        self.scene, self.length_us, self.bins = scene, length_us, bins
        self.stride_us = length_us if stride_us is None else stride_us
        if self.length_us <= 0 or self.stride_us <= 0:
            raise ValueError("windows have a length and a stride above 0 us")

    def __len__(self):
        return max(0, (self.scene.duration_us - self.length_us) // self.stride_us + 1)

    def __getitem__(self, i):
        if not 0 <= i < len(self):
            raise IndexError(i)
        t0_us = i * self.stride_us
        t1_us = t0_us + self.length_us
        voxel, pose = self.scene.voxel(t0_us, t1_us, self.bins), self.scene.pose((t0_us + t1_us) / 2)
        return {"t0_us": t0_us, "t1_us": t1_us, "voxel": voxel, "pose": pose}


def read_png(path):
    """uint8 [H, W, 3]: the pixels of a PNG of 8-bit RGB without interlacing, which is what a release holds."""
    with open(path, "rb") as file:
        data = file.read()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise ValueError(f"{path} is no PNG")
    at, parts = 8, []
    width = height = 0
    while at < len(data):
        length, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        body = data[at + 8 : at + 8 + length]
        if name == b"IHDR":
            width, height = int.from_bytes(body[:4], "big"), int.from_bytes(body[4:8], "big")
            if tuple(body[8:]) != (8, 2, 0, 0, 0):
                raise ValueError(f"{path} is no PNG of 8-bit RGB without interlacing")
        elif name == b"IDAT":
            parts.append(body)
        at += 12 + length
    raw = np.frombuffer(zlib.decompress(b"".join(parts)), np.uint8).reshape(height, 1 + 3 * width)
    return _unfiltered(raw[:, 0], raw[:, 1:].reshape(height, width, 3))


def _unfiltered(filters, sent):
    """Undoes the filters of a PNG's rows (its specification, section 9). A pixel needs the ones to the left, above and
    left above, so that those of one diagonal are independent of each other."""
    height, width, _ = sent.shape
    # With a row and a column of zeros before the first ones.
    out = np.zeros((height + 1, width + 1, 3), np.int16)
    for diagonal in range(height + width - 1):
        row = np.arange(max(0, diagonal - width + 1), min(height, diagonal + 1))
        column = diagonal - row
        left, up, corner = out[row + 1, column], out[row, column + 1], out[row, column]
        a, b, c = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
        paeth = np.where((a <= b) & (a <= c), left, np.where(b <= c, up, corner))
        guesses = [np.zeros_like(left), left, up, (left + up) // 2, paeth]
        out[row + 1, column + 1] = (sent[row, column] + np.choose(filters[row][:, None], guesses)) & 255
    return out[1:, 1:].astype(np.uint8)


def _description(folder):
    """scene.json."""
    with open(os.path.join(os.fspath(folder), "scene.json"), encoding="utf-8") as file:
        return json.load(file)


def _chosen(name, names, what, place):
    """The name that was asked for, or the only one."""
    if name is None and len(names) == 1:
        return names[0]
    if name not in names:
        raise ValueError(f"{place} has the {what} {', '.join(names)}; asked for is {name}")
    return name


def _slerp(a, b, share):
    """[..., 4]: from unit quaternion `a` to `b` the shorter way, at a steady rate."""
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(cosine < 0, -b, b)
    # The angle between them from their difference: its cosine has lost all digits where they are close.
    half = np.arctan2(np.linalg.norm(a - b, axis=-1, keepdims=True), np.linalg.norm(a + b, axis=-1, keepdims=True))
    sine = np.sin(2 * half)
    close = sine < 1e-9
    sine = np.where(close, 1, sine)
    share = share[..., None]
    from_a = np.where(close, 1 - share, np.sin((1 - share) * 2 * half) / sine)
    from_b = np.where(close, share, np.sin(share * 2 * half) / sine)
    out = from_a * a + from_b * b
    return out / np.linalg.norm(out, axis=-1, keepdims=True)


def _matrix(pose):
    """[..., 4, 4] of [..., 7]: tx ty tz qx qy qz qw."""
    x, y, z, w = np.moveaxis(pose[..., 3:], -1, 0)
    out = np.zeros((*pose.shape[:-1], 4, 4))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    out[..., :3, 3] = pose[..., :3]
    out[..., 3, 3] = 1
    return out
