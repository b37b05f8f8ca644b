import pytest

from ident.results import Estimate
from ident.stages.tyres import _handling, _size


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.00191, 0.0001, "understeers by 1.91 ± 0.2 mrad/(m/s²)"),
        (-0.00191, 0.0001, "oversteers by 1.91 ± 0.2 mrad/(m/s²)"),
        (0.0001, 0.0001, "neutral within its error (0.1 ± 0.2 mrad/(m/s²))"),
        (None, None, "understeer unknown"),
    ],
)
def test_the_verdict_tells_understeer_in_a_unit_that_is_read_at_a_glance(value, std, text):
    assert _handling(Estimate(value, std, None, None, "rad s^2/m")) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(0.0021, "rad/s", "2.1 mrad/s"), (0.049, "m/s^2", "0.049 m/s²"), (0.2, "m", "0.2 m")],
)
def test_the_size_of_an_error_is_told_without_powers_of_ten(value, unit, text):
    assert _size(value, unit) == text
