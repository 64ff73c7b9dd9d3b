"""Plants 73 faults in the data of a release, and counts those that a check finds by a measure.

    planted.py PROGRAM [--plant EXAMPLE] [FAULT…]

The faults are those of a hostile tester: 71 of a table, and two more of inertial data. A fault counts as found
if a check that compares the data with what determines it fails or warns. Counts, canonical bytes, catalogue and
report (`records`, but for `blur`, `imu` and `objects`) do not count: a careful forger writes them again; nor does
`affine`, which warns of this scene's Gaussians, with a fault or without.
`check --tree` reads no sums, so they stay as they are. The two controls have no fault and may have no such finding.

With the example `plant` (`cargo build --example plant`), each fault is planted in the store as well, and
`gs2e release` must find what `check --tree` finds and write nothing.

The exit code is 1 if fewer than 66 are found, a control has a finding, or
release and check differ. Only Python's standard library is used.
"""

import concurrent.futures
import functools
import itertools
import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile

from tree import HEIGHT, WIDTH, Tree, read_png

WANTED = 66
MEASURES = ["records#blur", "records#imu", "records#objects"]
BODY = "planted/all/base"
LEFT, RIGHT = BODY + "/left", BODY + "/right"
# Events: `E` of a sensor without noise, `V` of one with hot pixels.
E, V, OTHER = LEFT + "/events/e.h5", LEFT + "/events/v.h5", RIGHT + "/events.h5"
IMU, STATES, SENSOR = (f"{BODY}/imu/{name}" for name in ("imu.csv", "state.csv", "sensor.yaml"))
OBJECTS = LEFT + "/segmentation/objects.csv"
RECIPE = """\
version: 1
scene: planted/all
seed: 3
source: { procedural: { kind: still-life, gaussians: 3000, views: 11, arc: 16, seed: 1 } }
camera: { width: 160, height: 120 }
trajectories: [{ name: base, refine: { window: 1, factor: 9 } }]
sampling: { rate: 1200 }
sensors:
  e: { esim: { threshold: { on: 0.1, off: 0.1 }, labels: true } }
  v:
    voltmeter:
      preset: dvs346
      threshold: { on: 0.5, off: 0.5 }
      hot_pixels: { share: 0.004, rate: 2000 }
      labels: true
rig:
  cameras:
    - { name: left }
    - name: right
      extrinsic: { position: [0.1, 0.01, 0], rotation: [0, 0.02, 0, 0.9998] }
      sensor: { esim: { threshold: { on: 0.1, off: 0.1 }, labels: true } }
      outputs: [events, sharp, depth, segmentation]
  stereo: [[left, right]]
objects:
  - name: orange
    select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.24 } }
    path: { straight: { velocity: [3, -2, 0], spin: [0, 0, 250] } }
  - name: board
    select: { box: { low: [-1.5, -0.6, -1], high: [-0.35, 0.3, 1] } }
    path: { orbit: { centre: [0, 0, 0], axis: [0, 1, 0], degrees_per_second: 45 } }
outputs: [events, sharp, blur, depth, flow, disparity, segmentation, imu]
blur: { frames: 9, subframes: literal }
scale: { metres_per_unit: 0.5 }
imu: { up: [0, -1, 0] }
licence: { expression: CC0-1.0, holder: Nobody }
"""


# Faults of events: each takes the events and returns them.


def retimed(change):
    return lambda events: [[t + change(x, y), x, y, *rest] for t, x, y, *rest in events]


def jittered(us):
    draw = random.Random(1)
    return retimed(lambda x, y: round(draw.gauss(0, us)))


def moved(right, down, is_moved=lambda x, y: True):
    def change(events):
        def place(t, x, y, *rest):
            return [t, x + right, y + down, *rest] if is_moved(x, y) else [t, x, y, *rest]
        return [event for event in itertools.starmap(place, events) if event[1] < WIDTH and event[2] < HEIGHT]
    return change


def flipped(is_flipped):
    return lambda events: [[t, x, y, 1 - p if is_flipped(t, x, y) else p, *rest] for t, x, y, p, *rest in events]


def dropped(is_dropped):
    return lambda events: [event for event in events if not is_dropped(*event[:3])]


def repeated(us):
    return lambda events: events + [[t + us, *rest] for t, *rest in events[::20]]


def thinned(events):
    return [event for i, event in enumerate(events) if i % 33]


def window(start, us):
    return lambda t, *_: start <= t < start + us


def copied(events):
    """Those of 2 ms follow once more in the next 2 ms, in place of those there."""
    early = [event for event in events if window(30000, 2000)(*event)]
    return dropped(window(32000, 2000))(events) + [[t + 2000, *rest] for t, *rest in early]


def reversed_part(events):
    inside = window(30000, 10000)
    return [[69999 - t, *rest] if inside(t) else [t, *rest] for t, *rest in events]


def cluster(rate):
    def change(events):
        end, places = max(events)[0], itertools.product(range(70, 75), range(50, 55))
        step = 1000000 // rate
        return events + [[t, x, y, 1, 0] for x, y in places for t in range((37 * x + y) % step, end, step)]
    return change


def labelled(change):
    return lambda events: [[*rest, change(label)] for *rest, label in events]


def quadrant(_, x, y):
    return x < WIDTH // 2 and y < HEIGHT // 2


def block(side):
    return lambda _, x, y: 64 <= x < 64 + side and 48 <= y < 48 + side


# Faults of pictures and arrays.


def each(folder, change):
    """A fault of all arrays of a folder."""
    def plant(tree):
        for name in tree.files(folder):
            tree.numbers(name, change)
    return plant


def scaled(by):
    return lambda values: [by * v for v in values]


def along_ray(tree):
    """Distances in place of depths."""
    transforms = json.loads(tree.read(LEFT + "/transforms.json"))
    fx, fy, cx, cy = (transforms[key] for key in ("fl_x", "fl_y", "cx", "cy"))
    places = [((i % WIDTH + 0.5 - cx) / fx, (i // WIDTH + 0.5 - cy) / fy) for i in range(WIDTH * HEIGHT)]
    factors = [(1 + u * u + v * v) ** 0.5 for u, v in places]
    each(LEFT + "/depth", lambda values: [z * f for z, f in zip(values, factors)])(tree)


def under_objects(kind, change):
    """A fault of flow or depth at the pixels of moving objects."""
    def plant(tree):
        for name in tree.files(f"{LEFT}/{kind}"):
            mask = b"".join(read_png(tree.read(name.replace(kind, "segmentation").replace(".npy", ".png"))))
            wide = 2 if kind == "flow" else 1
            tree.numbers(name, lambda values: [change(v) if mask[i // wide] else v for i, v in enumerate(values)])
    return plant


def swapped(folder, a, b):
    def plant(tree):
        names = tree.files(f"{LEFT}/{folder}")
        tree.exchange(names[a], names[b])
    return plant


def turned_round(folder):
    def plant(tree):
        names = tree.files(folder)
        data = [tree.read(name) for name in names]
        for name, other in zip(names, reversed(data)):
            tree.write(name, other)
    return plant


def following(folder):
    """Each file has the content of the next one, and the last stays."""
    def plant(tree):
        names = tree.files(folder)
        for name, data in zip(names, [tree.read(other) for other in names[1:]]):
            tree.write(name, data)
    return plant


def recoloured(change):
    table = bytes(change(v) for v in range(256))
    return lambda tree: tree.pictures(LEFT + "/sharp", lambda rows: [row.translate(table) for row in rows])


def bgr(rows):
    return [bytes(itertools.chain.from_iterable(zip(row[2::3], row[1::3], row[::3]))) for row in rows]


def masks(change):
    return lambda tree: tree.pictures(LEFT + "/segmentation", lambda rows: [change(row) for row in rows])


def cameras(*kinds):
    """What both cameras have is exchanged between them."""
    def plant(tree):
        for kind in kinds:
            if kind == "events":
                tree.exchange(E, OTHER)
                continue
            for name in tree.files(f"{LEFT}/{kind}"):
                tree.exchange(name, name.replace(LEFT, RIGHT))
    return plant


# Faults of tables.


def columns(first, last, change):
    """Changes the numbers of some columns of a line."""
    return lambda i, line: [*line[:first], *map(repr, change(list(map(float, line[first:last])))), *line[last:]]


def table(name, first, last, change):
    return lambda tree: tree.lines(name, columns(first, last, change))


def of_events(name, change):
    return lambda tree: tree.events(name, change)


def one_late(tree):
    lines = [line.split(",") for line in tree.read(IMU).decode().splitlines()[1:]]
    tree.lines(IMU, lambda i, line: line[:1] + lines[max(i - 1, 0)][1:])


def renumbered(i, line):
    return [line[0], str(3 - int(line[1])), *line[2:]]


FAULTS = {
    "e: +1 px in x": of_events(E, moved(1, 0)),
    "e: +1 px in y": of_events(E, moved(0, 1)),
    "e: +1 px in half of the picture": of_events(E, moved(1, 0, lambda x, y: x < WIDTH // 2)),
    "e: polarity of a quadrant": of_events(E, flipped(quadrant)),
    "e: polarity of 16x16 pixels": of_events(E, flipped(block(16))),
    "e: 5 % twice": of_events(E, repeated(0)),
    "e: 5 % twice, 30 us later": of_events(E, repeated(30)),
    "e: jitter of 300 us": of_events(E, jittered(300)),
    "e: jitter of 30 us": of_events(E, jittered(30)),
    "e: rows late by y us": of_events(E, retimed(lambda x, y: y)),
    "e: 2 ms dropped": of_events(E, dropped(window(30000, 2000))),
    "e: 2 ms repeated": of_events(E, copied),
    "e: 2 ms of other polarity": of_events(E, flipped(window(30000, 2000))),
    "e: 10 ms reversed": of_events(E, reversed_part),
    "e: 5x5 pixels at 2 kHz": of_events(E, cluster(2000)),
    "e: 5x5 pixels at 100 Hz": of_events(E, cluster(100)),
    "e: a dead row": of_events(E, dropped(lambda t, x, y: y == 60)),
    "e: 8x8 dead pixels": of_events(E, dropped(block(8))),
    "sensors exchanged": lambda tree: tree.exchange(E, V),
    "v: 3 % dropped": of_events(V, thinned),
    "v: 2 ms dropped": of_events(V, dropped(window(30000, 2000))),
    "v: jitter of 300 us": of_events(V, jittered(300)),
    "v: +1 px in x": of_events(V, moved(1, 0)),
    "v: polarity of a quadrant": of_events(V, flipped(quadrant)),
    "v: 20 ms dropped": of_events(V, dropped(window(30000, 20000))),
    "v: labels inverted": of_events(V, labelled(lambda label: 1 - label)),
    "v: all labels signal": of_events(V, labelled(lambda label: 1)),
    "depth x1.01": each(LEFT + "/depth", scaled(1.01)),
    "depth x1.001": each(LEFT + "/depth", scaled(1.001)),
    "depth along the ray": along_ray,
    "depth moved by 1 px": each(LEFT + "/depth", lambda z: z[:1] + z[:-1]),
    "flow of another sign": each(LEFT + "/flow", scaled(-1)),
    "flow u and v exchanged": each(LEFT + "/flow", lambda f: [*itertools.chain(*zip(f[1::2], f[::2]))]),
    "flow x1.002": each(LEFT + "/flow", scaled(1.002)),
    "neighbouring frames exchanged": swapped("sharp", 40, 41),
    "distant frames exchanged": swapped("sharp", 20, 80),
    "blur of the next window": following(LEFT + "/blur"),
    "frames of gamma 1.02": recoloured(lambda v: round(255 * (v / 255) ** 1.02)),
    "frames lighter by 2": recoloured(lambda v: min(v + 2, 255)),
    "frames in BGR": lambda tree: tree.pictures(LEFT + "/sharp", bgr),
    "imu: accelerometer of another sign": table(IMU, 4, 7, scaled(-1)),
    "imu: gyroscope of another sign": table(IMU, 1, 4, scaled(-1)),
    "imu: axes exchanged": table(IMU, 1, 7, lambda v: [v[1], v[0], v[2], v[4], v[3], v[5]]),
    "imu: one sample late": one_late,
    "imu: gravity of another sign": lambda tree: tree.text(SENSOR, r"^(gravity: .*, )9\.80665", r"\1-9.80665"),
    "imu: degrees": table(IMU, 1, 4, scaled(57.29577951308232)),
    "imu: saturated": table(IMU, 1, 4, lambda v: [34.90658503988659, 0.0, 0.0]),
    "imu: beyond the range": table(IMU, 4, 7, lambda v: [1e6, 0.0, 0.0]),
    "imu: another rate in sensor.yaml": lambda tree: tree.text(SENSOR, "^rate_hz: 1000", "rate_hz: 500"),
    "imu: densities x100 in sensor.yaml": lambda tree: tree.text(SENSOR, r"_density: 0\.00", "_density: 0."),
    "cameras exchanged: all": cameras("sharp", "events", "depth", "segmentation"),
    "cameras exchanged: sharp": cameras("sharp"),
    "cameras exchanged: events": cameras("events"),
    "cameras exchanged: depth": cameras("depth"),
    "cameras exchanged: masks": cameras("segmentation"),
    "disparity x1.01": each(LEFT + "/disparity", scaled(1.01)),
    "disparity of another sign": each(LEFT + "/disparity", scaled(-1)),
    "disparity of another pose": swapped("disparity", 5, 6),
    "disparity of zero": each(LEFT + "/disparity", scaled(0)),
    "masks of zero": masks(lambda row: bytes(len(row))),
    "masks mirrored": masks(lambda row: row[::-1]),
    "masks in reverse order": turned_round(LEFT + "/segmentation"),
    "masks of one": masks(lambda row: b"\1" * len(row)),
    "masks: numbers exchanged": masks(lambda row: row.translate(bytes([0, 2, 1, *range(3, 256)]))),
    "objects: velocities of another sign": table(OBJECTS, 10, 13, scaled(-1)),
    "objects: places x2": table(OBJECTS, 3, 6, scaled(2)),
    "objects: numbers exchanged": lambda tree: tree.lines(OBJECTS, renumbered),
    "objects: half of the lines": lambda tree: tree.lines(OBJECTS, lambda i, line: line if i % 4 < 2 else None),
    "flow negated under objects": under_objects("flow", lambda v: -v),
    "flow of zero under objects": under_objects("flow", lambda v: 0.0),
    "depth x2 under objects": under_objects("depth", lambda v: 2 * v),
    # Two more of the same tester, which are not in the table.
    "imu: velocities + 3 m/s": table(STATES, 8, 11, lambda v: [x + 3 for x in v]),
    "imu: turned T_BS": lambda tree: tree.text(SENSOR, r"data: \[1\.0", "data: [-1.0"),
}


def rewritten(tree):
    """The same values in files of other bytes."""
    tree.events(E, lambda events: events)
    tree.events(V, lambda events: events)
    tree.pictures(LEFT + "/sharp", lambda rows: rows)
    tree.pictures(LEFT + "/segmentation", lambda rows: rows)
    each(LEFT + "/depth", lambda values: values)(tree)


CONTROLS = {"control: untouched": lambda tree: None, "control: written again": rewritten}


def measured(findings):
    counts = lambda check: check not in ("records", "affine")
    return [(what, verdict) for what, verdict in findings if counts(what.split("#")[0]) or what in MEASURES]


def judge(program, plant, base, name):
    """The findings of the check with a fault in a copy of the release, and what the release says of it."""
    root = pathlib.Path(tempfile.mkdtemp(dir=base))
    shutil.copytree(base / "out", root / "tree", copy_function=os.link)
    tree = Tree(program, root / "tree")
    (FAULTS | CONTROLS)[name](tree)
    findings = tree.findings()
    released = release_planted(program, plant, base, root) if plant else None
    shutil.rmtree(root)
    return findings, released


def link_blob(place, copy):
    """The program writes into its index and locks, and never into blobs."""
    (os.link if "/cas/" in str(place) else shutil.copy2)(place, copy)


def release_planted(program, plant, base, root):
    """The exit code of a release from a store with the fault, and its findings."""
    shutil.copytree(base / ".gs2e", root / "store", copy_function=link_blob)
    subprocess.run([plant, root / "store", base / "out", root / "tree"], check=True)
    command = [program, "release", "--json", "--store", root / "store", "--to", root / "new", base / "recipe.yaml"]
    ended = subprocess.run(command, capture_output=True, text=True)
    records = [json.loads(line) for line in ended.stdout.splitlines()]
    found = {(r["check"], r["subject"].partition("#")[2]) for r in records if r.get("verdict") in ("fail", "warn")}
    return ended.returncode, (root / "new").exists(), found


def differs(findings, released):
    """How the release and the check differ."""
    code, is_written, found = released
    fails = any(verdict == "fail" for _, verdict in measured(findings))
    if fails and (code != 3 or is_written):
        return f"the release ended with {code}"
    missed = {tuple(what.split("#")) for what, verdict in measured(findings) if verdict == "fail"} - found
    return f"the release did not find {sorted(missed)}" if missed else None


def shown(findings):
    return ", ".join(f"{what.rstrip('#')} {verdict}" for what, verdict in findings) or "-"


def main(program, plant, names):
    # No GPU: the same on every machine.
    os.environ |= {"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"}
    count = {"measured": 0, "form": 0, "none": 0, "alarms": 0, "differ": 0}
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ProcessPoolExecutor(2) as pool:
        base = pathlib.Path(folder)
        (base / "recipe.yaml").write_text(RECIPE)
        command = [program, "release", "-q", "--copy", "--to", "out", "recipe.yaml"]
        subprocess.run(command, cwd=base, check=True)
        judged = pool.map(functools.partial(judge, program, plant, base), names)
        for name, (findings, released) in zip(names, judged):
            difference = differs(findings, released) if plant else None
            count["differ"] += bool(difference)
            found = measured(findings)
            if name in CONTROLS:
                count["alarms"] += bool(found)
            else:
                count["measured" if found else "form" if findings else "none"] += 1
            print(f"{name:38} {shown(found)}{f' BUT {difference}' if difference else ''}", flush=True)
    faults = [name for name in names if name in FAULTS]
    print(f"{count['measured']} of {len(faults)} found by a check that measures, {count['form']} by form only, "
          f"{count['none']} not at all; controls: {count['alarms']} with a finding; release and check differ in {count['differ']}")
    return count["measured"] < min(WANTED, len(faults)) or count["alarms"] + count["differ"] > 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    words, plant = sys.argv[2:], None
    if words[:1] == ["--plant"]:
        plant, words = os.path.abspath(words[1]), words[2:]
    sys.exit(main(os.path.abspath(sys.argv[1]), plant, words or [*CONTROLS, *FAULTS]))
