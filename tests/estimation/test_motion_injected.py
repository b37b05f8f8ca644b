"""Effects of usual size in two runs of the truck of the sample logs: found, sized, and nothing left after."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from improve_runs import key_of, measured, noise_floor, true_parameters
from motion_campaign import SEED, driven, layer_over, usual

from ident.estimation.before_after import same_size
from ident.estimation.improvement import Improvement, improve_layers

EFFECTS = {  # injected -> signals of which it makes the model wrong
    ("tyre_relaxation", None): ("yaw_rate", "lateral_acceleration"),
    ("steering_linkage_play", None): ("yaw_rate", "heading", "lateral_velocity"),
    ("load_transfer", None): (),
    ("sensor_latency", "yaw_rate"): ("yaw_rate",),
    ("sensor_bias", "lateral_acceleration"): ("lateral_acceleration",),
}
QUANTILE = 2.576  # of 99 %


@cache
def found(name: str, of: str | None) -> Improvement:
    return improve_layers([layer_over(driven((name, of)))], level=0.05, draws=1000, seed=1, survivors=3)


pytestmark = pytest.mark.parametrize(("name", "of"), EFFECTS)


def test_the_effect_stands_out_and_is_the_first_of_all_effects_in_the_screen(
    name: str, of: str | None
) -> None:
    screen = found(name, of).rounds[0].screen
    assert screen.rejected
    assert screen.p_value < 1e-3
    effects = [one.key for one in screen.groups if one.effect is not None]
    assert effects[0] == key_of(usual(name, of))


def test_it_is_added_alone_and_nothing_is_left(name: str, of: str | None) -> None:
    made, key = found(name, of), key_of(usual(name, of))
    assert made.added == [("motion", key)]
    assert made.members(key) == (key,)
    assert made.passes
    assert made.fits["motion"].is_allowed() == {}


def test_its_size_is_within_its_interval_of_99_percent(name: str, of: str | None) -> None:
    key = key_of(usual(name, of))
    estimates = found(name, of).fits["motion"].estimates()[key].parameters
    for short, true in true_parameters([usual(name, of)])[key].items():
        one = estimates[short]
        assert one.value == pytest.approx(true, abs=QUANTILE * one.std), short
        assert one.low < one.value < one.high
        least_told = (key, short) == ("load_transfer", "front_share")  # bent curves stand in for much of it
        assert one.std < (0.4 if least_told else 0.25) * true
    assert found(name, of).fits["motion"].size(key) == pytest.approx(
        next(iter(estimates.values())).value, rel=0.02
    )


def test_the_error_after_is_that_of_the_sensors(name: str, of: str | None) -> None:
    made, drive = found(name, of), driven((name, of))
    floor = noise_floor(drive, measured(drive, SEED))
    before, after = made.base["motion"].rms(), made.fits["motion"].rms()
    for signal in ("yaw_rate", "lateral_acceleration", "lateral_velocity", "heading"):
        assert after[signal] < 1.1 * floor[signal], signal
    for signal in EFFECTS[name, of]:
        assert before[signal] > 1.1 * floor[signal], signal


def test_runs_that_tell_agree_about_its_size(name: str, of: str | None) -> None:
    made, key = found(name, of), key_of(usual(name, of))
    sizes, stds = made.fits["motion"].sizes_by_run(key)
    assert sizes.shape == stds.shape == (2,)
    told = np.isfinite(stds)
    assert told.any()
    p_value = same_size(sizes, stds)
    assert p_value is None or p_value > 1e-3
