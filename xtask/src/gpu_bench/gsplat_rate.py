"""Frames a second of gsplat's `rasterization` for the scene and the views of `cargo xtask bench gpu`.

    gsplat_rate.py FOLDER FRAMES      FOLDER holds scene.ply and views.json
    gsplat_rate.py --read FOLDER      reads both and prints their sizes, without gsplat

It prints one line of JSON. Without torch, gsplat or CUDA the line has `absent` with the reason.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np


def read_ply(path):
    """The vertices of a binary PLY of 32-bit floats, as a structured array."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:end].decode().splitlines()
    assert "format binary_little_endian 1.0" in header, header[:3]
    count = next(int(line.split()[2]) for line in header if line.startswith("element vertex "))
    names = [line.split()[2] for line in header if line.startswith("property float ")]
    return np.frombuffer(data, np.dtype([(name, "<f4") for name in names]), count, end)


def columns(rows, prefix, count):
    """`count` properties as columns."""
    return np.stack([rows[f"{prefix}{k}"] for k in range(count)], axis=1)


def read_scene(folder):
    """Arguments of `rasterization`, as arrays, and the degree of the harmonics."""
    rows = read_ply(folder / "scene.ply")
    rest = sum(name.startswith("f_rest_") for name in rows.dtype.names)
    degree = {0: 0, 9: 1, 24: 2, 45: 3}[rest]
    colours = columns(rows, "f_dc_", 3)[:, None, :]
    if rest:
        # The file has all coefficients of red, then of green, then of blue.
        others = columns(rows, "f_rest_", rest).reshape(len(rows), 3, rest // 3)
        colours = np.concatenate([colours, others.transpose(0, 2, 1)], axis=1)
    arrays = {
        "means": np.stack([rows["x"], rows["y"], rows["z"]], axis=1),
        "quats": columns(rows, "rot_", 4),
        "scales": np.exp(columns(rows, "scale_", 3)),
        "opacities": 1 / (1 + np.exp(-rows["opacity"])),
        "colors": colours,
    }
    return arrays, degree


def read_views(folder):
    found = json.loads((folder / "views.json").read_text())
    poses = np.array([view["camera_from_world"] for view in found["views"]], np.float32)
    cameras = np.array([view["k"] for view in found["views"]], np.float32)
    return found["width"], found["height"], poses, cameras


def measure(folder, frames):
    try:
        import gsplat
        import torch
    except ImportError as error:
        return {"absent": f"{error.name} is not installed"}
    if not torch.cuda.is_available():
        return {"absent": f"torch {torch.__version__} finds no CUDA"}
    arrays, degree = read_scene(folder)
    width, height, poses, cameras = read_views(folder)
    scene = {name: torch.from_numpy(np.ascontiguousarray(a)).float().cuda() for name, a in arrays.items()}
    poses, cameras = torch.from_numpy(poses).cuda(), torch.from_numpy(cameras).cuda()

    def render(frame):
        at = slice(frame % len(poses), frame % len(poses) + 1)
        picture, _, _ = gsplat.rasterization(
            **scene, viewmats=poses[at], Ks=cameras[at], width=width, height=height, sh_degree=degree, packed=False
        )
        return picture[0]

    with torch.no_grad():
        for frame in range(len(poses)):
            render(frame)
        rates = {}
        # On the device alone, and with the picture read by the host, as our renderer is measured.
        for name, read in [("on_device", lambda p: p), ("read_by_host", lambda p: p.cpu())]:
            torch.cuda.synchronize()
            begun = time.perf_counter()
            for frame in range(frames):
                read(render(frame))
            torch.cuda.synchronize()
            rates[name] = frames / (time.perf_counter() - begun)
    device = torch.cuda.get_device_name()
    return {"gsplat": gsplat.__version__, "torch": torch.__version__, "device": device, **rates}


def main():
    if sys.argv[1] == "--read":
        folder = Path(sys.argv[2])
        arrays, degree = read_scene(folder)
        width, height, poses, _ = read_views(folder)
        shapes = {name: list(array.shape) for name, array in arrays.items()}
        print(json.dumps({"degree": degree, "size": [width, height], "views": len(poses), **shapes}))
    else:
        print(json.dumps(measure(Path(sys.argv[1]), int(sys.argv[2]))))


main()
