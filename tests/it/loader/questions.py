# SPDX-License-Identifier: MIT OR Apache-2.0
"""questions.py QUESTION FOLDER ...: asserts what gs2e.py answers, by answers that do not come from it."""
import json
import os
import pathlib
import pickle
import struct
import sys
import zlib

import h5py
import numpy as np

import gs2e


def columns(path):
    """Whole columns, as h5py has them."""
    with h5py.File(path) as file:
        found = {name: file["events"][name][:] for name in file["events"]}
        found["t"] = found["t"].astype(np.int64) + int(file["t_offset"][()])
    return found


def same_window(scene, whole, t0_us, t1_us):
    """A window against a mask over whole columns."""
    if t0_us is not None and t1_us is not None and t1_us < t0_us:
        refused(lambda: scene.events(t0_us, t1_us), "ends before it begins")
        return 0
    t = whole["t"]
    mask = np.ones(len(t), bool)
    mask &= True if t0_us is None else t >= t0_us
    mask &= True if t1_us is None else t < t1_us
    found = scene.events(t0_us, t1_us)
    for name in "txyp":
        column = getattr(found, name)
        assert np.array_equal(column, whole[name][mask]), (name, t0_us, t1_us)
    assert [found.t.dtype, found.x.dtype, found.y.dtype, found.p.dtype] == [np.int64, np.uint16, np.uint16, np.uint8]
    if "label" in whole:
        assert np.array_equal(found.label, whole["label"][mask])
    else:
        assert found.label is None
    return mask.sum()


def same_windows(scene, whole, number):
    """Windows at random, and the whole."""
    random = np.random.default_rng(1)
    for _ in range(number):
        same_window(scene, whole, *map(int, random.integers(-500, int(whole["t"][-1]) + 500, 2)))
    assert same_window(scene, whole, None, None) == len(whole["t"]) > 0


def same_at_edges(scene, whole):
    """Windows whose bounds are of every kind."""
    first, last = int(whole["t"][0]), int(whole["t"][-1])
    ends = [None, -1000, -1, 0, first, first + 1, last, last + 1, last + 10**6, 10**12]
    ends += [k * 1000 + d for k in range(last // 1000 + 3) for d in (-1, 0, 1)]
    # Each of them as either bound, against every seventh.
    pairs = [pair for kind in ends for other in ends[::7] for pair in ((kind, other), (other, kind))]
    hits = [same_window(scene, whole, t0, t1) for t0, t1 in pairs]
    assert min(hits) == 0 < max(hits), "windows of both kinds were tried"
    # Floats are usually seconds.
    for times in [(0.0, 0.1), (0, 0.1), (0.0, None), (np.float64(0), 1000)]:
        try:
            scene.events(*times)
        except TypeError as error:
            assert "whole number of microseconds" in str(error), error
        else:
            raise AssertionError(f"floats were not refused: {times}")


def windows(folder, trajectory):
    whole = columns(f"{folder}/{trajectory}/events.h5")
    same_at_edges(gs2e.Scene(folder, trajectory), whole)
    same_windows(gs2e.Scene(f"{folder}/{trajectory}/"), whole, 100)


def rotated(q, v):
    """Quaternion q turns vector v: v + 2 w (u x v) + 2 u x (u x v)."""
    u, w = np.asarray(q[:3]), q[3]
    return v + 2 * w * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v))


def poses(folder, trajectory):
    scene = gs2e.Scene(folder, trajectory)
    rows = np.loadtxt(f"{folder}/{trajectory}/poses.txt")
    assert np.array_equal(scene.stamps_us, rows[:, 0]) and np.array_equal(scene.poses, rows[:, 1:])
    assert scene.stamps_us[-1] == scene.duration_us
    all_at_once = scene.pose(scene.stamps_us)
    assert all_at_once.shape == (len(rows), 4, 4)
    for (t, *numbers), matrix in zip(rows, all_at_once):
        assert np.array_equal(scene.pose(t), matrix)
        assert np.array_equal(matrix[:3, 3], numbers[:3])
        for axis in np.eye(3):
            # Rounding of products of numbers up to 1.
            assert np.abs(matrix[:3, :3] @ axis - rotated(numbers[3:], axis)).max() < 1e-14
        assert np.array_equal(matrix[3], [0, 0, 0, 1])
    between = scene.pose((rows[:-1, 0] + rows[1:, 0]) / 2)
    # A rotation halfway between two has the same turn from the first as to the second.
    a, b = all_at_once[:-1, :3, :3], all_at_once[1:, :3, :3]
    m, turned = between[:, :3, :3], lambda r: np.swapaxes(r, -1, -2)
    assert np.abs(turned(a) @ m - turned(m) @ b).max() < 1e-13
    assert np.abs(between[:, :3, 3] - (rows[:-1, 1:4] + rows[1:, 1:4]) / 2).max() < 1e-14
    for outside in (-1, rows[-1, 0] + 0.01, float("nan")):
        refused(lambda: scene.pose(outside), "is not within")
    with open(f"{folder}/{trajectory}/transforms.json") as file:
        camera = json.load(file)
    fx, fy, cx, cy = (camera[name] for name in ("fl_x", "fl_y", "cx", "cy"))
    assert np.array_equal(scene.K, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    assert (scene.width, scene.height) == (camera["w"], camera["h"])
    listed = [(frame.t_us, os.path.relpath(frame.path, scene.folder)) for frame in scene.frames]
    assert listed == [(frame["t_us"], frame["file_path"]) for frame in camera["frames"]]


def refused(act, wanted):
    try:
        act()
    except ValueError as error:
        assert wanted in str(error), error
    else:
        raise AssertionError(f"it was not refused: {wanted}")


def grids(folder, trajectory):
    scene = gs2e.Scene(folder, trajectory)
    whole = columns(f"{folder}/{trajectory}/events.h5")
    last = int(whole["t"][-1])
    for t0, t1 in [(0, last + 1), (1000, 2000), (last // 2, last), (last + 1, last + 5000)]:
        counts = np.zeros((2, scene.height, scene.width), np.int64)
        for t, x, y, p in zip(*(whole[name] for name in "txyp")):
            counts[p, y, x] += t0 <= t < t1
        found = scene.event_frame(t0, t1)
        assert found.dtype == np.int32 and np.array_equal(found, counts)
        for bins in (1, 2, 5, 16):
            grid = scene.voxel(t0, t1, bins)
            assert grid.shape == (bins, scene.height, scene.width) and grid.dtype == np.float32
            # Each of a pixel's events is split into two shares, rounded to 32 bits.
            wanted = counts[1] - counts[0]
            assert np.abs(grid.sum(0, dtype=np.float64) - wanted).max() <= 1e-6 * (1 + counts.sum(0).max())
    refused(lambda: scene.voxel(0, 1000, 0), "0 bins")
    refused(lambda: scene.voxel(1000, 1000, 5), "holds nothing")
    cut = gs2e.Windows(scene, 2000, 3, stride_us=1000)
    assert len(cut) == (scene.duration_us - 2000) // 1000 + 1
    entries = list(cut)
    assert len(entries) == len(cut) and entries[-1]["t1_us"] <= scene.duration_us
    for i, entry in enumerate(entries):
        assert (entry["t0_us"], entry["t1_us"]) == (1000 * i, 1000 * i + 2000)
        assert np.array_equal(entry["voxel"], scene.voxel(1000 * i, 1000 * i + 2000, 3))
        assert np.array_equal(entry["pose"], scene.pose(1000 * i + 1000))


def cuts(folder, trajectory):
    """Windows of equal numbers of events, and surfaces of the last event of each pixel."""
    scene = gs2e.Scene(folder, trajectory)
    whole = columns(f"{folder}/{trajectory}/events.h5")
    cut = gs2e.CountWindows(scene, 100, bins=4, stride=60, targets=("events",))
    assert len(cut) == (len(whole["t"]) - 100) // 60 + 1 > 3
    for i, entry in enumerate(cut):
        rows = slice(60 * i, 60 * i + 100)
        assert all(np.array_equal(getattr(entry["events"], name), whole[name][rows]) for name in "txyp")
        assert (entry["t0_us"], entry["t1_us"]) == (whole["t"][rows][0], whole["t"][rows][-1] + 1)
        # All shares of an event together have its sign.
        assert abs(entry["voxel"].sum(dtype=np.float64) - (2.0 * whole["p"][rows] - 1).sum()) < 1e-3
    t0, t1 = int(whole["t"][0]), int(whole["t"][-1]) * 2 // 3
    wanted = np.zeros((2, scene.height, scene.width))
    for t, x, y, p in zip(*(whole[name] for name in "txyp")):
        if t0 <= t < t1:
            wanted[p, y, x] = np.exp((t - t1) / 3000)
    found = scene.time_surface(t0, t1, 3000)
    # Values up to 1 in 32 bits.
    assert found.dtype == np.float32 and np.abs(found - wanted).max() < 1e-7 and found.max() > 0.5
    refused(lambda: scene.time_surface(t0, t1, 0), "tau_us is 0")
    refused(lambda: gs2e.CountWindows(scene, 0, 5), "above 0")
    bare = gs2e.Windows(gs2e.open_events(scene.path), 1000, bins=2, targets=["events"])
    assert len(bare) == (whole["t"][-1] + 1 - whole["t"][0]) // 1000
    assert bare[0]["t0_us"] == whole["t"][0] and "pose" not in bare[0]
    inside = (whole["t"] < bare[len(bare) - 1]["t1_us"]).sum()
    assert sum(len(entry["events"].t) for entry in bare) == inside
    refused(lambda: gs2e.Windows(gs2e.open_events(scene.path), 1000, 2, targets=["frame"]), "has no frame")


def targets(folder, trajectory):
    """Each target against the file whose pose is nearest, found in the folder and in poses.txt."""
    scene = gs2e.Scene(folder, trajectory)
    stamps = np.loadtxt(f"{folder}/{trajectory}/poses.txt")[:, 0]
    cut = gs2e.Windows(scene, 2000, 2, stride_us=500, targets=("frame", "blur", "depth", "flow", "events"))
    assert len(cut) > 5
    for entry in cut:
        middle = entry["t0_us"] + 1000
        for name, folder_name in [("frame", "sharp"), ("blur", "blur"), ("depth", "depth"), ("flow", "flow")]:
            paths = sorted(pathlib.Path(folder, trajectory, folder_name).iterdir())
            nearest = min(paths, key=lambda path: abs(stamps[int(path.stem)] - middle))
            assert entry[name + "_t_us"] == stamps[int(nearest.stem)], (name, entry["t0_us"])
            wanted = np.load(nearest) if nearest.suffix == ".npy" else gs2e.read_png(nearest)
            assert np.array_equal(entry[name], wanted, equal_nan=wanted.dtype == np.float32)
        assert np.array_equal(entry["events"].t, scene.events(entry["t0_us"], entry["t1_us"]).t)
    assert len({entry["frame_t_us"] for entry in cut}) > 1
    refused(lambda: gs2e.Windows(scene, 2000, 2, targets=("image",)), "no target 'image'")
    refused(lambda: gs2e.Windows(scene, 2000, 2, targets=("label",))[0], "has no labels")


def dataset(root):
    """A release with the splits train and test: rows from every reader, splits, and windows over all scenes."""
    described = [json.loads(path.read_text()) for path in sorted(pathlib.Path(root).glob("*/scene.json"))]
    found = {}
    for name in ("pyarrow", "pandas", "json"):
        blocked = {"pyarrow": [], "pandas": ["pyarrow.parquet"], "json": ["pyarrow.parquet", "pandas"]}[name]
        kept = {module: sys.modules.get(module) for module in blocked}
        sys.modules.update(dict.fromkeys(blocked))
        try:
            rows = gs2e.Dataset(root).rows
        finally:
            for module, value in kept.items():
                sys.modules.pop(module) if value is None else sys.modules.update({module: value})
        found[name] = [{key: row[key] for key in gs2e.Dataset.COLUMNS} for row in rows]
    assert all(rows == found["json"] for rows in found.values()), found
    assert [row["scene"] for row in found["json"]] == [scene["id"] for scene in described]
    splits = {"train": [], "test": []}
    for scene in described:
        splits[scene["split"]["name"]].append(scene["id"])
    assert all(splits.values()), splits
    for name, ids in splits.items():
        assert [scene.description["id"] for scene in gs2e.Dataset(root, split=name)] == ids
    refused(lambda: gs2e.Dataset(root, split="validation"), "splits test, train")
    whole = gs2e.Dataset(root)
    whole.MAX_OPEN = 1
    windows = whole.windows(2000, 2, stride_us=1000, targets=("frame",))
    wanted = [(row, entry) for row, scene in enumerate(whole) for entry in gs2e.Windows(scene, 2000, 2, 1000)]
    assert len(windows) == len(wanted) > len(described)
    for _ in range(2):
        for (row, wanted_entry), entry in zip(wanted, windows):
            assert (entry["row"], entry["t0_us"]) == (row, wanted_entry["t0_us"])
            assert np.array_equal(entry["voxel"], wanted_entry["voxel"]) and entry["frame"].ndim == 3
        assert len(windows.dataset._open) == 1
        windows = pickle.loads(pickle.dumps(windows))


def bare(path):
    """A file of events alone."""
    whole = columns(path)
    stream = gs2e.open_events(path)
    same_windows(stream, whole, 20)
    copy = pickle.loads(pickle.dumps(stream))
    same_windows(copy, whole, 5)
    assert (copy.width, copy.height) == (stream.width, stream.height)
    last = int(whole["t"][-1]) + 1
    assert stream.event_frame(0, last).sum() == len(whole["t"]) > 0
    counts = np.zeros((2, stream.height, stream.width), np.int64)
    np.add.at(counts, (whole["label"], whole["y"], whole["x"]), 1)
    assert np.array_equal(stream.label_frame(0, last), counts)
    stream.close()
    copy.close()
    with h5py.File(path, "r+") as file:
        del file.attrs["width"]
    refused(lambda: gs2e.open_events(path).voxel(0, last, 3), "does not state its size")
    raw = path + ".raw"
    with open(raw, "wb") as file:
        file.write(b"% evt 2.0\n% end\n")
    for size in (None, (3, 4)):
        refused(lambda: gs2e.open_events(raw, size), "gs2e convert")
    assert np.array_equal(gs2e.open_events(path, (stream.width, stream.height)).label_frame(0, last), counts)


def processes(folder, trajectory):
    """Pickled copies, and workers that were forked while the file was open."""
    scene = gs2e.Scene(folder, trajectory)
    whole = columns(f"{folder}/{trajectory}/events.h5")
    assert pickle.loads(pickle.dumps(scene))._file is None, "nothing is open before it is needed"
    same_windows(scene, whole, 10)
    copy = pickle.loads(pickle.dumps(scene))
    assert copy._file is None and repr(copy) == repr(scene)
    same_windows(copy, whole, 10)
    inherited = scene._file.id.id
    children = []
    for _ in range(4):
        child = os.fork()
        if child == 0:
            status = 1
            try:
                assert scene._file.id.id == inherited
                same_windows(scene, whole, 20)
                assert scene._pid == os.getpid()
                status = 0
            finally:
                os._exit(status)
        children.append(child)
    same_windows(scene, whole, 20)
    assert [os.waitpid(child, 0)[1] for child in children] == [0] * 4
    same_windows(scene, whole, 1)
    scene.close()
    same_windows(scene, whole, 1)


def plant(folder, name="path", **part):
    """A scene of one trajectory, without files of its own."""
    camera = {"width": 4, "height": 3, "fx": 2.0, "fy": 2.5, "cx": 2.0, "cy": 1.5}
    part = {"name": name, "duration_us": 1000, **part}
    base = pathlib.Path(folder) / name
    base.mkdir(parents=True, exist_ok=True)
    described = {"id": "planted", "camera": camera, "trajectories": [part]}
    (base.parent / "scene.json").write_text(json.dumps(described))
    return base


def planted_split(folder):
    home = plant(folder).parent
    assert gs2e.split(home) is None
    described = json.loads((home / "scene.json").read_text())
    described["split"] = {"name": "train", "group": "mug"}
    (home / "scene.json").write_text(json.dumps(described))
    assert gs2e.split(home) == "train"


def turn_z(degrees):
    half = np.radians(degrees) / 2
    return [0.0, 0.0, np.sin(half), np.cos(half)]


def planted_poses(folder):
    base = plant(folder)

    def scene_of(rows):
        (base / "poses.txt").write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows))
        return gs2e.Scene(folder)

    def turned(scene, t_us):
        m = scene.pose(t_us)
        return np.degrees(np.arctan2(m[1, 0], m[0, 0]))

    # From 10 to 100 degrees about z: the turn is linear in time, and so is the centre.
    row = lambda t, degrees, centre=(0.0, 0.0, 0.0): [t, *centre, *(float(v) for v in turn_z(degrees))]
    scene = scene_of([row(0, 10), row(900, 100, (9.0, 0.0, -18.0))])
    for t_us in (0, 1, 300, 450, 899, 900):
        assert abs(turned(scene, t_us) - (10 + t_us / 10)) < 1e-12
        assert np.abs(scene.pose(t_us)[:3, 3] - [t_us / 100, 0, -t_us / 50]).max() < 1e-13
    # The same rotations written with the other sign go the same way, not the long one around.
    flipped = row(900, 100)
    flipped[4:] = [-v for v in flipped[4:]]
    assert abs(turned(scene_of([row(0, 10), flipped]), 300) - 40) < 1e-12
    # Rotations closer than a cosine can tell, and none at all.
    for tiny in (1e-5, 1e-7, 1e-11, 0.0):
        assert abs(turned(scene_of([row(0, 0), row(1000, tiny)]), 250) - tiny / 4) < 1e-16
    # Several poses: the neighbours decide.
    scene = scene_of([row(0, 0), row(100, 10), row(1000, 20)])
    assert np.allclose([turned(scene, t) for t in (50, 100, 550)], [5, 10, 15], atol=1e-12)
    assert abs(turned(scene_of([row(0, 30)]), 0) - 30) < 1e-12


def planted_events(folder):
    base = plant(folder)
    (base / "poses.txt").write_text("0 0 0 0 0 0 0 1\n1000 0 0 0 0 0 0 1\n")
    rows = [(250, 1, 0, 1), (375, 2, 1, 0), (375, 2, 1, 0), (1999, 3, 2, 1)]

    def scene_of(rows, offset):
        stamps = [t for t, *_ in rows]
        index = [sum(t < 1000 * k for t in stamps) for k in range(max(stamps, default=1000) // 1000 + 2)]
        with h5py.File(base / "events.h5", "w") as file:
            for i, (name, kind) in enumerate([("t", "u4"), ("x", "u2"), ("y", "u2"), ("p", "u1")]):
                file[f"events/{name}"] = np.array([row[i] for row in rows], kind)
            file["ms_to_idx"] = np.array(index, "u8")
            file["t_offset"] = np.int64(offset)
        return gs2e.Scene(folder)

    # 5 bins over [0, 1000): an event at 250 is at bin 1, one at 375 halfway between bins 1 and 2.
    wanted = np.zeros((5, 3, 4))
    wanted[1, 0, 1], wanted[1, 1, 2], wanted[2, 1, 2] = 1, -1, -1
    for offset in (0, 7_000_000_123, -5000):
        scene = scene_of(rows, offset)
        assert np.array_equal(scene.voxel(offset, offset + 1000, 5), wanted)
        for t0, t1, count in [(0, 1000, 3), (250, 375, 1), (251, 376, 2), (376, 2000, 1), (1999, 2000, 1), (2000, 9000, 0)]:
            found = scene.events(offset + t0, offset + t1)
            assert found.t.tolist() == [offset + t for t, *_ in rows if t0 <= t < t1] and len(found.t) == count
        scene.close()
    # An empty stream has an index of zeros.
    scene = scene_of([], 0)
    assert [len(column) for column in scene.events()[:4]] == [0] * 4
    assert len(scene.events(0, 5000).t) == 0 and not scene.voxel(0, 5000, 3).any()
    assert not scene.event_frame(0, 5000).any() and scene.frames == []


def planted_pictures(folder):
    """Rows under each of PNG's five filters, by its definition, byte by byte."""
    base = plant(folder)
    (base / "poses.txt").write_text("0 0 0 0 0 0 0 1\n")
    image = np.random.default_rng(2).integers(0, 256, (11, 7, 3), dtype=np.uint8)
    raw = b""
    for r, row in enumerate(image):
        kind = r % 5
        raw += bytes([kind])
        above = image[r - 1].ravel() if r else np.zeros(21, np.uint8)
        for i, value in enumerate(row.ravel()):
            left = int(row.ravel()[i - 3]) if i >= 3 else 0
            up, corner = int(above[i]), int(above[i - 3]) if i >= 3 else 0
            nearest = min((abs(left + up - corner - v), order, v) for order, v in enumerate((left, up, corner)))[2]
            guess = (0, left, up, (left + up) // 2, nearest)[kind]
            raw += bytes([(int(value) - guess) % 256])
    chunk = lambda name, body: struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    head = struct.pack(">IIBBBBB", 7, 11, 8, 2, 0, 0, 0)
    packed = zlib.compress(raw)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", packed[:50]) + chunk(b"IDAT", packed[50:]) + chunk(b"IEND", b"")
    (base / "sharp").mkdir(exist_ok=True)
    (base / "sharp" / "000000.png").write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    (frame,) = gs2e.Scene(folder).frames
    assert (frame.index, frame.t_us) == (0, 0)
    assert np.array_equal(frame.read(), image) and frame.read().dtype == np.uint8
    for decoder in installed_decoders():
        found = gs2e.read_png(frame.path, decoder)
        assert np.array_equal(found, image) and found.dtype == np.uint8 and found.flags.writeable, decoder
    wide = (base / "wide.png")
    wide.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 7, 11, 16, 0, 0, 0, 0)))
    refused(lambda: gs2e.read_png(wide), "8-bit RGB")


def installed_decoders():
    """The decoder of the loader, and those of other packages that are installed."""
    from importlib.util import find_spec

    return ["numpy", *(name for name, module in [("pillow", "PIL"), ("opencv", "cv2")] if find_spec(module))]


def pictures(folder, decoded):
    frames = gs2e.Scene(folder).frames
    assert len(frames) == 6
    for frame in frames:
        found = frame.read()
        wanted = np.fromfile(f"{decoded}/{frame.index:06d}.raw", np.uint8).reshape(found.shape)
        assert np.array_equal(found, wanted) and wanted.any()
        for decoder in installed_decoders():
            assert np.array_equal(gs2e.read_png(frame.path, decoder), wanted), decoder


def exposures(folder):
    scene = gs2e.Scene(folder)
    assert [(frame.index, frame.t_us, frame.t0_us, frame.t1_us) for frame in scene.blurred] == [(8, 3333, 208, 6458)]
    assert scene.blurred[0].read().shape == (scene.height, scene.width, 3)
    for j in (0, 12):
        depth, flow = scene.depth(j), scene.flow(j)
        assert depth.shape == (scene.height, scene.width) and depth.dtype == np.float32
        assert flow.shape == (scene.height, scene.width, 2) and flow.dtype == np.float32
        assert np.array_equal(np.isnan(depth), np.isnan(flow).any(-1)) and np.nanmin(depth) > 0


def sensors(folder):
    assert gs2e.trajectories(folder) == ["base"] and gs2e.split(folder) is None
    for name in ("fine", "usual"):
        scene = gs2e.Scene(folder, sensor=name)
        whole = columns(f"{folder}/base/events/{name}.h5")
        assert ("label" in whole) == (name == "usual")
        same_windows(scene, whole, 20)
        same_windows(pickle.loads(pickle.dumps(scene)), whole, 20)
    refused(lambda: gs2e.Scene(folder), "sensors fine, usual")
    refused(lambda: gs2e.Scene(folder, "base", "coarse"), "asked for is coarse")
    refused(lambda: gs2e.Scene(folder, "slow", "fine"), "trajectories base")


def light(folder):
    scene = gs2e.Scene(folder)
    # Written again: a square wave at 250 Hz from its middle, and a stop per 2 ms from 1 ms on.
    wanted = {0: 0.7, 1_000: 0.7, 1_999: 0.7 * 2**0.4995, 2_000: 1.3 * 2**0.5, 3_000: 2.6, 5_000: 1.4}
    found = scene.light(list(wanted))
    assert np.allclose(found, list(wanted.values()), rtol=1e-12), found
    assert scene.light(2_000).shape == ()


def inertial(folder):
    times, rates, forces = gs2e.Scene(folder).imu()
    assert times.dtype == np.int64 and list(times[:3]) == [0, 1_000_000, 2_000_000]
    with open(f"{folder}/imu/imu.csv", encoding="utf-8") as file:
        rows = [[float(value) for value in line.split(",")] for line in list(file)[1:]]
    assert np.array_equal(np.column_stack([times, rates, forces]), np.array(rows))


def lens(folder):
    model, k = gs2e.Scene(folder, "base").lens
    assert model == "opencv" and k.tolist() == [-0.28, 0.09, 0.001, -0.0015, -0.012, 0, 0, 0]


def rig(folder):
    assert gs2e.trajectories(folder) == ["base", "base/left", "base/right", "base/frames"]
    body = gs2e.Scene(folder, "base")
    assert list(body.cameras) == ["left", "right", "frames"] and body.body is None
    assert body.cameras["left"].lens is None and body.cameras["frames"].lens[0] == "fisheye"
    assert np.array_equal(body.camera_from_body, np.eye(4))
    for name, camera in body.cameras.items():
        again = pickle.loads(pickle.dumps(camera))
        assert repr(again) == repr(gs2e.Scene(f"{folder}/base/{name}")) == repr(gs2e.Scene(folder, "base/" + name))
        assert camera.body.trajectory == "base" and camera.cameras == {}
        assert np.array_equal(camera.stamps_us, body.stamps_us)
        # A point of the body in the camera: world from body, and world from camera.
        at = camera.pose(camera.stamps_us[3]) @ camera.camera_from_body
        assert np.allclose(at, body.pose(body.stamps_us[3]), atol=1e-12)
        assert all(np.array_equal(a, b) for a, b in zip(camera.imu(), body.imu()))
    left, frames = body.cameras["left"], body.cameras["frames"]
    assert (left.width, left.height, left.K[0, 2]) == (64, 48, 31) and (frames.width, frames.height) == (32, 24)
    assert frames.frames[0].read().shape == (24, 32, 3) and left.events().t.size > 0
    assert [d.index for d in left.disparities] == list(range(12)) and body.cameras["right"].disparities == []
    disparity, depth = left.disparity(2), left.depth(2)
    assert np.array_equal(np.isnan(disparity), np.isnan(depth)) and np.nanmin(disparity) > 0
    assert left.rectify_map().shape == left.remap().shape == (48, 64, 2)
    refused(lambda: body.rectify_map(), "no camera of a rig")
    (window,) = list(gs2e.Windows(left, 4_000, bins=2, targets=("disparity", "depth")))[:1]
    assert window["disparity"].shape == (48, 64) and window["disparity_t_us"] == window["depth_t_us"]
    root = os.path.dirname(folder)
    assert {row["trajectory"] for row in gs2e.Dataset(root).rows} == {"base/left", "base/right", "base/frames"}
    assert {row["trajectory"] for row in gs2e._manifest_rows(root)} == {"base/left", "base/right", "base/frames"}


def masks(folder):
    scene = gs2e.Scene(folder)
    for decoder in (*installed_decoders(), None):
        mask = gs2e.read_png(f"{folder}/segmentation/000003.png", decoder)
        assert mask.dtype == np.uint8 and mask.ndim == 2 and set(np.unique(mask)) == {0, 1}
        assert np.array_equal(mask, scene.segmentation(3))
    events = scene.events(0, scene.duration_us)
    objects = scene.event_objects(events)
    stamps = [mask.t_us for mask in scene.masks]
    masks = [np.pad(mask.read(), 1) for mask in scene.masks]
    assert len(masks) == len(scene.stamps_us) and {0, 1} == set(objects)
    for t, x, y, found in zip(events.t[::7], events.x[::7], events.y[::7], objects[::7]):
        # With two numbers, the largest of a pixel and its neighbours is that of both rules. At equal distance, either.
        gap = min(abs(int(t) - stamp) for stamp in stamps)
        near = [mask[y : y + 3, x : x + 3].max() for mask, s in zip(masks, stamps) if abs(int(t) - s) == gap]
        assert found in near
    (name, (number, stamps, poses)), = scene.object_poses().items()
    assert (name, number) == ("bowl", 1) and np.array_equal(stamps, scene.stamps_us)
    assert np.allclose(poses[0], np.eye(4), atol=1e-12)
    # It turns by 90 degrees a second about an axis that the last pose leaves alone.
    turn = poses[-1][:3, :3]
    assert np.allclose(turn @ [0, -1, 0], [0, -1, 0]) and abs(np.linalg.det(turn) - 1) < 1e-9
    assert abs(np.degrees(np.arccos((np.trace(turn) - 1) / 2)) - 90e-6 * stamps[-1]) < 1e-6


if __name__ == "__main__":
    globals()[sys.argv[1]](*sys.argv[2:])
