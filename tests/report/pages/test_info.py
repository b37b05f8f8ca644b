from dataclasses import replace

import plotly.graph_objects as go
import pytest

from ident.report.html import _plain
from ident.report.page import Details, Figure, Lines
from ident.report.pages import health
from ident.report.pages.info import info_page, signals_found
from ident.results import Damage, Gap, TopicHealth


def test_says_first_what_could_not_be_read(info_result):
    page = info_page(info_result)
    assert page.verdict.tone == "caution"
    assert (
        page.verdict.text.replace("\u00a0", " ")
        == "3 runs read, 2 min 9 s; 1 of them damaged; 1 log unreadable."
    )
    whole = replace(info_result, unreadable=[], runs=info_result.runs[2:])
    assert (info_page(whole).verdict.badge, info_page(whole).verdict.tone) == ("read", "good")


def test_logs_without_a_known_signal_say_what_to_do(info_result):
    runs = [replace(run, signals={}) for run in info_result.runs]
    verdict = info_page(replace(info_result, runs=runs)).verdict
    assert (verdict.badge, verdict.tone) == ("no signals", "caution")
    assert "ident init" in verdict.next_step


def test_unreadable_logs_stand_with_their_reason(info_result):
    section = next(section for section in info_page(info_result).sections if section.name == "unreadable")
    assert isinstance(section.blocks[0], Lines)
    assert section.blocks[0].items[0][1] == "0 bytes: nothing to read"


def test_says_in_which_runs_a_signal_is(info_result):
    first = info_result.runs[0]
    with_speed = replace(first, signals={**first.signals, "speed": first.signals["steering_wheel_angle"]})
    rows = {row[0].text: row for row in signals_found([with_speed, *info_result.runs[1:]]).rows}
    assert rows["speed"][2].text == "1 of 3"
    assert rows["speed"][1].text == "m/s"
    assert "steering_sines_a" in rows["speed"][4].text
    assert (rows["yaw rate"][2].text, rows["yaw rate"][4].text) == ("0 of 3", "every run")


def test_draws_where_messages_are_missing(info_result):
    figure = health.gap_figure(info_result.runs[0])
    assert isinstance(figure, Figure)
    go.Figure(_plain(figure.spec))
    (trace,) = figure.spec["data"]
    assert trace["x"][:2].tolist() == pytest.approx([14.2, 14.72])
    assert health.gap_figure(info_result.runs[2]) is None


def test_short_gaps_are_widened_and_near_ones_are_drawn_as_one():
    assert health.merged([(1.0, 1.1), (1.2, 1.3), (5.0, 6.0)], 0.4) == [
        pytest.approx((0.85, 1.45)),
        pytest.approx((5.0, 6.0)),
    ]


def test_ten_thousand_gaps_make_few_bars(info_result):
    gaps = [Gap(0.003 * index, 0.002) for index in range(10_000)]
    topic = TopicHealth("/a", "t", 5, 1.0, 0.1, gaps, 3, "log")
    run = replace(info_result.runs[0], topics=[topic])
    assert len(health.gap_figure(run).spec["data"][0]["x"]) <= 3 * 601


def test_only_topics_that_a_signal_comes_from_count(info_result):
    run = info_result.runs[0]
    other = TopicHealth("/vehicle/steering_wheel_other", "t", 5, 1.0, 0.1, [Gap(1.0, 1.0)], 7, "log")
    with_other = replace(run, topics=[*run.topics, other])
    assert [topic.name for topic in health.used_topics(with_other)] == [
        "/control/steering_wheel_request",
        "/vehicle/steering_wheel",
    ]
    assert health.brief([with_other]).text == "1 gap (50 messages lost), no damage"
    assert health.brief(info_result.runs[2:]).text == "no gaps, no damage"


def test_damage_says_what_is_known_of_the_loss():
    assert health.damage_text(Damage("cut")) == "cut"
    assert health.damage_text(Damage("cut", 3, 1.5, 1)) == "cut (lost: 3 messages, 1.50\u00a0s, 1 byte)"


def test_details_of_a_few_runs_are_open(info_result):
    def opened(result):
        section = info_page(result).sections[0]
        return [block.open for block in section.blocks if isinstance(block, Details)]

    assert opened(info_result) == [True, True, True]
    assert opened(replace(info_result, runs=info_result.runs * 2)) == [True] + [False] * 5
