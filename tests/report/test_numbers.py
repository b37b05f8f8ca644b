import math

import pytest

from ident.report import numbers
from ident.results import Estimate


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (0.98765, "0.988"),
        (-12.34, "−12.3"),
        (123456.0, "123456"),
        (0.000123456, "0.000123"),
        (1.2e-7, "1.20e-07"),
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "–"),
    ],
)
def test_rounds_to_significant_digits(value, text):
    assert numbers.significant(value) == text


@pytest.mark.parametrize(
    ("value", "std", "shown", "interval"),
    [
        (0.12034, 0.0021, "0.1203", "0.1162 … 0.1245"),
        (0.12034, 0.021, "0.120", "0.079 … 0.162"),
        (1234.5, 56.0, "1234", "1125 … 1344"),
        (-0.5, 0.1, "−0.50", "−0.70 … −0.30"),
    ],
)
def test_shows_what_the_standard_error_supports(value, std, shown, interval):
    estimate = Estimate(value, std, value - 1.96 * std, value + 1.96 * std, "s")
    assert numbers.estimate_value(estimate) == shown
    assert numbers.estimate_interval(estimate) == interval


def test_without_a_standard_error_the_interval_stands_for_it():
    assert numbers.estimate_value(Estimate(0.12034, None, 0.11, 0.13, "s")) == "0.1203"


def test_a_parameter_that_is_not_known_is_a_dash():
    estimate = Estimate(None, None, None, None, "s", "not_identifiable", "no step")
    assert numbers.estimate_value(estimate) == "–"
    assert numbers.estimate_interval(estimate) == "–"


def test_a_minus_zero_loses_its_sign():
    assert numbers.fixed(-0.0004, 2) == "0.00"


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.5, "50.00\u00a0%"),
        (0.999912, "99.9912\u00a0%"),
        (-0.2, "−20.00\u00a0%"),
        (0.99999998, "> 99.9999\u00a0%"),
        (1.0, "100.00\u00a0%"),
        (None, "–"),
    ],
)
def test_a_share_near_the_whole_keeps_more_digits(share, text):
    assert numbers.percent(share) == text


def test_small_angles_are_in_milliradians_and_degrees():
    assert numbers.angle(0.0016) == "1.60\u00a0mrad (0.092°)"
    assert numbers.angle(1.5708) == "1.57\u00a0rad (90°)"


def test_a_small_p_value_is_a_bound():
    assert numbers.p_value(0.00004) == "p < 0.001"
    assert numbers.p_value(0.41) == "p = 0.41"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(59.94, "59.9 s"), (69.0, "1 min 9 s"), (3725.0, "1 h 2 min 5 s"), (3599.7, "1 h 0 min 0 s")],
)
def test_a_length_of_time_is_read_at_a_glance(seconds, text):
    assert numbers.duration(seconds).replace("\u00a0", " ") == text


def test_a_long_name_is_cut_in_its_middle():
    assert numbers.shorten("abcdefghij", 10) == "abcdefghij"
    assert numbers.shorten("abcdefghijk", 5) == "ab…jk"


def test_counts_with_the_right_noun():
    assert numbers.count(1, "gap") == "1 gap"
    assert numbers.count(12345, "gap") == "12\u202f345 gaps"


def test_control_characters_and_broken_unicode_do_not_reach_the_terminal():
    assert (
        numbers.plain("a\x1b[31mb\nc\udc80\u00a0d")
        == "a\N{REPLACEMENT CHARACTER}[31mb c\N{REPLACEMENT CHARACTER} d"
    )
