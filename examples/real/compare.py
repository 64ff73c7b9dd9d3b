"""Compares simulated events with the recorded ones of the same pixels.

    compare.py RECORDING SIMULATED.h5|.npz ... --start-us 46766 [--from 0.047] [--to 2.99] [--csv table.csv]

RECORDING is a folder with events.npz (t in us, x, y, p) and frames.npz, whose stamps_us tell where events are left out:
the read-out of frames leaks into the events of a DAVIS, so those from 0.8 ms before to 1.8 ms after a stamp do not
count, in any stream. `--start-us` is the time of the simulation's 0 on the recording's clock. `--from` and `--to`
select the part that is compared, in seconds of the recording's clock.

Columns:
    rate    events per pixel and second
    share   simulated over recorded events
    ON      share of ON events
    NCC     of signed windows: events of 20 ms summed with their signs per pixel, smoothed by a Gaussian of 1 px. The
            normalised cross-correlation with the recording's, mean over windows that begin every 50 ms, at the best
            shift in time
    at 0    the same without a shift
    shift   the best shift, ms: positive where the recording is later than the simulation
    r       correlation of the numbers of events per pixel
"""

import argparse
import csv
from pathlib import Path

import numpy as np

BEFORE_US, AFTER_US, WINDOW_US, STEP_US = 800, 1800, 20_000, 50_000


def load(path):
    """Times in us, x, y, and signs of the events of a file."""
    if str(path).endswith(".npz"):
        with np.load(path) as archive:
            t, x, y, p = (np.asarray(archive[key]).astype(np.int64) for key in "txyp")
    else:
        import h5py
        import hdf5plugin  # noqa: F401, registers the codec

        with h5py.File(path) as file:
            t, x, y, p = (file["events"][key][:].astype(np.int64) for key in "txyp")
            t = t + int(file["t_offset"][()])
    return t, x, y, np.where(p > 0, 1, -1)


def smoothing(n, sigma=1.0):
    """Matrix that smooths a vector of n values by a Gaussian, with mirrored ends."""
    radius = int(4 * sigma + 0.5)
    offsets = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (offsets / sigma) ** 2)
    matrix = np.zeros((n, n))
    for offset, weight in zip(offsets, weights / weights.sum()):
        j = np.arange(n) + offset
        j = np.where(j < 0, -j - 1, np.where(j >= n, 2 * n - 1 - j, j))
        np.add.at(matrix, (np.arange(n), j), weight)
    return matrix


def ncc(a, b):
    """Normalised cross-correlation of the last two axes."""
    a, b = (v - v.mean(axis=(-2, -1), keepdims=True) for v in (a, b))
    norm = np.sqrt((a * a).sum(axis=(-2, -1)) * (b * b).sum(axis=(-2, -1)))
    return (a * b).sum(axis=(-2, -1)) / np.maximum(norm, 1e-12)


class Judge:
    """The recorded side of the comparison, computed once for many simulated streams."""

    def __init__(self, folder, first_s, last_s):
        with np.load(Path(folder) / "frames.npz") as archive:
            self.stamps = np.sort(archive["stamps_us"])
            self.height, self.width = archive["frames"].shape[1:]
        self.first, self.last = first_s * 1e6, last_s * 1e6
        self.starts = np.arange(self.first + 50_000, self.last - WINDOW_US, STEP_US)
        self.smooth = smoothing(self.height), smoothing(self.width)
        masked = ((self.stamps >= self.first) & (self.stamps < self.last)).sum() * (BEFORE_US + AFTER_US)
        self.pixel_seconds = self.height * self.width * (self.last - self.first - masked) * 1e-6
        self.events = self.part(*load(Path(folder) / "events.npz"))
        self.windows, self.counts = self.signed(*self.events), self.per_pixel(*self.events)

    def away(self, t):
        """True for times that are away from the stamps of frames."""
        i = np.searchsorted(self.stamps, t, side="right")
        after = t - np.where(i > 0, self.stamps[np.maximum(i - 1, 0)], -(10**12))
        before = np.where(i < len(self.stamps), self.stamps[np.minimum(i, len(self.stamps) - 1)], 10**12) - t
        return (after >= AFTER_US) & (before > BEFORE_US)

    def part(self, t, x, y, s):
        """Events of the part that is compared, without those near the stamps of frames."""
        keep = (t >= self.first) & (t < self.last) & self.away(t)
        return t[keep], x[keep], y[keep], s[keep]

    def signed(self, t, x, y, s):
        """Smoothed sums of the signs in each window: [windows, height, width]. Events are in order of time."""
        images = np.zeros((len(self.starts), self.height * self.width))
        for k, start in enumerate(self.starts):
            i = slice(*np.searchsorted(t, (start, start + WINDOW_US)))
            weights = s[i] * self.away(t[i])
            images[k] = np.bincount(y[i] * self.width + x[i], weights, self.height * self.width)
        return self.smooth[0] @ images.reshape(-1, self.height, self.width) @ self.smooth[1].T

    def per_pixel(self, t, x, y, s):
        return np.bincount(y * self.width + x, minlength=self.width * self.height)

    def ncc(self, t, x, y, s, shift_us=0):
        """NCC of each window, with the simulated events moved by `shift_us`."""
        return ncc(self.windows, self.signed(t + shift_us, x, y, s))

    def row(self, t, x, y, s, shifts_ms=range(-15, 16)):
        """The columns for one simulated stream on the recording's clock."""
        order = np.argsort(t, kind="stable")
        t, x, y, s = t[order], x[order], y[order], s[order]
        score = {shift: self.ncc(t, x, y, s, shift * 1000).mean() for shift in shifts_ms}
        best = max(score, key=score.get)
        ours = self.part(t, x, y, s)
        return {
            "rate": len(ours[0]) / self.pixel_seconds,
            "share": len(ours[0]) / len(self.events[0]),
            "ON": (ours[3] > 0).mean(),
            "NCC": score[best],
            "at 0": score.get(0, np.nan),
            "shift": best,
            "r": np.corrcoef(self.counts, self.per_pixel(*ours))[0, 1],
        }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("simulated", nargs="+")
    parser.add_argument("--start-us", type=int, required=True)
    parser.add_argument("--from", dest="first", type=float, default=0.047)
    parser.add_argument("--to", dest="last", type=float, default=2.99)
    parser.add_argument("--csv")
    arguments = parser.parse_args()
    judge = Judge(arguments.recording, arguments.first, arguments.last)
    on = (judge.events[3] > 0).mean()
    print(f"recorded: {len(judge.events[0]) / judge.pixel_seconds:.2f} events per pixel and second, ON {on:.3f}")
    rows = []
    for path in arguments.simulated:
        t, x, y, s = load(path)
        rows.append({"stream": Path(path).stem, **judge.row(t + arguments.start_us, x, y, s)})
        print("  ".join(f"{k} {v:.3f}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()), flush=True)
    if arguments.csv:
        with open(arguments.csv, "w", newline="") as file:
            writer = csv.DictWriter(file, rows[0].keys())
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
