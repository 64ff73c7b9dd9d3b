"""Writes the scene goldens: small files in compressed forms, and beside each what its numbers stand for.

Encoders and decoders are written from the formats' definitions (playcanvas/splat-transform: `compressed-chunk.ts`,
`decompress-ply.ts`, `write-sog.ts`, `read-sog.ts`), in NumPy's 64 bits. Seeds are fixed.
"""
import io
import json
import zipfile

import numpy as np
from PIL import Image

C0 = 0.28209479177387814
CHUNK = 256


def planted(n, degree, seed):
    """Gaussians: positions, log scales, unit quaternions w x y z, opacities, coefficients [n, functions, 3]."""
    draw = np.random.default_rng(seed)
    rotation = draw.normal(size=(n, 4))
    return {
        "position": draw.normal(size=(n, 3)) * [1.0, 20.0, 0.05] + [0.0, 3.0, -1.0],
        "log_scale": draw.uniform(-9.0, 1.0, size=(n, 3)),
        "rotation": rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
        "opacity": draw.choice([0.0, 1.0, 0.5, 0.003, 0.9], size=n) * draw.choice([1.0, 0.7], size=n),
        "sh": draw.normal(size=(n, (degree + 1) ** 2, 3)) * 0.8,
    }


def logit_of_byte(byte):
    b = np.clip(byte.astype(np.float64), 0.5, 254.5)
    return np.log(b / (255.0 - b))


def write_expected(name, position, log_scale, rotation, logit, sh):
    """The decoded scene as a plain .ply of floats, in the order of 3DGS, harmonics channel by channel."""
    n, functions, _ = sh.shape
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * (functions - 1))]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    rest = sh[:, 1:, :].transpose(0, 2, 1).reshape(n, -1)
    table = np.concatenate([position, sh[:, 0, :], rest, logit[:, None], log_scale, rotation], axis=1)
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {n}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    with open(name, "wb") as f:
        f.write(header.encode() + table.astype("<f4").tobytes())


def unorm(x, bits):
    top = (1 << bits) - 1
    return np.clip(np.floor(x * top + 0.5), 0, top).astype(np.uint32)


def smallest_three(rotation):
    """Index of the largest component, made positive, and the other three in order."""
    n = len(rotation)
    largest = np.argmax(np.abs(rotation), axis=1)
    signed = rotation * np.sign(rotation[np.arange(n), largest])[:, None]
    others = np.array([[k for k in range(4) if k != l] for l in largest])
    return largest, np.take_along_axis(signed, others, axis=1), others


def complete(largest, others, three):
    n = len(largest)
    rotation = np.zeros((n, 4))
    np.put_along_axis(rotation, others, three, axis=1)
    rotation[np.arange(n), largest] = np.sqrt(np.maximum(0.0, 1.0 - (three ** 2).sum(axis=1)))
    return rotation


def compressed_ply(name, scene, coloured):
    n, functions, _ = scene["sh"].shape
    chunks = -(-n // CHUNK)
    colour = scene["sh"][:, 0, :] * C0 + 0.5
    bounded = [scene["position"], scene["log_scale"]] + ([colour] if coloured else [])
    bounds = np.zeros((chunks, 6 * len(bounded)), dtype="<f4")
    shares, values = [], []
    for k, field in enumerate(bounded):
        share = np.zeros_like(field)
        for c in range(chunks):
            part = slice(CHUNK * c, CHUNK * (c + 1))
            low = field[part].min(axis=0).astype(np.float32)
            high = field[part].max(axis=0).astype(np.float32)
            bounds[c, 6 * k:6 * k + 3], bounds[c, 6 * k + 3:6 * k + 6] = low, high
            share[part] = (field[part] - low.astype(np.float64)) / (high.astype(np.float64) - low)
        shares.append(np.clip(share, 0.0, 1.0))
    if not coloured:
        shares.append(np.clip(colour, 0.0, 1.0))
    of = np.arange(n) // CHUNK
    words = np.zeros((n, 4), dtype="<u4")
    for k in (0, 1):
        bits = [unorm(shares[k][:, axis], b) for axis, b in enumerate((11, 10, 11))]
        words[:, (0, 2)[k]] = bits[0] << 21 | bits[1] << 11 | bits[2]
        share = np.stack([b / t for b, t in zip(bits, (2047.0, 1023.0, 2047.0))], axis=1)
        low, high = (bounds[of, 6 * k + 3 * e:6 * k + 3 * e + 3].astype(np.float64) for e in (0, 1))
        values.append(low * (1.0 - share) + high * share)
    largest, three, others = smallest_three(scene["rotation"])
    bits = [unorm(three[:, k] * np.sqrt(0.5) + 0.5, 10) for k in range(3)]
    words[:, 1] = largest.astype(np.uint32) << 30 | bits[0] << 20 | bits[1] << 10 | bits[2]
    rotation = complete(largest, others, (np.stack(bits, axis=1) / 1023.0 - 0.5) * np.sqrt(2.0))
    rgb, alpha = unorm(shares[2], 8), unorm(scene["opacity"], 8)
    words[:, 3] = rgb[:, 0] << 24 | rgb[:, 1] << 16 | rgb[:, 2] << 8 | alpha
    decoded = rgb / 255.0
    if coloured:
        low, high = (bounds[of, 12 + 3 * e:15 + 3 * e].astype(np.float64) for e in (0, 1))
        decoded = low * (1.0 - decoded) + high * decoded
    rest = scene["sh"][:, 1:, :].transpose(0, 2, 1).reshape(n, -1)
    rest = np.clip(np.floor((rest / 8.0 + 0.5) * 256.0), 0, 255).astype(np.uint8)
    share = np.where(rest == 0, 0.0, np.where(rest == 255, 1.0, (rest + 0.5) / 256.0))
    values_rest = ((share - 0.5) * 8.0).reshape(n, 3, functions - 1).transpose(0, 2, 1)
    kinds = ["", "scale_"]
    columns = [f"{end}_{kind}{axis}" for kind in kinds for end in ("min", "max") for axis in "xyz"]
    columns += [f"{end}_{channel}" for end in ("min", "max") for channel in "rgb"] if coloured else []
    header = f"ply\nformat binary_little_endian 1.0\ncomment by generate.py\nelement chunk {chunks}\n"
    header += "".join(f"property float {c}\n" for c in columns) + f"element vertex {n}\n"
    packed = ("position", "rotation", "scale", "color")
    header += "".join(f"property uint packed_{p}\n" for p in packed)
    if functions > 1:
        header += f"element sh {n}\n" + "".join(f"property uchar f_rest_{i}\n" for i in range(rest.shape[1]))
    with open(name, "wb") as f:
        f.write(header.encode() + b"end_header\n" + bounds.tobytes() + words.tobytes())
        f.write(rest.tobytes() if functions > 1 else b"")
    sh = np.concatenate([((decoded - 0.5) / C0)[:, None, :], values_rest], axis=1)
    write_expected(expected(name), values[0], values[1], rotation, logit_of_byte(alpha), sh)


def expected(name):
    return name.rsplit(".", 1)[0] + ".expected.ply"


def webp(pixels):
    out = io.BytesIO()
    mode = "RGBA" if pixels.shape[2] == 4 else "RGB"
    Image.fromarray(pixels, mode).save(out, "WEBP", lossless=True, exact=True, quality=100)
    return out.getvalue()


def picture(rows, size):
    """One pixel a row, row by row; what is left over is 255."""
    width, height = size
    pixels = np.full((height * width, rows.shape[1]), 255, dtype=np.uint8)
    pixels[:len(rows)] = rows
    return webp(pixels.reshape(height, width, -1))


def codebook(values):
    """256 quantiles as 32-bit numbers, and the nearest entry of each value."""
    book = np.quantile(values, np.linspace(0.0, 1.0, 256)).astype(np.float32).astype(np.float64)
    return book, np.abs(values[..., None] - book).argmin(axis=-1).astype(np.uint8)


def sog(name, scene, size, sets, antialias, method):
    n, functions, _ = scene["sh"].shape
    draw = np.random.default_rng(n)
    folded = np.sign(scene["position"]) * np.log1p(np.abs(scene["position"]))
    mins, maxs = folded.min(axis=0), folded.max(axis=0)
    bits = np.floor((folded - mins) / (maxs - mins) * 65535.0 + 0.5).astype(np.uint32)
    share = bits / 65535.0
    back = mins * (1.0 - share) + maxs * share
    position = np.sign(back) * np.expm1(np.abs(back))
    scales, scale_bytes = codebook(scene["log_scale"])
    colours, colour_bytes = codebook(scene["sh"][:, 0, :])
    alpha = np.floor(scene["opacity"] * 255.0 + 0.5).astype(np.uint8)
    largest, three, others = smallest_three(scene["rotation"])
    quats = np.floor((three * np.sqrt(2.0) * 0.5 + 0.5) * 255.0 + 0.5).astype(np.uint8)
    rotation = complete(largest, others, (quats / 255.0 * 2.0 - 1.0) / np.sqrt(2.0))
    rgba = lambda rgb, a: np.concatenate([rgb, np.asarray(a, np.uint8)[:, None]], axis=1)
    files = {
        "means_l.webp": picture((bits & 255).astype(np.uint8), size),
        "means_u.webp": picture((bits >> 8).astype(np.uint8), size),
        "scales.webp": picture(scale_bytes, size),
        "quats.webp": picture(rgba(quats, 252 + largest), size),
        "sh0.webp": picture(rgba(colour_bytes, alpha), size),
    }
    meta = {
        "version": 2,
        "asset": {"generator": "generate.py"},
        "count": n,
        "means": {"mins": mins.tolist(), "maxs": maxs.tolist(), "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scales.tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": colours.tolist(), "files": ["sh0.webp"]},
    }
    if antialias is not None:
        meta["antialias"] = antialias
    sh = [colours[colour_bytes][:, None, :]]
    if functions > 1:
        book, entries = codebook(draw.normal(size=(sets, functions - 1, 3)) * 0.3)
        labels = draw.integers(0, sets, size=n)
        labels[:2] = [0, sets - 1]
        rows = -(-sets // 64)
        palette = np.zeros((rows * 64, functions - 1, 3), dtype=np.uint8)
        palette[:sets] = entries
        files["shN_centroids.webp"] = webp(palette.reshape(rows, 64 * (functions - 1), 3))
        split = np.stack([labels & 255, labels >> 8, np.zeros(n, int)], axis=1).astype(np.uint8)
        files["shN_labels.webp"] = picture(split, size)
        meta["shN"] = {"count": sets, "bands": int(np.sqrt(functions)) - 1, "codebook": book.tolist(),
                       "files": ["shN_centroids.webp", "shN_labels.webp"]}
        sh.append(book[entries[labels]])
    files["meta.json"] = json.dumps(meta).encode()
    with zipfile.ZipFile(name, "w", method) as archive:
        for file, content in files.items():
            archive.writestr(zipfile.ZipInfo(file), content, compress_type=method)
    write_expected(expected(name), position, scales[scale_bytes], rotation, logit_of_byte(alpha),
                   np.concatenate(sh, axis=1))


compressed_ply("packed-coloured.ply", planted(300, 1, seed=1), coloured=True)
compressed_ply("packed-plain.ply", planted(7, 0, seed=2), coloured=False)
compressed_ply("packed-third-degree.ply", planted(5, 3, seed=3), coloured=True)
sog("palette.sog", planted(90, 2, seed=4), size=(12, 8), sets=70, antialias=True, method=zipfile.ZIP_DEFLATED)
sog("third-degree.sog", planted(20, 3, seed=5), size=(5, 4), sets=9, antialias=None, method=zipfile.ZIP_STORED)
sog("flat.sog", planted(10, 0, seed=6), size=(4, 4), sets=0, antialias=False, method=zipfile.ZIP_DEFLATED)
