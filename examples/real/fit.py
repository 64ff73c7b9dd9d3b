"""Searches a sensor of `voltmeter` that resembles a recording, and writes it as a sensor file.

    fit.py RECORDING FRAMES --start-us 46766 --out sensor.yaml [--to 1.5] [--tries 300] [--order 1]

FRAMES is a folder of rendered frames, one per millisecond, such as built/real/base/base/sharp, or a .npy [N,H,W]
(float, white is 1). The search looks at the recording before `--to` only; judge the sensor on the rest.

A plain pixel in numpy stands for the sensor during the search: a low-pass filter of ln(L + offset) whose cutoff is a
power of the light, two thresholds, and a dead time, at steps of 2 ms. It has no noise. Each try varies the best
parameters so far, and is kept if it is better: the score is NCC of the signed windows + r, less 0.3 times the
logarithm of the ratio of the rates and 1 times the difference of the ON shares beyond 0.02.
"""

import argparse
from pathlib import Path

import numpy as np

from compare import WINDOW_US, Judge, ncc

STEP_MS = 2
DIM, BRIGHT = 4.0, 120.0  # greys at which the cutoff is stated
#          first value, lowest, highest, size of a change (all in logarithms of e)
SPACE = {
    "offset": (3.6, 0.3, 60.0, 0.4),  # grey
    "on": (0.72, 0.08, 1.5, 0.15),
    "off": (0.51, 0.08, 1.5, 0.15),
    "dim_hz": (80.0, 2.0, 800.0, 0.4),
    "bright_hz": (120.0, 2.0, 800.0, 0.4),
    "dead_us": (700.0, 50.0, 60000.0, 0.6),
    "early_ms": (6.0, 0.5, 14.0, 0.2),  # the simulation starts this much before --start-us
}


def greys(path):
    """Frames as greys [N, H*W], every STEP_MS."""
    if path.suffix == ".npy":
        frames = np.load(path, mmap_mode="r")[::STEP_MS] * np.float32(255)
        return np.maximum(frames, 0).reshape(len(frames), -1).astype(np.float32)
    from PIL import Image

    files = sorted(path.glob("*.png"))[::STEP_MS]
    return np.stack([np.asarray(Image.open(file).convert("L"), np.float32).ravel() for file in files])


def pixels(frames, p, order):
    """Events of each step and pixel: signed sums and numbers, both int8 [N, H*W]."""
    signed = np.zeros(frames.shape, np.int8)
    number = np.zeros(frames.shape, np.int8)
    slope = np.log(p["bright_hz"] / p["dim_hz"]) / np.log(BRIGHT / DIM)
    on, off, dead_ms = np.float32(p["on"]), np.float32(p["off"]), p["dead_us"] * 1e-3
    stages = [np.log(frames[0] + np.float32(p["offset"])) for _ in range(order)]
    reference, last = stages[-1].copy(), np.full(frames.shape[1], -1e9, np.float32)
    before = stages[0]
    for k in range(1, len(frames)):
        light = np.clip(frames[k], DIM, BRIGHT) / np.float32(DIM)
        follow = -np.expm1(np.float32(-2 * np.pi * STEP_MS * 1e-3 * p["dim_hz"]) * light ** np.float32(slope))
        after = np.log(frames[k] + np.float32(p["offset"]))
        drive = (before + after) / 2
        before = after
        for i in range(order):
            stages[i] = stages[i] + follow * (drive - stages[i])
            drive = stages[i]
        change = drive - reference
        up, down = np.floor(change / on), np.floor(-change / off)
        n = np.maximum(up, 0) - np.maximum(down, 0)
        reference += np.where(n > 0, n * on, n * off)
        hit = np.flatnonzero(n)
        # Events within the dead time are dropped, and the reference moves on without them.
        room = np.maximum(np.floor((k * STEP_MS - last[hit]) / dead_ms), 0)
        kept = np.minimum(np.abs(n[hit]), np.minimum(room, 100))
        last[hit[kept > 0]] = k * STEP_MS
        signed[k, hit], number[k, hit] = np.sign(n[hit]) * kept, kept
    return signed, number


class Search:
    """Score of parameters on the first part of a recording."""

    def __init__(self, judge, frames, start_us):
        self.judge, self.start = judge, start_us
        self.frames = frames[: int((judge.last - start_us) / 1000 / STEP_MS)]

    def clock(self, early_ms):
        """Time of each step on the recording's clock, and the share of it that counts."""
        start = self.start - early_ms * 1000
        fine = start + np.arange(len(self.frames) * STEP_MS * 10) * 100 - STEP_MS * 1000 + 50
        inside = (fine >= self.judge.first) & (fine < self.judge.last) & self.judge.away(fine)
        time = start + (np.arange(len(self.frames)) - 0.5) * STEP_MS * 1000
        return time, inside.reshape(len(self.frames), -1).mean(axis=1)

    def figures(self, signed, number, early_ms):
        j, images = self.judge, []
        time, weight = self.clock(early_ms)
        for start in j.starts:
            k = np.flatnonzero((time >= start) & (time < start + WINDOW_US))
            images.append(np.tensordot(weight[k], signed[k].astype(np.float32), 1))
        images = j.smooth[0] @ np.reshape(images, (-1, j.height, j.width)) @ j.smooth[1].T
        counts = weight @ number
        balance = weight @ signed
        share, on = counts.sum() / j.counts.sum(), (1 + balance.sum() / max(counts.sum(), 1)) / 2
        return dict(NCC=ncc(j.windows, images).mean(), r=np.corrcoef(counts, j.counts)[0, 1], share=share, ON=on)

    def score(self, p, order):
        f = self.figures(*pixels(self.frames, p, order), p["early_ms"])
        apart = abs(f["ON"] - (self.judge.events[3] > 0).mean())
        return f["NCC"] + f["r"] - 0.3 * abs(np.log(max(f["share"], 1e-3))) - max(apart - 0.02, 0), f


def sensor_file(p, order):
    return f"""# The simulation's 0 is {p["early_ms"]:.1f} ms before --start-us.
sensor:
  voltmeter:
    k: [1, {p["offset"]:.2f}, 0, 0, 0, 0]
    units: {{ time: s, brightness: 255 }}
    law: exact
    contrast: [{p["on"]:.3f}, {p["off"]:.3f}]
    refractory: {{ period_us: {p["dead_us"]:.0f} }}
    front_end: {{ lux: 255 }}
    bandwidth:
      {{ order: {order}, points: [{{ lux: {DIM:g}, cutoff_hz: {p["dim_hz"]:.1f} }}, {{ lux: {BRIGHT:g}, cutoff_hz: {p["bright_hz"]:.1f} }}] }}
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("frames", type=Path)
    parser.add_argument("--start-us", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--from", dest="first", type=float, default=0.047)
    parser.add_argument("--to", dest="last", type=float, default=1.5)
    parser.add_argument("--tries", type=int, default=300)
    parser.add_argument("--order", type=int, default=1)
    parser.add_argument("--fix", nargs="*", default=[], help="NAME=VALUE: keeps a parameter")
    arguments = parser.parse_args()
    judge = Judge(arguments.recording, arguments.first, arguments.last)
    search = Search(judge, greys(arguments.frames), arguments.start_us)
    fixed = {name: float(value) for name, value in (item.split("=") for item in arguments.fix)}
    best = {name: fixed.get(name, first) for name, (first, *_) in SPACE.items()}
    score, figures = search.score(best, arguments.order)
    draw = np.random.default_rng(0)
    for k in range(arguments.tries):
        size, p = 0.15 + 0.85 * (1 - k / arguments.tries), dict(best)
        for name in draw.permutation([n for n in SPACE if n not in fixed])[: draw.integers(1, 4)]:
            _, low, high, change = SPACE[name]
            p[name] = float(np.clip(p[name] * np.exp(draw.normal(0, change * size)), low, high))
        new, found = search.score(p, arguments.order)
        if new > score:
            best, score, figures = p, new, found
            print(k, f"score {score:.4f}", {n: round(float(v), 3) for n, v in {**figures, **best}.items()}, flush=True)
            arguments.out.write_text(sensor_file(best, arguments.order))


if __name__ == "__main__":
    main()
