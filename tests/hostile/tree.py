"""Reads and changes the data of a release: events, pictures, arrays and tables.

Only Python's standard library is used, so the formats are written out below.
"""

import array
import json
import re
import struct
import subprocess
import zipfile
import zlib

from make import png

WIDTH, HEIGHT = 160, 120
# Columns of events and their types, by the codes of `array` and of NumPy.
EVENT_COLUMNS = dict(zip([*"txyp", "label"], "qHHBB"))
KINDS = {"q": "<i8", "H": "<u2", "B": "|u1"}


class Tree:
    """A copy of the release. Files are links to the same bytes, so a change replaces the file."""

    def __init__(self, program, root):
        self.program, self.root = program, root

    def run(self, *arguments):
        command = [self.program, *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, cwd=self.root, check=False)

    def read(self, name):
        return (self.root / name).read_bytes()

    def write(self, name, data):
        (self.root / name).unlink()
        (self.root / name).write_bytes(data)

    def files(self, folder):
        """The numbered files of a folder."""
        names = sorted(path.name for path in (self.root / folder).iterdir())
        return [f"{folder}/{name}" for name in names if re.fullmatch(r"\d+\.\w+", name)]

    def events(self, name, change):
        """Changes the events, lists of time, column, row, polarity and label, and sorts them."""
        packed = self.root / "events.npz"
        self.convert(name, packed)
        with zipfile.ZipFile(packed) as archive:
            columns = {part: archive.read(part + ".npy") for part in [*"txyp", "label", "size"]}
        numbers = [array.array(code, columns[part][128:]) for part, code in EVENT_COLUMNS.items()]
        end = int(self.read(name.partition("/events")[0] + "/timestamps_us.txt").split()[-1])
        changed = sorted(event for event in change([list(e) for e in zip(*numbers)]) if 0 <= event[0] <= end)
        with zipfile.ZipFile(packed, "w") as archive:
            for (part, code), values in zip(EVENT_COLUMNS.items(), zip(*changed)):
                archive.writestr(part + ".npy", npy(KINDS[code], len(values), array.array(code, values)))
            archive.writestr("size.npy", columns["size"])
        (self.root / name).unlink()
        self.convert(packed, name)
        packed.unlink()

    def convert(self, source, target):
        done = self.run("convert", "--lossy", source, target)
        if done.returncode:
            raise RuntimeError(done.stderr)

    def numbers(self, name, change):
        """Changes the numbers of an array of 32 bits, whose header has 128 bytes."""
        data = self.read(name)
        self.write(name, data[:128] + array.array("f", change(array.array("f", data[128:]))).tobytes())

    def lines(self, name, change):
        """Changes the columns of each line but the first; a line without columns is left out."""
        head, *lines = self.read(name).decode().splitlines()
        changed = filter(None, (change(i, line.split(",")) for i, line in enumerate(lines)))
        self.write(name, ("\n".join([head, *map(",".join, changed)]) + "\n").encode())

    def text(self, name, pattern, by):
        changed, count = re.subn(pattern, by, self.read(name).decode(), flags=re.MULTILINE)
        assert count, f"{name} has no {pattern}"
        self.write(name, changed.encode())

    def pictures(self, folder, change):
        for name in self.files(folder):
            self.write(name, write_png(change(read_png(self.read(name)))))

    def exchange(self, a, b):
        first, second = self.read(a), self.read(b)
        self.write(a, second)
        self.write(b, first)

    def findings(self):
        """Pairs of check and verdict for each failure and warning."""
        done = self.run("check", "--tree", ".", "--json")
        if done.returncode not in (0, 3):
            raise RuntimeError(done.stderr)
        found = set()
        for record in map(json.loads, done.stdout.splitlines()):
            if record["verdict"] in ("fail", "warn"):
                found.add((record["check"] + "#" + record["subject"].partition("#")[2], record["verdict"]))
        return sorted(found)


def npy(kind, count, values):
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({count},), }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + head.encode() + values.tobytes()


def chunks(data):
    at = 8
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        yield kind, data[at + 8:at + 8 + size]
        at += size + 12


def predicted(kind, a, b, c):
    """The predictor of PNG: left, above, their mean, or the nearest of three to their plane."""
    if kind < 4:
        return [0, a, b, (a + b) // 2][kind]
    return min((a, b, c), key=lambda value: abs(a + b - c - value))


def read_png(data):
    """The rows of a picture of 8 bits, and its number of channels."""
    parts = list(chunks(data))
    depth, colour = parts[0][1][8:10]
    channels = {0: 1, 2: 3}[colour]
    assert depth == 8
    raw = zlib.decompress(b"".join(part for kind, part in parts if kind == b"IDAT"))
    size, above, rows = WIDTH * channels, bytes(WIDTH * channels), []
    for start in range(0, len(raw), size + 1):
        kind, row = raw[start], bytearray(raw[start + 1:start + 1 + size])
        for i in range(size if kind else 0):
            a, c = (row[i - channels], above[i - channels]) if i >= channels else (0, 0)
            row[i] = row[i] + predicted(kind, a, above[i], c) & 255
        rows.append(bytes(row))
        above = rows[-1]
    return rows


def write_png(rows):
    colour = 2 if len(rows[0]) > WIDTH else 0
    grey = png(WIDTH, HEIGHT, b"".join(b"\0" + row for row in rows))
    header = struct.pack(">4s2I5B", b"IHDR", WIDTH, HEIGHT, 8, colour, 0, 0, 0)
    return grey[:12] + header + struct.pack(">I", zlib.crc32(header)) + grey[33:]
