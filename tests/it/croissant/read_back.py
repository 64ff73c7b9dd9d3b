# SPDX-License-Identifier: MIT OR Apache-2.0
"""read_back.py RELEASE: the release as mlcroissant and pyarrow read it; every record set, every record."""
import json
import logging
import os
import pathlib
import sys

import mlcroissant
import pyarrow.parquet

logging.disable(logging.CRITICAL)
os.chdir(sys.argv[1])
scenes = {str(path.parent): json.loads(path.read_text()) for path in pathlib.Path(".").rglob("scene.json")}
assert scenes

table = pyarrow.parquet.read_table("index.parquet")
rows = table.to_pylist()
assert [row["id"] for row in rows] == sorted(row["id"] for row in rows)
described = [part for scene in scenes.values() for part in scene["trajectories"]]
assert len(rows) == sum(max(1, len(part.get("sensors", {}))) for part in described)
for row in rows:
    scene = scenes[row["scene"]]
    assert row["licence"] == scene["licence"]["expression"] and row["seed"] == str(scene["seed"])
    (part,) = [part for part in scene["trajectories"] if part["name"] == row["trajectory"]]
    counted = part["sensors"][row["sensor"]] if row["sensor"] else part
    assert row["events"] == counted["statistics"]["events"]
    assert (row["frames"], row["duration_us"]) == (part["poses"], part["duration_us"])

dataset = mlcroissant.Dataset(jsonld="croissant.json")
issues = dataset.metadata.ctx.issues
assert not issues.errors and not issues.warnings, issues.report()
read = {}
for records in dataset.metadata.record_sets:
    read[records.uuid] = list(dataset.records(record_set=records.uuid))
plain = lambda value: value.decode() if isinstance(value, bytes) else value
splits = json.loads(pathlib.Path("manifest.json").read_text()).get("splits")
assert sorted(read) == ["index", "scenes"] + (["splits"] if splits else [])
if splits:
    assert [plain(record["splits/name"]) for record in read["splits"]] == sorted(splits["shares"])
assert len(read["index"]) == len(rows) and len(read["scenes"]) == len(scenes)
for record, row in zip(read["index"], rows):
    for column in table.column_names:
        found, wanted = plain(record[f"index/{column}"]), row[column]
        # What is null is None, or the NaN that pandas has for it.
        assert found == wanted or wanted is None and (found is None or found != found), (column, found, wanted)
for record in read["scenes"]:
    scene = scenes[plain(record["scenes/id"])]
    assert plain(record["scenes/licence"]) == scene["licence"]["expression"]
    assert record["scenes/width"] == scene["camera"]["width"] and record["scenes/fx"] == scene["camera"]["fx"]
