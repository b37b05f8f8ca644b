"""Magic Formula axle (2.7): F = D sin(C atan(B α - E (B α - atan(B α)))).

The parameters are the cornering stiffness K = B C D, the peak force D, the shape C and the curvature E, so
that the one which gentle driving tells stands alone: B = K/(C D). D, C and E are known only jointly until
the peak is excited.

Relations of the source: C = 2 - (2/π) asin(y_s/D) with y_s the force at very large slip, and
E = (B x_m - tan(π/(2 C)))/(B x_m - atan(B x_m)) with x_m the slip angle of the peak.
"""

from __future__ import annotations

import math

import sympy
from sympy import Expr

from ident.dynamics.parameter import Parameter
from ident.dynamics.tyres.linear import CORNERING_STIFFNESS
from ident.dynamics.tyres.tyre import Tyre

PEAK_FORCE = Parameter("peak_force", "N", 1e2, 1e7, 5e4, "D, the largest force of the axle")
SHAPE = Parameter("shape", "1", 0.5, 2.5, 1.35, "C, which sets the force at very large slip")
CURVATURE = Parameter("curvature", "1", -20.0, 1.0, -0.5, "E, which sets the slip angle of the peak")


def lateral_force(
    slip_angle: Expr,
    vertical_load: Expr,  # noqa: ARG001
    *,
    cornering_stiffness: Expr,
    peak_force: Expr,
    shape: Expr,
    curvature: Expr,
) -> Expr:
    """Force of the axle [N]."""
    stretched = cornering_stiffness / (shape * peak_force) * slip_angle
    bent = stretched - curvature * (stretched - sympy.atan(stretched))
    return peak_force * sympy.sin(shape * sympy.atan(bent))


MAGIC_FORMULA = Tyre("magic_formula", (CORNERING_STIFFNESS, PEAK_FORCE, SHAPE, CURVATURE), lateral_force)


def from_bcde(stiffness: float, shape: float, peak: float, curvature: float) -> dict[str, float]:
    """Our parameters from the source's B [1/rad], C, D [N] and E."""
    return {
        "cornering_stiffness": stiffness * shape * peak,
        "peak_force": peak,
        "shape": shape,
        "curvature": curvature,
    }


def to_bcde(
    *, cornering_stiffness: float, peak_force: float, shape: float, curvature: float
) -> tuple[float, float, float, float]:
    """The source's B [1/rad], C, D [N] and E from our parameters."""
    return cornering_stiffness / (shape * peak_force), shape, peak_force, curvature


def shape_from_sliding_force(sliding_force: float, peak_force: float) -> float:
    """C from the force y_s at very large slip [N] and the peak force D [N].

    Raises
    ------
    ValueError
        If the sliding force is not between zero and the peak force.
    """
    if not 0 <= sliding_force <= peak_force:
        raise ValueError(f"sliding force {sliding_force:g} N, need 0 to the peak force {peak_force:g} N")
    return 2.0 - 2.0 / math.pi * math.asin(sliding_force / peak_force)


def curvature_from_peak_slip(stiffness: float, shape: float, peak_slip: float) -> float:
    """E from B [1/rad], C and the slip angle x_m of the peak [rad].

    Raises
    ------
    ValueError
        If C is not above 1: then the force has no peak.
    """
    if shape <= 1:
        raise ValueError(f"shape {shape:g}, need above 1: below, the force grows without a peak")
    stretched = stiffness * peak_slip
    return (stretched - math.tan(math.pi / (2.0 * shape))) / (stretched - math.atan(stretched))
