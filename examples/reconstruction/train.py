"""Trains a small network that makes pictures of events.

    python train.py --out network.pt RECORDING... [--iterations 2000] [--side 80] [--steps 24] [--batch 2]

A RECORDING is a folder or a release: see recordings.py. The loss is the mean over the frames of a sequence, but for the
first two, of the squared error + 0.5 (1 - SSIM). The same recordings, seed and number of threads give the same
network on one machine.

An iteration takes about `batch` x `steps` x 25 ms of one core at 80 px, and less in proportion to the area.
"""

import argparse
import time

import numpy as np
import torch
from torch.nn import functional

from network import Network, ssim
from recordings import batch, opened

UNSEEN = 2  # Frames at the start of a sequence that do not count: no event tells the brightness at rest.


def main():
    arguments = parsed()
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(arguments.threads)
    draw = np.random.default_rng(arguments.seed)
    recordings = [recording for place in arguments.recordings for recording in opened(place)]
    network = Network()
    print(f"{len(recordings)} recordings, {sum(map(len, recordings))} steps; {network.weights()} weights", flush=True)
    optimiser = torch.optim.Adam(network.parameters(), arguments.rate)
    # The last fifth goes down to a tenth of the rate.
    fade = lambda i: min(1.0, 0.1 + 4.5 * (1 - i / arguments.iterations))
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, fade)
    began, losses = time.process_time(), []
    for i in range(1, arguments.iterations + 1):
        voxels, frames = batch(draw, recordings, arguments.batch, arguments.side, arguments.steps)
        loss = sequence_loss(network, torch.from_numpy(voxels), torch.from_numpy(frames))
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        schedule.step()
        losses.append(loss.item())
        if i % arguments.report == 0 or i == arguments.iterations:
            seconds = (time.process_time() - began) / i
            print(f"{i:6} loss {np.mean(losses):.4f}, {seconds:.3f} core-seconds an iteration", flush=True)
            losses = []
            torch.save({"weights": network.state_dict(), "arguments": vars(arguments)}, arguments.out)


def sequence_loss(network, voxels, frames):
    """Of sequences [B, T, …]."""
    states, total = (None, None), 0.0
    for k in range(voxels.shape[1]):
        made, states = network(voxels[:, k], states)
        if k >= UNSEEN:
            total = total + functional.mse_loss(made, frames[:, k]) + 0.5 * (1 - ssim(made, frames[:, k]))
    return total / (voxels.shape[1] - UNSEEN)


def parsed():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--out", required=True)
    parser.add_argument("--iterations", type=int, default=2000)
    parser.add_argument("--side", type=int, default=80, help="pixels, a multiple of 4")
    parser.add_argument("--steps", type=int, default=24, help="frames of a sequence")
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--report", type=int, default=50)
    return parser.parse_args()


if __name__ == "__main__":
    main()
