"""Shows a trajectory of a release in the viewer `rerun`: poses, camera, frames, depth and events on one time line.

    pip install rerun-sdk
    python examples/rerun_release.py out                        # opens the viewer
    python examples/rerun_release.py out --save release.rrd     # writes a recording; `rerun release.rrd` shows it
    python examples/rerun_release.py out/procedural/still-life/base --bin-us 5000

The time line `time` has the seconds from the first pose. The world has the axes of the release, and the camera those of
OpenCV: x right, y down, z forward.
"""

import argparse
import os

import numpy as np
import rerun as rr

import gs2e


def main():
    arguments = parsed()
    source = gs2e.open(arguments.release)
    scenes = source if isinstance(source, gs2e.Dataset) else [source]
    rr.init("gs2e_release", spawn=arguments.save is None)
    if arguments.save is not None:
        rr.save(arguments.save)
    for scene in scenes:
        parts = (scene.description["id"], scene.trajectory, scene.sensor)
        show(scene, "/".join(part for part in parts if part), arguments.bin_us)


def parsed():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("release", help="a release, or the folder of one trajectory in it")
    parser.add_argument("--save", metavar="FILE", help="write a recording instead of opening the viewer")
    parser.add_argument("--bin-us", type=int, default=10_000, metavar="N", help="length of a picture of events")
    return parser.parse_args()


def show(scene, root, bin_us):
    path = scene.poses[:, :3]
    rr.log(f"{root}/path", rr.LineStrips3D([path]), static=True)
    # The picture plane of the camera is drawn at a tenth of the path's extent.
    plane = float(np.linalg.norm(np.ptp(path, axis=0))) / 10 or 1.0
    size = [scene.width, scene.height]
    pinhole = rr.Pinhole(
        image_from_camera=scene.K, resolution=size, camera_xyz=rr.ViewCoordinates.RDF, image_plane_distance=plane
    )
    rr.log(f"{root}/camera", pinhole, static=True)
    for t_us, matrix in zip(scene.stamps_us, scene.pose(scene.stamps_us)):
        at(t_us)
        rr.log(f"{root}/camera", rr.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3]))
    for frame in scene.frames:
        at(frame.t_us)
        rr.log(f"{root}/camera/frame", rr.Image(frame.read()))
    for depth in scene.depths:
        at(depth.t_us)
        # Zero is "no depth" to the viewer, as NaN is in a release. A metre of the viewer is a unit of the scene.
        rr.log(f"{root}/camera/depth", rr.DepthImage(np.nan_to_num(depth.read()), meter=1.0))
    # A recipe without the output `events` has none.
    for t0_us in range(0, scene.duration_us if os.path.exists(scene.path) else 0, bin_us):
        at(t0_us + bin_us / 2)
        darker, brighter = scene.event_frame(t0_us, t0_us + bin_us)
        rr.log(f"{root}/camera/events", rr.Image(picture(darker, brighter)))
        count = int(darker.sum() + brighter.sum())
        rr.log(f"{root}/events_per_second", rr.Scalars(count / (bin_us * 1e-6)))


def at(t_us):
    rr.set_time("time", duration=float(t_us) * 1e-6)


def picture(darker, brighter):
    """uint8 [H, W, 3]: the polarity of most events of a pixel; red is brighter, blue is darker, white has no event."""
    shown = np.full((*brighter.shape, 3), 255, np.uint8)
    shown[brighter > darker] = (215, 25, 28)
    shown[darker > brighter] = (44, 80, 190)
    shown[(darker == brighter) & (darker > 0)] = (128, 128, 128)
    return shown


if __name__ == "__main__":
    main()
