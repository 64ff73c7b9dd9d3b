"""Event cameras from Gaussian splats: simulates sensors, and reads releases of the program `gs2e`.

>>> import gs2e, numpy as np
>>> frames = np.linspace(20, 200, 5, dtype=np.float32)[:, None, None] * np.ones((1, 4, 6), np.float32)
>>> events = gs2e.simulate(frames, np.arange(5) * 1000, sensor="esim", full_scale=255)
>>> len(events.t), events.t.dtype, sorted(set(events.p.tolist()))
(264, dtype('int64'), [1])
"""

from gs2e._errors import RecipeError
from gs2e._open import open
from gs2e._reader import (
    Array,
    Blurred,
    CountWindows,
    Dataset,
    EventFile,
    Events,
    Frame,
    Scene,
    Windows,
    open_events,
    read_png,
    split,
    trajectories,
)
from gs2e._recipe import read_recipes, write_recipe
from gs2e._simulate import Sensor, simulate, simulate_to_file, to_structured
from gs2e._splats import SplatScene
from gs2e._trajectory import Trajectory

__all__ = [
    "Array",
    "Blurred",
    "CountWindows",
    "Dataset",
    "EventFile",
    "Events",
    "Frame",
    "RecipeError",
    "Scene",
    "Sensor",
    "SplatScene",
    "Trajectory",
    "Windows",
    "open",
    "open_events",
    "read_png",
    "read_recipes",
    "simulate",
    "simulate_to_file",
    "split",
    "to_structured",
    "trajectories",
    "write_recipe",
]
