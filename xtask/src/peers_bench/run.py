"""Calls the peers of `cargo xtask bench peers`. Prints numbers, or the reason why a peer is absent."""

import os
import pathlib
import sys
import time

for threads in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[threads] = "1"
import numpy as np


def frames(pictures, stamps, count, out_frames, out_stamps):
    """Grey frames of 8 bits, [N, H, W], with the weights that OpenCV uses, and their stamps in microseconds."""
    from PIL import Image

    names = sorted(os.listdir(pictures))[: int(count)]
    grey = [np.asarray(Image.open(os.path.join(pictures, name)).convert("L")) for name in names]
    np.save(out_frames, np.stack(grey))
    np.save(out_stamps, np.loadtxt(stamps, dtype=np.int64, ndmin=1)[: len(names)])


def count(path):
    with np.load(path) as file:
        print(file["t"].size)


def voltmeter(home):
    """The published program, through the class that its `main.py` calls."""
    if home:
        sys.path.insert(0, home)
    from src.config import cfg
    from src.simulator import EventSim

    def start(size):
        simulator = EventSim(cfg=cfg, output_folder=".", video_name="bench")
        return lambda frame, t_us: simulator.generate_events(frame, t_us)

    return start


def v2e(home, noisy):
    """The published program, through the class that its `v2e.py` calls, on the CPU, with its own presets."""
    if home:
        sys.path.insert(0, home)
    from v2ecore.emulator import EventEmulator

    preset = dict(sigma_thres=0.02, cutoff_hz=0, leak_rate_hz=0, shot_noise_rate_hz=0)
    if noisy:
        preset = dict(sigma_thres=0.05, cutoff_hz=30, leak_rate_hz=0.1, shot_noise_rate_hz=5)

    def start(size):
        height, width = size
        emulator = EventEmulator(
            pos_thres=0.2, neg_thres=0.2, seed=1, output_width=width, output_height=height, device="cpu", **preset
        )
        return lambda frame, t_us: emulator.generate_events(frame.astype(np.float32), t_us * 1e-6)

    return start


def simulate(peer, home, frames_path, stamps_path, runs):
    """Prints the least CPU time of the calls for all frames, s, and the number of events."""
    output, sys.stdout = sys.stdout, sys.stderr
    try:
        import torch

        torch.set_num_threads(1)
        start = voltmeter(home) if peer == "dvs-voltmeter" else v2e(home, peer.endswith("noisy"))
    except ImportError as reason:
        print(reason, file=output)
        return
    stack, stamps = np.load(frames_path), np.load(stamps_path)
    least, events = float("inf"), 0
    for _ in range(int(runs)):
        step = start(stack.shape[1:])
        begun = time.process_time()
        found = [step(frame, t_us) for frame, t_us in zip(stack, stamps.tolist())]
        least = min(least, time.process_time() - begun)
        events = sum(len(some) for some in found if some is not None)
    print(least, events, file=output)


def read_or_write(peer, source, target, codec):
    """A function that passes over all events of a file and returns their number, or writes them to another."""
    if peer == "faery":
        import faery

        table = dict(has_header=False, separator=b",", t_index=0, x_index=1, y_index=2, on_index=3)
        # The comment and the names at the head of a file are lines that it skips.
        rest = dict(t_scale=0.0, on_value=b"1", off_value=b"0", skip_errors=True)
        options = dict(csv_properties=faery.CsvProperties(**table, **rest)) if source.endswith(".csv") else {}
        version = codec if target.endswith(".raw") else None

        def stream():
            return faery.events_stream_from_file(source, **options)

        if target == "none":
            return lambda: sum(map(len, stream()))
        return lambda: stream().to_file(target, version=version)
    from evutils.io import EventReader, EventStreamer, EventWriter

    def write():
        with EventWriter(target) as writer:
            for chunk in EventReader(source, n_events=1_000_000):
                writer.write(chunk)

    return write if target != "none" else lambda: sum(map(len, EventStreamer(source)))


def events(peer, source, target, runs, codec="evt2"):
    """Prints the number of events, and the least CPU time of the calls, s."""
    if peer == "evutils" and codec == "evt2" and target != "none":
        # Its writer chooses EVT 3.0.
        print("not written")
        return
    try:
        run = read_or_write(peer, source, target, codec)
        least, count = float("inf"), 0
        for _ in range(int(runs)):
            # A peer may append to a file that is there, or refuse to.
            pathlib.Path(target).unlink(missing_ok=True)
            begun = time.process_time()
            count = run()
            least = min(least, time.process_time() - begun)
        print(count if target == "none" else 0, least)
    except ImportError as reason:
        print(f"absent: {reason}")


def gsplat():
    try:
        import gsplat  # noqa: F401
        import torch

        if not torch.cuda.is_available():
            raise ImportError("no CUDA device")
        print("gsplat: `cargo xtask bench gpu` measures it")
    except ImportError as reason:
        print(f"gsplat: absent: {reason}")


if __name__ == "__main__":
    tasks = {"frames": frames, "count": count, "simulate": simulate, "events": events, "gsplat": gsplat}
    tasks[sys.argv[1]](*sys.argv[2:])
