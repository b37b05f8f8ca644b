"""What stands between the steering angle and the wheels runs on through windows, with exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from ident.estimation.vehicle_inputs import (
    LateAngle,
    LinkagePlay,
    Placed,
    begin_terms,
    places_in_runs,
    through_blocks,
)
from ident.estimation.vehicle_records import MotionRecord, Samples, Windows, cut

STEP = 0.01
WIDTH, DELAY = 0.012, 0.0437
TIMES = STEP * np.arange(1201)
ANGLE = 0.05 * np.sin(0.9 * TIMES) + 0.01 * np.sin(4.1 * TIMES + 1.0)


def windows_of(lead: float, *, gap: bool = False) -> Windows:
    """Two runs in windows of three seconds; with a gap, the first run is interrupted in its middle."""
    pieces = [(0, slice(0, 601)), (0, slice(650, 1201))] if gap else [(0, slice(0, 1201))]
    pieces.append((1, slice(0, 1201)))
    made = []
    for run, own in pieces:
        grid = TIMES[own]
        sampled = {"yaw_rate": Samples(grid, np.zeros(grid.size))}
        made += cut(MotionRecord(run, grid, ANGLE[own], 10 + 0 * grid, sampled), 3.0, lead)
    return Windows(made)


def on_grid(windows: Windows, values: np.ndarray) -> np.ndarray:
    """Values at TIMES, on the grid of all windows."""
    return values[np.rint(windows.times / STEP).astype(int)]


def by_hand(angle: np.ndarray, width: float) -> np.ndarray:
    """Play of a linkage that stands in its middle at first."""
    made = [float(angle[0])]
    for now in angle[1:]:
        made.append(min(max(made[-1], now - width / 2), now + width / 2))
    return np.array(made)


def through(
    windows: Windows, blocks: tuple, values: list[float], begins: tuple[float, ...] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Columns: a change of the ratio, each block's own, then where each stretch begins."""
    count = len(windows.stretches)
    begun = begins or (0.0,) * count
    given = np.zeros((windows.times.size, 1 + len(blocks) + count))
    given[:, 0] = -windows.inputs[:, 0]
    first = 1 + len(blocks)
    placed = [
        Placed(block, value, 1 + number, begun, list(range(first, first + count)))
        for number, (block, value) in enumerate(zip(blocks, values, strict=True))
    ]
    return through_blocks(placed, windows.stretches, windows.inputs[:, 0], given)


@pytest.mark.parametrize("lead", [0.0, 0.2])
def test_a_play_runs_on_through_the_windows_of_a_run(lead: float) -> None:
    windows = windows_of(lead)
    assert len(windows.records) == 8
    angle, _ = through(windows, (LinkagePlay(),), [WIDTH])
    assert angle == pytest.approx(on_grid(windows, by_hand(ANGLE, WIDTH)), abs=1e-15)
    begins = windows.offsets[:-1]
    taken_up = np.abs(angle - windows.inputs[:, 0])[begins]
    assert np.count_nonzero(taken_up > 1e-3) == 6  # anew at the start of each run, and nowhere else


def test_a_play_begins_anew_after_an_interruption() -> None:
    windows = windows_of(0.0, gap=True)
    assert len(windows.stretches) == 3
    angle, _ = through(windows, (LinkagePlay(),), [WIDTH])
    of_grid = np.repeat(windows.run, np.diff(windows.offsets))
    later = (of_grid == 0) & (windows.times > 6.2)
    place = np.rint(windows.times[later] / STEP).astype(int) - 650
    assert place.min() == 0
    assert angle[later] == pytest.approx(by_hand(ANGLE[650:], WIDTH)[place], abs=1e-15)


def test_a_late_angle_stood_there_before_its_stamp() -> None:
    windows = windows_of(0.2)
    angle, _ = through(windows, (LateAngle(),), [DELAY])
    expected = np.interp(windows.times + DELAY, TIMES, ANGLE)
    assert angle == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(
    "blocks", [(LinkagePlay(),), (LateAngle(),), (LinkagePlay(), LateAngle()), (LateAngle(), LinkagePlay())]
)
def test_derivatives_through_the_blocks_are_exact(blocks: tuple) -> None:
    windows = windows_of(0.2)
    values = [WIDTH if isinstance(block, LinkagePlay) else DELAY for block in blocks]
    _, exact = through(windows, blocks, values)
    small = 1e-9
    for number in range(len(blocks)):
        more, less = list(values), list(values)
        more[number] += small
        less[number] -= small
        change = (through(windows, blocks, more)[0] - through(windows, blocks, less)[0]) / (2 * small)
        assert_equal_but_at_kinks(exact[:, 1 + number], change)
    ends = [Windows(windows.records) for _ in range(2)]
    for one, sign in zip(ends, (1, -1), strict=True):
        one.inputs = windows.inputs * np.array([1 - sign * small, 1.0])
    change = (through(ends[0], blocks, values)[0] - through(ends[1], blocks, values)[0]) / (2 * small)
    assert_equal_but_at_kinks(exact[:, 0], change)


def assert_equal_but_at_kinks(exact: np.ndarray, difference: np.ndarray) -> None:
    """A difference straddles the kink of a held output at a grid point or two for each reversal."""
    scale = np.abs(difference).max()
    assert scale > 0.01
    assert np.mean(np.abs(exact - difference) < 1e-5 * scale) > 0.995


def test_a_play_that_is_wider_than_the_steering_holds_the_wheels() -> None:
    windows = windows_of(0.2)
    angle, exact = through(windows, (LinkagePlay(),), [1.0])
    assert np.ptp(angle) == 0
    assert np.all(exact[:, 1] == 0)


def test_no_block_changes_nothing() -> None:
    windows = windows_of(0.2)
    angle, given = through(windows, (), [])
    assert np.array_equal(angle, windows.inputs[:, 0])
    assert np.array_equal(given[:, 0], -windows.inputs[:, 0])


@pytest.mark.parametrize("share", [-0.8, 0.3])
def test_a_play_begins_where_it_is_said_to_and_forgets_it_once_it_is_used_up(share: float) -> None:
    windows = windows_of(0.2)
    angle, _ = through(windows, (LinkagePlay(),), [WIDTH], (float(np.arctanh(share)), 0.0))
    made = [float(ANGLE[0]) + share * WIDTH / 2]
    for now in ANGLE[1:]:
        made.append(min(max(made[-1], now - WIDTH / 2), now + WIDTH / 2))
    own = np.repeat(windows.run, np.diff(windows.offsets)) == 0
    assert angle[own] == pytest.approx(on_grid(windows, np.array(made))[own], abs=1e-15)
    centred, _ = through(windows, (LinkagePlay(),), [WIDTH])
    differs = np.abs(angle - centred) > 1e-12
    assert differs[0]
    assert not differs[-1]
    assert not differs[~own].any()


def test_derivatives_to_where_a_play_begins_are_exact() -> None:
    windows = windows_of(0.2)
    begins, small = (0.4, -0.7), 1e-7
    _, exact = through(windows, (LinkagePlay(),), [WIDTH], begins)
    for number in range(2):
        ends = [tuple(b + sign * small * (k == number) for k, b in enumerate(begins)) for sign in (1.0, -1.0)]
        more, less = (through(windows, (LinkagePlay(),), [WIDTH], one)[0] for one in ends)
        change = (more - less) / (2 * small)
        assert np.abs(change).max() > 1e-3
        assert np.mean(np.abs(exact[:, 2 + number] - change) < 1e-6 * np.abs(change).max()) > 0.995
    wider, narrower = (
        through(windows, (LinkagePlay(),), [WIDTH + sign * 1e-9], begins)[0] for sign in (1.0, -1.0)
    )
    assert_equal_but_at_kinks(exact[:, 1], (wider - narrower) / 2e-9)


def test_each_stretch_of_a_run_begins_by_itself_the_longest_first() -> None:
    windows = windows_of(0.0, gap=True)
    assert places_in_runs(windows) == [(0, 0), (0, 1), (1, 0)]
    terms = begin_terms((LateAngle(), LinkagePlay()), windows)
    assert [(one.name, one.only) for one in terms] == [
        ("linkage_play begins 0", frozenset({0, 1})),
        ("linkage_play begins 1", frozenset({0})),
    ]
