"""A run is divided where its commands are not known, and nowhere else."""

import numpy as np
import pytest

from ident.experiments.stretches import find_stretches, jitter_of

TIME = np.arange(0, 20, 0.02)
SEEN = np.arange(0, 20, 0.01)
COMMAND = np.sin(TIME)
ANSWER = np.sin(SEEN - 0.4)


def without(*lost):
    return np.delete(np.arange(TIME.size), lost)


def stretches(keep=slice(None), seen=slice(None), **more):
    return find_stretches(TIME[keep], COMMAND[keep], SEEN[seen], ANSWER[seen], **more)


def test_an_unbroken_run_is_one_stretch():
    (one,) = stretches()
    assert one.lost.size == 0
    assert one.starts.tolist() == [0]
    assert one.times.size == SEEN.size


def test_lost_commands_are_put_in_their_place():
    (one,) = stretches(without(300, 301))
    assert one.lost.tolist() == [300, 301]
    assert one.command_times == pytest.approx(TIME)
    assert one.command_values[[300, 301]] == pytest.approx(COMMAND[[300, 301]], abs=1e-3)


def test_a_command_that_did_not_change_across_a_loss_has_lost_nothing():
    (one,) = find_stretches(TIME[without(300)], 0.3 + 0 * TIME[without(300)], SEEN, ANSWER)
    assert one.lost.size == 0
    assert one.command_times.size == TIME.size - 1


def test_a_longer_loss_divides_the_run_and_nothing_is_used_in_between():
    first, second = stretches(without(*range(300, 330)))
    assert first.times[-1] <= TIME[299] + 0.03
    assert second.times[0] >= TIME[330]


def test_a_lost_measurement_restarts_the_noise_and_not_the_stretch():
    (one,) = stretches(seen=np.delete(np.arange(SEEN.size), [700]))
    assert one.starts.tolist() == [0, 700]


def test_commands_sent_only_when_they_change_are_not_taken_for_losses():
    random = np.random.default_rng(0)
    times = np.cumsum(random.exponential(0.5, 40))
    (one,) = find_stretches(times, random.standard_normal(40), SEEN, ANSWER)
    assert one.lost.size == 0
    assert one.times[-1] == SEEN[-1]


def test_only_what_is_followed_is_used():
    first, second = stretches(enabled=[(2.0, 6.0), (10.0, 15.0)])
    assert first.times[0] >= 2.0
    assert first.times[-1] <= 6.0 + 0.03
    assert second.times[0] >= 10.0
    assert second.times[-1] <= 15.0 + 0.03


def test_rest_is_told_from_motion_at_the_start():
    (moving,) = stretches()
    (resting,) = find_stretches(TIME, COMMAND, SEEN, np.where(SEEN < 0.3, 0.0, ANSWER))
    assert not moving.at_rest
    assert resting.at_rest


def test_jitter_is_a_share_of_the_period():
    random = np.random.default_rng(1)
    regular = np.arange(5000) * 0.01
    assert jitter_of(regular) == pytest.approx(0.0, abs=1e-9)
    spread = regular + random.normal(0, 0.001, regular.size)
    assert jitter_of(spread) == pytest.approx(0.1 * np.sqrt(2), rel=0.05)
