"""What stands around the model: signal blocks before it, late sensors behind it, probes of its inputs.

A block has one coordinate of the fit. It acts on whole stretches of driving, not on windows: whether the play
of a linkage is used up does not begin anew where a window does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ident.dynamics.blocks import delayed, play
from ident.estimation.vehicle_records import Stretch

Array = NDArray[np.float64]


class InputBlock(Protocol):
    """Changes the road-wheel angle before the model.

    name : of its coordinate
    """

    @property
    def name(self) -> str:
        """Of its coordinate."""
        ...

    def through(self, times: Array, angle: Array, given: Array, value: float) -> tuple[Array, Array, Array]:
        """One stretch.

        Parameters
        ----------
        times, angle : (k,) [s], [rad]; given : (k, c) derivatives of the angle to parameters before it
        value : of the coordinate's parameter

        Returns
        -------
        (k,) angle after the block, (k, c) its derivatives to the parameters before it, (k,) to its own
        """
        ...


@dataclass(frozen=True)
class LinkagePlay:
    """``steering_linkage_play``: the road wheels follow only when the play of whole width w is used up."""

    name: str = "linkage_play"

    def through(self, times: Array, angle: Array, given: Array, value: float) -> tuple[Array, Array, Array]:
        """See :class:`InputBlock`."""
        del times
        out, derivatives = play(angle, value, derivatives=given)
        return out, derivatives[:, 1:], derivatives[:, 0]


@dataclass(frozen=True)
class LateAngle:
    """``sensor_latency`` of the steering angle: the wheels stood there a delay before the stamp says so."""

    name: str = "delay.road_wheel_angle"

    def through(self, times: Array, angle: Array, given: Array, value: float) -> tuple[Array, Array, Array]:
        """See :class:`InputBlock`."""
        out, to_delay = delayed(times, angle, -value, times)
        before = [delayed(times, np.ascontiguousarray(one), -value, times)[0] for one in given.T]
        return out, np.array(before).reshape(given.shape[1], -1).T, -to_delay


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


NOTHING_AROUND = Around()


@dataclass(frozen=True)
class Probe:
    """A small disturbance, to see what it does to the measured signals at first order.

    inputs : input of the model -> (N,) what is added on the grid of all windows
    signals : measured signal -> (n,) what is added at its samples
    """

    inputs: Mapping[str, Array] = field(default_factory=dict)
    signals: Mapping[str, Array] = field(default_factory=dict)


def through_blocks(
    blocks: Sequence[InputBlock],
    stretches: Sequence[Stretch],
    angle: Array,
    given: Array,
    values: Sequence[float],
    columns: Sequence[int],
) -> tuple[Array, Array]:
    """Take the angle (N,) and its derivatives (N, c) through all blocks, in their order.

    values, columns : of each block, the value of its parameter and which column of the derivatives it has
    """
    angle, given = angle.copy(), given.copy()
    for stretch in stretches:
        now, known = stretch.whole(angle), stretch.whole(given)
        for block, value, column in zip(blocks, values, columns, strict=True):
            now, known, own = block.through(stretch.times, now, known, value)
            known = known.copy()
            known[:, column] += own
        angle[stretch.rows], given[stretch.rows] = now[stretch.place], known[stretch.place]
    return angle, given
