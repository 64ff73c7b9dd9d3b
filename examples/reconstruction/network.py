"""A small recurrent network from events to pictures, after E2VID (Rebecq et al., TPAMI 2021).

Two levels with convolutional GRUs (Ballas et al., 2016) in place of three with LSTMs, sums in place of joined skips
as in E2VID, 24 and 48 channels: fewer than 300,000 weights.
"""

import torch
from torch import nn
from torch.nn import functional

from recordings import BINS


class Gru(nn.Module):
    """A gated recurrent unit whose products are convolutions."""

    def __init__(self, channels):
        super().__init__()
        self.gates = nn.Conv2d(2 * channels, 2 * channels, 3, padding=1)
        self.candidate = nn.Conv2d(2 * channels, channels, 3, padding=1)

    def forward(self, x, state):
        if state is None:
            state = torch.zeros_like(x)
        update, reset = torch.sigmoid(self.gates(torch.cat([x, state], 1))).chunk(2, 1)
        candidate = torch.tanh(self.candidate(torch.cat([x, reset * state], 1)))
        return state + update * (candidate - state)


class Encoder(nn.Module):
    """Half the size, and memory."""

    def __init__(self, inside, outside):
        super().__init__()
        self.down = nn.Conv2d(inside, outside, 3, stride=2, padding=1)
        self.memory = Gru(outside)

    def forward(self, x, state):
        return self.memory(torch.relu(self.down(x)), state)


class Decoder(nn.Module):
    """Twice the size, by interpolation: transposed convolutions leave a checkerboard."""

    def __init__(self, inside, outside):
        super().__init__()
        self.up = nn.Conv2d(inside, outside, 3, padding=1)

    def forward(self, x):
        return torch.relu(self.up(functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)))


class Residual(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)

    def forward(self, x):
        return torch.relu(x + self.second(torch.relu(self.first(x))))


class Network(nn.Module):
    """Voxels [B, BINS, H, W] and states to a picture [B, H, W] from 0 to 1 and states. H and W are multiples of 4."""

    def __init__(self, channels=(16, 24, 48)):
        super().__init__()
        head, middle, low = channels
        self.head = nn.Conv2d(BINS, head, 5, padding=2)
        self.encoders = nn.ModuleList([Encoder(head, middle), Encoder(middle, low)])
        self.residual = Residual(low)
        self.decoders = nn.ModuleList([Decoder(low, middle), Decoder(middle, head)])
        self.picture = nn.Conv2d(head, 1, 1)

    def forward(self, voxels, states=(None, None)):
        head = torch.relu(self.head(voxels))
        middle = self.encoders[0](head, states[0])
        low = self.encoders[1](middle, states[1])
        x = self.decoders[0](self.residual(low)) + middle
        x = self.decoders[1](x) + head
        return torch.sigmoid(self.picture(x)).squeeze(1), (middle, low)

    def weights(self):
        return sum(p.numel() for p in self.parameters())


def ssim(a, b):
    """Mean structural similarity (Wang et al., 2004) of pictures [B, H, W] from 0 to 1; a Gaussian of 1.5 px."""
    x = torch.arange(11, dtype=a.dtype, device=a.device) - 5
    g = torch.exp(-x * x / 4.5)
    g = g / g.sum()
    planes = torch.stack([a, b, a * a, b * b, a * b], 1).flatten(0, 1).unsqueeze(1)
    blurred = functional.conv2d(functional.conv2d(planes, g.view(1, 1, 1, 11)), g.view(1, 1, 11, 1))
    ma, mb, aa, bb, ab = blurred.view(-1, 5, *blurred.shape[-2:]).unbind(1)
    similar = (2 * ma * mb + 0.01**2) * (2 * (ab - ma * mb) + 0.03**2)
    return (similar / ((ma * ma + mb * mb + 0.01**2) * (aa - ma * ma + bb - mb * mb + 0.03**2))).mean()
