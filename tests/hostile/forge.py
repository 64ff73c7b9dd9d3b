"""Rewrites every digest of a release after a change: `manifest.json`, `B3SUMS` and `SHA256SUMS`.

    forge.py seal DIR                  rewrites the digests
    forge.py set FILE POINTER VALUE    sets a value of a JSON file, `VALUE` in JSON

Only Python's standard library is used, so BLAKE3 is written out below.
"""

import hashlib
import json
import pathlib
import re
import struct
import sys

SUMS = ["B3SUMS", "SHA256SUMS"]
IV = (0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A, 0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19)
ORDER = (2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8)
LANES = [(0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
         (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14)]
START, END, PARENT, ROOT = 1, 2, 4, 8


def compress(value, block, counter, length, flags):
    """The compression function of BLAKE3, for one block of 64 bytes."""
    words = struct.unpack("<16I", block)
    v = [*value, *IV[:4], counter, 0, length, flags]
    for _ in range(7):
        for (a, b, c, d), x, y in zip(LANES, words[::2], words[1::2]):
            for word, right, left in [(x, 16, 12), (y, 8, 7)]:
                v[a] = v[a] + v[b] + word & 0xFFFFFFFF
                v[d] ^= v[a]
                v[d] = (v[d] >> right | v[d] << 32 - right) & 0xFFFFFFFF
                v[c] = v[c] + v[d] & 0xFFFFFFFF
                v[b] ^= v[c]
                v[b] = (v[b] >> left | v[b] << 32 - left) & 0xFFFFFFFF
        words = [words[i] for i in ORDER]
    return [v[i] ^ v[i + 8] for i in range(8)]


def chunk(data, counter, root):
    """The value of at most 1,024 bytes."""
    value = IV
    blocks = range(0, max(len(data), 1), 64)
    for at in blocks:
        block = data[at:at + 64]
        flags = (START if at == 0 else 0) | (END | root if at == blocks[-1] else 0)
        value = compress(value, block.ljust(64, b"\0"), counter, len(block), flags)
    return value


def subtree(data, first, root):
    """The value of data whose first chunk has the number `first`."""
    if len(data) <= 1024:
        return chunk(data, first, root)
    # The left side has the largest power of two of chunks that leaves something for the right.
    left = 1 << ((len(data) - 1) // 1024).bit_length() - 1
    sides = subtree(data[:left * 1024], first, 0) + subtree(data[left * 1024:], first + left, 0)
    return compress(IV, struct.pack("<16I", *sides), 0, 64, PARENT | root)


def blake3(data):
    return struct.pack("<8I", *subtree(data, 0, ROOT)).hex()


def files(root):
    """The paths of all files, sorted by their bytes."""
    below = (p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file() or p.is_symlink())
    return sorted((path for path in below if path not in SUMS), key=str.encode)


def read_sums(root, name):
    lines = (root / name).read_text().splitlines()
    return {path: digest for digest, path in (line.split("  ", 1) for line in lines)}


class Digests:
    """The BLAKE3 of a tree's files. A file with the SHA-256 that was listed has the BLAKE3 that was listed."""

    def __init__(self, root):
        self.root = root
        self.sha256, self.blake3 = read_sums(root, "SHA256SUMS"), read_sums(root, "B3SUMS")

    @staticmethod
    def sha256_of(path):
        return hashlib.sha256(path.read_bytes()).hexdigest()

    def is_listed(self, name):
        path = self.root / name
        return path.exists() and self.sha256.get(name) == self.sha256_of(path)

    def of(self, name):
        return self.blake3[name] if self.is_listed(name) else blake3((self.root / name).read_bytes())


def read_json(path):
    """The values of a file, and its fractions as they are written there."""
    return json.loads(path.read_text(), parse_float=lambda number: f"\0{number}\0")


def write_json(path, value):
    text = json.dumps(value, indent=2, ensure_ascii=False)
    path.write_text(re.sub(r'"\\u0000(.*?)\\u0000"', r"\1", text) + "\n")


def seal_manifest(root, digests):
    path = root / "manifest.json"
    manifest = read_json(path)
    rest = [name for name in files(root) if name != "manifest.json"]

    def listed(name):
        return {"path": name, "size": (root / name).stat().st_size, "blake3": digests.of(name)}

    for scene in manifest["scenes"]:
        own = [name for name in rest if name.startswith(scene["id"] + "/")]
        rest = [name for name in rest if name not in own]
        before = {file["path"]: file["blake3"] for file in scene["files"]}
        scene["files"] = [listed(name) for name in own]
        after = {before.get(file["path"]): file for file in scene["files"]}
        for output in (output for step in scene["steps"] for output in step["outputs"]):
            if output["digest"] in after:
                file = after[output["digest"]]
                output["digest"], output["size"] = file["blake3"], file["size"]
    manifest["files"] = [listed(name) for name in rest]
    write_json(path, manifest)


def seal_catalogue(root, digests):
    """Updates what `croissant.json` states of an index that was changed."""
    index, path = root / "index.parquet", root / "croissant.json"
    if digests.is_listed("index.parquet") or not index.exists() or not path.exists():
        return
    catalogue = read_json(path)
    node = next(node for node in catalogue["distribution"] if node["@id"] == "index.parquet")
    node["sha256"], node["contentSize"] = digests.sha256_of(index), f"{index.stat().st_size} B"
    write_json(path, catalogue)


def seal(root):
    digests = Digests(root)
    seal_catalogue(root, digests)
    if (root / "manifest.json").exists():
        seal_manifest(root, digests)
    (root / "B3SUMS").write_text("".join(f"{digests.of(name)}  {name}\n" for name in files(root)))
    listed = sorted([*files(root), "B3SUMS"], key=str.encode)
    (root / "SHA256SUMS").write_text("".join(f"{digests.sha256_of(root / name)}  {name}\n" for name in listed))


def put(path, pointer, value):
    document = read_json(path)
    *way, last = (int(key) if key.isdigit() else key for key in pointer.strip("/").split("/"))
    place = document
    for key in way:
        place = place[key]
    place[last] = json.loads(value)
    write_json(path, document)


if __name__ == "__main__":
    verb, target, *rest = sys.argv[1:]
    {"seal": seal, "set": put}[verb](pathlib.Path(target), *rest)
