"""Asks OpenCV, numpy and h5py about a trajectory, in the form in which it is released.

python3 -I ask.py geometry|readback REQUEST.json ANSWER.json
"""

import hashlib
import json
import os
import sys

import numpy as np


# ---- poses and camera -------------------------------------------------------------------------------------------------


def poses_of_text(path):
    """World to camera of each line `t_us tx ty tz qx qy qz qw`, which is camera to world with OpenCV axes, by stamps."""
    found = {}
    for line in open(path):
        t_us, *numbers = line.split()
        x, y, z, w = (float(number) for number in numbers[3:])
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        found[int(t_us)] = (turn.T, -turn.T @ np.array([float(number) for number in numbers[:3]]))
    return found


def poses_of_transforms(transforms):
    """World to camera of each frame, whose matrix is camera to world with OpenGL axes, by stamps."""
    found = {}
    for frame in transforms["frames"]:
        matrix = np.array(frame["transform_matrix"])
        turn = matrix[:3, :3] @ np.diag([1.0, -1.0, -1.0])
        found[frame["t_us"]] = (turn.T, -turn.T @ matrix[:3, 3])
    return found


def intrinsics(transforms):
    """The camera matrix for OpenCV, to whom the centre of the first pixel is 0."""
    half = transforms["pixel_center"]
    return np.array(
        [
            [transforms["fl_x"], 0, transforms["cx"] - half],
            [0, transforms["fl_y"], transforms["cy"] - half],
            [0, 0, 1],
        ]
    )


def distortion(transforms):
    """The lens for OpenCV: whether it is a fisheye, and its coefficients; none for a pinhole."""
    model = transforms["camera_model"]
    if model == "OPENCV_FISHEYE":
        return True, np.array([transforms[f"k{k}"] for k in (1, 2, 3, 4)])
    names = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]
    numbers = [float(transforms.get(name, 0)) for name in names]
    return False, None if model == "PINHOLE" else np.array(numbers)


def projection(cv2, views, poses, matrix, lens):
    """The largest distance between where OpenCV and where we see a point, px, and in which pose."""
    worst = {"px": 0.0, "pose": None, "points": 0}
    for view in views:
        if view["t_us"] not in poses:
            continue
        turn, shift = poses[view["t_us"]]
        points = np.array(view["points"])
        fisheye, k = lens
        if fisheye:
            seen, _ = cv2.fisheye.projectPoints(points[None], cv2.Rodrigues(turn)[0], shift, matrix, k)
        else:
            seen, _ = cv2.projectPoints(points, cv2.Rodrigues(turn)[0], shift, matrix, k)
        off = np.linalg.norm(seen.reshape(-1, 2) + 0.5 - np.array(view["pixels"]), axis=1).max()
        off = float(off) if np.isfinite(off) else sys.float_info.max
        worst["points"] += len(points)
        if worst["pose"] is None or off > worst["px"]:
            worst.update(px=off, pose=view["pose"])
    return worst


# ---- poses from pictures ----------------------------------------------------------------------------------------------

RATIO = 0.8
LEAST_MATCHES = 40
LEAST_PARALLAX_PX = 8.0
MOST_OFF_PX = 0.5


class Eye:
    """Key points of pictures, each looked at once, where a pinhole camera would show them."""

    def __init__(self, cv2, matrix, lens):
        self.cv2, self.matrix, self.lens, self.known = cv2, matrix, lens, {}
        self.sift = cv2.SIFT_create(2000)
        self.matcher = cv2.BFMatcher(cv2.NORM_L2)

    def look(self, file):
        if file not in self.known:
            grey = self.cv2.imread(file, self.cv2.IMREAD_GRAYSCALE)
            if grey is None:
                raise SystemExit(f"OpenCV cannot read {file}")
            points, descriptors = self.sift.detectAndCompute(grey, None)
            self.known[file] = (self.straight(np.array([point.pt for point in points])), descriptors)
        return self.known[file]

    def straight(self, points):
        fisheye, k = self.lens
        if k is None or not len(points):
            return points
        if fisheye:
            return self.cv2.fisheye.undistortPoints(points[None], self.matrix, k, P=self.matrix)[0]
        until = (self.cv2.TERM_CRITERIA_COUNT + self.cv2.TERM_CRITERIA_EPS, 100, 1e-9)
        if hasattr(self.cv2, "undistortPointsIter"):
            seen = self.cv2.undistortPointsIter(points[:, None], self.matrix, k, None, self.matrix, until)
        else:
            # From version 5.
            seen = self.cv2.undistortPoints(points[:, None], self.matrix, k, P=self.matrix, criteria=until)
        return seen[:, 0]

    def matches(self, one, other):
        (a, of_a), (b, of_b) = self.look(one), self.look(other)
        if min(len(a), len(b)) < 2:
            return np.zeros((0, 2)), np.zeros((0, 2))

        def near(x, y):
            pairs = (m for m in self.matcher.knnMatch(x, y, k=2) if len(m) == 2)
            return {m.queryIdx: m.trainIdx for m, n in pairs if m.distance < RATIO * n.distance}

        there, back = near(of_a, of_b), near(of_b, of_a)
        both = sorted((i, j) for i, j in there.items() if back.get(j) == i)
        return a[[i for i, _ in both]], b[[j for _, j in both]]


def degrees_between(a, b):
    """Angle between two directions, exact near 0 too."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))))


def degrees_of(turn):
    """Angle of a rotation."""
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.degrees(np.arctan2(np.linalg.norm(axis), np.trace(turn) - 1)))


def relative(eye, pictures, start, poses):
    """The motion from a picture to the nearest later one that shows it apart enough, by OpenCV and as it is stated."""
    cv2, matrix = eye.cv2, eye.matrix
    step = 1
    while start + step < len(pictures):
        one, other = pictures[start], pictures[start + step]
        a, b = eye.matches(one["file"], other["file"])
        if len(a) < LEAST_MATCHES:
            return None
        (turn_a, shift_a), (turn_b, shift_b) = poses[one["t_us"]], poses[other["t_us"]]
        turn = turn_b @ turn_a.T
        shift = shift_b - turn @ shift_a
        # What is left of the motion of points when the stated turn is taken out of it.
        rays = np.column_stack([a, np.ones(len(a))]) @ np.linalg.inv(matrix).T @ turn.T @ matrix.T
        parallax = np.median(np.linalg.norm(rays[:, :2] / rays[:, 2:] - b, axis=1))
        if not parallax < LEAST_PARALLAX_PX:
            essential, inliers = cv2.findEssentialMat(a, b, matrix, cv2.USAC_ACCURATE, 0.9999, MOST_OFF_PX)
            if essential is None or essential.shape != (3, 3):
                return None
            count, found_turn, found_shift, _ = cv2.recoverPose(essential, a, b, matrix, mask=inliers)
            if count < LEAST_MATCHES:
                return None
            return {
                "from": one["pose"],
                "to": other["pose"],
                "matches": int(count),
                "rotation_deg": degrees_of(turn.T @ found_turn),
                "direction_deg": degrees_between(shift, found_shift.ravel()),
            }
        step *= 2
    return None


def geometry(request):
    import cv2

    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    transforms = json.load(open(request["transforms"]))
    matrix, lens = intrinsics(transforms), distortion(transforms)
    by_text, by_transforms = poses_of_text(request["poses"]), poses_of_transforms(transforms)
    eye = Eye(cv2, matrix, lens)
    pictures = request["pictures"]
    pairs = [relative(eye, pictures, start, by_text) for start in request["starts"]]
    return {
        "poses_txt": projection(cv2, request["views"], by_text, matrix, lens),
        "transforms_json": projection(cv2, request["views"], by_transforms, matrix, lens),
        "tried": len(pairs),
        "pairs": [pair for pair in pairs if pair],
    }


# ---- events and pictures ----------------------------------------------------------------------------------------------

CHUNK = 1 << 20


def stream(h5py, file):
    with h5py.File(file, "r") as opened:
        events = opened["events"]
        offset = int(opened["t_offset"][()])
        names = ["t", "x", "y", "p"] + (["label"] if "label" in events else [])
        digests = {name: hashlib.sha256() for name in names}
        count = len(events["t"])
        for start in range(0, count, CHUNK):
            for name in names:
                values = events[name][start : start + CHUNK]
                values = values.astype("<i8") + offset if name == "t" else values.astype("<u2")
                digests[name].update(values.tobytes())
        t = events["t"][()]
        index = opened["ms_to_idx"][()]
        wanted = np.searchsorted(t, 1000 * np.arange(len(index), dtype=np.int64), side="left")
        return {
            "count": count,
            "columns": {name: digest.hexdigest() for name, digest in digests.items()},
            "entries": len(index),
            "wrong_entries": int(np.count_nonzero(index != wanted)),
        }


def pixels(file):
    import cv2

    picture = cv2.imread(file, cv2.IMREAD_UNCHANGED)
    if picture is None:
        return "unreadable"
    picture = picture[:, :, ::-1] if picture.ndim == 3 else picture
    return hashlib.sha256(np.ascontiguousarray(picture).tobytes()).hexdigest()


def readback(request):
    import h5py

    return {
        "streams": [stream(h5py, file) for file in request["streams"]],
        "pictures": [pixels(file) for file in request["pictures"]],
    }


def main():
    question, asked, answered = sys.argv[1:]
    request = json.load(open(asked))
    answer = {"geometry": geometry, "readback": readback}[question](request)
    with open(answered + ".part", "w") as out:
        json.dump(answer, out, allow_nan=False)
    os.replace(answered + ".part", answered)


if __name__ == "__main__":
    main()
