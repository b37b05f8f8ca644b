"""The settings that every stage shares."""

from pathlib import Path

import pytest

from ident.errors import BadRecipe
from ident.stages.inputs import InputSettings
from ident.yaml_file import check


def read(**settings):
    return check(InputSettings, settings, "recipe")


def test_what_is_not_said_has_its_default():
    settings = read()
    assert (settings.channels, settings.vehicle, settings.seed) == ("auto", None, 0)
    assert (settings.align.rate, settings.align.max_gap, settings.align.latency) == (100.0, 0.2, {})


def test_quantities_are_read_with_their_units():
    settings = read(align={"rate": "50 Hz", "max_gap": "300 ms", "latency": {"yaw_rate": "0.32 s"}})
    assert (settings.align.rate, settings.align.max_gap) == (50.0, 0.3)
    assert settings.align.latency == {"yaw_rate": 0.32}


@pytest.mark.parametrize("channels", ["auto", Path("a.yaml"), [Path("a.yaml"), Path("b.yaml")]])
def test_channels_are_auto_or_files(channels):
    assert read(channels=channels).channels == channels


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"align": {"rate": "100 m"}}, "unit 'm' does not fit, need a unit of 'Hz'"),
        ({"align": {"rate": 100}}, "no quantity with a unit"),
        ({"align": {"rate": "0 Hz"}}, "is not positive"),
        ({"align": {"max_gap": "-1 s"}}, "is not positive"),
        ({"align": {"max_gaps": "1 s"}}, "did you mean 'max_gap'?"),
        ({"align": {"latency": {"yawrate": "1 s"}}}, "unknown signal 'yawrate': did you mean 'yaw_rate'?"),
        ({"channel": "auto"}, "did you mean 'channels'?"),
        ({"seed": "x"}, "seed"),
    ],
)
def test_refuses_what_is_wrong_in_one_line(settings, reason):
    with pytest.raises(BadRecipe) as caught:
        read(**settings)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
