"""Plants a fault in the data of a release: `plant.py FAULT FILE`.

FILE is a text of events (a line of names, then `t,x,y,p`), a `poses.txt`, or a folder of frames, as the fault
demands. Only Python's standard library is used.
"""

import math
import pathlib
import random
import sys

WIDTH, HEIGHT = 64, 48


def end(events):
    return max(t for t, *_ in events)


def flipped(events, every):
    return [(t, x, y, 1 - p if i % every == 0 else p) for i, (t, x, y, p) in enumerate(events)]


def moved(events, right, down):
    return [(t, min(x + right, WIDTH - 1), min(y + down, HEIGHT - 1), p) for t, x, y, p in events]


def later(events):
    return [(t + 100, *rest) for t, *rest in events if t + 100 <= end(events)]


def shuffled(events):
    times = [t for t, *_ in events]
    random.Random(1).shuffle(times)
    return [(t, *rest) for t, (_, *rest) in zip(times, events)]


def echoed(events):
    last = end(events)
    return events + [(t + 1, *rest) for i, (t, *rest) in enumerate(events) if i % 100 == 0 and t < last]


def noise(events):
    draw = random.Random(1)
    return [(t, draw.randrange(WIDTH), draw.randrange(HEIGHT), draw.randrange(2)) for t, *_ in events]


def twentieth():
    """One pixel in twenty."""
    return random.Random(1).sample([(x, y) for x in range(WIDTH) for y in range(HEIGHT)], WIDTH * HEIGHT // 20)


def dead(events):
    gone = set(twentieth())
    return [event for event in events if event[1:3] not in gone]


def hot(events):
    return events + [(t, x, y, 1) for x, y in twentieth() for t in range(x * 39, end(events), 2500)]


EVENT_FAULTS = {
    "nothing": lambda events: events,
    "flipped": lambda events: flipped(events, 1),
    "tenth_flipped": lambda events: flipped(events, 10),
    "mirrored_x": lambda events: [(t, WIDTH - 1 - x, y, p) for t, x, y, p in events],
    "mirrored_y": lambda events: [(t, x, HEIGHT - 1 - y, p) for t, x, y, p in events],
    "transposed": lambda events: [(t, y, x, p) for t, x, y, p in events if x < HEIGHT],
    "moved_column": lambda events: moved(events, 1, 0),
    "moved_row": lambda events: moved(events, 0, 1),
    "reversed_times": lambda events: [(end(events) - t, *rest) for t, *rest in events],
    "shuffled_times": shuffled,
    "later": later,
    "half_time": lambda events: [(round(t * 0.5), *rest) for t, *rest in events],
    "fast_clock": lambda events: [(round(t * 0.99), *rest) for t, *rest in events],
    "rounded_times": lambda events: [(t - t % 100, *rest) for t, *rest in events],
    "hundredth_dropped": lambda events: [event for i, event in enumerate(events) if i % 100],
    "fifth_dropped": lambda events: [event for i, event in enumerate(events) if i % 5],
    "echoed": echoed,
    "left_missing": lambda events: [event for event in events if event[1] >= WIDTH / 2],
    "end_missing": lambda events: [event for event in events if event[0] < end(events) / 2],
    "gap": lambda events: [event for event in events if not 0 <= event[0] - end(events) / 2 < 5000],
    "dead_pixels": dead,
    "hot_pixels": hot,
    "noise": noise,
    "no_events": lambda events: [],
}


def turned(quaternion, degrees):
    """The rotation after a turn about the camera's own y."""
    x, y, z, w = quaternion
    c, s = math.cos(math.radians(degrees) / 2), math.sin(math.radians(degrees) / 2)
    return [x * c - z * s, y * c + w * s, z * c + x * s, w * c - y * s]


def inverted(pose):
    t, *centre = pose[:4]
    x, y, z, w = pose[4:]
    # v + 2 q x (q x v + w v), for the inverse rotation
    q, v = (-x, -y, -z), centre

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    inner = [i + w * k for i, k in zip(cross(q, v), v)]
    return [t, *(-(k + 2 * i) for k, i in zip(v, cross(q, inner))), *q, w]


def jittered(poses, share):
    draw = random.Random(1)
    step = math.dist(poses[0][1:4], poses[1][1:4])
    return [[t, *(v + draw.gauss(0, share * step) for v in rest[:3]), *rest[3:]] for t, *rest in poses]


def one_turned(poses):
    poses[20][4:] = turned(poses[20][4:], 0.1)
    return poses


def swapped(poses):
    poses[20][1:], poses[21][1:] = poses[21][1:], poses[20][1:]
    return poses


POSE_FAULTS = {
    "still_camera": lambda poses: [[t, *poses[0][1:]] for t, *_ in poses],
    "reversed_poses": lambda poses: [[t, *other[1:]] for (t, *_), other in zip(poses, poses[::-1])],
    "inverse_poses": lambda poses: [inverted(pose) for pose in poses],
    # Turned by 180 degrees about the camera's x.
    "opengl_poses": lambda poses: [[*pose[:4], pose[7], pose[6], -pose[5], -pose[4]] for pose in poses],
    "scaled_poses": lambda poses: [[t, *(1.1 * v for v in rest[:3]), *rest[3:]] for t, *rest in poses],
    "noisy_poses": lambda poses: jittered(poses, 0.5),
    "faint_noise": lambda poses: jittered(poses, 0.01),
    "turned_pose": one_turned,
    "swapped_poses": swapped,
}


def plant_in_frames(folder):
    frames = sorted(folder.iterdir())
    data = [frame.read_bytes() for frame in frames]
    for frame, other in zip(frames, reversed(data)):
        frame.unlink()
        frame.write_bytes(other)


def plant_in_poses(fault, path):
    lines = path.read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    poses = [[float(word) for word in line.split()] for line in lines if not line.startswith("#")]
    rows = []
    for t, *rest in POSE_FAULTS[fault](poses):
        # w is not negative in this file.
        sign = math.copysign(1, rest[6])
        rows.append(" ".join([str(int(t)), *map(repr, rest[:3]), *(repr(sign * q) for q in rest[3:])]))
    path.write_text("\n".join(head + rows) + "\n")


def plant_in_events(fault, path):
    names, *lines = path.read_text().splitlines()
    planted = sorted(EVENT_FAULTS[fault]([tuple(map(int, line.split(","))) for line in lines]))
    path.write_text("\n".join([names, *(",".join(map(str, event)) for event in planted)]) + "\n")


if __name__ == "__main__":
    fault, path = sys.argv[1], pathlib.Path(sys.argv[2])
    if fault == "reversed_frames":
        plant_in_frames(path)
    elif fault in POSE_FAULTS:
        plant_in_poses(fault, path)
    else:
        plant_in_events(fault, path)
