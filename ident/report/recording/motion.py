"""A truck that moves on its path, seen from above: as it was measured and as models put it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from ident.report.condense import Array, Line, contiguous
from ident.report.outline import Outline
from ident.report.palette import DARK
from ident.report.poses import Poses
from ident.report.recording.parts import TIMELINE, rgb

SIDES = ("front_right", "front_left")
ABOVE = 0.05
"""How far above the ground what is simulated is drawn, so that it is seen [m]."""
HEIGHT_NEAR = 25.0
"""Of the eye above a truck that it follows [m]."""
POSE_PERIOD = 0.05
"""One pose of the truck is shown in each so many seconds [s]."""


def log_trucks(
    recording: rr.RecordingStream,
    root: str,
    found: Mapping[str, Poses],
    outline: Outline,
    roles: Mapping[str, str],
) -> None:
    """Log what stands still: the paths, and the outline of each truck in its own frame.

    Parameters
    ----------
    found : "measured" or the name of a model -> where it is; roles : the same -> colour
    """
    for way, pose in found.items():
        role = roles[way]
        recording.log(f"{root}/path/{way}", _strips(_path(pose), role), static=True, strict=True)
        truck = f"{root}/truck/{way}"
        recording.log(f"{truck}/body", _strips(outline.body, role), static=True, strict=True)
        for side in SIDES:
            recording.log(f"{truck}/{side}", _strips([outline.wheel], role), static=True, strict=True)


def send_trucks(
    recording: rr.RecordingStream,
    root: str,
    found: Mapping[str, Poses],
    outline: Outline,
    steering: Line,
    begin: float,
) -> None:
    """Send the trucks as they move, with their front wheels turned.

    Parameters
    ----------
    steering : angle of the road wheels [rad]
    begin : of the run [s]; each truck stands at its first known place until it moves
    """
    known = np.isfinite(steering.value)
    for way, pose in found.items():
        kept = _thinned(pose.time)
        time, truck = pose.time[kept], f"{root}/truck/{way}"
        time[0] = begin
        send_turned(recording, truck, time, pose.heading[kept], np.column_stack([pose.x, pose.y])[kept])
        angle = np.interp(time, steering.time[known], steering.value[known]) if known.any() else 0.0 * time
        for side, centre in zip(SIDES, outline.front_wheels, strict=True):
            send_turned(recording, f"{truck}/{side}", time, angle, np.tile(centre, (time.size, 1)))


def _strips(strips: Sequence[Array], role: str) -> rr.LineStrips3D:
    """Draw lines on the ground, those of a model thinner and above the measured ones."""
    height, width = (0.0, 2.2) if role == "measured" else (ABOVE, 1.1)
    flat = [np.column_stack([strip, np.full(len(strip), height)]) for strip in strips]
    return rr.LineStrips3D(flat, colors=[rgb(DARK[role])], radii=rr.Radius.ui_points(width))


def _path(pose: Poses) -> list[Array]:
    return [
        np.column_stack([pose.x[part], pose.y[part]])
        for part in contiguous(pose.time, pose.window if pose.window.size else None)
    ]


def _thinned(time: Array) -> NDArray[np.int_]:
    """Choose the first sample in each ``POSE_PERIOD``."""
    _, first = np.unique(np.floor((time - time[0]) / POSE_PERIOD + 1e-6), return_index=True)
    return first


def send_turned(recording: rr.RecordingStream, entity: str, time: Array, angle: Array, place: Array) -> None:
    """Send transforms: turned by (n,) angles [rad] about z, moved to (n, 2) places [m]."""
    zero = np.zeros(angle.size)
    turned = np.column_stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)])
    rr.send_columns(
        entity,
        indexes=[rr.TimeColumn(TIMELINE, duration=time)],
        columns=rr.Transform3D.columns(translation=np.column_stack([place, zero]), quaternion=turned),
        recording=recording,
        strict=True,
    )


def maps(root: str, found: Mapping[str, Poses]) -> rrb.Vertical:
    """Show the path from above with the truck near by below it."""
    return rrb.Vertical(_map(root, found, near=False), _map(root, found, near=True), name="path")


def _map(root: str, found: Mapping[str, Poses], *, near: bool) -> rrb.Spatial3DView:
    """Look from above: on the whole path, or near by at the truck, which the eye then follows."""
    x, y = (np.concatenate([getattr(pose, axis) for pose in found.values()]) for axis in ("x", "y"))
    middle = [(float(x.min()) + float(x.max())) / 2, (float(y.min()) + float(y.max())) / 2]
    height = HEIGHT_NEAR if near else max(HEIGHT_NEAR, 1.1 * float(max(np.ptp(x), np.ptp(y))))
    target = [float(x[0]), float(y[0])] if near else middle
    way = next(iter(found))
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=[*target, height],
        look_target=[*target, 0.0],
        eye_up=[0.0, 1.0, 0.0],
        tracking_entity=f"{root}/truck/{way}/body" if near else None,
    )
    return rrb.Spatial3DView(
        origin=root,
        contents=["$origin/path/**", "$origin/truck/**"],
        name="truck" if near else "path",
        background=rgb(DARK["surface"]),
        line_grid=rrb.LineGrid3D(visible=True, spacing=10.0 if not near else 1.0, color=rgb(DARK["grid"])),
        eye_controls=eye,
    )
