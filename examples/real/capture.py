"""Makes a capture and a recipe of a recording with frames and poses.

    capture.py RECORDING OUT [--middle-ms 8] [--last-s 3]

RECORDING is a folder with
    frames.npz       frames uint8 [N,H,W]; stamps_us int64 [N], the start of each exposure
    groundtruth.txt  lines `t_s px py pz qx qy qz qw`: camera to world, axes of OpenCV
    calib.txt        fx fy cx cy k1 k2 p1 p2 [k3]

OUT receives images/, transforms.json and base.yaml. The recipe base.yaml renders the scene that was trained on the
capture from where the camera was at each moment: its path has one level of speed between any two frames, so that the
camera passes each pose at the frame's stamp. A path of constant speed would pass the poses of a camera that
accelerates at other times.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image


def slerp(a, b, share):
    """Rotation between two unit quaternions."""
    if a @ b < 0:
        b = -b
    angle = np.arccos(np.clip(a @ b, -1, 1))
    if angle < 1e-6:
        return a
    return (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)


def pose_at(truth, time):
    """Position and quaternion at a time, between the two nearest rows."""
    i = int(np.clip(np.searchsorted(truth[:, 0], time), 1, len(truth) - 1))
    share = np.clip((time - truth[i - 1, 0]) / (truth[i, 0] - truth[i - 1, 0]), 0, 1)
    position = (1 - share) * truth[i - 1, 1:4] + share * truth[i, 1:4]
    return position, slerp(truth[i - 1, 4:8], truth[i, 4:8], share)


def rotation(q):
    """Matrix of a unit quaternion (x, y, z, w)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--middle-ms", type=float, default=8, help="from the stamp to the middle of the exposure")
    parser.add_argument("--last-s", type=float, default=np.inf, help="frames after this time are left out")
    arguments = parser.parse_args()

    (arguments.out / "images").mkdir(parents=True, exist_ok=True)
    calibration = [float(number) for number in (arguments.recording / "calib.txt").read_text().split()]
    truth = np.loadtxt(arguments.recording / "groundtruth.txt")
    with np.load(arguments.recording / "frames.npz") as archive:
        images, times = archive["frames"], archive["stamps_us"] * 1e-6 + arguments.middle_ms * 1e-3
    # Before the first row of the truth the pose is unknown.
    used = np.flatnonzero((times >= truth[0, 0]) & (times <= arguments.last_s))

    opencv_from_opengl = np.diag([1.0, -1.0, -1.0])
    frames, positions = [], []
    for k in used:
        position, q = pose_at(truth, times[k])
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation(q) @ opencv_from_opengl, position
        name = f"images/{k:04}.png"
        Image.fromarray(images[k]).save(arguments.out / name)
        frames.append({"file_path": name, "transform_matrix": matrix.tolist()})
        positions.append(position)

    height, width = images.shape[1:]
    fx, fy, cx, cy, k1, k2, p1, p2 = calibration[:8]
    camera = dict(w=width, h=height, fl_x=fx, fl_y=fy, cx=cx, cy=cy, k1=k1, k2=k2, p1=p1, p2=p2)
    capture = {"camera_model": "OPENCV", **camera, "frames": frames}
    (arguments.out / "transforms.json").write_text(json.dumps(capture, indent=1))

    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    levels = ", ".join(f"{step:.5f}" for step in steps / steps.mean())
    start, end = round(times[used[0]] * 1e6), round(times[used[-1]] * 1e6)
    recipe = f"""version: 1
scene: real/base
source: {{ nerfstudio: {{ path: transforms.json }} }}
reconstruct: {{ given: {{ path: scene.ply }} }}
camera:
  {{ width: {width}, height: {height}, fx: {fx}, fy: {fy}, cx: {cx}, cy: {cy}, lens: {{ opencv: [{k1}, {k2}, {p1}, {p2}] }} }}
trajectories:
  - name: base
    refine: {{ window: 0, duration: {(end - start) * 1e-6:.6f} }}
    speed: {{ list: {{ blend: 0.1, multipliers: [{levels}] }} }}
sampling: {{ rate: 1000 }}
outputs: [events, sharp]
sharp: {{ every: 1 }}
licence: {{ expression: CC0-1.0, holder: measurement only }}
sensors:
"""
    (arguments.out / "base.yaml").write_text(recipe)
    print(f"{len(frames)} frames; the recipe begins at {start} us of the recording's clock and ends at {end} us")


if __name__ == "__main__":
    main()
