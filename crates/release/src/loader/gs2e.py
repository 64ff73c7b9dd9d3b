# SPDX-FileCopyrightText: The gs2e authors
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Reads a release of gs2e: events, poses, camera, pictures, depth, flow and masks. Needs only numpy and h5py.
Copy this file next to your own code: if Python imports it from the release, it leaves a `__pycache__` there.

    from gs2e import Dataset, Scene, open_events

    scene = Scene("out/procedural/still-life", "base")
    t, x, y, p, label = scene.events(10_000, 20_000)   # of the window [10 ms, 20 ms)
    world_from_camera = scene.pose(15_000)             # [4, 4]
    voxel = scene.voxel(10_000, 20_000, bins=5)        # [5, H, W]; also event_frame, label_frame, time_surface
    for frame in scene.frames:
        image = frame.read()                           # [H, W, 3]
    for frame in scene.blurred:
        image = frame.read()                           # of the exposure [frame.t0_us, frame.t1_us]
    depth, flow = scene.depth(0), scene.flow(0)        # [H, W] unit, [H, W, 2] px/s, of pose 0; NaN: undefined

    train = Dataset("out", split="train")              # a Scene per trajectory and sensor
    windows = train.windows(20_000, bins=5, targets=("frame", "flow"))
    stream = open_events("events.h5")                  # a file that `gs2e simulate` wrote

Times are microseconds from the first pose, and windows are half open: [t0_us, t1_us). Camera axes are those of
OpenCV: x right, y down, z forward. Pixel (i, j) has its centre at (i + 0.5, j + 0.5). Polarity 1 is brighter, 0
is darker. Lengths are in the unit of the scene's source.

A file of events is opened when it is first needed, and each process opens its own. A Scene can therefore be
pickled, and the workers of a torch DataLoader may share one. `Windows` and `Dataset.windows` are datasets for
such a loader. Pictures are decoded with Pillow or OpenCV if one is installed, which is faster; the result is
the same.
"""

import bisect
import csv
import itertools
import json
import math
import operator
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
    """uint8 [N]: 1 signal, 0 noise; None if the stream has no labels."""


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


class Array(NamedTuple):
    """Depth, optical flow or disparity at a pose."""

    index: int
    """Number of the pose: row of `Scene.poses`, and the file's name."""
    t_us: int
    """Time of the pose, in microseconds."""
    path: str
    """An .npy file."""

    def read(self):
        """float32 [H, W] or [H, W, 2]; see `Scene.depth`, `Scene.flow` and `Scene.disparity`."""
        return np.load(self.path)


def trajectories(folder):
    """Names of the trajectories of a scene, in the order of its recipe. `folder` is the one that holds scene.json."""
    return [part["name"] for part in _description(folder)["trajectories"]]


def split(folder):
    """Name of the split that a scene is in, or None. `folder` is the one that holds scene.json."""
    return _description(folder).get("split", {}).get("name")


class EventFile:
    """The events of one file. `open_events` opens one; a `Scene` is one with poses and pictures.

    `size` is (width, height) in pixels. It is needed only for grids, and only if the file does not state it.
    """

    def __init__(self, path, size=None):
        self.path = os.path.abspath(os.fspath(path))
        """The HDF5 file."""
        self.width, self.height = (None, None) if size is None else size
        self._file = self._columns = self._index = self._offset_us = self._pid = None

    def __repr__(self):
        return f"<EventFile {self.path}: {self.width}x{self.height}>"

    def __reduce__(self):
        return EventFile, (self.path, None if self.width is None else (self.width, self.height))

    def close(self):
        """Closes the file of events; it is opened again when it is needed."""
        file, self._file, self._columns = self._file, None, None
        if file is not None:
            file.close()

    def _open(self):
        """Opens the file if it is not open; opens it again in a process that was forked."""
        if self._pid != os.getpid():
            # What a fork inherits shares its parent's file descriptor: closing it here leaves the parent's open.
            self.close()
            self._pid = os.getpid()
        if self._file is None:
            if not os.path.exists(self.path):
                raise FileNotFoundError(f"{self.path} does not exist; the recipe has to ask for events")
            _require_hdf5(self.path)
            self._file = h5py.File(self.path, "r")
            # Kept open, since HDF5 keeps the chunks that it has unpacked with an open column.
            self._columns = dict(self._file["events"].items())
            self._index = self._file["ms_to_idx"][:].astype(np.int64)
            self._offset_us = int(self._file["t_offset"][()])

    def events(self, t0_us=None, t1_us=None):
        """Events with t0_us <= t < t1_us; without a bound, from the first or to the last.

        Times are whole microseconds. A window in which nothing happens, or that lies outside of the recording, has no
        events; one that ends before it begins is an error.
        """
        t0_us, t1_us = _whole_us(t0_us), _whole_us(t1_us)
        if t0_us is not None and t1_us is not None and t1_us < t0_us:
            raise ValueError(f"the window from {t0_us} to {t1_us} us ends before it begins")
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

    @property
    def count(self):
        """Number of events in the file."""
        self._open()
        return len(self._columns["t"])

    def rows(self, first, end):
        """Events by number: those from `first` up to, and without, `end`."""
        self._open()
        columns, rows = self._columns, slice(max(first, 0), max(end, 0))
        t = columns["t"][rows].astype(np.int64) + self._offset_us
        label = columns["label"][rows] if "label" in columns else None
        return Events(t, columns["x"][rows], columns["y"][rows], columns["p"][rows], label)

    def _span_us(self):
        """Times that windows cut: from the first event to the last."""
        ends = [int(t) for rows in ((0, 1), (self.count - 1, self.count)) for t in self.rows(*rows).t]
        return (ends[0], ends[1] + 1) if self.count else (0, 0)

    def event_frame(self, t0_us, t1_us):
        """int32 [2, H, W]: number of events in the window, by polarity: 0 darker, 1 brighter."""
        return self._event_frame(self.events(t0_us, t1_us))

    def label_frame(self, t0_us, t1_us):
        """int32 [2, H, W]: number of events in the window, by label: 0 noise, 1 signal."""
        return self._label_frame(self.events(t0_us, t1_us))

    def _event_frame(self, events):
        return self._counts(events.p, events)

    def _label_frame(self, events):
        if events.label is None:
            raise ValueError(f"{self.path} has no labels; the recipe has to ask for them: `labels: true`")
        return self._counts(events.label, events)

    def _counts(self, kind, events):
        """int32 [2, H, W]: number of events by kind, 0 or 1, and pixel."""
        height, width = self._size()
        cells = self._pixels(events) + height * width * kind.astype(np.int64)
        return np.bincount(cells, minlength=2 * height * width).reshape(2, height, width).astype(np.int32)

    def _size(self):
        """Height and width, px."""
        if self.height is None:
            raise ValueError(f"{self.path} does not state its size; open it with size=(width, height)")
        return self.height, self.width

    def _pixels(self, events):
        """int64 [N]: number of the pixel of each event, row after row."""
        height, width = self._size()
        if len(events.x) and (events.x.max() >= width or events.y.max() >= height):
            raise ValueError(f"{self.path} has an event outside its {width}x{height} pixels")
        return events.y.astype(np.int64) * width + events.x

    def voxel(self, t0_us, t1_us, bins):
        """float32 [bins, H, W]: polarity, +1 or -1, divided between the two nearest bins, linearly in time.

        The grid of Zhu et al. (CVPR 2019, eq. 1 and 2), which E2VID reads too. An event at t is at bin
        (bins - 1) (t - t0_us) / (t1_us - t0_us); they use the stamps of the first and the last event instead
        of the ends of the window. The sum of a pixel over the bins is the sum of its polarities. Nothing is
        normalised.
        """
        return self._voxel(self.events(t0_us, t1_us), t0_us, t1_us, bins)

    def _voxel(self, events, t0_us, t1_us, bins):
        if bins < 1 or not t1_us > t0_us:
            raise ValueError(f"a grid of {bins} bins over [{t0_us}, {t1_us}) us holds nothing")
        height, width = self._size()
        pixels, sign = self._pixels(events), 2.0 * events.p - 1.0
        at = (bins - 1) * ((events.t - t0_us) / (t1_us - t0_us))
        grid = np.empty((bins, height * width), np.float32)
        # Events are sorted, so those of a bin are neighbours. Bin by bin, the sums fit into memory that the allocator
        # hands out again; those of a whole grid would be pages that the system has to clear for every window.
        ends = [0, *np.searchsorted(at, np.arange(1, bins)), len(at)]
        later = 0.0
        for k in range(bins):
            rows = slice(ends[k], ends[k + 1])
            share = (at[rows] - k) * sign[rows]
            grid[k] = np.bincount(pixels[rows], sign[rows] - share, height * width) + later
            later = np.bincount(pixels[rows], share, height * width)
        return grid.reshape(bins, height, width)

    def time_surface(self, t0_us, t1_us, tau_us):
        """float32 [2, H, W]: exp((t - t1_us) / tau_us) of each pixel's last event in the window, by polarity: 0 darker,
        1 brighter; 0 where there is none (Lagorce et al., TPAMI 2017)."""
        if not tau_us > 0:
            raise ValueError(f"tau_us is {tau_us}, wanted a number above 0")
        events = self.events(t0_us, t1_us)
        height, width = self._size()
        surface = np.zeros(2 * height * width, np.float32)
        # Events are sorted by time, and the last value that is assigned to a cell stays.
        cells = self._pixels(events) + height * width * events.p.astype(np.int64)
        surface[cells] = np.exp((events.t - t1_us) / tau_us)
        return surface.reshape(2, height, width)


def open_events(path, size=None):
    """The EventFile at `path`: an .h5 file of `gs2e simulate` or `gs2e convert`, or another in the layout of DSEC.

    Its methods are `events`, `event_frame`, `label_frame`, `voxel` and `close`. Files of gs2e state their size; for
    others, `size` is (width, height).
    """
    _require_hdf5(path)
    if size is None:
        with h5py.File(path, "r") as file:
            found = [file.attrs.get(name) for name in ("width", "height")]
        size = None if None in found else tuple(int(side) for side in found)
    return EventFile(path, size)


def _whole_us(t_us):
    """A time as an int; None stays."""
    if t_us is None:
        return None
    try:
        return operator.index(t_us)
    except TypeError:
        raise TypeError(f"a time is a whole number of microseconds, found {t_us!r}: 0.1 s is 100_000") from None


def _require_hdf5(path):
    """Refuses a file of another format."""
    if os.path.isfile(path) and not h5py.is_hdf5(path):
        raise ValueError(f"{path} is no HDF5 file; `gs2e convert {path} events.h5` makes one of .raw, .aedat4 and others")


class Scene(EventFile):
    """One trajectory of a scene, as one sensor saw it.

    `folder` is the folder of a scene, which has a scene.json, or the folder of a trajectory in it. `trajectory` and
    `sensor` are names, and can be left out if there is only one. Everything that is read is kept, except for events
    and pictures.
    """

    def __init__(self, folder, trajectory=None, sensor=None):
        folder = os.path.abspath(os.fspath(folder))
        if trajectory is None and not os.path.exists(os.path.join(folder, "scene.json")):
            folder, trajectory = os.path.split(folder)
            if not os.path.exists(os.path.join(folder, "scene.json")):
                # A camera of a rig is one folder deeper.
                folder, body = os.path.split(folder)
                trajectory = body + "/" + trajectory
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
        self.folder = os.path.join(folder, *trajectory.split("/"))
        """The folder of the trajectory."""
        self.scene_folder = folder
        """The folder of the scene."""
        self._camera = self.part.get("mounted", self.description)["camera"]
        camera = self._camera
        events = "events.h5" if sensor is None else os.path.join("events", sensor + ".h5")
        super().__init__(os.path.join(self.folder, events), (camera["width"], camera["height"]))
        self.duration_us = self.part["duration_us"]
        """Stamp of the last pose. The stamp of the first is 0."""
        self._poses = self._stamps = None
        self._listed = {}

    def __repr__(self):
        sensor = "" if self.sensor is None else f", sensor {self.sensor}"
        return f"<Scene {self.description['id']}/{self.trajectory}{sensor}: {self.width}x{self.height}>"

    def __reduce__(self):
        return Scene, (self.scene_folder, self.trajectory, self.sensor)

    def _span_us(self):
        """Times that windows cut: those of the poses."""
        return 0, self.duration_us

    @property
    def K(self):
        """float64 [3, 3]: pixels from camera axes, before the lens, if there is one."""
        camera = self._camera
        return np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]], np.float64)

    @property
    def lens(self):
        """The lens by OpenCV's model and coefficients: ("opencv", float64 [8]) for cv2.projectPoints, or
        ("fisheye", float64 [4]) for cv2.fisheye.projectPoints; None for a pinhole."""
        lens = self._camera.get("lens")
        return None if lens is None else next((model, np.array(k, np.float64)) for model, k in lens.items())

    @property
    def cameras(self):
        """The cameras of the rig on this body by name: a dictionary of Scene; empty if this is no body."""
        return {name: Scene(self.scene_folder, self.trajectory + "/" + name) for name in self.part.get("cameras", [])}

    @property
    def body(self):
        """The Scene of the body that carries this camera; None if there is one camera alone."""
        mounted = self.part.get("mounted")
        return None if mounted is None else Scene(self.scene_folder, mounted["body"])

    @property
    def camera_from_body(self):
        """float64 [4, 4]: maps points of the body to points of this camera of a rig, in scene units."""
        mounted = self.part.get("mounted")
        return np.eye(4) if mounted is None else np.array(mounted["camera_from_body"], np.float64)

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

        Between two poses, the centre of the camera moves on a straight line and its rotation takes the shortest way,
        both at a constant rate (lerp, slerp). Times before the first pose or after the last are refused.
        """
        return _pose_at(self.stamps_us, self.poses, t_us)

    @property
    def frames(self):
        """The sharp pictures by time: a list of Frame; empty if the recipe asks for none."""
        return self._numbered("sharp", ".png", Frame)

    @property
    def depths(self):
        """Depths by time: a list of Array; empty if the recipe asks for none."""
        return self._numbered("depth", ".npy", Array)

    @property
    def flows(self):
        """Optical flows by time: a list of Array; empty if the recipe asks for none."""
        return self._numbered("flow", ".npy", Array)

    @property
    def disparities(self):
        """Disparities by time: a list of Array; empty if the recipe asks for none, or if this is not the first camera of
        a stereo pair."""
        return self._numbered("disparity", ".npy", Array)

    @property
    def masks(self):
        """Masks of moving objects by time: a list of Frame; empty if the recipe asks for none."""
        return self._numbered("segmentation", ".png", Frame)

    def _numbered(self, name, end, kind):
        """The files of a folder that are named by the number of a pose."""
        if name not in self._listed:
            folder = os.path.join(self.folder, name)
            names = sorted(os.listdir(folder)) if os.path.isdir(folder) else []
            numbers = [int(name[: -len(end)]) for name in names if name.endswith(end)]
            paths = [os.path.join(folder, f"{j:06d}{end}") for j in numbers]
            self._listed[name] = [kind(j, int(self.stamps_us[j]), path) for j, path in zip(numbers, paths)]
        return self._listed[name]

    @property
    def blurred(self):
        """The blurred pictures by time: a list of Blurred; empty if the recipe asks for none."""
        if "blurred" not in self._listed:
            self._listed["blurred"] = self._read_blurred()
        return self._listed["blurred"]

    def _read_blurred(self):
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

    def light(self, t_us):
        """float64: factor on the light of the scene at these times in microseconds, in linear light; 1 if the recipe has no
        `lights`."""
        lights = self.description["recipe"].get("lights", {})
        seconds = np.asarray(t_us, np.float64) * 1e-6
        factor = np.ones_like(seconds)
        if "flicker" in lights:
            flicker = lights["flicker"]
            # A jump of a square wave belongs to the stamp at which it is, whatever the rounding.
            turns = np.mod(flicker["hz"] * seconds + flicker["phase"] + 1e-9, 1.0)
            if flicker["waveform"] == "sine":
                form = np.sin(2 * np.pi * turns)
            elif flicker["waveform"] == "square":
                form = np.where(turns < 0.5, 1.0, -1.0)
            else:
                form = np.pi / 2 * np.sin(np.pi * turns) - 1.0
            factor = np.maximum(1.0 + flicker["depth"] * form, 0.0)
        level = lights.get("level", [])
        if level:
            factor = factor * np.exp2(np.interp(seconds, [at["t"] for at in level], [at["stops"] for at in level]))
        return factor

    def imu(self):
        """Inertial measurements: int64 [N] times in ns since the first pose, on the clock of the events; float64 [N, 3]
        body rates, rad/s; float64 [N, 3] specific forces, m/s^2. Both in the axes of the camera (x right, y down, z
        forward), or of the body that carries it. `imu/state.csv` has the truth, and `imu/sensor.yaml` noise and gravity."""
        mounted = self.part.get("mounted")
        # Those of a camera of a rig belong to the body.
        body = self.folder if mounted is None else os.path.join(self.scene_folder, *mounted["body"].split("/"))
        path = os.path.join(body, "imu", "imu.csv")
        values = np.loadtxt(path, delimiter=",", ndmin=2)
        times = np.loadtxt(path, delimiter=",", ndmin=1, usecols=0, dtype=np.int64)
        return times, values[:, 1:4], values[:, 4:7]

    def depth(self, index):
        """float32 [H, W]: depth at the pose of this number, along the optical axis, in scene units; NaN: undefined."""
        return np.load(os.path.join(self.folder, "depth", f"{index:06d}.npy"))

    def flow(self, index):
        """float32 [H, W, 2]: optical flow at the pose of this number, px/s to the right and down; NaN: undefined."""
        return np.load(os.path.join(self.folder, "flow", f"{index:06d}.npy"))

    def disparity(self, index):
        """float32 [H, W]: disparity at the pose of this number, px; NaN: undefined. The pixels are those of this camera.
        The value is the column of the pixel's point in the first rectified picture minus that in the second, or the row
        for cameras above each other."""
        return np.load(os.path.join(self.folder, "disparity", f"{index:06d}.npy"))

    def rectify_map(self):
        """float32 [H, W, 2]: for each pixel of this camera of a stereo pair, its column and row in the rectified picture.
        Pixels are OpenCV's, with the centre of the first one at (0, 0). NaN: not seen."""
        return self._map("_rectify_map.npy")

    def remap(self):
        """float32 [H, W, 2]: for each pixel of the rectified picture, its place in the picture of this camera, for
        cv2.remap(picture, scene.remap(), None, cv2.INTER_LINEAR). NaN: not seen."""
        return self._map("_remap.npy")

    def _map(self, end):
        mounted = self.part.get("mounted")
        if mounted is None:
            raise ValueError(f"{self!r} is no camera of a rig")
        folder = os.path.join(self.scene_folder, *mounted["body"].split("/"), "calibration")
        return np.load(os.path.join(folder, mounted["name"] + end))

    def segmentation(self, index):
        """uint8 [H, W]: the number of the moving object that each pixel shows at the pose of this number; 0: what is
        still."""
        return read_png(os.path.join(self.folder, "segmentation", f"{index:06d}.png"))

    def event_objects(self, events):
        """uint8 [N]: the moving object at each of these events; 0: what is still. It is the one of the nearest mask in
        time. Where that shows what is still, it is the largest number of the eight pixels around, because an edge
        leaves its mask until the next one."""
        masks = self.masks
        if not masks:
            raise ValueError(f"{self!r} has no masks; the recipe has to ask for segmentation")
        stamps = np.array([mask.t_us for mask in masks])
        after = np.clip(np.searchsorted(stamps, events.t), 1, len(stamps) - 1) if len(stamps) > 1 else 0
        nearest = after - (events.t - stamps[after - 1] < stamps[after] - events.t) if len(stamps) > 1 else after
        nearest = np.broadcast_to(nearest, events.t.shape)
        found = np.zeros(len(events.t), np.uint8)
        for number in np.unique(nearest):
            mask = masks[number].read()
            padded = np.pad(mask, 1)
            height, width = mask.shape
            near = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
            rows = nearest == number
            found[rows] = np.where(mask > 0, mask, np.max(near, axis=0))[events.y[rows], events.x[rows]]
        return found

    def object_poses(self):
        """The moving objects by name: number in the masks, int64 [N] stamps in us, and float64 [N, 4, 4] poses, world
        from object. `segmentation/objects.csv` has their velocities too."""
        found = {}
        with open(os.path.join(self.folder, "segmentation", "objects.csv"), encoding="utf-8") as file:
            for row in csv.reader(line for line in file if not line.startswith("#")):
                number, stamps, poses = found.setdefault(row[2], (int(row[1]), [], []))
                tx, ty, tz, x, y, z, w = map(float, row[3:10])
                stamps.append(int(row[0]))
                poses.append(
                    [
                        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), tx],
                        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), ty],
                        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), tz],
                        [0.0, 0.0, 0.0, 1.0],
                    ]
                )
        return {name: (n, np.array(t, dtype=np.int64), np.array(p)) for name, (n, t, p) in found.items()}


class _Cut:
    """What windows have in common: their grids, their poses and their targets."""

    PRODUCTS = {
        "frame": "frames",
        "blur": "blurred",
        "depth": "depths",
        "flow": "flows",
        "disparity": "disparities",
    }
    """Targets that are files, and the properties of Scene that list them."""

    def __init__(self, scene, bins, targets):
        self.scene, self.bins, self.targets = scene, bins, tuple(targets)
        known = [*self.PRODUCTS, "label", "events"]
        for name in self.targets:
            if name not in known:
                raise ValueError(f"a window has no target {name!r}; there are {', '.join(known)}")
        wanted = [name for name in self.targets if name in self.PRODUCTS]
        self._products = {name: getattr(scene, self.PRODUCTS[name], []) for name in wanted}
        for name, listed in self._products.items():
            if not listed:
                raise ValueError(f"{scene!r} has no {name}; the recipe has to ask for it")
        self._times = {name: [product.t_us for product in listed] for name, listed in self._products.items()}

    def __iter__(self):
        return (self[i] for i in range(len(self)))

    def _entry(self, events, t0_us, t1_us):
        middle_us = (t0_us + t1_us) / 2
        entry = {"t0_us": t0_us, "t1_us": t1_us, "voxel": self.scene._voxel(events, t0_us, t1_us, self.bins)}
        if isinstance(self.scene, Scene):
            # An event at the last pose ends a window half a microsecond behind it.
            entry["pose"] = self.scene.pose(min(middle_us, self.scene.duration_us))
        for name, listed in self._products.items():
            nearest = _nearest(listed, self._times[name], middle_us)
            entry[name], entry[name + "_t_us"] = nearest.read(), nearest.t_us
        if "label" in self.targets:
            entry["label"] = self.scene._label_frame(events)
        if "events" in self.targets:
            entry["events"] = events
        return entry


class Windows(_Cut):
    """A scene cut into windows of equal length: a map-style dataset for torch.utils.data.DataLoader.

    Entry i is of [i * stride_us, i * stride_us + length_us). It is a dictionary of `t0_us`, `t1_us`, `voxel` (see
    Scene.voxel) and `pose` (see Scene.pose) at the middle of the window. The last window ends by the last pose.
    Windows of an EventFile have no pose; they start at the first event, and end by the last.

    `targets` names what else an entry has:

    - "frame", "blur", "depth", "flow", "disparity": the product nearest in time to the middle of the window, as an array, and its
      time: `frame` and `frame_t_us`. Of two at the same distance it is the earlier one. A blurred picture has the
      time of its pose.
    - "label": int32 [2, H, W], the number of events by label: 0 noise, 1 signal.
    - "events": the Events of the window. Their number varies, so a batch of them needs a `collate_fn`.
    """

    def __init__(self, scene, length_us, bins, stride_us=None, targets=()):
        self.length_us, self.stride_us = length_us, length_us if stride_us is None else stride_us
        if self.length_us <= 0 or self.stride_us <= 0:
            raise ValueError("windows have a length and a stride above 0 us")
        super().__init__(scene, bins, targets)
        self._start_us, end_us = scene._span_us()
        self._count = _window_count(end_us - self._start_us, self.length_us, self.stride_us)

    def __len__(self):
        return self._count

    def __getitem__(self, i):
        if not 0 <= i < len(self):
            raise IndexError(i)
        t0_us = self._start_us + i * self.stride_us
        t1_us = t0_us + self.length_us
        return self._entry(self.scene.events(t0_us, t1_us), t0_us, t1_us)


class CountWindows(_Cut):
    """A scene or an EventFile cut into windows of equal numbers of events: a map-style dataset.

    Entry i has the events from number i * stride on, `count` of them, and the keys of `Windows`. `t0_us` is the time
    of its first event, and `t1_us` lies 1 us after its last.
    """

    def __init__(self, scene, count, bins, stride=None, targets=()):
        self.count, self.stride = count, count if stride is None else stride
        if self.count <= 0 or self.stride <= 0:
            raise ValueError("windows have a number of events and a stride above 0")
        super().__init__(scene, bins, targets)

    def __len__(self):
        return _window_count(self.scene.count, self.count, self.stride)

    def __getitem__(self, i):
        if not 0 <= i < len(self):
            raise IndexError(i)
        events = self.scene.rows(i * self.stride, i * self.stride + self.count)
        return self._entry(events, int(events.t[0]), int(events.t[-1]) + 1)


def _nearest(listed, times, t_us):
    """The product nearest to a time; of two at the same distance, the earlier one. `times` are those of the products."""
    after = bisect.bisect_left(times, t_us)
    return min(listed[max(after - 1, 0) : after + 1], key=lambda product: abs(product.t_us - t_us))


def _window_count(duration_us, length_us, stride_us):
    """Number of windows that fit."""
    return max(0, (duration_us - length_us) // stride_us + 1)


class Dataset:
    """The trajectories of a release: a sequence of Scene, one for each trajectory and sensor.

    `root` is the folder that has manifest.json. `split` is the name of a split, or None for all scenes. The list
    comes from index.parquet if pyarrow or pandas is installed, and otherwise from manifest.json and each scene.json.
    """

    COLUMNS = ("id", "scene", "trajectory", "sensor", "split", "duration_us")
    """Columns that each row has in both cases. The other columns of index.parquet need pyarrow or pandas."""

    MAX_OPEN = 16
    """Maximum number of scenes that are kept open."""

    def __init__(self, root, split=None):
        self.root = os.path.abspath(os.fspath(root))
        rows = _index_rows(self.root)
        splits = sorted({row["split"] for row in rows if row["split"]})
        if split is not None and split not in splits:
            raise ValueError(f"{self.root} has the splits {', '.join(splits) or 'none'}; asked for is {split}")
        self.split = split
        self.rows = [row for row in rows if split is None or row["split"] == split]
        """Rows of index.parquet, one dictionary for each entry."""
        self._open = {}

    def __repr__(self):
        return f"<Dataset {self.root}, split {self.split}: {len(self)}>"

    def __getstate__(self):
        return {**self.__dict__, "_open": {}}

    def __len__(self):
        return len(self.rows)

    def __getitem__(self, i):
        row = self.rows[i]
        scene = self._open.pop(row["id"], None)
        if scene is None:
            scene = Scene(os.path.join(self.root, *row["scene"].split("/")), row["trajectory"], row["sensor"])
        # A dict keeps the order of insertion, so the scene used last is at its end.
        self._open[row["id"]] = scene
        if len(self._open) > self.MAX_OPEN:
            self._open.pop(next(iter(self._open))).close()
        return scene

    def windows(self, length_us, bins, stride_us=None, targets=()):
        """The windows of all entries, one after the other: a map-style dataset. See `Windows` for the arguments.

        An entry has one more key: `row`, the number of its row in `Dataset.rows`.
        """
        return _DatasetWindows(self, length_us, bins, stride_us, targets)


class _DatasetWindows:
    """Windows over many scenes."""

    def __init__(self, dataset, length_us, bins, stride_us, targets):
        self.dataset, self.arguments = dataset, (length_us, bins, stride_us, targets)
        if length_us <= 0 or stride_us is not None and stride_us <= 0:
            raise ValueError("windows have a length and a stride above 0 us")
        stride_us = length_us if stride_us is None else stride_us
        counts = (_window_count(row["duration_us"], length_us, stride_us) for row in dataset.rows)
        self._ends = list(itertools.accumulate(counts))
        self._made = {}

    def __getstate__(self):
        return {**self.__dict__, "_made": {}}

    def __len__(self):
        return self._ends[-1] if self._ends else 0

    def _of_row(self, row):
        """The windows of a row; kept, with the lists of its products."""
        scene, made = self.dataset[row], self._made.get(row)
        if made is None or made.scene is not scene:
            if len(self._made) >= Dataset.MAX_OPEN:
                self._made.clear()
            made = self._made[row] = Windows(scene, *self.arguments)
        return made

    def __getitem__(self, i):
        if not 0 <= i < len(self):
            raise IndexError(i)
        row = bisect.bisect_right(self._ends, i)
        first = self._ends[row - 1] if row else 0
        return {**self._of_row(row)[i - first], "row": row}


def _index_rows(root):
    """The rows of index.parquet; without a reader of Parquet, the most important columns, from the JSON files."""
    path = os.path.join(root, "index.parquet")
    if not os.path.exists(path):
        return _manifest_rows(root)
    try:
        import pyarrow.parquet

        return pyarrow.parquet.read_table(path).to_pylist()
    except ImportError:
        pass
    try:
        import pandas

        frame = pandas.read_parquet(path)
        return frame.astype(object).where(frame.notna(), None).to_dict("records")
    except ImportError:
        # pandas itself needs pyarrow or fastparquet.
        return _manifest_rows(root)


def _manifest_rows(root):
    """One row for each trajectory and sensor, in the order of index.parquet."""
    with open(os.path.join(root, "manifest.json"), encoding="utf-8") as file:
        ids = [scene["id"] for scene in json.load(file)["scenes"]]
    rows = []
    for scene in ids:
        description = _description(os.path.join(root, *scene.split("/")))
        for part in description["trajectories"]:
            if part.get("cameras"):
                # The body of a rig sees nothing.
                continue
            for sensor in part.get("sensors") or [None]:
                names = [scene, part["name"], *([] if sensor is None else [sensor])]
                split_name = (description.get("split") or {}).get("name")
                values = ("/".join(names), scene, part["name"], sensor, split_name, part["duration_us"])
                rows.append(dict(zip(Dataset.COLUMNS, values)))
    return sorted(rows, key=lambda row: (row["scene"], row["trajectory"], row["sensor"] or ""))


def read_png(path, decoder=None):
    """uint8 [H, W, 3], or [H, W] for a mask: the pixels of a PNG of 8-bit RGB or grey without interlacing, the only
    kinds in a release.

    `decoder` is "pillow", "opencv" or "numpy"; without it, the first of them that is installed.
    """
    with open(path, "rb") as file:
        data = file.read()
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR":
        raise ValueError(f"{path} is not a PNG")
    if tuple(data[24:29]) not in ((8, 2, 0, 0, 0), (8, 0, 0, 0, 0)):
        raise ValueError(f"{path} is not a PNG of 8-bit RGB or grey without interlacing")
    for decode in _DECODERS.values() if decoder is None else [_DECODERS[decoder]]:
        try:
            return decode(data)
        except ImportError:
            # The last decoder needs nothing but numpy.
            continue
    raise ImportError(f"the decoder {decoder} is not installed")


def _decode_with_pillow(data):
    import io

    from PIL import Image

    return np.array(Image.open(io.BytesIO(data)))


def _decode_with_opencv(data):
    import cv2

    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None:
        raise ValueError("OpenCV cannot decode the picture")
    return decoded if decoded.ndim == 2 else cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB)


def _decode_with_numpy(data):
    width, height = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    at, parts, channels = 8, [], 3 if data[25] == 2 else 1
    while at < len(data):
        length, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        if name == b"IDAT":
            parts.append(data[at + 8 : at + 8 + length])
        at += 12 + length
    raw = np.frombuffer(zlib.decompress(b"".join(parts)), np.uint8).reshape(height, 1 + channels * width)
    pixels = _unfiltered(raw[:, 0], raw[:, 1:].reshape(height, width, channels))
    return pixels if channels == 3 else pixels[:, :, 0]


_DECODERS = {"pillow": _decode_with_pillow, "opencv": _decode_with_opencv, "numpy": _decode_with_numpy}
"""Decoders by name, in the order in which they are tried."""


def _unfiltered(filters, sent):
    """Undoes the filters of a PNG's rows (its specification, section 9). A pixel needs the pixels to the left, above,
    and above the left one, so the pixels of one diagonal are independent of each other."""
    height, width, channels = sent.shape
    # With a row and a column of zeros before the first ones.
    out = np.zeros((height + 1, width + 1, channels), np.int16)
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


def _pose_at(stamps, poses, t_us):
    """The poses [..., 4, 4] at times; see Scene.pose."""
    t_us = np.asarray(t_us, np.float64)
    outside = (t_us < stamps[0]) | (t_us > stamps[-1]) | np.isnan(t_us)
    if outside.any():
        raise ValueError(f"{t_us[outside].flat[0]} us is not within {stamps[0]}..{stamps[-1]} us, where the poses are")
    if len(stamps) == 1:
        return _matrix(np.broadcast_to(poses[0], (*t_us.shape, 7)))
    before = np.clip(np.searchsorted(stamps, t_us, side="right") - 1, 0, len(stamps) - 2)
    share = (t_us - stamps[before]) / (stamps[before + 1] - stamps[before])
    a, b = poses[before], poses[before + 1]
    centre = (1 - share)[..., None] * a[..., :3] + share[..., None] * b[..., :3]
    return _matrix(np.concatenate([centre, _slerp(a[..., 3:], b[..., 3:], share)], axis=-1))


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
