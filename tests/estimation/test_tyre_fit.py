"""The tyre fit on a truck that shares nothing with it: truth, symmetry, robustness, kinks, peaks, bank."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plane_truck import BODY, INERTIA, NOISE, PlaneTruck, inputs, linear, magic, piecewise

from ident.errors import NotIdentifiable
from ident.estimation.noise import AutoRegression, NoiseModel
from ident.estimation.tyre_fit import KindFit, criteria, fit_tyres
from ident.estimation.tyre_start import tyre_starts
from ident.estimation.vehicle_records import MotionRecord, Samples
from ident.stages.tyres import choose

C_F, C_R = 330e3, 417e3
BIASES = {"yaw_rate": 0.002, "lateral_acceleration": 0.05, "lateral_velocity": -0.02, "heading": 0.004}
OFFSET = 0.003
PLAIN = PlaneTruck(linear(C_F), linear(C_R))
ERRING = replace(PLAIN, offset=OFFSET, biases=BIASES)
PEAK = {"front": (C_F, 36e3, 1.4, -0.8), "rear": (C_R, 40e3, 1.35, -0.5)}
BENT = PlaneTruck(magic(*PEAK["front"]), magic(*PEAK["rear"]))
KINKED = PlaneTruck(piecewise(C_F, 0.055), piecewise(C_R, 0.05))
TRUE = {
    "front.cornering_stiffness": C_F,
    "rear.cornering_stiffness": C_R,
    "yaw_inertia": INERTIA,
    "steering_offset": 0.0,
}
FAR_OFF = {
    "front.cornering_stiffness": 0.6 * C_F,
    "rear.cornering_stiffness": 1.5 * C_R,
    "yaw_inertia": 1.5 * INERTIA,
}
CURVE = ("cornering_stiffness", "peak_force", "shape", "curvature")
KINDS = ("linear", "piecewise_linear", "magic_formula")


@cache
def driven(
    truck: PlaneTruck = PLAIN, most: float = 0.06, *, noisy: bool = True, seconds: float = 16.0
) -> tuple[MotionRecord, ...]:
    return tuple(
        truck.drive(
            *inputs(seconds, seed=run, most=most),
            run=run,
            seed=10 + run if noisy else None,
            pose=(0.3 + 2.0 * run, 40.0, -25.0),
        )
        for run in range(2)
    )


def fit(records, kind="linear", *, start=None, **how) -> KindFit:
    """From far off; kinds with curves, whose minima are several, from where the data say."""
    if start is None:
        start = [FAR_OFF] if kind == "linear" else tyre_starts(kind, records, BODY)
    return fit_tyres(records, kind, BODY, start, **how)


@cache
def fitted(truck: PlaneTruck = PLAIN, most: float = 0.06, kind: str = "linear"):
    return fit(driven(truck, most), kind)


def known_noise(share: float = 1.0) -> dict[str, NoiseModel]:
    """What the sensors are given, or a share of it."""
    made = {name: NoiseModel(AutoRegression(np.zeros(0)), share * std) for name, std in NOISE.items()}
    made |= {"position_along": made["position_x"], "position_across": made["position_x"]}
    return {name: one for name, one in made.items() if name not in ("position_x", "position_y")}


def std_of(found: KindFit):
    return dict(zip(found.names, np.sqrt(np.diag(found.fit.covariance)), strict=True))


def errors(found: KindFit, true):
    """Error of every coordinate that has a truth, in its standard deviations."""
    std = std_of(found)
    return {
        one.name: (at - one.coordinate(true[one.name])) / std[one.name]
        for one, at in zip(found.problem.coordinates, found.fit.shared, strict=True)
        if one.name in true
    }


def terms(found: KindFit):
    """Terms of the runs with their standard deviations."""
    names = [term.name for term in found.problem.run_terms]
    made = []
    for values, run in zip(found.fit.point.of_runs, found.fit.point.by_run, strict=True):
        std = np.sqrt(np.diag(run.own_covariance(found.fit.covariance)))
        made.append({n: (v, s) for n, v, s in zip(names, values, std, strict=True)})
    return made


# --- truth ----------------------------------------------------------------------------------------


def test_without_noise_the_truth_comes_back() -> None:
    found = fit(driven(ERRING, noisy=False))
    for name, value in (TRUE | {"steering_offset": OFFSET}).items():
        assert found.parameters[name] == pytest.approx(value, rel=1e-6), name
    for of_run in terms(found):
        for name, bias in BIASES.items():
            assert of_run[name][0] == pytest.approx(bias, rel=1e-3), name
    assert found.fit.converged


def test_without_noise_the_stiffness_of_a_bent_curve_comes_back_too() -> None:
    """What only the peak tells is drawn a little to what is usual, by much less than its error."""
    found = fit(driven(BENT, 0.12, noisy=False), "magic_formula", noise=known_noise(0.1))
    true = TRUE | {
        f"{axle}.{name}": value
        for axle, values in PEAK.items()
        for name, value in zip(CURVE, values, strict=True)
    }
    for name in ("front.cornering_stiffness", "rear.cornering_stiffness", "yaw_inertia"):
        assert found.parameters[name] == pytest.approx(true[name], rel=1e-4)
    assert max(abs(z) for z in errors(found, true).values()) < 0.5
    assert found.fit.converged


def test_offset_and_biases_are_found_within_their_errors() -> None:
    found = fitted(ERRING)
    assert not found.fit.is_coloured
    for name, z in errors(found, TRUE | {"steering_offset": OFFSET}).items():
        assert abs(z) < 3.3, name
    for of_run in terms(found):
        for name, bias in BIASES.items():
            value, std = of_run[name]
            assert abs(value - bias) < 3.3 * std, name
            assert abs(bias) > 8 * std, name


# --- what must not matter --------------------------------------------------------------------------


def same(one: KindFit, other: KindFit, within: float = 0.05) -> None:
    """Equal to a small part of the standard deviations, which are equal too."""
    std = std_of(one)
    apart = (one.fit.shared - other.fit.shared) / list(std.values())
    assert np.abs(apart).max() < within, dict(zip(one.names, apart, strict=True))
    assert std_of(other) == pytest.approx(std, rel=0.02)


def test_a_mirrored_drive_gives_the_same_tyres_and_opposite_offsets() -> None:
    def mirrored(one: MotionRecord) -> MotionRecord:
        turned = {
            name: each if name == "position_x" else Samples(each.times, -each.values)
            for name, each in one.measured.items()
        }
        return replace(
            one, road_wheel_angle=-one.road_wheel_angle, measured=turned, imu=(one.imu[0], -one.imu[1])
        )

    there = fitted(ERRING)
    back = fit([mirrored(one) for one in driven(ERRING)])
    turned = np.array([-1.0 if name == "steering_offset" else 1.0 for name in back.names])
    same(there, replace(back, fit=replace(back.fit, point=_signed(back, turned))))
    assert back.fit.point.of_runs == pytest.approx(-there.fit.point.of_runs, abs=2e-5)


def _signed(found: KindFit, signs):
    return replace(found.fit.point, shared=found.fit.point.shared * signs)


@pytest.mark.parametrize(("turn", "x", "y"), [(0.0, 5e5, 5.8e6), (2.5, -300.0, 80.0), (-40.0, 0.0, 0.0)])
def test_another_map_gives_the_same(turn: float, x: float, y: float) -> None:
    def moved(one: MotionRecord) -> MotionRecord:
        px, py, heading = (one.measured[name] for name in ("position_x", "position_y", "heading"))
        c, s = np.cos(turn), np.sin(turn)
        placed = {
            "position_x": Samples(px.times, x + c * px.values - s * py.values),
            "position_y": Samples(py.times, y + s * px.values + c * py.values),
            "heading": Samples(heading.times, heading.values + turn),
        }
        return replace(one, measured={**one.measured, **placed})

    same(fitted(), fit([moved(one) for one in driven()]))


def test_the_time_at_which_a_run_begins_does_not_matter() -> None:
    def later(one: MotionRecord) -> MotionRecord:
        measured = {n: Samples(each.times + 3600.0, each.values) for n, each in one.measured.items()}
        return replace(one, times=one.times + 3600.0, measured=measured)

    same(fitted(), fit([later(one) for one in driven()]))


def test_the_order_of_the_runs_does_not_matter() -> None:
    first, second = driven()
    turned = fit([replace(second, run=0), replace(first, run=1)])
    same(fitted(), turned)
    assert turned.fit.point.of_runs[::-1] == pytest.approx(fitted().fit.point.of_runs, abs=1e-5)


def test_shorter_windows_tell_the_same_with_larger_errors() -> None:
    ten, five = fitted(), fit(driven(), window=5.0)
    assert [len(one.problem.windows.records) for one in (ten, five)] == [4, 6]
    std, wider = std_of(ten), std_of(five)
    for name, one, other in zip(ten.names, ten.fit.shared, five.fit.shared, strict=True):
        assert wider[name] > 0.99 * std[name], name
        between = np.sqrt(max(wider[name] ** 2 - std[name] ** 2, (0.2 * std[name]) ** 2))
        assert abs(one - other) < 3.5 * between, name


def test_the_same_data_give_the_same_numbers() -> None:
    one, other = fit(driven()), fit(driven())
    assert np.array_equal(one.fit.shared, other.fit.shared)
    assert np.array_equal(one.fit.covariance, other.fit.covariance)


# --- whatever was recorded ---------------------------------------------------------------------------

SETS = [
    ("yaw_rate",),
    ("lateral_acceleration",),
    ("heading",),
    ("yaw_rate", "lateral_acceleration"),
    ("heading", "lateral_velocity"),
    ("position_x", "position_y", "heading"),
    ("position_x", "position_y", "yaw_rate"),
    ("position_x", "yaw_rate"),
]


def only(one: MotionRecord, names) -> MotionRecord:
    return replace(one, measured={name: one.measured[name] for name in names})


@pytest.mark.parametrize("names", SETS, ids="+".join)
def test_every_set_of_signals_is_fitted_within_its_errors(names) -> None:
    found = fit([only(one, names) for one in driven()])
    assert found.fit.converged
    for name, z in errors(found, TRUE).items():
        assert abs(z) < 3.3, name
    assert std_of(found)["front.cornering_stiffness"] > std_of(fitted())["front.cornering_stiffness"]


def test_one_run_is_enough() -> None:
    found = fit(driven()[:1])
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.3


def test_runs_without_a_signal_in_common_are_fitted_together() -> None:
    first, second = driven()
    both = [only(first, ("yaw_rate",)), only(second, ("heading", "lateral_acceleration"))]
    found = fit(both)
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.3
    alone = fit([only(first, ("yaw_rate",))])
    assert std_of(found)["yaw_inertia"] < std_of(alone)["yaw_inertia"]


def test_a_signal_that_drops_out_for_a_whole_window_costs_that_window_only() -> None:
    def holed(one: MotionRecord) -> MotionRecord:
        def kept(each: Samples, end: float) -> Samples:
            keep = (each.times < 7.5) | (each.times > end)
            return Samples(each.times[keep], each.values[keep])

        return replace(one, measured={n: kept(each, 99.0) for n, each in one.measured.items()})

    first, second = driven()
    found = fit([holed(first), second])
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.3
    assert std_of(found)["yaw_inertia"] > std_of(fitted())["yaw_inertia"]
    every = fit([holed(first), holed(second)])
    assert max(abs(z) for z in errors(every, TRUE).values()) < 3.3


@pytest.mark.parametrize("every", [150])
def test_a_signal_with_a_few_samples_a_window_does_no_harm(every: int) -> None:
    def thinned(one: MotionRecord) -> MotionRecord:
        heading = one.measured["heading"]
        few = Samples(heading.times[150::every], heading.values[150::every])
        return replace(one, measured={**one.measured, "heading": few})

    found = fit([thinned(one) for one in driven()])
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.5


def test_a_piece_of_a_few_grid_points_does_no_harm() -> None:
    first, second = driven()
    (short,) = (
        replace(
            first,
            times=first.times[:5],
            road_wheel_angle=first.road_wheel_angle[:5],
            speed=first.speed[:5],
            measured={n: Samples(each.times[:5], each.values[:5]) for n, each in first.measured.items()},
        ),
    )
    found = fit([short, replace(second, run=1)])
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.3


@pytest.mark.parametrize("every", [700, 5000])
def test_a_signal_too_sparse_for_its_noise_to_be_told_is_not_compared(every: int) -> None:
    def thinned(one: MotionRecord, *names: str) -> MotionRecord:
        few = {
            n: Samples(one.measured[n].times[150::every], one.measured[n].values[150::every]) for n in names
        }
        return replace(one, measured={**one.measured, **few})

    found = fit([thinned(one, "heading") for one in driven()])
    without = fit([only(one, set(NOISE) - {"heading"}) for one in driven()])
    assert "heading" not in found.problem.compared
    assert "heading" not in [term.name for term in found.problem.run_terms]
    same(without, found)
    with pytest.raises(NotIdentifiable, match=r"need 20 of a signal: record faster"):
        fit([thinned(one, *NOISE) for one in driven()])


# --- kinds of tyres ----------------------------------------------------------------------------------


def test_a_kink_is_found_where_it_was_driven() -> None:
    found = fitted(KINKED, 0.12, "piecewise_linear")
    true = TRUE | {"front.saturation_slip": 0.055}
    assert {name: z for name, z in errors(found, true).items() if abs(z) > 3.3} == {}
    assert std_of(found)["front.saturation_slip"] < 0.01


def test_a_kink_beyond_what_was_driven_stays_what_is_usual() -> None:
    found = fitted(KINKED, 0.04, "piecewise_linear")
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.3
    for axle in ("front", "rear"):
        assert std_of(found)[f"{axle}.saturation_slip"] == pytest.approx(1.0, rel=0.01)  # the prior


def test_driving_to_the_peak_tells_peak_and_shape() -> None:
    found = fitted(BENT, 0.35, "magic_formula")
    true = TRUE | {f"front.{n}": v for n, v in zip(CURVE, PEAK["front"], strict=True)}
    assert {name: z for name, z in errors(found, true).items() if abs(z) > 3.3} == {}
    std = std_of(found)
    assert std["front.peak_force"] < 0.02
    assert std["front.shape"] < 0.05


def test_below_the_peak_shape_and_peak_are_known_only_jointly() -> None:
    found = fitted(BENT, 0.05, "magic_formula")
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.3
    std = std_of(found)
    assert std["front.shape"] > 0.15  # the prior is 0.3
    assert std["front.peak_force"] > 0.05


@pytest.mark.parametrize(
    ("truck", "most", "kind"),
    [
        (PLAIN, 0.06, "linear"),
        (KINKED, 0.12, "piecewise_linear"),
        (BENT, 0.12, "magic_formula"),
        (BENT, 0.004, "linear"),
    ],
    ids=["linear", "piecewise linear", "magic formula", "magic formula, driven gently"],
)
def test_the_kind_that_made_the_data_is_chosen(truck: PlaneTruck, most: float, kind: str) -> None:
    found = {one: fitted(truck, most, one) for one in KINDS}
    assert choose(criteria(found)) == kind
    assert not found[kind].fit.is_coloured


# --- bank --------------------------------------------------------------------------------------------


def turning(truck: PlaneTruck, seed: int) -> MotionRecord:
    """Twenty seconds in which the heading turns by more than half a circle, on which a bank can be told."""
    return truck.drive(*inputs(20.0, seed=seed, most=0.04, mean=0.05), seed=200 + seed)


def test_the_bank_of_a_road_is_found_and_its_size_right() -> None:
    banked = replace(PLAIN, bank=(0.03, -0.02))
    found = fit([turning(banked, 1), replace(turning(banked, 2), run=1)])
    assert found.bank
    assert found.bank_p < 1e-10
    assert not found.fit.is_coloured
    assert max(abs(z) for z in errors(found, TRUE).values()) < 3.3
    for of_run in terms(found):
        for name, true in (("bank_cos", 0.03), ("bank_sin", -0.02)):
            value, std = of_run[name]
            assert abs(value - true) < 3.3 * std, name
            assert std < 0.01


def test_no_bank_is_called_for_on_a_level_road() -> None:
    p = []
    for seed in range(12):
        found = fit_tyres([turning(PLAIN, seed)], "linear", BODY, [TRUE], noise=known_noise())
        assert not found.bank
        p.append(found.bank_p)
    assert min(p) > 1e-3
    assert 0.2 < np.mean(p) < 0.8  # uniform: 0.5 ± 0.08


def test_where_the_heading_hardly_turns_a_bank_is_a_bias_and_none_is_fitted() -> None:
    assert not fitted(replace(PLAIN, bank=(0.03, -0.02))).bank
