"""Recordings of events and frames of the same pixels, cut into steps from frame to frame.

A recording is one of
- a folder with `events.npz` (`t`, `x`, `y`, `p`) or `events.h5` (the layout of DSEC), and `frames.npy` [N, H, W] with
  `stamps.npy` [N] in us, or `frames.npz` with `frames` and `stamps_us`, or `ft` in seconds;
- a release of gs2e, whose trajectories are one recording each. Its own loader `gs2e.py` reads it (h5py).

`FOLDER@8000` adds 8,000 us to the stamps of frames: those of `slider_depth` are the start of the exposure, 8 ms before
its middle.

The step k has the events between the frames k - 1 and k as a voxel grid, and frame k.
"""

import importlib.util
import math
from pathlib import Path

import numpy as np

BINS = 5


class Recording:
    """Events sorted by time, and grey frames from 0 to 1: dark and bright ends of the recording, not of the frame."""

    def __init__(self, name, events, frames, stamps_us):
        self.name = name
        t, x, y, p = events
        stamps_us = np.asarray(stamps_us, np.int64)
        self.edges = np.searchsorted(t, stamps_us)
        self.t, self.x, self.y = t, x.astype(np.int64), y.astype(np.int64)
        self.sign = np.where(p > 0, 1, -1).astype(np.float32)
        self.stamps_us = stamps_us
        low, high = np.percentile(frames[::max(1, len(frames) // 20)], [1, 99])
        self.frames = np.clip((frames - low) / max(high - low, 1e-6), 0, 1).astype(np.float32)
        self.height, self.width = frames.shape[1:]

    def __len__(self):
        return len(self.stamps_us) - 1

    def voxels(self, k, top=0, left=0, height=None, width=None):
        """The events before frame k + 1 in a part of the picture, float32 [BINS, height, width].

        Each event is divided between the two bins next to it in time. Values that are not zero are then brought to
        a mean of 0 and a deviation of 1, as E2VID does.
        """
        height, width = height or self.height, width or self.width
        part = slice(self.edges[k], self.edges[k + 1])
        y, x = self.y[part] - top, self.x[part] - left
        inside = (0 <= y) & (y < height) & (0 <= x) & (x < width)
        y, x, sign = y[inside], x[inside], self.sign[part][inside]
        start, end = self.stamps_us[k], self.stamps_us[k + 1]
        place = (self.t[part][inside] - start) * ((BINS - 1) / max(end - start, 1))
        early = np.clip(place.astype(np.int64), 0, BINS - 1)
        share = (place - early).astype(np.float32)
        size, pixel = BINS * height * width, y * width + x
        late = np.minimum(early + 1, BINS - 1)
        grid = np.bincount(early * height * width + pixel, sign * (1 - share), size)
        grid += np.bincount(late * height * width + pixel, sign * share, size)
        return normalised(grid).reshape(BINS, height, width).astype(np.float32)

    def crop(self, draw, side, steps):
        """Steps from a random start in a random square: voxels [steps, BINS, side, side] and frames."""
        first = int(draw.integers(0, max(len(self) - steps, 0) + 1))
        top, left = (int(draw.integers(0, length - side + 1)) for length in (self.height, self.width))
        ks = range(first, min(first + steps, len(self)))
        grids = np.stack([self.voxels(k, top, left, side, side) for k in ks])
        frames = self.frames[first + 1:ks.stop + 1, top:top + side, left:left + side]
        return turned(draw, grids, frames)


def normalised(grid):
    used = grid != 0
    if not used.any():
        return grid
    values = grid[used]
    grid[used] = (values - values.mean()) / max(values.std(), 1e-6)
    return grid


def turned(draw, *arrays):
    """All arrays mirrored and transposed alike."""
    across, down, swap = draw.random(3) < 0.5
    for array in arrays:
        array = array[..., ::-1] if across else array
        array = array[..., ::-1, :] if down else array
        yield np.ascontiguousarray(array.swapaxes(-1, -2) if swap else array)


def opened(place):
    """The recordings of a folder or release."""
    folder, _, shift = str(place).partition("@")
    folder = Path(folder)
    if (folder / "manifest.json").exists():
        return released(folder)
    frames, stamps_us = read_frames(folder)
    return [Recording(folder.name, read_events(folder), frames, stamps_us + int(shift or 0))]


def read_frames(folder):
    if (folder / "frames.npy").exists():
        return np.load(folder / "frames.npy"), np.load(folder / "stamps.npy")
    with np.load(folder / "frames.npz") as archive:
        stamps = archive["stamps_us"] if "stamps_us" in archive else np.rint(archive["ft"] * 1e6).astype(np.int64)
        return archive["frames"], stamps


def read_events(folder):
    if (folder / "events.npz").exists():
        with np.load(folder / "events.npz") as archive:
            t, x, y, p = (archive[name] for name in "txyp")
        t = np.rint(t * 1e6).astype(np.int64) if t.dtype.kind == "f" else t.astype(np.int64)
    else:
        import h5py
        with h5py.File(folder / "events.h5") as file:
            t, x, y, p = (file["events"][name][:] for name in "txyp")
            t = t.astype(np.int64) + int(file["t_offset"][()])
    order = np.argsort(t, kind="stable")
    return t[order], x[order], y[order], p[order]


def released(folder):
    spec = importlib.util.spec_from_file_location("released_gs2e", folder / "gs2e.py")
    loader = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loader)
    recordings = []
    for scene in loader.Dataset(str(folder)):
        # Grey as the sensors of gs2e see it.
        frames = np.stack([frame.read() @ [0.299, 0.587, 0.114] for frame in scene.frames]).astype(np.float32)
        stamps_us = np.array([frame.t_us for frame in scene.frames])
        t, x, y, p, *_ = scene.events(int(stamps_us[0]), int(stamps_us[-1]) + 1)
        events = np.asarray(t, np.int64), np.asarray(x), np.asarray(y), np.asarray(p)
        name = "/".join(part for part in (scene.description["id"], scene.trajectory, scene.sensor) if part)
        recordings.append(Recording(name, events, frames, stamps_us))
    return recordings


def batch(draw, recordings, size, side, steps):
    """Crops of recordings drawn by their steps, those that are shorter left out: [size, steps, …]."""
    fits = [r for r in recordings if len(r) >= steps and min(r.height, r.width) >= side]
    if not fits:
        raise SystemExit(f"no recording has {steps} steps and {side} pixels a side")
    weights = np.array([len(r) for r in fits]) / sum(len(r) for r in fits)
    crops = [tuple(fits[draw.choice(len(fits), p=weights)].crop(draw, side, steps)) for _ in range(size)]
    return tuple(np.stack(column) for column in zip(*crops))


def padded(array, multiple=4):
    """Zeros below and to the right, up to a multiple of the network's stride."""
    missing = [-length % multiple for length in array.shape[-2:]]
    return np.pad(array, [(0, 0)] * (array.ndim - 2) + [(0, m) for m in missing])


def equalised(picture):
    """Histogram equalisation to ranks from 0 to 1: what is left is the order of the brightness of pixels."""
    flat = np.rint(np.clip(picture, 0, 1) * 255).astype(np.int64)
    below = np.cumsum(np.bincount(flat.ravel(), minlength=256))
    first = below[below > 0][0]
    return ((below[flat] - first) / max(math.prod(picture.shape) - first, 1)).astype(np.float32)


def stretched(picture):
    """From the 1st to the 99th percentile of the picture."""
    low, high = np.percentile(picture, [1, 99])
    return np.clip((picture - low) / max(high - low, 1e-6), 0, 1).astype(np.float32)
