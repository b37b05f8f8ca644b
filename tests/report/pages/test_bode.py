"""The Bode section: its numbers against closed forms, its words, and hostile run names."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ident.report import bode
from ident.report.html import render
from ident.report.page import Figure, Table, Text
from ident.report.pages.bode import bode_figure, frequency_blocks, linearity_figure, points_table, verdict
from ident.report.pages.steering import steering_page
from ident.results import Bandwidth, Cutoff, Estimate, FrequencyCurve, FrequencyPoint

RUN = '<img src=x onerror="window.injected=1">'


def response(w):
    return 0.986 * np.exp(-0.12j * w) / ((1 + 0.25j * w) * (1 + 0.08j * w))


def phase(w):
    return -0.12 * w - np.arctan(0.25 * w) - np.arctan(0.08 * w)


def point(w, method="sine", off=0.0):
    sine = method == "sine"
    return FrequencyPoint(
        run=RUN,
        method=method,
        start=0.0,
        end=10.0,
        frequency=w,
        amplitude=0.4 if sine else None,
        gain=abs(response(w)) * (1 + off),
        gain_std=0.01 * abs(response(w)),
        phase=phase(w),
        phase_std=0.01,
        harmonic_2=0.001 if sine else None,
        harmonic_2_std=0.002 if sine else None,
        harmonic_3=0.05 if sine and w > 2 else 0.001 if sine else None,
        harmonic_3_std=0.002 if sine else None,
        coherence=None if sine else 0.98,
    )


def estimate(value):
    return Estimate(value, 0.02, value - 0.04, value + 0.04, "rad/s")


BANDWIDTH = Bandwidth(estimate(3.63), estimate(3.65), Cutoff(3.0, 5.0, "rad/s"), True, "they overlap")


@pytest.fixture(scope="module")
def case(steering_case):
    """A result with nine sines, one of them 4 % too high, and five bands of a spectrum."""
    w = np.geomspace(0.05, 20.0, 121)
    gain, width = abs(response(w)), np.full(w.size, 0.005)
    curve = FrequencyCurve(
        w.tolist(), gain.tolist(), (0.005 * gain).tolist(), phase(w).tolist(), width.tolist()
    )
    points = [point(w, off=0.04 if w == 5.0 else 0.0) for w in (0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)]
    points += [point(w, "h1") for w in (0.4, 0.9, 2.5, 4.0, 8.0)]
    model = replace(steering_case[0].model, gain=replace(steering_case[0].model.gain, value=0.986))
    return replace(
        steering_case[0],
        model=model,
        frequency_response=points,
        model_response=curve,
        bandwidth=BANDWIDTH,
    )


def test_gains_are_in_decibel_with_their_interval(case):
    marks = bode.gather(case).gain["sine"]
    assert marks.value[3] == pytest.approx(20 * np.log10(abs(response(1.0))))
    assert marks.high[3] - marks.value[3] == pytest.approx(20 * np.log10(np.exp(1.96 * 0.01)))


def test_the_limit_is_three_decibel_below_the_dc_gain(case):
    gathered = bode.gather(case)
    assert gathered.dc == pytest.approx(20 * np.log10(0.986))
    assert gathered.limit == pytest.approx(20 * np.log10(0.986 / np.sqrt(2)))


def test_points_on_the_model_lie_on_zero_and_the_others_where_they_are_off(case):
    gathered = bode.gather(case)
    off = dict(zip(gathered.gain_off["sine"].frequency, gathered.gain_off["sine"].value, strict=True))
    assert off[5.0] == pytest.approx(4.0, abs=1e-3)
    assert all(abs(value) < 1e-3 for w, value in off.items() if w != 5.0)
    assert np.all(abs(gathered.phase_off["h1"].value) < 1e-2)
    assert gathered.curve_gain_off.high == pytest.approx(100 * 1.96 * 0.005)


def test_the_level_of_noise_is_the_95_per_cent_point_of_rayleigh(case):
    rng = np.random.default_rng(1)
    amplitude = np.hypot(*rng.normal(0.0, 0.002, (2, 200_000)))
    level = bode.noise_level(case.frequency_response, 2).value[0] / 100
    assert np.mean(amplitude < level) == pytest.approx(0.95, abs=0.003)


def test_counts_the_harmonics_that_stand_out_of_the_noise(case):
    assert bode.significant_harmonics(case.frequency_response) == 4  # harmonic 3 of 3, 5, 7 and 10 rad/s
    caption = linearity_figure(case.frequency_response).caption
    assert "4 are more than three times the level of noise" in caption


def test_frequencies_are_on_logarithmic_axes_that_hold_all_points(case):
    layout = bode_figure(bode.gather(case), BANDWIDTH).spec["layout"]
    for axis in ("xaxis", "xaxis2", "xaxis3", "xaxis4"):
        assert layout[axis]["type"] == "log"
        low, high = layout[axis]["range"]
        assert 10**low < 0.1
        assert 10**high > 10.0
    assert all("type" not in layout[axis] for axis in ("yaxis", "yaxis2"))


def test_the_bandwidths_are_marked_at_their_frequencies_and_not_at_their_logarithms(case):
    shapes = bode_figure(bode.gather(case), BANDWIDTH).spec["layout"]["shapes"]
    spans = {(shape["x0"], shape["x1"]) for shape in shapes if str(shape["xref"]) == "x"}
    assert (3.0, 5.0) in spans
    assert (BANDWIDTH.bode.low, BANDWIDTH.bode.high) in spans
    assert (3.63, 3.63) in spans


@pytest.mark.parametrize(
    ("overlap", "tone", "word"),
    [(True, "good", "passed"), (False, "bad", "failed"), (None, "caution", "not possible")],
)
def test_the_verdict_is_one_line_in_the_colour_of_its_meaning(overlap, tone, word):
    text, colour = verdict(replace(BANDWIDTH, overlap=overlap))
    assert colour == tone
    assert word in text
    assert "\n" not in text


def test_all_points_are_in_the_table_with_unrounded_numbers(case):
    table = points_table(case.frequency_response)
    assert len(table.rows) == 14
    assert table.cells()[6][4].raw == pytest.approx(1.04 * abs(response(5.0)), rel=1e-12)
    assert table.cells()[6][4].detail.startswith("±")


def test_without_a_measurement_the_model_is_drawn_and_what_to_drive_is_said(case):
    blocks = frequency_blocks(replace(case, frequency_response=[]))
    assert any(isinstance(block, Figure) for block in blocks)
    assert "drive sines" in next(b.text for b in reversed(blocks) if isinstance(b, Text))


def test_an_old_result_without_any_of_it_still_has_its_section(steering_case):
    blocks = frequency_blocks(steering_case[0])
    assert [type(block) for block in blocks] == [Text]


def test_an_open_cutoff_and_a_missing_crossing_are_shown_as_such(case):
    nothing = Estimate(None, None, None, None, "rad/s", "not_identifiable", "the sines end at 2 rad/s")
    shown = replace(BANDWIDTH, measured=nothing, sine_cutoff=Cutoff(2.0, None, "rad/s"), overlap=None)
    blocks = frequency_blocks(replace(case, bandwidth=shown))
    table = next(block for block in blocks if isinstance(block, Table))
    texts = [cell.text for row in table.cells() for cell in row]
    assert "above 2.00" in texts
    assert "not reached" in texts
    assert "not identifiable" in texts


def test_a_hostile_run_name_stays_text(case, steering_case):
    page = steering_page(case, steering_case[1])
    html = render([page])
    assert RUN not in html
    figure = bode_figure(bode.gather(case), BANDWIDTH)
    texts = [text for trace in figure.spec["data"] for text in trace.get("text", [])]
    assert texts
    assert all("<" not in text for text in texts)
    assert "NaN" not in json.dumps(figure.spec, default=lambda x: x.tolist())
