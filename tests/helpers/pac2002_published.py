"""PAC2002 for one tyre in plain numbers, as published; shares nothing with the package.

H.B. Pacejka, Tyre and Vehicle Dynamics (2002), 4.3, and the Adams/Tire manual "Using the PAC2002 Tire Model";
names are those of the formulas there. Signs of the property file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan, cos, exp, pi, sin, sqrt, tan


@dataclass(frozen=True)
class Published:
    """Forces [N], moments [Nm] and what the formulas hold on the way."""

    fx0: float
    fy0: float
    mz0: float
    fx: float
    fy: float
    mz: float
    kx: float
    ky: float
    dx: float
    dy: float
    shx: float
    shy: float
    svx: float
    svy: float
    cx: float
    cy: float
    g_xa: float
    g_yk: float
    svyk: float
    trail: float


def sgn(x: float) -> float:
    """-1, 0 or 1."""
    return float((x > 0) - (x < 0))


def published(  # noqa: PLR0915 (the formulas of the book, one a line, in its order)
    p: Mapping[str, float], fz: float, alpha: float, kappa: float = 0.0, gamma: float = 0.0
) -> Published:
    """All forces of a tyre; ``p`` holds coefficients, scaling factors, FNOMIN, UNLOADED_RADIUS, PRESSURE."""
    fz0, r0, dp = p["FNOMIN"] * p["LFZO"], p["UNLOADED_RADIUS"], p["PRESSURE"]
    dfz = (fz - fz0) / fz0

    # pure longitudinal
    gx = gamma * p["LGAX"]
    shx = (p["PHX1"] + p["PHX2"] * dfz) * p["LHX"]
    kx_ = kappa + shx
    cx = p["PCX1"] * p["LCX"]
    mux = (p["PDX1"] + p["PDX2"] * dfz) * (1 + p["PPX3"] * dp + p["PPX4"] * dp * dp)
    mux *= (1 - p["PDX3"] * gx * gx) * p["LMUX"]
    dx = mux * fz
    ex = (p["PEX1"] + p["PEX2"] * dfz + p["PEX3"] * dfz * dfz) * (1 - p["PEX4"] * sgn(kx_)) * p["LEX"]
    ex = min(ex, 1.0)
    kx = fz * (p["PKX1"] + p["PKX2"] * dfz) * exp(p["PKX3"] * dfz)
    kx *= (1 + p["PPX1"] * dp + p["PPX2"] * dp * dp) * p["LKX"]
    bx = kx / (cx * dx)
    svx = fz * (p["PVX1"] + p["PVX2"] * dfz) * p["LVX"] * p["LMUX"]
    fx0 = dx * sin(cx * atan(bx * kx_ - ex * (bx * kx_ - atan(bx * kx_)))) + svx

    # pure lateral
    gy = gamma * p["LGAY"]
    shy = (p["PHY1"] + p["PHY2"] * dfz) * p["LHY"] + p["PHY3"] * gy * p["LKG"]
    ay = alpha + shy
    cy = p["PCY1"] * p["LCY"]
    muy = (p["PDY1"] + p["PDY2"] * dfz) * (1 + p["PPY3"] * dp + p["PPY4"] * dp * dp)
    muy *= (1 - p["PDY3"] * gy * gy) * p["LMUY"]
    dy = muy * fz
    ey = (p["PEY1"] + p["PEY2"] * dfz) * (1 - (p["PEY3"] + p["PEY4"] * gy) * sgn(ay)) * p["LEY"]
    ey = min(ey, 1.0)
    ky0 = p["PKY1"] * p["FNOMIN"] * (1 + p["PPY1"] * dp)
    ky0 *= sin(2 * atan(fz / (p["PKY2"] * fz0 * (1 + p["PPY2"] * dp)))) * p["LFZO"] * p["LKY"]
    ky = ky0 * (1 - p["PKY3"] * abs(gy))
    by = ky / (cy * dy)
    svy = fz * (p["PVY1"] + p["PVY2"] * dfz) * p["LVY"] * p["LMUY"]
    svy += fz * (p["PVY3"] + p["PVY4"] * dfz) * gy * p["LKG"] * p["LMUY"]
    fy0 = dy * sin(cy * atan(by * ay - ey * (by * ay - atan(by * ay)))) + svy

    # pure aligning
    gz = gamma * p["LGAZ"]
    at = alpha + p["QHZ1"] + p["QHZ2"] * dfz + (p["QHZ3"] + p["QHZ4"] * dfz) * gz
    bt = (p["QBZ1"] + p["QBZ2"] * dfz + p["QBZ3"] * dfz * dfz) * (1 + p["QBZ4"] * gz + p["QBZ5"] * abs(gz))
    bt *= p["LKY"] / p["LMUY"]
    ct = p["QCZ1"]
    dt = fz * (p["QDZ1"] + p["QDZ2"] * dfz) * (1 - p["QPZ1"] * dp)
    dt *= (1 + p["QDZ3"] * gz + p["QDZ4"] * gz * gz) * r0 / fz0 * p["LTR"]
    et = p["QEZ1"] + p["QEZ2"] * dfz + p["QEZ3"] * dfz * dfz
    et = min(et * (1 + (p["QEZ4"] + p["QEZ5"] * gz) * 2 / pi * atan(bt * ct * at)), 1.0)
    ar = alpha + shy + svy / ky
    br = p["QBZ9"] * p["LKY"] / p["LMUY"] + p["QBZ10"] * by * cy
    dr = (p["QDZ6"] + p["QDZ7"] * dfz) * p["LRES"]
    dr = fz * (dr + (p["QDZ8"] + p["QDZ9"] * dfz) * (1 + p["QPZ2"] * dp) * gz) * r0 * p["LMUY"]
    trail = dt * cos(ct * atan(bt * at - et * (bt * at - atan(bt * at)))) * cos(alpha)
    mz0 = -trail * fy0 + dr * cos(atan(br * ar)) * cos(alpha)

    # combined longitudinal
    bxa = p["RBX1"] * cos(atan(p["RBX2"] * kappa)) * p["LXAL"]
    exa = min(p["REX1"] + p["REX2"] * dfz, 1.0)
    sxa, as_ = p["RHX1"], alpha + p["RHX1"]
    above = cos(p["RCX1"] * atan(bxa * as_ - exa * (bxa * as_ - atan(bxa * as_))))
    g_xa = above / cos(p["RCX1"] * atan(bxa * sxa - exa * (bxa * sxa - atan(bxa * sxa))))
    fx = g_xa * fx0

    # combined lateral
    byk = p["RBY1"] * cos(atan(p["RBY2"] * (alpha - p["RBY3"]))) * p["LYKA"]
    eyk = min(p["REY1"] + p["REY2"] * dfz, 1.0)
    syk = p["RHY1"] + p["RHY2"] * dfz
    ks = kappa + syk
    above = cos(p["RCY1"] * atan(byk * ks - eyk * (byk * ks - atan(byk * ks))))
    g_yk = above / cos(p["RCY1"] * atan(byk * syk - eyk * (byk * syk - atan(byk * syk))))
    dvyk = muy * fz * (p["RVY1"] + p["RVY2"] * dfz + p["RVY3"] * gamma) * cos(atan(p["RVY4"] * alpha))
    svyk = dvyk * sin(p["RVY5"] * atan(p["RVY6"] * kappa)) * p["LVYKA"]
    fy = g_yk * fy0 + svyk

    # combined aligning
    ate = atan(sqrt(tan(at) ** 2 + (kx / ky) ** 2 * kappa**2)) * sgn(at)
    are = atan(sqrt(tan(ar) ** 2 + (kx / ky) ** 2 * kappa**2)) * sgn(ar)
    t = dt * cos(ct * atan(bt * ate - et * (bt * ate - atan(bt * ate)))) * cos(alpha)
    s = p["SSZ1"] + p["SSZ2"] * fy / fz0 + (p["SSZ3"] + p["SSZ4"] * dfz) * gamma
    mz = -t * (fy - svyk) + dr * cos(atan(br * are)) * cos(alpha) + s * r0 * p["LS"] * fx

    return Published(
        fx0, fy0, mz0, fx, fy, mz, kx, ky, dx, dy, shx, shy, svx, svy, cx, cy, g_xa, g_yk, svyk, trail
    )
