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


@dataclass(frozen=True)
class _At:
    """Where the tyre is: load [N], its relative change, slips, camber."""

    fz: float
    fz0: float
    dfz: float
    alpha: float
    kappa: float
    gamma: float


def published(
    p: Mapping[str, float], fz: float, alpha: float, kappa: float = 0.0, gamma: float = 0.0
) -> Published:
    """All forces of a tyre; ``p`` holds coefficients, scaling factors, FNOMIN, UNLOADED_RADIUS, PRESSURE."""
    fz0 = p["FNOMIN"] * p["LFZO"]
    at = _At(fz, fz0, (fz - fz0) / fz0, alpha, kappa, gamma)
    pure = _longitudinal(p, at) | _lateral(p, at)
    pure |= _aligning(p, at, pure)
    return Published(**pure, **_combined(p, at, pure))


def _longitudinal(p: Mapping[str, float], at: _At) -> dict[str, float]:
    fz, dfz, dp = at.fz, at.dfz, p["PRESSURE"]
    gx = at.gamma * p["LGAX"]
    shx = (p["PHX1"] + p["PHX2"] * dfz) * p["LHX"]
    kx_ = at.kappa + shx
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
    return {"fx0": fx0, "kx": kx, "dx": dx, "shx": shx, "svx": svx, "cx": cx}


def _lateral(p: Mapping[str, float], at: _At) -> dict[str, float]:
    fz, fz0, dfz, dp = at.fz, at.fz0, at.dfz, p["PRESSURE"]
    gy = at.gamma * p["LGAY"]
    shy = (p["PHY1"] + p["PHY2"] * dfz) * p["LHY"] + p["PHY3"] * gy * p["LKG"]
    ay = at.alpha + shy
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
    return {"fy0": fy0, "ky": ky, "dy": dy, "shy": shy, "svy": svy, "cy": cy}


def _moment(
    p: Mapping[str, float], at: _At, pure: Mapping[str, float], along: float | None = None
) -> tuple[float, float]:
    """Trail t [m] and residual moment M_zr [Nm]; ``along`` = K_x/K_y kappa under combined slip."""
    fz, fz0, dfz, alpha, dp = at.fz, at.fz0, at.dfz, at.alpha, p["PRESSURE"]
    gz, r0 = at.gamma * p["LGAZ"], p["UNLOADED_RADIUS"]
    a_t = alpha + p["QHZ1"] + p["QHZ2"] * dfz + (p["QHZ3"] + p["QHZ4"] * dfz) * gz
    bt = (p["QBZ1"] + p["QBZ2"] * dfz + p["QBZ3"] * dfz * dfz) * (1 + p["QBZ4"] * gz + p["QBZ5"] * abs(gz))
    bt *= p["LKY"] / p["LMUY"]
    ct = p["QCZ1"]
    dt = fz * (p["QDZ1"] + p["QDZ2"] * dfz) * (1 - p["QPZ1"] * dp)
    dt *= (1 + p["QDZ3"] * gz + p["QDZ4"] * gz * gz) * r0 / fz0 * p["LTR"]
    et = p["QEZ1"] + p["QEZ2"] * dfz + p["QEZ3"] * dfz * dfz
    et = min(et * (1 + (p["QEZ4"] + p["QEZ5"] * gz) * 2 / pi * atan(bt * ct * a_t)), 1.0)
    ar = alpha + pure["shy"] + pure["svy"] / pure["ky"]
    br = p["QBZ9"] * p["LKY"] / p["LMUY"] + p["QBZ10"] * pure["ky"] / pure["dy"]
    dr = (p["QDZ6"] + p["QDZ7"] * dfz) * p["LRES"]
    dr = fz * (dr + (p["QDZ8"] + p["QDZ9"] * dfz) * (1 + p["QPZ2"] * dp) * gz) * r0 * p["LMUY"]
    te, re = a_t, ar
    if along is not None:
        te, re = (atan(sqrt(tan(x) ** 2 + along**2)) * sgn(x) for x in (a_t, ar))
    trail = dt * cos(ct * atan(bt * te - et * (bt * te - atan(bt * te)))) * cos(alpha)
    return trail, dr * cos(atan(br * re)) * cos(alpha)


def _aligning(p: Mapping[str, float], at: _At, pure: Mapping[str, float]) -> dict[str, float]:
    trail, residual = _moment(p, at, pure)
    return {"trail": trail, "mz0": -trail * pure["fy0"] + residual}


def _combined(p: Mapping[str, float], at: _At, pure: Mapping[str, float]) -> dict[str, float]:
    alpha, kappa, dfz = at.alpha, at.kappa, at.dfz

    bxa = p["RBX1"] * cos(atan(p["RBX2"] * kappa)) * p["LXAL"]
    exa = min(p["REX1"] + p["REX2"] * dfz, 1.0)
    g_xa = _weight(alpha, p["RHX1"], bxa, p["RCX1"], exa)
    fx = g_xa * pure["fx0"]

    byk = p["RBY1"] * cos(atan(p["RBY2"] * (alpha - p["RBY3"]))) * p["LYKA"]
    eyk = min(p["REY1"] + p["REY2"] * dfz, 1.0)
    g_yk = _weight(kappa, p["RHY1"] + p["RHY2"] * dfz, byk, p["RCY1"], eyk)
    dvyk = pure["dy"] * (p["RVY1"] + p["RVY2"] * dfz + p["RVY3"] * at.gamma) * cos(atan(p["RVY4"] * alpha))
    svyk = dvyk * sin(p["RVY5"] * atan(p["RVY6"] * kappa)) * p["LVYKA"]
    fy = g_yk * pure["fy0"] + svyk

    trail, residual = _moment(p, at, pure, pure["kx"] / pure["ky"] * kappa)
    s = p["SSZ1"] + p["SSZ2"] * fy / at.fz0 + (p["SSZ3"] + p["SSZ4"] * dfz) * at.gamma
    mz = -trail * (fy - svyk) + residual + s * p["UNLOADED_RADIUS"] * p["LS"] * fx
    return {"fx": fx, "fy": fy, "mz": mz, "g_xa": g_xa, "g_yk": g_yk, "svyk": svyk}


def _weight(slip: float, shift: float, b: float, c: float, e: float) -> float:
    """cos(C atan(...)) at the slip moved by the shift, over that at the shift alone."""
    above, below = (cos(c * atan(b * x - e * (b * x - atan(b * x)))) for x in (slip + shift, shift))
    return above / below
