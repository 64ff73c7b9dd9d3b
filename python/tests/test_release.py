"""Releases through the module, compared with their own files."""

import pickle
import subprocess
import sys

import h5py
import numpy as np
import pytest

import gs2e


def whole(path):
    with h5py.File(path) as file:
        columns = {name: file["events"][name][:] for name in "txyp"}
        return {**columns, "t": columns["t"].astype(np.int64) + int(file["t_offset"][()])}


def test_a_release_is_a_sequence_of_scenes(release):
    dataset = gs2e.open(release)
    assert [(row["scene"], row["trajectory"]) for row in dataset.rows] == [("a/one", "base"), ("b/two", "base")]
    for row, scene in zip(dataset.rows, dataset):
        columns = whole(release / row["scene"] / "base" / "events.h5")
        for name in "txyp":
            assert np.array_equal(getattr(scene.events(), name), columns[name])
    assert isinstance(gs2e.open(release / "a/one"), gs2e.Scene)
    assert isinstance(gs2e.open(release / "a/one/base"), gs2e.Scene)
    assert isinstance(gs2e.open(release / "a/one/base/events.h5"), gs2e.EventFile)
    with pytest.raises(FileNotFoundError, match="neither manifest.json nor scene.json"):
        gs2e.open(release / "LICENSES")
    with pytest.raises(ValueError, match="has no split"):
        gs2e.open(release / "a/one", split="train")
    with pytest.raises(ValueError, match="gs2e convert"):
        gs2e.open_events(release / "gs2e.py")


def test_windows_are_in_whole_microseconds(release):
    scene = gs2e.open(release)[0]
    with pytest.raises(TypeError, match="whole number of microseconds"):
        scene.events(0.0, 0.1)
    with pytest.raises(ValueError, match="ends before it begins"):
        scene.events(2000, 1000)
    assert len(scene.events(10**12, 10**12 + 1000).t) == 0


def test_the_released_loader_is_the_module_s(release):
    with open(gs2e._reader.__file__) as ours:
        assert (release / "gs2e.py").read_text() == ours.read()


def test_windows_of_equal_counts(release):
    scene = gs2e.open(release / "a/one")
    columns = whole(release / "a/one/base/events.h5")
    windows = gs2e.CountWindows(scene, 100, bins=4, stride=60, targets=("events", "label", "frame", "flow"))
    assert len(windows) == (len(columns["t"]) - 100) // 60 + 1 > 3
    for i, entry in enumerate(windows):
        rows = slice(60 * i, 60 * i + 100)
        assert all(np.array_equal(getattr(entry["events"], name), columns[name][rows]) for name in "txyp")
        assert (entry["t0_us"], entry["t1_us"]) == (columns["t"][rows][0], columns["t"][rows][-1] + 1)
        # Every event has the weight 1 in all bins together.
        signs = np.where(columns["p"][rows] == 1, 1, -1).sum()
        assert entry["voxel"].sum(dtype=np.float64) == pytest.approx(signs, abs=1e-3)
        assert entry["label"].sum() == 100 and entry["pose"].shape == (4, 4)
        assert entry["frame"].shape == (36, 48, 3) and entry["flow"].shape == (36, 48, 2)
    with pytest.raises(IndexError):
        windows[len(windows)]


def test_a_bare_file_has_windows_without_poses(release):
    file = gs2e.open(release / "a/one/base/events.h5")
    t = whole(release / "a/one/base/events.h5")["t"]
    windows = gs2e.Windows(file, 1000, bins=2, targets=["events"])
    assert len(windows) == (t[-1] + 1 - t[0]) // 1000
    assert windows[0]["t0_us"] == t[0] and "pose" not in windows[0]
    assert sum(len(entry["events"].t) for entry in windows) == (t < windows[len(windows) - 1]["t1_us"]).sum()
    with pytest.raises(ValueError, match="has no frame"):
        gs2e.Windows(file, 1000, bins=2, targets=["frame"])


def test_time_surfaces_hold_the_last_events(release):
    scene = gs2e.open(release / "a/one")
    columns = whole(release / "a/one/base/events.h5")
    t0, t1 = int(columns["t"][0]), int(columns["t"][-1] * 2 // 3)
    wanted = np.zeros((2, 36, 48))
    for t, x, y, p in zip(*(columns[name] for name in "txyp")):
        if t0 <= t < t1:
            wanted[p, y, x] = np.exp((t - t1) / 3000)
    found = scene.time_surface(t0, t1, tau_us=3000)
    assert found.dtype == np.float32 and np.abs(found - wanted).max() < 1e-6 and found.max() > 0.5
    with pytest.raises(ValueError, match="tau_us"):
        scene.time_surface(t0, t1, 0)


def test_what_is_open_can_be_pickled(release):
    dataset = gs2e.open(release)
    first = dataset[0].events()
    for copy in (pickle.loads(pickle.dumps(dataset))[0], pickle.loads(pickle.dumps(dataset[0]))):
        assert np.array_equal(copy.events().t, first.t)


def test_the_module_does_not_import_torch():
    code = "import sys, gs2e; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_torch_loads_windows_in_workers(release):
    torch = pytest.importorskip("torch")
    from gs2e.torch import EventWindows

    windows = EventWindows(release, length_us=2000, bins=3, targets=("frame", "depth"))
    plain = gs2e.open(release).windows(2000, 3, targets=("frame", "depth"))
    assert len(windows) == len(plain)
    loader = torch.utils.data.DataLoader(windows, batch_size=2, num_workers=2)
    batches = list(loader)
    voxels = np.concatenate([batch["voxel"].numpy() for batch in batches])
    assert np.array_equal(voxels, np.stack([plain[i]["voxel"] for i in range(len(plain))]))


def test_torch_gets_batches_of_every_kind(release):
    torch = pytest.importorskip("torch")
    from gs2e.torch import EventWindows

    scene = gs2e.open(release / "a/one")
    windows = EventWindows(release / "a/one", length_us=2000, bins=3, targets=("frame", "flow", "label", "events"))
    entry, plain = windows[1], gs2e.Windows(scene, 2000, 3, targets=("frame", "flow", "label", "events"))[1]
    assert set(entry) == set(plain)
    kinds = {"voxel": torch.float32, "frame": torch.uint8, "flow": torch.float32, "label": torch.int32, "pose": torch.float64}
    for name, kind in kinds.items():
        assert entry[name].dtype == kind and np.array_equal(entry[name].numpy(), plain[name], equal_nan=True)
    assert entry["events"].x.dtype == torch.int32 and np.array_equal(entry["events"].x.numpy(), plain["events"].x)
    with pytest.raises(TypeError, match="has no poses"):
        EventWindows(release / "a/one/base/events.h5", length_us=2000, bins=3)


def test_the_program_keeps_its_exit_codes(program, tmp_path):
    assert program("--version").stdout.startswith("gs2e ")
    assert program("simulate").returncode == 2
    assert program("audit", tmp_path).returncode != 0
