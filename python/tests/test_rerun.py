"""The example that shows a release in rerun: its recording is read back."""

import pathlib
import subprocess
import sys

import numpy as np
import pytest

import gs2e

EXAMPLE = pathlib.Path(__file__).parents[2] / "examples/rerun_release.py"


def columns(path):
    """Rows that have a time, by entity: the times in nanoseconds, and each component by its name."""
    chunk = pytest.importorskip("rerun.chunk")
    found = {}
    for part in chunk.RrdReader(path).stream().to_chunks():
        if part.is_static:
            continue
        batch = part.to_record_batch()
        names = [name for name in batch.schema.names if name == "time" or ":" in name]
        entity = found.setdefault(part.entity_path, {})
        for name in names:
            column = batch.column(batch.schema.names.index(name))
            values = column.cast("int64").to_pylist() if name == "time" else column.to_pylist()
            entity.setdefault(name, []).extend(values)
    return found


def test_a_recording_has_the_release_on_one_time_line(release, tmp_path):
    pytest.importorskip("rerun")
    recording = tmp_path / "one.rrd"
    words = [EXAMPLE, release, "--save", recording, "--bin-us", "2000"]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = columns(recording)
    for scene in gs2e.open(release):
        root = f"/{scene.description['id']}/{scene.trajectory}"
        camera = found[f"{root}/camera"]
        assert camera["time"] == [1000 * t for t in scene.stamps_us.tolist()]
        [first] = camera["Transform3D:translation"][0]
        np.testing.assert_allclose(first, scene.poses[0, :3], rtol=1e-6)
        # Matrices are stored by columns.
        [matrix] = camera["Transform3D:mat3x3"][-1]
        np.testing.assert_allclose(np.reshape(matrix, (3, 3)).T, scene.pose(scene.duration_us)[:3, :3], atol=1e-6)
        frames = found[f"{root}/camera/frame"]
        assert frames["time"] == [1000 * frame.t_us for frame in scene.frames]
        [image] = frames["Image:buffer"][-1]
        assert bytes(image) == scene.frames[-1].read().tobytes()
        assert found[f"{root}/camera/depth"]["time"] == [1000 * depth.t_us for depth in scene.depths]
        rates = [rate for [rate] in found[f"{root}/events_per_second"]["Scalars:scalars"]]
        assert sum(rates) * 2e-3 == pytest.approx(len(scene.events(0, 2000 * len(rates)).t), rel=1e-9)
        assert len(found[f"{root}/camera/events"]["time"]) == len(rates) > 5
