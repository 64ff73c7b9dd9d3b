"""Makes the files that a stranger might send: `make.py KIND` writes them into the current folder.

    capture             capture/: six photos of 64x48 with poses, and the Gaussians of the scene
    picture             frames/: two PNGs, each a header of 65535x65535
    scene               in.sog: one Gaussian in images of 16383x16383
    events              in.npz: 30,000,000 events at one time
    index               index.parquet: 3,000,000 rows, all equal
    sensor              in.h5: an event file that is there, with a sensor of 65535x65535 in place of 346x260
    link FILE OBJECT    in.h5: the stream is a link to an object in another file

Only Python's standard library is used, so the formats are written out below.
"""

import json
import math
import pathlib
import struct
import sys
import zipfile
import zlib

GAUSSIAN = ("x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3").split()


def png(width, height, data):
    """A grey PNG, without its end if `data` is empty."""
    header = struct.pack(">2I5B", width, height, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header)] + ([(b"IDAT", zlib.compress(data)), (b"IEND", b"")] if data else [])
    framed = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(framed)


def capture():
    root = pathlib.Path("capture")
    (root / "images").mkdir(parents=True)
    rows = []
    for i in range(40):
        shade = i % 5 - 2
        rows += [(i - 20) / 10, shade / 10, 0, shade, -shade, 0.5, 2, -2.5, -2, -2.5, 1, 0, 0, 0]
    header = "".join(f"property float {name}\n" for name in GAUSSIAN)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex 40\n{header}end_header\n"
    (root / "scene.ply").write_bytes(header.encode() + struct.pack(f"<{len(rows)}f", *rows))
    frames = []
    for i in range(6):
        name, sin, cos = f"images/{i}.png", math.sin(0.002 * i), math.cos(0.002 * i)
        (root / name).write_bytes(png(64, 48, bytes([0] + [10 + i] * 64) * 48))
        pose = [[cos, 0, sin, 4 * sin], [0, 1, 0, 0], [-sin, 0, cos, 4 * cos], [0, 0, 0, 1]]
        frames.append({"file_path": name, "transform_matrix": pose})
    camera = {"w": 64, "h": 48, "fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24}
    (root / "transforms.json").write_text(json.dumps(camera | {"frames": frames}))


def picture():
    root = pathlib.Path("frames")
    root.mkdir()
    for i in range(2):
        (root / f"{i}.png").write_bytes(png(65535, 65535, b""))


def webp(side, colour):
    """A lossless WebP of one colour (green, red, blue, alpha): each code has one symbol, of no bits."""
    bits, count = side - 1 | side - 1 << 14 | 1 << 28, 32
    # No transform, no colour cache, no meta codes; then codes of the form: simple, one symbol, of 8 bits.
    count += 3
    for symbol in colour:
        bits |= (0b101 | symbol << 3) << count
        count += 11
    # The code of distances: simple, one symbol, of one bit.
    bits |= 0b0001 << count
    data = b"\x2f" + bits.to_bytes(count // 8 + 2, "little")
    data += b"\0" * (len(data) % 2)
    return b"RIFF" + struct.pack("<I", len(data) + 12) + b"WEBPVP8L" + struct.pack("<I", len(data)) + data


def scene():
    codebook = [i / 64 for i in range(256)]
    meta = {
        "version": 2, "count": 1,
        "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["l.webp", "u.webp"]},
        "scales": {"codebook": codebook, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]}, "sh0": {"codebook": codebook, "files": ["sh0.webp"]},
    }
    with zipfile.ZipFile("in.sog", "w") as archive:
        for name in ["l", "u", "scales", "quats", "sh0"]:
            colour = (128, 128, 128, 252) if name == "quats" else (7, 7, 7, 255)
            # Bytes after the image make it look incompressible.
            archive.writestr(f"{name}.webp", webp(16383, colour) + bytes(900_000))
        archive.writestr("meta.json", json.dumps(meta))


def events(count=30_000_000):
    with zipfile.ZipFile("in.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, kind, size in [("t", "<i8", 8), ("x", "<u2", 2), ("y", "<u2", 2), ("p", "|u1", 1)]:
            head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({count},), }}"
            with archive.open(f"{name}.npy", "w") as file:
                file.write(b"\x93NUMPY\x01\x00\x76\x00" + head.ljust(117).encode() + b"\n")
                for _ in range(30):
                    file.write(bytes(size * count // 30))


def sensor():
    path = pathlib.Path("in.h5")
    data = path.read_bytes()
    for name, size in [(b"width", 346), (b"height", 260)]:
        at = data.index(struct.pack("<I", size), data.index(name))
        data = data[:at] + struct.pack("<I", 65535) + data[at + 4:]
    path.write_bytes(data)


def varint(number):
    out = b""
    while number > 127:
        out, number = out + bytes([number & 127 | 128]), number >> 7
    return out + bytes([number])


def thrift(value):
    """A value in Thrift's compact protocol, with its type: int, str, list, or struct as a dict of field ids."""
    if isinstance(value, int):
        return 5 + (value > 1 << 30), varint(value << 1)
    if isinstance(value, str):
        return 8, varint(len(value)) + value.encode()
    if isinstance(value, list):
        items = [thrift(item) for item in value]
        return 9, bytes([len(items) << 4 | items[0][0]]) + b"".join(data for _, data in items)
    out, last = b"", 0
    for key, item in value.items():
        kind, data = thrift(item)
        out, last = out + bytes([key - last << 4 | kind]) + data, key
    return 12, out + b"\0"


def index(rows=3_000_000):
    """Ten columns of texts, each a dictionary of one text and one run of its number."""
    file, columns = b"PAR1", []
    for i in range(10):
        start = len(file)
        for page in [{"text": b"\1\0\0\0a"}, {"run": b"\1" + varint(rows << 1) + b"\0"}]:
            (kind, data), = page.items()
            about = {7: {1: 1, 2: 0}} if kind == "text" else {5: {1: rows, 2: 8, 3: 3, 4: 3}}
            head = thrift({1: 2 if kind == "text" else 0, 2: len(data), 3: len(data)} | about)[1]
            page_start, file = len(file), file + head + data
        size = len(file) - start
        columns.append({2: start, 3: {1: 6, 2: [0, 3, 8], 3: [f"c{i}"], 4: 0, 5: rows, 6: size, 7: size,
                                      9: page_start, 11: start}})
    schema = [{4: "rows", 5: 10}] + [{1: 6, 3: 0, 4: f"c{i}", 6: 0} for i in range(10)]
    group = {1: columns, 2: len(file) - 4, 3: rows}
    foot = thrift({1: 1, 2: schema, 3: rows, 4: [group]})[1]
    pathlib.Path("index.parquet").write_bytes(file + foot + struct.pack("<I", len(foot)) + b"PAR1")


def link(target, inside):
    """An HDF5 file whose root group has external links and nothing else."""
    none = b"\xff" * 8

    def message(kind, data):
        data += bytes(-len(data) % 8)
        return struct.pack("<HHI", kind, len(data), 0) + data

    messages = [message(2, b"\0\0" + none + none), message(10, b"\0\0")]
    # The size of the sensor: attributes of one unsigned number of 32 bits.
    for name, value in [(b"width", 64), (b"height", 48)]:
        form = bytes([0x10, 0, 0, 0, 4, 0, 0, 0, 0, 0, 32, 0, 0, 0, 0, 0]) + b"\1" + bytes(7)
        data = struct.pack("<4H", 1, len(name) + 1, 12, 8) + name.ljust(8, b"\0") + form
        messages.append(message(12, data + struct.pack("<I", value)))
    for name in ["events", "ms_to_idx", "t_offset"]:
        way = b"\0" + target.encode() + b"\0" + f"{inside}/{name}".encode() + b"\0"
        messages.append(message(6, b"\1\x08\x40" + bytes([len(name)]) + name.encode()
                                + struct.pack("<H", len(way)) + way))
    body = b"".join(messages)
    header = struct.pack("<BBHIII", 1, 0, len(messages), 1, len(body), 0) + body
    superblock = b"\x89HDF\r\n\x1a\n" + struct.pack("<8BHHI", 0, 0, 0, 0, 0, 8, 8, 0, 4, 16, 0)
    superblock += bytes(8) + none + struct.pack("<Q", 96 + len(header)) + none
    superblock += struct.pack("<QQII", 0, 96, 0, 0) + bytes(16)
    pathlib.Path("in.h5").write_bytes(superblock + header)


if __name__ == "__main__":
    kinds = [capture, picture, scene, events, sensor, index, link]
    {kind.__name__: kind for kind in kinds}[sys.argv[1]](*sys.argv[2:])
