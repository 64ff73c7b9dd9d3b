"""Events of the same frames by the programs of other authors, for compare.py.

    peers.py CLONE SETTING FRAMES --out EVENTS.npz [--fps 1000]

CLONE is a clone of github.com/Lynn0306/DVS-Voltmeter (needs torch, easydict) or of github.com/SensorsINI/v2e (needs
torch, opencv, numba, h5py, screeninfo, easygui, engineering-notation, dv-processing). SETTING is one of theirs:
`DVS240` and `DVS346`, or `clean` (thresholds 0.6 and 0.4, spread 0.05, 150 Hz) and `noisy` (v2e's own). FRAMES is a
folder of pictures, named in order.
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

SETTINGS = {
    "clean": dict(pos_thres=0.6, neg_thres=0.4, sigma_thres=0.05, cutoff_hz=150, leak_rate_hz=0, shot_noise_rate_hz=0),
    "noisy": dict(pos_thres=0.2, neg_thres=0.2, sigma_thres=0.05, cutoff_hz=30, leak_rate_hz=0.1, shot_noise_rate_hz=5,
                  refractory_period_s=0.0005),
}


# k1 to k6 of the configuration of DVS-Voltmeter.
CONSTANTS = {
    "DVS240": [0.000094 * 47065, 23, 0.0002, 1e-7, 5e-8, 0.00001],
    "DVS346": [0.00018 * 29250, 20, 0.0001, 1e-7, 5e-9, 0.00001],
}


def voltmeter(setting):
    """The simulator of DVS-Voltmeter, with its constants of a camera."""
    from easydict import EasyDict
    from src.simulator import EventSim

    cfg = EasyDict(SENSOR=EasyDict(K=CONSTANTS[setting]))
    simulator = EventSim(cfg=cfg, output_folder=".", video_name="events")
    return lambda picture, us: simulator.generate_events(picture, us)


def v2e(setting, picture):
    """The emulator of v2e. It counts in seconds."""
    from v2ecore.emulator import EventEmulator

    height, width = picture.shape
    emulator = EventEmulator(device="cpu", seed=1, output_width=width, output_height=height, **SETTINGS[setting])

    def events(picture, us):
        made = emulator.generate_events(picture, us * 1e-6)
        return None if made is None else made * [1e6, 1, 1, 1]

    return events


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clone")
    parser.add_argument("setting", choices=[*CONSTANTS, *SETTINGS])
    parser.add_argument("frames", type=Path)
    parser.add_argument("--out", required=True)
    parser.add_argument("--fps", type=float, default=1000)
    given = parser.parse_args()
    sys.path.insert(0, given.clone)
    paths = sorted(path for path in given.frames.iterdir() if path.suffix in (".png", ".jpg"))
    pictures = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths)
    first = cv2.imread(str(paths[0]), cv2.IMREAD_GRAYSCALE)
    simulate = v2e(given.setting, first) if given.setting in SETTINGS else voltmeter(given.setting)
    made = [simulate(picture, round(i * 1e6 / given.fps)) for i, picture in enumerate(pictures)]
    t, x, y, p = np.concatenate([np.asarray(part, float) for part in made if part is not None and len(part)]).T
    order = np.argsort(t, kind="stable")
    t, x, y, p = np.rint(t[order]), x[order], y[order], p[order] > 0
    np.savez(given.out, t=t.astype(np.int64), x=x.astype(np.uint16), y=y.astype(np.uint16), p=p.astype(np.uint8))
    print(f"{given.out}: {len(t)} events of {len(paths)} frames")


if __name__ == "__main__":
    main()
