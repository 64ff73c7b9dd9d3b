"""`gs2e.open`: whatever the program writes."""

from __future__ import annotations

import os

from gs2e._reader import Dataset, EventFile, Scene, open_events


def open(path: str | os.PathLike, split: str | None = None) -> Dataset | Scene | EventFile:
    """Opens a release, a trajectory in it, or a file of events.

    - A folder with manifest.json is a release: a `Dataset`, a sequence of `Scene` over all trajectories and sensors.
      `split` is the name of a split, or None for all.
    - A folder with scene.json, or the folder of a trajectory in it: a `Scene`. It needs to have one trajectory and
      one sensor; `Scene(folder, trajectory, sensor)` chooses from several.
    - A file: the `EventFile` of `gs2e simulate`, `gs2e convert`, or another in the layout of DSEC.
    """
    path = os.fspath(path)
    if os.path.exists(os.path.join(path, "manifest.json")):
        return Dataset(path, split)
    if split is not None:
        raise ValueError(f"{path} has no manifest.json, so it has no split {split!r}")
    if not os.path.isdir(path):
        return open_events(path)
    folders = (path, os.path.dirname(os.path.abspath(path)))
    if not any(os.path.exists(os.path.join(folder, "scene.json")) for folder in folders):
        raise FileNotFoundError(f"{path} has neither manifest.json nor scene.json: it is no release")
    return Scene(path)
