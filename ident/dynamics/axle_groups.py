"""Axles that stand close together and share their load: single, tandem, tridem, one of them lifted.

The group stands where the bicycle has its axle: its middle is l_f before or l_r behind the centre of gravity
(CG), its axles are a spacing s apart, the foremost first. All of them bear the same load, as axles on one
walking beam do. A lift u of one axle, from 0 (down) to 1 (off the road), takes that share of its load away
and gives it to the others: of n axles

    w_lifted = (1 - u)/n,      w_other = (1 + u/(n - 1))/n,      Σ w = 1

so that the load of the group no longer acts in its middle but at x = Σ w_j x_j, and the loads at rest, front
and rear, follow from there:

    F_z,f = m g (-x_r)/(x_f - x_r),      F_z,r = m g x_f/(x_f - x_r)

Axles that cannot steer are dragged sideways in every turn. With the stiffness C_r shared by two of them, the
steady steering angle is that of a wheelbase (Winkler 1998, SAE 982847)

    L_e = L + T/L (1 + C_r/C_f),      T = Σ Δ_j²/n = s²/4

with Δ_j the way of an axle to the middle of its group; no term of it is written here, it comes of the slip
angles that the axles have of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy
from sympy import Expr

from ident.dynamics.constants import GRAVITY
from ident.dynamics.parameter import Parameter

Known = Mapping[str, Expr]

MOST_AXLES = 4


@dataclass(frozen=True)
class AxleGroup:
    """Axles at one end of the vehicle.

    name : "front" or "rear"
    axles : how many
    lifted : which of them can be lifted, 0 is the foremost; None: none

    Raises
    ------
    ValueError
        If there is no such axle, or the only one should be lifted.
    """

    name: str
    axles: int = 1
    lifted: int | None = None

    def __post_init__(self) -> None:
        if self.name not in {"front", "rear"} or not 1 <= self.axles <= MOST_AXLES:
            raise ValueError(
                f"{self.axles} axles in the group {self.name!r}, need 1 to {MOST_AXLES} in front or rear"
            )
        if self.lifted is not None and (self.axles < 2 or not 0 <= self.lifted < self.axles):
            raise ValueError(f"axle {self.lifted} of {self.axles} cannot be lifted: another one has to stay")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What the group has beside its tyres: track, and spacing and lift where it has them."""
        own = [Parameter(f"{self.name}_track", "m", 0.8, 3.0, 2.0, "from the left to the right wheels")]
        if self.axles > 1:
            own.append(Parameter(f"{self.name}_spacing", "m", 0.5, 3.0, 1.35, "from one axle to the next"))
        if self.lifted is not None:
            own.append(
                Parameter(f"{self.name}_lift", "1", 0.0, 1.0, 0.0, "share of its load that the axle lacks")
            )
        return tuple(own)

    @property
    def axle_names(self) -> tuple[str, ...]:
        """Such as "rear" of a single axle, "rear_1" and "rear_2" of a tandem."""
        if self.axles == 1:
            return (self.name,)
        return tuple(f"{self.name}_{number + 1}" for number in range(self.axles))

    def middle(self, known: Known) -> Expr:
        """Place of the middle of the group, forward of the CG [m]."""
        return known["cg_to_front_axle"] if self.name == "front" else -known["cg_to_rear_axle"]

    def offset(self, number: int, known: Known) -> Expr:
        """Way from the middle of the group to one of its axles, forward [m]."""
        if self.axles == 1:
            return sympy.Integer(0)
        return sympy.Rational(self.axles - 1 - 2 * number, 2) * known[f"{self.name}_spacing"]

    def share(self, number: int, known: Known) -> Expr:
        """Share of the load of the group that one of its axles bears."""
        equal = sympy.Rational(1, self.axles)
        if self.lifted is None:
            return equal
        lift = known[f"{self.name}_lift"]
        if number == self.lifted:
            return equal * (1 - lift)
        return equal * (1 + lift / (self.axles - 1))

    def centre_of_load(self, known: Known) -> Expr:
        """Place at which the load of the group acts, forward of the CG [m]."""
        if self.lifted is None:
            return self.middle(known)
        places = (self.share(k, known) * self.offset(k, known) for k in range(self.axles))
        return self.middle(known) + sum(places, sympy.Integer(0))


def loads_at_rest(front: AxleGroup, rear: AxleGroup, known: Known) -> tuple[Expr, Expr]:
    """Loads of both groups at rest [N]: together the weight, without a moment about the CG."""
    before, behind = front.centre_of_load(known), rear.centre_of_load(known)
    weight = known["mass"] * GRAVITY / (before - behind)
    return -weight * behind, weight * before


def rated_load(group: AxleGroup, known: Known) -> Expr:
    """Load at rest [N] of each axle of a group with all axles of the vehicle down."""
    l_f, l_r = known["cg_to_front_axle"], known["cg_to_rear_axle"]
    return known["mass"] * GRAVITY * (l_r if group.name == "front" else l_f) / (l_f + l_r) / group.axles
