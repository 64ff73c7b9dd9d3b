"""Says what separates a simulated stream from the recorded one.

    rest.py RECORDING SIMULATED.h5|.npz --start-us 46766 [--split 1.5] [--to 2.99]

All figures are those of compare.py, after `--split` and without a shift in time.

    noise       the recorded events are divided into two halves at random, by event. From the correlation c of the
                halves follows what a perfect, noiseless simulation would reach, if the numbers of events of a pixel
                were Poisson: sqrt(2 c / (1 + c)). The same with halves by pixel, as on a chessboard; there, detail of
                the scene that one half cannot see counts as noise too
    thinned     the recording against the recording without a random half of its events
    place       the best displacement of each tile of 60 x 60 px, and the NCC after it
    time        the best shift in time of each window, and the NCC after it
    pixels      the numbers of events of each pixel before `--split` say how sensitive it is; the simulated counts after
                it are multiplied by that
"""

import argparse
from pathlib import Path

import numpy as np

from compare import Judge, load, ncc

TILE = 60


def halves(judge, choose):
    """The recorded events in two parts: windows and counts of each."""
    first = choose(*judge.events)
    parts = [tuple(v[k] for v in judge.events) for k in (first, ~first)]
    return [judge.signed(*p) for p in parts], [judge.per_pixel(*p) for p in parts]


def limit(c):
    return np.sqrt(2 * c / (1 + c))


def noise(judge):
    draw = np.random.default_rng(0)
    windows, counts = halves(judge, lambda t, x, y, s: draw.random(len(t)) < 0.5)
    c, r = ncc(*windows).mean(), np.corrcoef(*counts)[0, 1]
    print(f"noise, by event: halves NCC {c:.3f}, r {r:.3f}; limits NCC {limit(c):.3f}, r {limit(r):.3f}")
    print(f"thinned to a half: NCC {ncc(judge.windows, windows[0]).mean():.3f}", end=", ")
    print(f"r {np.corrcoef(judge.counts, counts[0])[0, 1]:.3f}")
    windows, _ = halves(judge, lambda t, x, y, s: (x + y) % 2 == 0)
    c = ncc(*windows).mean()
    print(f"noise, by pixel: halves NCC {c:.3f}; limit NCC {limit(c):.3f}")


def place(judge, windows):
    """NCC after each tile has its best displacement, which is the same in all windows."""
    moved, found = np.empty_like(windows), []
    for y in range(0, judge.height, TILE):
        for x in range(0, judge.width, TILE):
            part = np.s_[:, y : y + TILE, x : x + TILE]
            score = {}
            for dy in (-2, -1, 0, 1, 2):
                for dx in (-3, -2, -1, 0, 1, 2, 3):
                    tile = np.roll(windows, (dy, dx), (1, 2))[part]
                    score[dy, dx] = ncc(judge.windows[part], tile).mean()
            dy, dx = max(score, key=score.get)
            moved[part] = np.roll(windows, (dy, dx), (1, 2))[part]
            found.append(((x, y), (dx, dy), round(float(score[0, 0]), 3), round(float(score[dy, dx]), 3)))
    print(f"place: NCC {ncc(judge.windows, moved).mean():.3f} with the best displacement of each tile (x, y; dx, dy):")
    for tile in found:
        print("   ", *tile)


def time(judge, stream):
    shifts = list(range(-8, 9, 2))
    score = np.array([judge.ncc(*stream, shift * 1000) for shift in shifts])
    best = np.array(shifts)[score.argmax(axis=0)]
    print(f"time: NCC {score.max(axis=0).mean():.3f} with the best shift of each window; {best.mean():+.1f} ms,", end=" ")
    print(f"standard deviation {best.std():.1f} ms; NCC of windows {np.round(score[shifts.index(0)], 2)}")


def pixels(judge, before, stream, prior=8.0):
    """r after a gain of each pixel that the first part gives; `prior` events at the mean gain are added."""
    ours_first, ours = before.per_pixel(*before.part(*stream)), judge.per_pixel(*judge.part(*stream))
    ratio = before.counts.sum() / ours_first.sum()
    gain = (before.counts + prior * ratio) / (ours_first + prior)
    r = np.corrcoef(judge.counts, ours)[0, 1], np.corrcoef(judge.counts, ours * gain)[0, 1]
    print(f"pixels: r {r[0]:.3f}, with a gain of each pixel {r[1]:.3f}; spread of ln gain {np.log(gain).std():.2f}")
    t, x, y, s = stream
    weighted = t, x, y, s * gain[y * judge.width + x]
    print(f"        NCC {judge.ncc(*stream).mean():.3f}, with the gains {judge.ncc(*weighted).mean():.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("simulated")
    parser.add_argument("--start-us", type=int, required=True)
    parser.add_argument("--from", dest="first", type=float, default=0.047)
    parser.add_argument("--split", type=float, default=1.5)
    parser.add_argument("--to", dest="last", type=float, default=2.99)
    arguments = parser.parse_args()
    before = Judge(arguments.recording, arguments.first, arguments.split)
    judge = Judge(arguments.recording, arguments.split, arguments.last)
    t, x, y, s = load(arguments.simulated)
    order = np.argsort(t, kind="stable")
    stream = t[order] + arguments.start_us, x[order], y[order], s[order]
    noise(judge)
    place(judge, judge.signed(*stream))
    time(judge, stream)
    pixels(judge, before, stream)


if __name__ == "__main__":
    main()
