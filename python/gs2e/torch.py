"""Windows of events as a dataset of torch. This module needs torch; `import gs2e` does not.

    from gs2e.torch import EventWindows

    windows = EventWindows("out", split="train", length_us=20_000, bins=5, targets=("frame", "flow"))
    loader = torch.utils.data.DataLoader(windows, batch_size=8, num_workers=2)
"""

from __future__ import annotations

import os
from typing import Any, Iterable

import numpy as np
import torch

from gs2e._open import open as _open
from gs2e._reader import Dataset, Events, Scene, Windows


class EventWindows(torch.utils.data.Dataset):
    """The windows of a release, of one trajectory, or of a `Scene` or `Dataset` that is open: a map-style dataset.

    The arguments are those of `gs2e.Windows`. Arrays become tensors; uint16 columns of the target "events" become
    int32, which all versions of torch have. Files are opened in the worker that reads them, so `num_workers` may be
    above 0.
    """

    def __init__(
        self,
        release: str | os.PathLike | Dataset | Scene,
        length_us: int,
        bins: int,
        stride_us: int | None = None,
        targets: Iterable[str] = (),
        split: str | None = None,
    ):
        source = release if isinstance(release, (Dataset, Scene)) else _open(release, split)
        if isinstance(source, Dataset):
            self._windows = source.windows(length_us, bins, stride_us, tuple(targets))
        elif isinstance(source, Scene):
            self._windows = Windows(source, length_us, bins, stride_us, tuple(targets))
        else:
            raise TypeError(f"{source!r} has no poses, so it has no windows; use EventFile.voxel")

    def __len__(self) -> int:
        return len(self._windows)

    def __getitem__(self, i: int) -> dict[str, Any]:
        return {name: _tensor(value) for name, value in self._windows[i].items()}


def _tensor(value: Any) -> Any:
    if isinstance(value, Events):
        return Events(*(_tensor(column) for column in value))
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype == np.uint16:
        value = value.astype(np.int32)
    return torch.from_numpy(np.ascontiguousarray(value))
