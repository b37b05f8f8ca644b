"""Delays with honest standard errors: Monte Carlo on generated data with coloured noise."""

import numpy as np
import pytest
from scipy.signal import firwin, lfilter

from ident.signals.delay import Piece, estimate_delay

RATE = 20.0
FINE = 10


def coloured(rng, count, std, memory):
    noise = lfilter([1.0], [1.0, -memory], rng.standard_normal(count + 500))[500:]
    return std * noise * np.sqrt(1 - memory**2)


def pair(rng, seconds, delay, *, late=0.2, reference=0.2, memory=0.9, band=0.5):
    """Two series of one motion of unit size, band-limited to ``band`` [Hz], one of them late."""
    count = int(seconds * RATE)
    fine = rng.standard_normal((count + int(12 * RATE)) * FINE)
    motion = np.convolve(fine, firwin(4001, band, fs=RATE * FINE), "same")
    motion /= motion.std()
    at = int(6 * RATE * FINE) + FINE * np.arange(count)
    shifted = motion[at - round(delay * RATE * FINE)]
    return Piece(
        0.8 * shifted + 0.3 + coloured(rng, count, late, memory),
        motion[at] + coloured(rng, count, reference, memory),
    )


@pytest.mark.parametrize(
    ("seconds", "late", "reference", "memory", "band"),
    [(60, 0.3, 0.3, 0.9, 0.5), (120, 0.6, 0.1, 0.95, 0.4), (40, 0.1, 0.1, 0.0, 1.0)],
)
def test_the_95_percent_interval_holds_the_truth(seconds, late, reference, memory, band):
    rng = np.random.default_rng(11)
    truth = 0.13
    found = [
        estimate_delay(
            [pair(rng, seconds, truth, late=late, reference=reference, memory=memory, band=band)], RATE
        )
        for _ in range(100)
    ]
    found = [each for each in found if each.value is not None]
    inside = sum(each.low <= truth <= each.high for each in found)
    assert len(found) >= 95
    assert inside >= 0.88 * len(found)  # 95 % but for the chance of a hundred
    values = np.array([each.value for each in found])
    assert values.mean() == pytest.approx(truth, abs=4 * values.std() / np.sqrt(len(values)))
    assert np.mean([each.std for each in found]) == pytest.approx(values.std(), rel=0.3)


def test_series_that_have_nothing_in_common_are_refused():
    rng = np.random.default_rng(5)
    named = 0
    for _ in range(100):
        one, other = pair(rng, 60, 0.0), pair(rng, 60, 0.0)
        named += estimate_delay([Piece(one.late, other.reference)], RATE).value is not None
    assert named <= 4


@pytest.mark.parametrize("delay", [-0.8, 0.0, 0.32, 1.6])
def test_without_noise_the_delay_is_found_to_a_millisecond(delay):
    rng = np.random.default_rng(1)
    found = estimate_delay([pair(rng, 60, delay, late=0.001, reference=0.001)], RATE)
    assert found.value == pytest.approx(delay, abs=1e-3)
    assert found.status == "identified"


def test_several_pieces_are_one_estimate():
    rng = np.random.default_rng(2)
    whole = estimate_delay([pair(rng, 40, 0.2) for _ in range(5)], RATE)
    one = estimate_delay([pair(rng, 40, 0.2)], RATE)
    assert whole.low <= 0.2 <= whole.high
    assert whole.std < one.std


def test_jumps_do_not_spoil_it():
    rng = np.random.default_rng(3)
    piece = pair(rng, 120, 0.3, late=0.1, reference=0.1)
    piece.reference[rng.integers(0, len(piece.reference), 12)] += 30.0
    found = estimate_delay([piece], RATE)
    assert found.low <= 0.3 <= found.high
    assert found.std < 0.03


def test_a_slow_trend_is_not_taken_for_agreement_at_any_lag():
    rng = np.random.default_rng(4)
    piece = pair(rng, 80, 0.25, late=0.05, reference=0.05)
    trend = np.linspace(0, 60, len(piece.late))
    found = estimate_delay([Piece(piece.late + 0.8 * trend, piece.reference + trend)], RATE)
    assert found.value == pytest.approx(0.25, abs=0.05)


def test_a_long_drive_is_sampled():
    rng = np.random.default_rng(8)
    found = estimate_delay([pair(rng, 4000, 0.2)], RATE)
    assert abs(found.value - 0.2) < 4 * found.std
    assert found.std < 0.005


def test_a_short_record_is_refused_with_what_it_lacks():
    rng = np.random.default_rng(6)
    found = estimate_delay([pair(rng, 5, 0.1)], RATE)
    assert (found.value, found.status) == (None, "not_identifiable")
    assert "s in common" in found.reason


def test_opposite_signs_are_refused_by_name():
    rng = np.random.default_rng(7)
    piece = pair(rng, 100, 0.1, late=0.05, reference=0.05)
    found = estimate_delay([Piece(-piece.late, piece.reference)], RATE)
    assert found.value is None
    assert found.reason == "the signs are opposite: correlation -1.00"


@pytest.mark.parametrize("series", [np.zeros(2000), np.full(2000, 3.0)])
def test_standstill_is_refused(series):
    assert estimate_delay([Piece(series, series)], RATE).value is None
    assert estimate_delay([Piece(np.random.default_rng(1).standard_normal(2000), series)], RATE).value is None
