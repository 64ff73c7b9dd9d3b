"""Judges networks of train.py by the frames of recordings.

    python evaluate.py RECORDING... --network A.pt B.pt [--skip 5] [--pictures DIR]

    python evaluate.py ../../../shared/data/real/slider_depth@8000 ../../../shared/data/real/davis346_ics --network a.pt

Prints SSIM and MSE, means over the frames after the first `--skip`, in two ways: `equalised` equalises the histograms
of the picture and of the frame first, as the authors of E2VID do; `stretched` brings the 1st and 99th percentile of
each to 0 and 1. `flat` is a picture of 0.5, and `sums` a leaky sum of the events with their signs (time constant
100 ms): what needs no training. `moving` counts only the tenth of each picture where the most events are.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from network import Network, ssim
from recordings import equalised, opened, padded, stretched


def main():
    arguments = parsed()
    torch.set_num_threads(1)
    makers = {"flat": flat, "sums": leaky_sums} | {Path(path).stem: trained(path) for path in arguments.network}
    for place in arguments.recordings:
        for recording in opened(place):
            print(f"{recording.name}: {len(recording)} frames, {recording.width}x{recording.height}")
            print(f"  {'':16}{'equalised: SSIM':>16}{'MSE':>9}{'stretched: SSIM':>18}{'MSE':>9}{'moving: MSE':>14}")
            for name, maker in makers.items():
                figures = judged(recording, maker, arguments.skip, arguments.pictures, name)
                columns = "".join(f"{value:{width}.4f}" for value, width in zip(figures, (16, 9, 18, 9, 14)))
                print(f"  {name:16}{columns}", flush=True)


def judged(recording, maker, skip, pictures, name):
    rows = []
    for k, made in enumerate(maker(recording)):
        if k < skip:
            continue
        row, frame = [], recording.frames[k + 1]
        for brought in (equalised, stretched):
            a, b = (torch.from_numpy(brought(v)) for v in (made, frame))
            row += [float(ssim(a[None], b[None])), float(((a - b) ** 2).mean())]
        # The last of the two is stretched.
        row.append(float(((a - b) ** 2)[torch.from_numpy(moving(recording, k))].mean()))
        rows.append(row)
        if pictures and k % 10 == 0:
            path = Path(pictures) / f"{recording.name}_{name}_{k:04}.pgm".replace("/", "_")
            save(path, np.hstack([equalised(made), equalised(frame)]))
    return np.mean(rows, axis=0)


def moving(recording, k):
    """The tenth of the pixels with the most events between the frames."""
    part = slice(recording.edges[k], recording.edges[k + 1])
    pixel = recording.y[part] * recording.width + recording.x[part]
    counts = np.bincount(pixel, minlength=recording.height * recording.width)
    return (counts >= max(1, np.quantile(counts, 0.9))).reshape(recording.height, recording.width)


def flat(recording):
    for _ in range(len(recording)):
        yield np.full((recording.height, recording.width), 0.5, np.float32)


def leaky_sums(recording):
    total = np.zeros(recording.height * recording.width)
    for k in range(len(recording)):
        part = slice(recording.edges[k], recording.edges[k + 1])
        pixel = recording.y[part] * recording.width + recording.x[part]
        total *= np.exp(-(recording.stamps_us[k + 1] - recording.stamps_us[k]) / 1e5)
        total += np.bincount(pixel, recording.sign[part], len(total))
        yield stretched(total.reshape(recording.height, recording.width).astype(np.float32))


def trained(path):
    network = Network()
    network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True)["weights"])
    network.eval()

    @torch.no_grad()
    def make(recording):
        states = (None, None)
        for k in range(len(recording)):
            made, states = network(torch.from_numpy(padded(recording.voxels(k)))[None], states)
            yield made[0, :recording.height, :recording.width].numpy()
    return make


def save(path, picture):
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = picture.shape
    path.write_bytes(b"P5 %d %d 255\n" % (width, height) + np.rint(255 * picture).astype(np.uint8).tobytes())


def parsed():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--network", nargs="*", default=[])
    parser.add_argument("--skip", type=int, default=5)
    parser.add_argument("--pictures")
    return parser.parse_args()


if __name__ == "__main__":
    main()
