"""Makes recordings of a camera whose every number is known, and judges `gs2e calibrate` by them.

    calibration_planted.py [PROGRAM] --out DIR [--count 40] [--first 0] [--seed 1] [--noise]
    calibration_planted.py --self-test

Without PROGRAM, the recordings are made only. `--noise` gives the program the second file of a static scene as well.
Those in DIR that have the same seed and `VERSION` are not made again. numpy is needed; nothing is shared
with gs2e: the voltage of every pixel goes forward in steps of 50 us. A recording takes 5 to 20 s.

A recording is a folder `DIR/NN`:
| file | content |
|---|---|
| frames.npy | uint8 [N, H, W] |
| stamps.npy | int64 [N], us: the middle of each exposure |
| events.npz | `t` (int64, us), `x`, `y` (uint16), `p` (uint8), `size` (int32: columns, rows); sorted by time |
| noise.npz | the same pixels for 3 s before a grey wall, without motion, frames or the delay |
| truth.json | `parameters`: what is compared. `camera`, `scene`: everything else, units in the names |

The camera. G is the light in grey above black: a pixel of G shows F = black_level + mean of G over the exposure
+ shot noise + read noise, rounded. Its voltage is the low-pass (first order) of ln(G + offset), with a cutoff of
cutoff_hz (G / grey_moving)^cutoff_slope, plus an Ornstein-Uhlenbeck noise, plus the leak. An ON event is made where
the voltage is a threshold above the reference. Then the pixel is dead. `dead_mode` is `follows` (the reference is the
voltage at the end of the dead time) or `keeps` (it moves by one threshold; what was missed follows after the dead
time). Stamps are crossing times, interpolated in a step, plus the delay.

What an estimate is compared with (`parameters`):
| name | unit | meaning |
|---|---|---|
| contrast_on, contrast_off | 1 | mean threshold over the pixels, natural logarithm, both positive |
| spread | 1 | standard deviation of the thresholds over the pixels by their mean (ON and OFF are drawn independently) |
| dead_time_us | us | from an event of a pixel to the earliest next one |
| cutoff_hz | Hz | of the low-pass at the mean G of the moving pixels (`grey_moving`) |
| delay_us | us | of the stamps of events behind those of frames. The lag of the low-pass is not in it |
| black_level | grey | frame of a pixel without light |
| offset | grey | added to G under the logarithm. See below |
| leak_hz | Hz | ON events of a pixel from the leak alone, mean over the pixels |
| noise | 1 | median over the pixels of the standard deviation of the Ornstein-Uhlenbeck voltage, natural logarithm |
| hot_pixels | 1 | share of the pixels with more than 5 events/s in a static scene |

Events and frames know the voltage as ln(F - black_level + offset): they determine the difference of the two only.
Where `black_level` is not determined, `offset` is therefore compared with offset - black_level: what is to be added
to the frames as they are. It may be negative.

The program is called as `PROGRAM calibrate --frames F --stamps S --events E --json`. It prints one JSON object, or one
in a line, which holds the estimates `"name": {"value": …, "se": …, "determined": true}` at any depth.

The judgement: of the determined estimates at least 95 % lie within three standard errors, and at least 95 % of the
determined thresholds within 3 %, of the dead times within 10 % and of the cutoffs within 15 %. A program that
determines too little has nothing to judge: thresholds must be determined in at least half of the recordings.
`DIR/estimates.csv` has every determined estimate.

Known bias of the steps: an excursion of the noise inside a step is missed. Thresholds look larger to the noise by
0.58 of its deviation in one step: below 0.15 `noise` in events.npz, 0.2 in noise.npz (`--self-test` shows it).
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import time

import numpy as np

VERSION = 3  # To be raised when recordings of the same seed become other ones.
STEP_US = 50
SCENE_STEP_US = 500  # The light is linear in time between two of these; frames are the mean of the same light.
WARM_UP_US = 100_000  # Simulated before time 0 and left out, so that references are those of a running camera.
WORLD, SAMPLES = 256, 2  # The periodic texture: its side in px, and samples per px.
HOT_HZ = 5.0
WALL_S = 3.0
WITHIN = {"contrast_on": 0.03, "contrast_off": 0.03, "dead_time_us": 0.10, "cutoff_hz": 0.15}
NAMES = ["contrast_on", "contrast_off", "spread", "dead_time_us", "cutoff_hz", "delay_us", "offset", "black_level",
         "leak_hz", "noise", "hot_pixels"]


class Pixels:
    """Change detectors: thresholds, references and dead times of all pixels. Voltages are linear in a step."""

    def __init__(self, on, off, reference, dead_us, keeps):
        self.on, self.off, self.reference = on, off, reference.copy()
        self.dead_us, self.keeps = dead_us, keeps
        self.high, self.low = reference + on, reference - off  # A dead pixel has infinite levels.
        self.free_at = np.full(len(on), -np.inf)
        self.dead = np.zeros(0, np.int64)
        self.made = []

    def step(self, v0, v1, start, length):
        """Goes on by `length` us from `start`, while voltages go from `v0` to `v1`."""
        end = start + length
        pixel = np.flatnonzero((v1 >= self.high) | (v1 <= self.low))
        since = np.full(len(pixel), float(start))
        if len(self.dead):
            is_free = self.free_at[self.dead] < end
            freed = self.dead[is_free]
            self.dead = self.dead[~is_free]
            self.rearm(freed, v0[freed] + (v1 - v0)[freed] * (self.free_at[freed] - start) / length)
            pixel, since = np.concatenate([pixel, freed]), np.concatenate([since, self.free_at[freed]])
        while len(pixel):
            pixel, since = self.fire(pixel, since, v0, v1, start, length)

    def rearm(self, pixel, voltage):
        if not self.keeps:
            self.reference[pixel] = voltage
        self.high[pixel] = self.reference[pixel] + self.on[pixel]
        self.low[pixel] = self.reference[pixel] - self.off[pixel]

    def fire(self, pixel, since, v0, v1, start, length):
        """The next event of each pixel in this step, if any. Returns pixels that are free again in it."""
        end, slope = start + length, (v1[pixel] - v0[pixel]) / length
        now = v0[pixel] + slope * (since - start)
        high, low, last = self.high[pixel], self.low[pixel], v1[pixel]
        is_on = (now >= high) | (last >= high)
        is_event = is_on | (now <= low) | (last <= low)
        level = np.where(is_on, high, low)
        is_late = np.where(is_on, now >= high, now <= low)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.where(is_late, since, since + (level - now) / slope)
        pixel, at, level, is_on = pixel[is_event], np.minimum(at, end)[is_event], level[is_event], is_on[is_event]
        if not len(pixel):
            return pixel, at
        self.made.append((at, pixel, is_on))
        self.reference[pixel] = level
        self.free_at[pixel] = at + self.dead_us
        self.high[pixel], self.low[pixel] = np.inf, -np.inf
        is_free = self.free_at[pixel] < end
        self.dead = np.concatenate([self.dead, pixel[~is_free]])
        freed = pixel[is_free]
        self.rearm(freed, v0[freed] + (v1 - v0)[freed] / length * (self.free_at[freed] - start))
        return freed, self.free_at[freed]

    def events(self):
        """Times (us, not rounded), pixels and whether ON, in the order of time."""
        if not self.made:
            return np.zeros(0), np.zeros(0, np.int64), np.zeros(0, bool)
        at, pixel, is_on = (np.concatenate(column) for column in zip(*self.made))
        order = np.argsort(at, kind="stable")
        return at[order], pixel[order], is_on[order]


class Noise:
    """Ornstein-Uhlenbeck voltages; a step of any length has the exact law."""

    def __init__(self, draw, deviation, cutoff_hz, step_us):
        self.draw, self.value = draw, deviation * draw.standard_normal(len(deviation))
        self.keep = math.exp(-2e-6 * math.pi * cutoff_hz * step_us)
        self.kick = (deviation * math.sqrt(1 - self.keep**2)).astype(np.float32)
        self.buffer = np.empty(len(deviation), np.float32)

    def step(self):
        if not self.kick.any():
            return self.value
        self.draw.standard_normal(out=self.buffer, dtype=np.float32)
        self.buffer *= self.kick
        self.value *= self.keep
        self.value += self.buffer
        return self.value


class LowPass:
    """A first-order low-pass; exact for an input that is linear in a step."""

    def __init__(self, first):
        self.input, self.behind = first, np.zeros(len(first))  # Output less input.

    def set_cutoff(self, cutoff_hz, step_us):
        turns = 2e-6 * math.pi * step_us * cutoff_hz
        self.keep = np.exp(-turns)
        self.lag = (1 - self.keep) / turns

    def step(self, to):
        self.behind *= self.keep
        self.behind -= (to - self.input) * self.lag
        self.input = to
        return to + self.behind


# The scene.


def texture(draw, finest_px, darkest, edges):
    """A periodic picture of values from `darkest` to 1: noise of many scales, and bright and dark shapes."""
    side = WORLD * SAMPLES
    wave = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.rfftfreq(side), indexing="ij")) * SAMPLES
    colour = np.where((wave > 0) & (wave < 1 / finest_px), 1 / np.maximum(wave, 1 / 60), 0)
    field = np.fft.irfft2(np.fft.rfft2(draw.standard_normal((side, side))) * colour, (side, side))
    field /= field.std()
    rows, columns = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    for _ in range(edges):
        row, column, size, height = *draw.uniform(0, side, 2), draw.uniform(6, 24) * SAMPLES, draw.choice([-2, 2])
        down, right = ((v + side / 2) % side - side / 2 for v in (rows - row, columns - column))
        inside = np.hypot(down, right) < size if draw.random() < 0.5 else (abs(down) < size) & (abs(right) < size / 3)
        field[inside] += height
    # No pixel of a camera sees a sharper edge than its own optics: a Gaussian of 0.6 px.
    field = np.fft.irfft2(np.fft.rfft2(field) * np.exp(-2 * (math.pi * 0.6 * wave) ** 2), (side, side))
    return darkest ** (1 / (1 + np.exp(1.2 * field)))


def sampled(picture, x, y):
    """Bilinear, in px of the periodic world."""
    side = len(picture)
    u, v = x * SAMPLES, y * SAMPLES
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    u, v = u - i, v - j
    wrap = side - 1  # The side is a power of two.
    i, j, k, m = i & wrap, (j & wrap) * side, (i + 1) & wrap, ((j + 1) & wrap) * side
    flat = picture.ravel()
    above, below = flat.take(j + i), flat.take(m + i)
    above += u * (flat.take(j + k) - above)
    below += u * (flat.take(m + k) - below)
    return above + v * (below - above)


class Scene:
    """Light in grey above black over time: a texture that is moved and turned, beside a part that stands still."""

    def __init__(self, draw, scene):
        self.scene = scene
        self.picture = texture(draw, scene["finest_px"], scene["darkest"], scene["edges"]) * scene["grey_white"]
        rows, columns = np.meshgrid(np.arange(scene["height"]), np.arange(scene["width"]), indexing="ij")
        self.x = (columns - scene["width"] / 2).ravel().astype(float)
        self.y = (rows - scene["height"] / 2).ravel().astype(float)
        self.moves = columns.ravel() >= scene["static_share"] * scene["width"]
        self.still = sampled(self.picture, self.x + 3.3, self.y + 120.7)[~self.moves]
        self.phases = draw.uniform(0, 2 * math.pi, 3)
        self.place = draw.uniform(0, WORLD, 2)

    def light(self, at_us):
        s, seconds = self.scene, at_us * 1e-6
        wave = [math.sin(2 * math.pi * s["sway_hz"] * f * seconds + a) for f, a in zip((1, 1.37, 0.71), self.phases)]
        right = self.place[0] + s["velocity_px_per_s"][0] * seconds + s["sway_px"] * wave[0]
        down = self.place[1] + s["velocity_px_per_s"][1] * seconds + 0.6 * s["sway_px"] * wave[1]
        angle = s["spin_rad_per_s"] * seconds + s["sway_rad"] * wave[2]
        cos, sin = math.cos(angle), math.sin(angle)
        x, y = self.x[self.moves], self.y[self.moves]
        light = np.empty(len(self.x))
        light[self.moves] = sampled(self.picture, right + cos * x - sin * y, down + sin * x + cos * y)
        light[~self.moves] = self.still
        return light

    def grey_moving(self):
        """The mean over the moving pixels and the time."""
        times = np.linspace(0, self.scene["duration_us"], 100)
        return float(np.mean([self.light(at)[self.moves].mean() for at in times]))


# What is drawn.


def drawn(draw):
    """The numbers of one recording. A part of them is zero in a part of the recordings."""
    uniform, either = draw.uniform, lambda share, value: value if draw.random() < share else 0.0
    logarithmic = lambda low, high: float(np.exp(draw.uniform(math.log(low), math.log(high))))
    on = uniform(0.12, 0.45)
    off = float(np.clip(on * uniform(0.7, 1.4), 0.1, 0.5))
    camera = {
        "contrast_on": on, "contrast_off": off, "spread": either(0.8, uniform(0.005, 0.08)),
        "dead_time_us": either(0.8, logarithmic(100, 2000)), "dead_mode": str(draw.choice(["follows", "keeps"])),
        "cutoff_hz": logarithmic(30, 1000), "cutoff_slope": uniform(0.5, 1.0),
        "delay_us": either(0.6, uniform(200, 8000)),
        "black_level": either(0.6, uniform(1, 20)), "offset": either(0.7, uniform(0.5, 10)),
        "leak_hz": either(0.75, uniform(0.02, 0.3)),
        "noise": either(0.8, min(uniform(0.004, 0.03), 0.2 * min(on, off))), "noise_spread": uniform(0.1, 0.4),
        "noise_cutoff_hz": logarithmic(5, 100), "hot_share": either(0.65, logarithmic(5e-4, 4e-3)),
        "read_out_volt": either(0.3, uniform(0.02, 0.08)), "read_out_us": 300,
        "lux_white": logarithmic(50, 2000),
        "read_noise_grey": uniform(0.3, 1.2), "electrons_per_grey": uniform(20, 80),
    }
    period, exposure = int(draw.integers(40, 101)), int(draw.integers(2, 12)) * 2
    # Up to 4 px from frame to frame: frames that lie farther apart do not show what is between them.
    speed = logarithmic(20, min(150, 4e6 / (period * SCENE_STEP_US)))
    kind = str(draw.choice(["slides", "sways", "turns"]))
    direction, sway_hz = uniform(0, 2 * math.pi), uniform(0.5, 2.5)
    width = int(draw.choice([64, 72, 80, 96, 112]))
    slide = {"slides": 1.0, "sways": 0.2, "turns": 0.3}[kind] * speed
    scene = {
        "kind": kind, "width": width, "height": width * 3 // 4, "duration_us": int(draw.integers(3, 7)) * 500_000,
        "frame_period_us": period * SCENE_STEP_US, "exposure_us": exposure * SCENE_STEP_US,
        "clock_us": int(draw.integers(0, 1_000_000)), "static_share": either(0.6, uniform(0.2, 0.5)),
        "velocity_px_per_s": [slide * math.cos(direction), slide * math.sin(direction)],
        "sway_hz": sway_hz,
        "sway_px": {"slides": 0.3, "sways": 1.0, "turns": 0.3}[kind] * speed / (2 * math.pi * sway_hz),
        "spin_rad_per_s": speed / (width / 3) if kind == "turns" else 0.0, "sway_rad": 0.02,
        "finest_px": uniform(4, 8), "darkest": logarithmic(0.06, 0.3), "edges": int(draw.integers(0, 30)),
        "grey_white": uniform(150, 250) - camera["black_level"],
    }
    return camera, scene


def rounded(value):
    return float(f"{value:.6g}") if isinstance(value, float) else value


class Camera:
    """The pixels of one camera: what differs from pixel to pixel is drawn once, and holds for both of its files."""

    def __init__(self, draw, camera, count):
        self.draw, self.camera = draw, camera
        normal = draw.standard_normal
        self.on = camera["contrast_on"] * np.maximum(1 + camera["spread"] * normal(count), 0.5)
        self.off = camera["contrast_off"] * np.maximum(1 + camera["spread"] * normal(count), 0.5)
        self.deviation = camera["noise"] * np.exp(camera["noise_spread"] * normal(count))
        self.leak_per_us = camera["leak_hz"] * 1e-6 / np.mean(1 / self.on)
        self.hot = np.flatnonzero(draw.random(count) < camera["hot_share"])
        self.hot_hz = np.exp(draw.uniform(math.log(10), math.log(300), len(self.hot)))

    def pixels(self, voltage):
        """References as far from the voltages as those of a camera that has run for long."""
        reference = voltage + self.off - self.draw.random(len(voltage)) * (self.on + self.off)
        keeps = self.camera["dead_mode"] == "keeps"
        return Pixels(self.on, self.off, reference, self.camera["dead_time_us"], keeps)

    def with_hot(self, events, duration_us):
        """Hot pixels have nothing but random events of either sign, a dead time apart at least."""
        at, pixel, is_on = events
        stays = ~np.isin(pixel, self.hot) & (at >= 0) & (at < duration_us)
        columns = [(at[stays], pixel[stays], is_on[stays])]
        for hot, rate in zip(self.hot, self.hot_hz):
            enough = int(3 * rate * duration_us * 1e-6) + 50
            times = np.cumsum(self.camera["dead_time_us"] + self.draw.exponential(1e6 / rate, enough))
            times = times[times < duration_us]
            columns.append((times, np.full(len(times), hot), self.draw.random(len(times)) < 0.5))
        at, pixel, is_on = (np.concatenate(column) for column in zip(*columns))
        order = np.argsort(at, kind="stable")
        return at[order], pixel[order], is_on[order]


def record(camera, scene, pictured):
    """Frames and events of a scene. A voltage has three parts: the low-pass, the noise and the leak."""
    numbers, step, per_scene = camera.camera, STEP_US, SCENE_STEP_US // STEP_US
    slope, bright = numbers["cutoff_slope"], numbers["grey_moving"]
    sums, starts, exposure, duration = exposures(scene)
    light = pictured.light(-WARM_UP_US)
    passed = LowPass(np.log(light + numbers["offset"]))
    noise = Noise(camera.draw, camera.deviation, numbers["noise_cutoff_hz"], step)
    voltage = passed.input + noise.value
    pixels, at = camera.pixels(voltage), -WARM_UP_US
    for next_at in range(-WARM_UP_US + SCENE_STEP_US, duration + SCENE_STEP_US, SCENE_STEP_US):
        before, light = light, pictured.light(next_at)
        shown = (starts <= at) & (at < starts + exposure)
        for k in np.flatnonzero(shown):
            sums[k] += 0.5 * (before + light)
        cutoff = numbers["cutoff_hz"] * (np.maximum(0.5 * (before + light), 1) / bright) ** slope
        passed.set_cutoff(cutoff, step)
        for i in range(1, per_scene + 1):
            to = np.log(before + (light - before) * (i / per_scene) + numbers["offset"])
            next_voltage = passed.step(to) + noise.step()
            next_voltage += camera.leak_per_us * (at + step + WARM_UP_US)
            next_voltage += read_out(numbers, at + step, starts + exposure)
            pixels.step(voltage, next_voltage, at, step)
            voltage, at = next_voltage, at + step
    return developed(camera, sums * (SCENE_STEP_US / exposure)), camera.with_hot(pixels.events(), duration)


def exposures(scene):
    """Empty sums for frames, when the exposures start, how long they and the recording take."""
    exposure, duration = scene["exposure_us"], scene["duration_us"]
    starts = np.arange(SCENE_STEP_US, duration - exposure, scene["frame_period_us"])
    return np.zeros((len(starts), scene["width"] * scene["height"])), starts, exposure, duration


def read_out(numbers, at, ends):
    """Frames that are read out leak into the events: all voltages are higher for a moment after each exposure."""
    since = at - ends
    return numbers["read_out_volt"] if ((since > 0) & (since <= numbers["read_out_us"])).any() else 0.0


def developed(camera, light):
    """Frames of the mean light during the exposure."""
    numbers = camera.camera
    variance = light / numbers["electrons_per_grey"] + numbers["read_noise_grey"] ** 2
    grey = numbers["black_level"] + light + np.sqrt(variance) * camera.draw.standard_normal(light.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def before_wall(camera):
    """Events without any change of the light."""
    numbers = camera.camera
    step = min(200.0, 0.06e6 / (2 * math.pi * numbers["noise_cutoff_hz"]))
    noise = Noise(camera.draw, camera.deviation, numbers["noise_cutoff_hz"], step)
    voltage, at, end = noise.value.copy(), -float(WARM_UP_US), WALL_S * 1e6
    pixels = camera.pixels(voltage)
    while at < end:
        next_voltage = noise.step() + camera.leak_per_us * (at + step + WARM_UP_US)
        pixels.step(voltage, next_voltage, at, step)
        voltage, at = next_voltage, at + step
    return camera.with_hot(pixels.events(), end)


def save_events(path, events, width, height, shift_us):
    at, pixel, is_on = events
    np.savez_compressed(path, t=np.floor(at + shift_us).astype("<i8"), x=(pixel % width).astype("<u2"),
                        y=(pixel // width).astype("<u2"), p=is_on.astype("u1"), size=np.array([width, height], "<i4"))


def make(folder, seed, index):
    """Writes one recording."""
    mark = {"seed": seed, "index": index, "version": VERSION}
    if (folder / "truth.json").exists() and json.loads((folder / "truth.json").read_text())["mark"] == mark:
        return False
    folder.mkdir(parents=True, exist_ok=True)
    draw = np.random.default_rng([seed, index])
    numbers, scene = ({k: rounded(v) for k, v in part.items()} for part in drawn(draw))
    pictured = Scene(draw, scene)
    numbers["grey_moving"] = pictured.grey_moving()
    camera = Camera(draw, numbers, scene["width"] * scene["height"])
    frames, events = record(camera, scene, pictured)
    wall = before_wall(camera)
    width, height, clock = scene["width"], scene["height"], scene["clock_us"]
    np.save(folder / "frames.npy", frames.reshape(-1, height, width))
    np.save(folder / "stamps.npy", exposures(scene)[1] + scene["exposure_us"] // 2 + clock)
    save_events(folder / "events.npz", events, width, height, clock + numbers["delay_us"])
    save_events(folder / "noise.npz", wall, width, height, 0)
    (folder / "truth.json").write_text(json.dumps(truth(camera, scene, events, wall) | {"mark": mark}, indent=1))
    return True


def truth(camera, scene, events, wall):
    numbers = camera.camera
    counts = np.bincount(wall[1], minlength=len(camera.on))
    spreads = [of.std() / of.mean() if numbers["spread"] else 0.0 for of in (camera.on, camera.off)]
    parameters = {name: numbers[name] for name in ["dead_time_us", "cutoff_hz", "delay_us", "offset", "black_level"]}
    parameters |= {
        "contrast_on": camera.on.mean(), "contrast_off": camera.off.mean(),
        "spread": float(np.sqrt(np.mean(np.square(spreads)))), "leak_hz": numbers["leak_hz"],
        "noise": float(np.median(camera.deviation)), "hot_pixels": float(np.mean(counts > HOT_HZ * WALL_S)),
    }
    measured = {
        "events": len(events[0]), "on_share": float(events[2].mean()),
        "events_per_px_s": len(events[0]) / len(counts) / (scene["duration_us"] * 1e-6),
        "wall_events_per_px_s": len(wall[0]) / len(counts) / WALL_S,
        "lag_us": numbers["delay_us"] + 1e6 / (2 * math.pi * numbers["cutoff_hz"]),
    }
    return {"parameters": parameters, "camera": numbers, "scene": scene, "measured": measured}


# The judge.


def estimates(value):
    """All estimates in what a program printed, by name."""
    found = {}
    if isinstance(value, dict):
        for name, inner in value.items():
            if name in NAMES and isinstance(inner, dict) and "determined" in inner:
                found[name] = inner
            else:
                found |= estimates(inner)
    elif isinstance(value, list):
        for inner in value:
            found |= estimates(inner)
    return found


def calibrated(program, folder, with_noise):
    """The estimates of a program for one recording, and how long it took."""
    command = [program, "calibrate", "--frames", folder / "frames.npy", "--stamps", folder / "stamps.npy",
               "--events", folder / "events.npz", "--json"]
    command += ["--noise", folder / "noise.npz"] if with_noise else []
    began = time.monotonic()
    ended = subprocess.run(command, capture_output=True, text=True)
    if ended.returncode:
        print(f"{folder.name}: ended with {ended.returncode}: {ended.stderr.strip()[-300:]}")
    try:
        printed = [json.loads(ended.stdout)]
    except ValueError:
        printed = [json.loads(line) for line in ended.stdout.splitlines() if line.startswith("{")]
    return estimates(printed), time.monotonic() - began


def wanted(name, parameters, found):
    """The truth of an estimate; of an offset, where the black level is not determined, see the head of this file."""
    if name == "offset" and not found.get("black_level", {}).get("determined"):
        return parameters["offset"] - parameters["black_level"]
    return parameters[name]


def compared(name, recordings):
    """Rows of a parameter: value, standard error and truth of each determined estimate."""
    rows = []
    for folder, parameters, found in recordings:
        estimate = found.get(name, {})
        if estimate.get("determined"):
            rows.append((folder, estimate["value"], estimate.get("se") or 0.0, wanted(name, parameters, found)))
    return rows


def table(recordings):
    """Prints a row for each parameter, and returns the counts for the judgement."""
    counts = {}
    heads = f"{'determined':>11}{'within 3 se':>12}{'error, median':>15}{'worst':>9}{'within':>8}"
    print(f"{'':14}{heads}   worst by se; in")
    for name in NAMES:
        rows = compared(name, recordings)
        z = [abs(value - true) / max(se, 1e-12) for _, value, se, true in rows]
        relative = [abs(value / true - 1) for *_, value, _, true in rows if true]
        inside = sum(error <= WITHIN.get(name, math.inf) for error in relative)
        three = sum(v <= 3 for v in z)
        counts[name] = {"determined": len(rows), "three": three, "relative": len(relative), "inside": inside}
        middle, worst = (f"{100 * of(relative):.1f} %" if relative else "-" for of in (np.median, max))
        near = f"{inside}/{len(relative)}" if name in WITHIN else ""
        last = f"{max(z):6.1f} {rows[int(np.argmax(z))][0]}" if z else ""
        share = f"{len(rows)}/{len(recordings)}"
        print(f"{name:14}{share:>11}{three:>12}{middle:>15}{worst:>9}{near:>8}   {last}")
    return counts


def write_rows(path, recordings):
    """All determined estimates next to the truth."""
    lines = [",".join([name, *map(str, row)]) for name in NAMES for row in compared(name, recordings)]
    path.write_text("\n".join(["parameter,recording,value,se,truth", *lines]) + "\n")


def passes(counts, total):
    """Prints the lines of the judgement, and returns whether all of them hold."""
    determined, three = (sum(row[key] for row in counts.values()) for key in ("determined", "three"))
    lines = [(f"{three} of {determined} determined estimates within three standard errors, wanted 95 %",
              determined and three >= 0.95 * determined)]
    for names in (["contrast_on", "contrast_off"], ["dead_time_us"], ["cutoff_hz"]):
        inside, relative = (sum(counts[name][key] for name in names) for key in ("inside", "relative"))
        text = f"{inside} of {relative} of {', '.join(names)} within {100 * WITHIN[names[0]]:.0f} %, wanted 95 %"
        # What is determined nowhere is said, and fails nothing.
        lines.append((text, not relative or inside >= 0.95 * relative))
    least = min(counts[name]["determined"] for name in ("contrast_on", "contrast_off"))
    lines.append((f"thresholds are determined in {least} of {total}, wanted half", least >= 0.5 * total))
    for text, holds in lines:
        print(f"{'pass' if holds else 'FAIL'}  {text}")
    return all(holds for _, holds in lines)


# The closed forms.


def driven(pixels, voltage, until_us, step):
    """Events while the voltage of all pixels is a function of time."""
    at, before = 0.0, voltage(0.0)
    while at < until_us:
        after = voltage(at + step)
        pixels.step(before, after, at, step)
        before, at = after, at + step
    return pixels.events()


def self_test():
    """The parts of the simulation next to what they must be. Prints a line for each, and returns whether all hold."""
    rows = [*ramps(), leaking(), *passing(), *wandering(), first_passage()]
    for what, value, true, allowed in rows:
        verdict = "pass" if abs(value - true) <= allowed else "FAIL"
        print(f"{verdict}  {what:64} {value:.6g}, wanted {true:.6g} +- {allowed:.2g}")
    return all(abs(value - true) <= allowed for _, value, true, allowed in rows)


def even(contrast, dead_us=0.0, keeps=True):
    """Pixels of equal thresholds for ON and OFF, with references of 0."""
    contrast = np.asarray(contrast, float)
    return Pixels(contrast, contrast, np.zeros(len(contrast)), dead_us, keeps)


def ramps():
    """A ramp from 0 by 1 in 1 s: floor(1 / C) events at multiples of C, and what a dead time makes of it."""
    contrast = np.array([0.12, 0.17, 0.3, 0.0301])
    for sign, name in ((1, "ON"), (-1, "OFF")):
        at, pixel, is_on = driven(even(contrast), lambda t: np.full(4, sign * t * 1e-6), 1e6, 50)
        want = sum(math.floor(1 / c) for c in contrast)
        yield f"{name} events of a ramp: floor(1 / C), all pixels", len(at), want, 0
        times = [at[pixel == i] for i in range(4)]
        wrong = max(abs(t - 1e6 * c * np.arange(1, len(t) + 1)).max() for t, c in zip(times, contrast))
        yield f"{name} events of a ramp: error of their times, us", wrong, 0, 1e-3
        yield f"{name} events of a ramp: share of {name}", np.mean(is_on == (sign > 0)), 1, 0
    for keeps, dead, gap in ((False, 2e3, 32_100), (True, 2e3, 30_100), (True, 4e4, 40_000), (False, 7.0, 30_107)):
        at, pixel, _ = driven(even(contrast, dead, keeps), lambda t: np.full(4, t * 1e-6), 1e6, 50)
        what = f"gap of events on a ramp, dead {dead:.0f} us, reference {'keeps' if keeps else 'follows'}"
        yield what, np.diff(at[pixel == 3]).mean(), gap, 1e-3
    at, *_ = driven(even([0.1]), lambda t: np.full(1, 0.0 if t < 100 else 1.05), 200, 50)
    yield "events of a jump by 10.5 C in one step", len(at), 10, 0
    yield "change without a dead time: distance of the events' sum, of a threshold", *swaying()


def swaying():
    """Sums of waves, other ones for every pixel: what the events add up to is as close as the two thresholds."""
    draw = np.random.default_rng(4)
    on, off = draw.uniform(0.1, 0.4, (2, 300))
    hz, phase = draw.uniform(0.5, 20, (4, 300)), draw.uniform(0, 2 * math.pi, (4, 300))
    voltage = lambda t: np.sin(2e-6 * math.pi * hz * t + phase).sum(0)
    _, pixel, is_on = driven(Pixels(on, off, voltage(0.0), 0.0, True), voltage, 1e6, 50)
    total = np.bincount(pixel, np.where(is_on, on[pixel], -off[pixel]), 300)
    largest = np.max(np.abs(voltage(1e6) - voltage(0.0) - total) / np.maximum(on, off))
    return largest, 0.5, 0.5


def leaking():
    """A leak alone: the mean over pixels of slope / C is `leak_hz`, by the number of events in 100 s."""
    numbers = drawn(np.random.default_rng(5))[0] | {"spread": 0.08, "leak_hz": 0.3, "dead_time_us": 0.0}
    camera = Camera(np.random.default_rng(5), numbers, 2000)
    pixels = camera.pixels(np.zeros(2000))
    at, _, is_on = driven(pixels, lambda t: np.full(2000, camera.leak_per_us * t), 1e8, 50_000)
    # References are uniform over C_on + C_off, so a pixel has C_off / (2 C_on) events less than in a long run.
    want = 0.3 - np.mean(camera.off / (2 * camera.on)) / 100
    # Of this count, the phase has a deviation of less than 0.6.
    return "leak: ON events/s of a pixel", is_on.sum() / 2000 / 100, want, 4 * 0.6 / math.sqrt(2000) / 100


def passing():
    """A low-pass: 1 - 1/e of a step at its time constant, behind a ramp by it."""
    tau = 1e6 / (2 * math.pi * 100)
    for step in (10.0, 50.0):
        passed = LowPass(np.zeros(1))
        passed.set_cutoff(np.full(1, 100.0), step)
        passed.input, passed.behind = np.ones(1), -np.ones(1)
        out = [passed.step(np.ones(1))[0] for _ in range(2000)]
        reached = np.interp(tau, step * np.arange(1, 2001), out)
        yield f"low-pass of 100 Hz, step of 1 at tau, steps of {step:.0f} us", reached, 1 - math.exp(-1), 5e-4
        passed = LowPass(np.zeros(1))
        passed.set_cutoff(np.full(1, 100.0), step)
        out = [passed.step(np.full(1, i * step))[0] for i in range(1, 2001)][-1]
        yield f"low-pass of 100 Hz, us behind a ramp, steps of {step:.0f} us", 2000 * step - out, tau, 0.01


def wandering():
    """The noise: variance, and correlation after a time constant; 20,000 pixels (standard errors 1 % and 0.7 %)."""
    for step in (50.0, 500.0):
        noise = Noise(np.random.default_rng(6), np.full(20_000, 0.02), 40.0, step)
        first = noise.value.copy()
        turns = round(1e6 / (2 * math.pi * 40) / step)
        for _ in range(turns):
            last = noise.step()
        yield f"noise: variance by its own, steps of {step:.0f} us", last.var() / 0.02**2, 1, 0.04
        want = math.exp(-2e-6 * math.pi * 40 * turns * step)
        found = np.mean(first * last) / 0.02**2
        yield f"noise: correlation after a time constant, steps of {step:.0f} us", found, want, 0.04


def first_passage():
    """The mean time that an Ornstein-Uhlenbeck voltage takes from 0 to a distance a on either side.

    In units of its time constant and deviation: the integral from 0 to a of exp(y^2/2) times that of exp(-z^2/2) from
    0 to y. Steps see a boundary that is farther by 0.5826 of the deviation in a step (Broadie, Glasserman, Kou 1997).
    """
    step, cutoff, count, a = 50.0, 40.0, 20_000, 1.8
    turn = 2e-6 * math.pi * cutoff
    noise = Noise(np.random.default_rng(7), np.ones(count), cutoff, step)
    noise.value[:] = 0
    pixels, before, at = even(np.full(count, a), 1e12), np.zeros(count), 0.0
    while len(pixels.dead) < count:
        after = noise.step().copy()
        pixels.step(before, after, at, step)
        before, at = after, at + step
    y = np.linspace(0, a + 0.5826 * math.sqrt(2 * turn * step), 20_001)
    inner = np.concatenate([[0], np.cumsum(0.5 * (np.exp(-y[1:]**2 / 2) + np.exp(-y[:-1]**2 / 2)) * np.diff(y))])
    want = np.trapezoid(np.exp(y**2 / 2) * inner, y)
    took = np.concatenate([m[0] for m in pixels.made]) * turn
    allowed = 4 * took.std() / math.sqrt(count)
    return "noise: mean time to 1.8 deviations, of the time constant", took.mean(), want, allowed


def main(arguments):
    if arguments.self_test:
        return not self_test()
    recordings = []
    for index in range(arguments.first, arguments.first + arguments.count):
        folder, began = arguments.out / f"{index:02}", time.process_time()
        is_new = make(folder, arguments.seed, index)
        true = json.loads((folder / "truth.json").read_text())
        if is_new:
            rates = [true["measured"][key] for key in ("events_per_px_s", "wall_events_per_px_s")]
            took = time.process_time() - began
            print(f"{folder.name}: made in {took:.1f} s; events per pixel and second: {rates[0]:.2f}, "
                  f"before a wall {rates[1]:.3f}", flush=True)
        if arguments.program:
            found, took = calibrated(arguments.program, folder, arguments.noise)
            determined = sum(bool(estimate["determined"]) for estimate in found.values())
            print(f"{folder.name}: {len(found)} estimates, {determined} determined, {took:.1f} s", flush=True)
            recordings.append((folder.name, true["parameters"], found))
    if not arguments.program:
        return False
    write_rows(arguments.out / "estimates.csv", recordings)
    return not passes(table(recordings), len(recordings))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", nargs="?")
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--self-test", action="store_true")
    given = parser.parse_args()
    if not given.self_test and not given.out:
        parser.error("--out is missing")
    sys.exit(main(given))
