"""Simulation of event sensors on frames in memory."""

from __future__ import annotations

import json
import os
from typing import Any, Iterable, Literal, Mapping, NamedTuple, Union

import numpy as np
import numpy.typing as npt

from gs2e import _native
from gs2e._reader import Events

Between = Literal["linear", "catmull", "hermite"]


class Sensor:
    """An event sensor with all its parameters.

    `sensor` is the name of a preset (`Sensor.NAMES`), a dictionary with the content of a recipe's key `sensor`, or the
    path of a YAML file: a recipe, or that content alone. `name` chooses one of the `sensors` of a recipe. `threshold`
    is the change of ln(brightness) that makes an event: one number, or those of ON and OFF.

    >>> Sensor("v2e-noisy", threshold=0.25)
    <Sensor v2e, contrast 0.25, 0.25>
    >>> Sensor({"esim": {"threshold": {"on": 0.3, "off": 0.2}}}).contrast
    (0.3, 0.2)
    >>> Sensor({"esim": {"treshold": {}}})
    Traceback (most recent call last):
        ...
    gs2e.RecipeError: sensor:1:11: unknown field "treshold"
    """

    NAMES = tuple(_native.Sensor.names())
    """The names of presets."""

    def __init__(
        self,
        sensor: SensorLike = "davis346",
        *,
        name: str | None = None,
        threshold: float | tuple[float, float] | None = None,
        between: Between | None = None,
        labels: bool = False,
        allow_cap: bool = False,
    ):
        native = _native_sensor(sensor, name)
        if threshold is not None:
            on, off = threshold if isinstance(threshold, (tuple, list)) else (threshold, threshold)
            native = native.with_contrast(on, off)
        if between is not None:
            native = native.with_between(between)
        self._native = native.switched(labels, allow_cap)

    @property
    def model(self) -> str:
        """The name of the model: voltmeter, esim or v2e."""
        return self._native.model

    @property
    def contrast(self) -> tuple[float, float]:
        """Changes of ln(brightness) that make one ON and one OFF event."""
        return self._native.contrast

    @property
    def between(self) -> str:
        """The interpolation of brightness between frames."""
        return self._native.between

    @property
    def labels(self) -> bool:
        """True if events are labelled as signal or noise."""
        return self._native.labels

    @property
    def parameters(self) -> dict[str, Any]:
        """All parameters, as `gs2e simulate --json` prints them."""
        return json.loads(self._native.to_json())

    def __repr__(self) -> str:
        on, off = self.contrast
        return f"<Sensor {self.model}, contrast {on:.4g}, {off:.4g}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sensor) and self._native == other._native

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self):
        return _sensor_from_json, (self._native.to_json(),)


SensorLike = Union["Sensor", str, os.PathLike, Mapping[str, Any]]


def _sensor_from_json(text: str) -> Sensor:
    sensor = Sensor.__new__(Sensor)
    sensor._native = _native.Sensor.from_json(text)
    return sensor


def _native_sensor(sensor: Any, name: str | None) -> _native.Sensor:
    if isinstance(sensor, Sensor):
        return sensor._native
    if isinstance(sensor, Mapping):
        # JSON is YAML, so a dictionary is read as the text of a recipe is.
        return _native.Sensor.from_text(json.dumps(sensor), "sensor")
    if not isinstance(sensor, (str, os.PathLike)):
        kind = type(sensor).__name__
        raise TypeError(f"sensor is a {kind}, wanted a Sensor, the name of a preset, a dict, or a path")
    path = os.fspath(sensor)
    # As on the command line: a file hides a preset of the same name.
    if not os.path.isfile(path):
        preset = _native.Sensor.by_name(path)
        if preset is not None:
            return preset
        file, colon, after = path.rpartition(":")
        if not (colon and name is None and os.path.isfile(file)):
            raise FileNotFoundError(f"{path} is neither a file nor a preset: {', '.join(Sensor.NAMES)}")
        path, name = file, after
    return _native.Sensor.from_file(path, name)


class _Request(NamedTuple):
    """The arguments of a simulation; the fields are read by name."""

    stamps_us: np.ndarray
    rates: Any
    sensor: Any
    seed: int
    full_scale: int | None
    origin: tuple[int, int]
    threads: int | None


def _request(stamps_us, sensor, seed, between, rates, full_scale, origin, labels, allow_cap, threads) -> _Request:
    stamps = np.asarray(stamps_us)
    if stamps.ndim != 1 or stamps.dtype.kind not in "iu":
        raise TypeError(f"stamps_us is {stamps.dtype} of shape {stamps.shape}, wanted integers [N], in microseconds")
    if stamps.dtype == np.uint64 and len(stamps) and stamps.max() > np.iinfo(np.int64).max:
        raise ValueError("stamps_us exceeds 64 bits with a sign")
    if threads is not None and threads < 1:
        raise ValueError(f"threads is {threads}, wanted 1 or more")
    chosen = Sensor(sensor, between=between, labels=labels, allow_cap=allow_cap)
    stamps = np.ascontiguousarray(stamps, np.int64)
    return _Request(stamps, rates, chosen._native, seed, full_scale, tuple(origin), threads)


def simulate(
    frames: npt.NDArray | Iterable[npt.NDArray],
    stamps_us: npt.ArrayLike,
    sensor: SensorLike = "davis346",
    *,
    seed: int = 0,
    between: Between | None = None,
    rates: npt.NDArray | Iterable[npt.NDArray] | None = None,
    full_scale: int | None = None,
    origin: tuple[int, int] = (0, 0),
    labels: bool = False,
    allow_cap: bool = False,
    threads: int | None = None,
) -> Events:
    """Simulates a sensor on frames, and returns its events, sorted by time.

    The events are those of `gs2e simulate` on the same frames, bit for bit, whatever the number of threads.

    `frames` is an array [N, H, W], or an iterable of arrays [H, W]; two of them are in memory at a time. The samples
    are uint8, grey from 0 to 255, or float32; white is 1 or 255 in floats, which the first two frames decide unless
    `full_scale` states it. Arrays may have any strides. `stamps_us` has one integer for each frame, in microseconds,
    strictly increasing, at least two.

    `between` is the interpolation of brightness between frames; "hermite" needs `rates`, the change of luminance per
    second on the scale of the frames, as float32 arrays in the form of `frames`. `origin` is the position (x, y) of
    the frames' top-left pixel on the sensor. `labels` marks each event as signal or noise. `allow_cap` drops and
    counts events beyond the sensor's `max_events_per_pixel_frame`, instead of failing. `threads` is the number of
    threads; by default, one for each core.

    The lock of the interpreter is released while the sensor works, and Ctrl-C stops the simulation. An exception of
    the iterator passes through unchanged.
    """
    request = _request(
        stamps_us, sensor, seed, between, rates, full_scale, origin, labels, allow_cap, threads
    )
    columns, _ = _native.simulate(frames, request)
    return Events(*columns)


def simulate_to_file(
    out: str | os.PathLike,
    frames: npt.NDArray | Iterable[npt.NDArray],
    stamps_us: npt.ArrayLike,
    sensor: SensorLike = "davis346",
    *,
    seed: int = 0,
    between: Between | None = None,
    rates: npt.NDArray | Iterable[npt.NDArray] | None = None,
    full_scale: int | None = None,
    origin: tuple[int, int] = (0, 0),
    labels: bool = False,
    allow_cap: bool = False,
    threads: int | None = None,
    h5_filter: str = "gzip",
) -> dict[str, Any]:
    """Simulates a sensor on frames, writes its events to a file, and returns their counts.

    `out` is an .h5, .npz, .raw, .aedat4, .txt or .csv file with the same bytes as that of `gs2e simulate`. It appears
    when it is complete; nothing is left of it if the simulation fails. The events are never in memory as a whole.
    `h5_filter` is the compression of an .h5: gzip[:0-9], zstd[:1-19], lz4 or none. The other arguments are those of
    `simulate`.
    """
    request = _request(
        stamps_us, sensor, seed, between, rates, full_scale, origin, labels, allow_cap, threads
    )
    return json.loads(_native.simulate_to_file(os.fspath(out), h5_filter, frames, request))


def to_structured(events: Events) -> np.ndarray:
    """The events as one structured array with the fields t, x, y, p, as the library `tonic` expects them.

    >>> columns = [np.array([7]), np.array([3]), np.array([2]), np.array([1])]
    >>> to_structured(Events(*columns, None))["t"]
    array([7])
    """
    rows = np.empty(len(events.t), [("t", np.int64), ("x", np.uint16), ("y", np.uint16), ("p", np.uint8)])
    for name in rows.dtype.names:
        rows[name] = getattr(events, name)
    return rows
