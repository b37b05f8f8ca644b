"""What a recording holds, read back without ident."""

import numpy as np
from rerun.chunk import RrdReader


def columns(path):
    """Give every signal of a recording: entity -> (time [s], values)."""
    found = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if "Scalars:scalars" in batch.schema.names:
            time = np.asarray(batch.column("time").cast("int64"), dtype=np.float64) / 1e9
            values = np.array([row[0] for row in batch.column("Scalars:scalars").to_pylist()])
            found.setdefault(chunk.entity_path, []).append((time, values))
    return {
        entity: tuple(np.concatenate([piece[axis] for piece in pieces]) for axis in (0, 1))
        for entity, pieces in found.items()
    }


def views(path):
    """Give the names of the views and tabs in the blueprint of a recording."""
    reader = RrdReader(str(path))
    names = []
    for chunk in reader.stream(store=reader.blueprints()[0]):
        batch = chunk.to_record_batch()
        for column in batch.schema.names:
            if column.endswith(":display_name"):
                names += [row[0] for row in batch.column(column).to_pylist() if row]
    return names


def moved(path, entity):
    """Give how a truck or a wheel moves: time [s], place (n, 3) [m], angle about z [rad]."""
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and "Transform3D:translation" in batch.schema.names:
            time = np.asarray(batch.column("time").cast("int64"), dtype=np.float64) / 1e9
            place = np.array([row[0] for row in batch.column("Transform3D:translation").to_pylist()])
            turned = np.array([row[0] for row in batch.column("Transform3D:quaternion").to_pylist()])
            return time, place, 2 * np.arctan2(turned[:, 2], turned[:, 3])
    raise AssertionError(f"nothing moves at {entity}")


def strips(path, entity):
    """Give the time [s], None where static, and the first strip of lines of every log of an entity."""
    found = []
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and "LineStrips3D:strips" in batch.schema.names:
            lines = batch.column("LineStrips3D:strips").to_pylist()
            timed = "time" in batch.schema.names
            times = np.asarray(batch.column("time").cast("int64")) / 1e9 if timed else [None] * len(lines)
            found += [(time, np.array(line[0])) for time, line in zip(times, lines, strict=True)]
    return found
