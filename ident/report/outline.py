"""The truck seen from above, in the frame of the point that its logged positions belong to.

x forward, y left [m]. Only the axles are known; cab, wheels and width are those of any heavy truck, smaller
for a vehicle whose axles are nearer to each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.report.condense import Array
from ident.results import TyresResult

FRONT_OVERHANG, REAR_OVERHANG, WIDTH = 1.4, 1.1, 2.5
WHEEL_LENGTH, WHEEL_WIDTH, TRACK = 1.0, 0.35, 2.0
USUAL_WHEELBASE = 3.6
"""From here on a truck has its full width [m]."""
CAB = 1.9
"""Length of the cab [m]."""
AXLES = (2.3, 2.1)
"""Where nothing tells: CG to front and to rear axle [m]."""


@dataclass(frozen=True)
class Outline:
    """Lines of (n, 2) points: the body with its rear wheels, one wheel about its own centre, where such are.

    front_wheels : (2, 2) centres of the steered wheels
    """

    body: list[Array]
    wheel: Array
    front_wheels: Array


def outline_of(result: TyresResult, run: str) -> Outline:
    """Draw the truck of a run about the point that its positions belong to; the CG where nothing tells."""
    told = (result.fixed.get("cg_to_front_axle"), result.fixed.get("cg_to_rear_axle"))
    front, rear = (given.value if given else usual for given, usual in zip(told, AXLES, strict=True))
    points = [one.reference_x for one in result.by_run if one.run == run and one.reference_x is not None]
    return outline(front, rear, points[0] if points else 0.0)


def outline_from(geometry: Mapping[str, float]) -> Outline:
    """Draw the truck of an evaluation; what is not known of it is as usual.

    Parameters
    ----------
    geometry : cg_to_front_axle, cg_to_rear_axle, reference_x [m]
    """
    front, rear = (
        geometry.get(name, usual)
        for name, usual in zip(("cg_to_front_axle", "cg_to_rear_axle"), AXLES, strict=True)
    )
    return outline(front, rear, geometry.get("reference_x", 0.0))


def outline(front: float, rear: float, reference_x: float) -> Outline:
    """Draw a truck.

    Parameters
    ----------
    front, rear : distance of the axles from the CG [m]
    reference_x : of the origin, from the CG [m]
    """
    ahead, behind = front - reference_x, -rear - reference_x
    scale = min(1.0, (front + rear) / USUAL_WHEELBASE)
    nose, tail = ahead + scale * FRONT_OVERHANG, behind - scale * REAR_OVERHANG
    right, left = -scale * WIDTH / 2, scale * WIDTH / 2
    body, cab = (
        _box(tail, nose, right, left),
        np.array([[nose - scale * CAB, right], [nose - scale * CAB, left]]),
    )
    wheel = scale * _box(-WHEEL_LENGTH / 2, WHEEL_LENGTH / 2, -WHEEL_WIDTH / 2, WHEEL_WIDTH / 2)
    sides = scale * np.array([-TRACK / 2, TRACK / 2])
    rear_wheels = [wheel + np.array([behind, side]) for side in sides]
    return Outline([body, cab, *rear_wheels], wheel, np.column_stack([np.full(2, ahead), sides]))


def _box(back: float, front: float, right: float, left: float) -> Array:
    return np.array([[back, right], [front, right], [front, left], [back, left], [back, right]])
