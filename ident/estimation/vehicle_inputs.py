"""What stands around the model: signal blocks before it, late sensors behind it, probes of its inputs.

A block has one coordinate of the fit. It acts on whole stretches of driving, not on windows: whether the play
of a linkage is used up does not begin anew where a window does. Where in the play a stretch begins is not
known, and half a play of a few milliradians is a large angle until it is used up: it is estimated, a term of
the run for each of its stretches.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.blocks import delayed, play
from ident.estimation.coordinates import RunTerm
from ident.estimation.vehicle_records import Stretch, Windows

Array = NDArray[np.float64]


MOST_BEGUN = 4  # stretches of a run, the longest ones, for which it is estimated where a play begins
BEGIN_STD = 1.0  # of that; its hyperbolic tangent is then anywhere in the play about equally
NEAREST_END = 0.999  # of half the play, to which a step leads at most


@dataclass(frozen=True)
class Through:
    """What a block makes of the angle of one stretch.

    angle : (k,); given : (k, c) its derivatives to the parameters before the block
    own, begin : (k,) those to the block's own parameter, and to where it begins
    """

    angle: Array
    given: Array
    own: Array
    begin: Array


class InputBlock(Protocol):
    """Changes the road-wheel angle before the model.

    name : of its coordinate
    hysteresis : whether its output depends on where it stood before, with corners where it begins to follow
    """

    @property
    def name(self) -> str:
        """Of its coordinate."""
        ...

    @property
    def hysteresis(self) -> bool:
        """Whether its output depends on where it stood before."""
        ...

    def through(self, times: Array, angle: Array, given: Array, value: float, begin: float = 0.0) -> Through:
        """One stretch.

        Parameters
        ----------
        times, angle : (k,) [s], [rad]; given : (k, c) derivatives of the angle to parameters before it
        value : of the coordinate's parameter
        begin : where its output stands as the stretch begins: at tanh of this, between the ends at -1 and 1
        """
        ...


@dataclass(frozen=True)
class LinkagePlay:
    """``steering_linkage_play``: the road wheels follow only when the play of whole width w is used up."""

    name: str = "linkage_play"
    hysteresis: bool = True

    def through(self, times: Array, angle: Array, given: Array, value: float, begin: float = 0.0) -> Through:
        """See :class:`InputBlock`."""
        del times
        share = 0.5 * float(np.tanh(begin))
        start = float(angle[0]) + share * value
        out, derivatives = play(angle, value, start=start, derivatives=given)
        rests = np.cumprod(out == start).astype(bool)  # until the input reaches an end of the play
        derivatives[rests, 0] = share
        derivatives[rests, 1:] = given[0]
        return Through(out, derivatives[:, 1:], derivatives[:, 0], rests * value * (0.5 - 2 * share**2))


def moved_begins(begins: Array, steps: Array) -> Array:
    """Where a play begins after steps that were found to first order; all of one shape.

    The model follows the place in the play, their hyperbolic tangent: the steps are taken in that. Near an
    end it hardly changes, and a step in its argument would lead far past the other end.
    """
    place = np.tanh(begins)
    made = place + (1.0 - place**2) * steps
    return np.asarray(np.arctanh(np.clip(made, -NEAREST_END, NEAREST_END)))


@dataclass(frozen=True)
class LateAngle:
    """``sensor_latency`` of the steering angle: the wheels stood there a delay before the stamp says so."""

    name: str = "delay.road_wheel_angle"
    hysteresis: bool = False

    def through(self, times: Array, angle: Array, given: Array, value: float, begin: float = 0.0) -> Through:
        """See :class:`InputBlock`."""
        del begin
        out, to_delay = delayed(times, angle, -value, times)
        before = [delayed(times, np.ascontiguousarray(one), -value, times)[0] for one in given.T]
        moved = np.array(before).reshape(given.shape[1], -1).T
        return Through(out, moved, -to_delay, np.zeros_like(out))


@dataclass(frozen=True)
class Around:
    """What stands around the model: blocks before it, sensors that read late behind it.

    blocks : before the model, in order, each with a coordinate of its name
    late : measured signal -> name of the coordinate that holds its delay [s]
    pushes : coordinate -> input of the model -> (N,) what is added to it, times the coordinate's value
    """

    blocks: tuple[InputBlock, ...] = ()
    late: Mapping[str, str] = field(default_factory=dict)
    pushes: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Coordinates that the model itself does not know."""
        return tuple(
            dict.fromkeys([*(block.name for block in self.blocks), *self.late.values(), *self.pushes])
        )

    @property
    def has_corners(self) -> bool:
        """Whether a block before the model depends on where it stood before."""
        return any(block.hysteresis for block in self.blocks)


NOTHING_AROUND = Around()


@dataclass(frozen=True)
class Probe:
    """A small disturbance, to see what it does to the measured signals at first order.

    inputs : input of the model -> (N,) what is added on the grid of all windows
    signals : measured signal -> (n,) what is added at its samples
    """

    inputs: Mapping[str, Array] = field(default_factory=dict)
    signals: Mapping[str, Array] = field(default_factory=dict)


def begin_name(block: str, number: int) -> str:
    """Name of the term of a run for where a block begins in one of its stretches, the longest being 0."""
    return f"{block} begins {number}"


def places_in_runs(windows: Windows) -> list[tuple[int, int]]:
    """Run of each stretch, and its place among those of its run, the longest first."""
    runs = [int(windows.run_of(stretch)) for stretch in windows.stretches]
    made, seen = [(run, 0) for run in runs], Counter[int]()
    for number in sorted(range(len(runs)), key=lambda k: -windows.stretches[k].times.size):
        made[number] = (runs[number], seen[runs[number]])
        seen[runs[number]] += 1
    return made


def begin_terms(blocks: Sequence[InputBlock], windows: Windows) -> list[RunTerm]:
    """Terms of the runs for where blocks with hysteresis begin."""
    places = places_in_runs(windows) if blocks else []
    return [
        RunTerm(begin_name(block.name, number), BEGIN_STD, frozenset(run for run, k in places if k == number))
        for block in blocks
        if block.hysteresis
        for number in range(min(MOST_BEGUN, 1 + max(k for _, k in places)))
    ]


@dataclass(frozen=True)
class Placed:
    """Where a block stands among the parameters.

    value, column : of its coordinate, and which column of the derivatives it has
    begins, begin_columns : (stretches,) where it begins in each, and its column, None where it is held
    """

    block: InputBlock
    value: float
    column: int
    begins: Sequence[float]
    begin_columns: Sequence[int | None]


def placed_blocks(
    blocks: Sequence[InputBlock],
    values: Mapping[str, float],
    terms: Mapping[str, Array],
    places: Sequence[tuple[int, int]],
    active: Sequence[str],
) -> list[Placed]:
    """Place blocks among the parameters of a fit.

    Parameters
    ----------
    values : of the coordinates, by name; terms : (runs,) of the runs, by name
    places : of all stretches, as :func:`places_in_runs` gives them
    active : names of the columns of the derivatives
    """
    made = []
    for block in blocks:
        names = [(run, begin_name(block.name, number)) for run, number in places]
        begins = [float(terms[name][run]) if name in terms else 0.0 for run, name in names]
        columns = [active.index(name) if name in terms else None for _, name in names]
        made.append(Placed(block, values[block.name], active.index(block.name), begins, columns))
    return made


def through_blocks(
    placed: Sequence[Placed], stretches: Sequence[Stretch], angle: Array, given: Array
) -> tuple[Array, Array]:
    """Take the angle (N,) and its derivatives (N, c) through all blocks, in their order."""
    angle, given = angle.copy(), given.copy()
    for number, stretch in enumerate(stretches):
        now, known = stretch.whole(angle), stretch.whole(given)
        for one in placed:
            made = one.block.through(stretch.times, now, known, one.value, one.begins[number])
            now, known = made.angle, made.given.copy()
            known[:, one.column] += made.own
            if (column := one.begin_columns[number]) is not None:
                known[:, column] += made.begin
        angle[stretch.rows], given[stretch.rows] = now[stretch.place], known[stretch.place]
    return angle, given
