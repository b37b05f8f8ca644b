"""Fit the two-track model to the same windows as the bicycle, from where the bicycle's fit ended.

Tyres that were fitted with a bicycle hold what two tracks do on top of them: what the moving load takes from
an axle, what wheels that are not parallel give it. In a two-track model they would count it twice, so they
are fitted again, with everything else of the fit: yaw inertia, offset of the steering, biases, noise. Track,
height, roll share, geometry of the steering and the dependence on load are taken as given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ident.dynamics.axle_groups import AxleGroup
from ident.dynamics.engine import compiled
from ident.dynamics.two_track import FRONT, REAR, two_track
from ident.dynamics.tyres import by_name
from ident.estimation.tyre_fit import KindFit
from ident.estimation.vehicle_fit import fit_vehicle
from ident.estimation.vehicle_problem import VehicleProblem


def fit_two_track(
    found: KindFit,
    chassis: Mapping[str, float],
    *,
    groups: tuple[AxleGroup, AxleGroup] = (FRONT, REAR),
    floor: Mapping[str, float] | None = None,
) -> KindFit:
    """Fit the tyres of a bicycle again as those of a two-track model.

    Parameters
    ----------
    found : the bicycle's fit
    chassis : what ``two_track_parameters`` names for these tyres and groups -> value
    floor : signal -> least standard deviation of its noise

    Raises
    ------
    ValueError
        If ``chassis`` lacks a parameter, or the model blows up from the bicycle's tyres.
    """
    before = found.problem
    axles = found.axles
    system = two_track(by_name(axles.front), by_name(axles.rear), groups=groups)
    if missing := sorted(set(system.parameters) - set(before.engine.parameters) - set(chassis)):
        raise ValueError(f"the two-track model needs {', '.join(missing)}")
    problem = VehicleProblem(
        compiled(system),
        before.windows,
        before.coordinates,
        {**before.fixed, **chassis},
        before.run_terms,
    )
    return replace(found, problem=problem, fit=fit_vehicle(problem, [found.fit.shared], floor=floor))
