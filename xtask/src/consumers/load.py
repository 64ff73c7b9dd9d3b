"""Reads an export with the loader of the program that it is for: load.py FORMAT CLONE EXPORT.

The loader is imported from the clone, unchanged. Packages that its files import and its loader does
not use are replaced where they are absent.
"""

import importlib.util
import json
import sys
from pathlib import Path
from unittest.mock import MagicMock


def stub(*names):
    """Replaces absent packages, with the modules in them."""
    for name in names:
        package = name.split(".")[0]
        if package in sys.modules and isinstance(sys.modules[package], MagicMock):
            sys.modules[name] = MagicMock()
        elif importlib.util.find_spec(package) is None:
            sys.modules[package] = sys.modules[name] = MagicMock()


def e2vid(export):
    # For timers of CUDA.
    stub("torch")
    from utils.event_readers import FixedSizeEventReader

    windows = FixedSizeEventReader(str(export / "events.txt"), num_events=100_000)
    return {"events": sum(len(window) for window in windows)}


def e2vid_zip(export):
    stub("torch")
    from utils.event_readers import FixedSizeEventReader

    windows = FixedSizeEventReader(str(export / "events.zip"), num_events=100_000)
    return {"events": sum(len(window) for window in windows)}


def dsec(export):
    import h5py
    from scripts.utils.eventslicer import EventSlicer

    (path,) = export.glob("test/*/events_left/events.h5")
    with h5py.File(path) as file:
        slicer = EventSlicer(file)
        # The last millisecond of the index: later windows are None.
        end_us = slicer.get_start_time_us() + (len(slicer.ms_to_idx) - 1) * 1000
        events = slicer.get_events(slicer.get_start_time_us(), end_us)
        # An event at the very end is in no window.
        last = int((file["events/t"][:] >= end_us - slicer.get_start_time_us()).sum())
        return {"events": len(events["t"]) + last}


def evreal(export):
    stub("cv2")
    from dataset import MemMapDataset

    data = MemMapDataset(str(export))
    item = data[len(data) - 1]
    assert item["frame"].shape[1:] == item["events"].shape[1:], "frame and voxels differ in size"
    return {"events": data.num_events, "frames": data.num_frames}


def monash_h5(export):
    stub("matplotlib.pyplot", "matplotlib.patches", "torchvision.transforms", "skimage.measure", "cv2")
    from data_loader.dataset import DynamicH5Dataset

    (path,) = export.glob("*.h5")
    data = DynamicH5Dataset(str(path))
    data[len(data) - 1]
    # An item lies between two frames.
    return {"events": int(data.num_events), "frames": len(data) + 1}


def robust_e_nerf(export):
    # The packages themselves import the trainer.
    for name in ["robust_e_nerf", "robust_e_nerf.data", "robust_e_nerf.utils"]:
        package = type(sys)(name)
        package.__path__ = [str(Path(sys.path[0], *name.split(".")))]
        sys.modules[name] = package
    from robust_e_nerf.data.datasets import Event

    import numpy as np

    raw = len(np.load(export / "raw_events.npz")["timestamp"])
    pairs = len(Event(str(export), permutation_seed=None))
    assert 0 < pairs <= raw, f"{pairs} pairs of {raw} events"
    return {"events": raw}


def e2nerf(export):
    from load_blender import load_blender_data

    import torch

    pictures, poses, test_pictures, *_ = load_blender_data(str(export))
    counts = torch.load(export / "events.pt")
    assert poses.shape == (len(pictures), 5, 4, 4), f"poses of the shape {poses.shape}"
    assert counts.shape[:2] == (len(pictures), 4), f"counts of the shape {tuple(counts.shape)}"
    return {"views": len(pictures), "test_views": len(test_pictures)}


def main(format, clone, export):
    sys.path.insert(0, clone)
    found = globals()[format.replace("-", "_")](Path(export))
    description = json.loads((Path(export) / "export.json").read_text())
    stated = {**description["selection"], **description["facts"]}
    for name, number in found.items():
        print(f"{name}: {number}, export.json states {stated.get(name)}")
    wrong = [name for name, number in found.items() if stated.get(name) not in (None, number)]
    if wrong:
        sys.exit(f"the loader found other numbers of {', '.join(wrong)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
