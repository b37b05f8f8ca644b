"""Sines and chirps of a simulated actuator against its exact transfer function.

The model that is handed in is wrong by a per cent or more on purpose: what comes out must be the truth all
the same. The truth is written out here and shares nothing with ident.
"""

from dataclasses import replace

import numpy as np
import pytest
from generator.commands import Sine, sines, sines_end
from generator.steering import SteeringTest, steering_signals
from generator.truth import Actuator, load_truth
from scipy.stats import binom

from ident.errors import NotIdentifiable
from ident.estimation.broadband import h1
from ident.estimation.frequency_response import (
    Excerpt,
    Plant,
    fit_sine,
    held_fundamental,
    prepare_sine,
    sine_noise,
)
from ident.experiments.find import find_experiments
from ident.experiments.stretches import find_stretches

TRUTH = load_truth().steering
ACTUATOR = TRUTH.actuator
NINE = (0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)


def transfer(frequency, actuator=ACTUATOR):
    s = 1j * frequency
    return (
        actuator.gain
        * np.exp(-s * actuator.dead_time)
        / ((1 + s * actuator.time_constant_1) * (1 + s * actuator.time_constant_2))
    )


def true_phase(frequency, actuator=ACTUATOR):
    lags = (actuator.time_constant_1, actuator.time_constant_2)
    return -frequency * actuator.dead_time - sum(np.arctan(frequency * lag) for lag in lags)


def plant(actuator=ACTUATOR, *, gain=1.0, dead_time=0.0, total=1.0, product=1.0):
    """The model, with the given errors."""
    first, second = actuator.time_constant_1, actuator.time_constant_2
    return Plant(
        actuator.gain * gain,
        actuator.dead_time + dead_time,
        float(np.real(first + second)) * total,
        float(np.real(first * second)) * product,
    )


WRONG = plant(gain=1.01, dead_time=0.005, total=1.02, product=1.05)


def excerpts(signals):
    """(excerpt, frequency) of every sine that is found."""
    stretches = find_stretches(signals.request_time, signals.request, signals.angle_time, signals.angle)
    return [
        (excerpt(stretch, one.start, one.end_time), one.frequency)
        for stretch in stretches
        for one in find_experiments(stretch)
        if one.kind == "sine" and not one.rejected
    ]


def excerpt(stretch, begin, end):
    return Excerpt(
        stretch.command_times,
        stretch.command_values,
        stretch.times,
        stretch.measured,
        stretch.starts,
        begin,
        end,
    )


def responses(signals, model=WRONG, jitter=0.0):
    fits = [prepare_sine(one, frequency, model) for one, frequency in excerpts(signals)]
    shape = sine_noise(fits, jitter)
    return [fit_sine(fit, model, shape) for fit in fits]


def with_rates(request, angle, **errors):
    channel = replace(TRUTH.angle.channels["angle"], **errors)
    return replace(
        TRUTH,
        request=replace(TRUTH.request, rate=request),
        angle=replace(TRUTH.angle, rate=angle, channels={"angle": channel}),
    )


def one_sine(frequency, cycles, amplitude=0.4):
    segments = [Sine(frequency, amplitude, cycles)]
    return SteeringTest(sines(2.0, segments, 1.0), sines_end(2.0, segments, 1.0))


@pytest.fixture(scope="module")
def sample_sines():
    """Responses of steering_sines_a over seeds: seed -> nine responses."""
    return {seed: responses(steering_signals("steering_sines_a", TRUTH, seed), WRONG) for seed in range(12)}


def within(count, trials, share=0.95):
    """Whether so many successes are likely for this share: 99.9 % band of the binomial."""
    low, high = binom.ppf([0.0005, 0.9995], trials, share)
    return low <= count <= high


def test_all_nine_sample_sines_give_a_point(sample_sines):
    for found in sample_sines.values():
        assert np.allclose([one.frequency for one in found], NINE, rtol=1e-3)


def test_intervals_of_gain_and_phase_hold_the_truth_although_the_model_is_wrong(sample_sines):
    points = [one for found in sample_sines.values() for one in found]
    gain = [abs(one.gain - abs(transfer(one.frequency))) < 1.96 * one.gain_std for one in points]
    phase = [abs(one.phase - true_phase(one.frequency)) < 1.96 * one.phase_std for one in points]
    assert within(sum(gain), len(points))
    assert within(sum(phase), len(points))


@pytest.mark.parametrize("index", range(9))
def test_errors_at_each_frequency_are_of_the_size_of_their_standard_errors(sample_sines, index):
    points = [found[index] for found in sample_sines.values()]
    gain = np.array([(one.gain - abs(transfer(one.frequency))) / one.gain_std for one in points])
    phase = np.array([(one.phase - true_phase(one.frequency)) / one.phase_std for one in points])
    # Chi squared of 12 degrees of freedom lies within 1.9 … 36 with 99.94 %.
    assert 1.9 < gain @ gain < 36
    assert 1.9 < phase @ phase < 36


def test_errors_are_small_enough_to_see_half_a_per_cent(sample_sines):
    for one in sample_sines[0]:
        assert one.gain_std < 0.0025 * one.gain
        assert one.phase_std < 0.0025


def test_phase_is_continuous_beyond_half_a_turn():
    slow = replace(ACTUATOR, dead_time=0.5)
    signals = steering_signals(one_sine(10.0, 12.0), replace(TRUTH, actuator=slow), 3)
    (one,) = responses(signals, plant(slow, dead_time=0.004))
    assert one.phase < -2 * np.pi
    assert one.phase == pytest.approx(true_phase(one.frequency, slow), abs=4 * one.phase_std)


@pytest.mark.parametrize("request_rate", [20.0, 50.0])
@pytest.mark.parametrize("angle_rate", [20.0, 50.0])
def test_the_hold_of_the_command_is_not_taken_for_the_actuator(request_rate, angle_rate):
    """Held at 20 Hz, a sine of 10 rad/s is late by 25 ms (0.25 rad) and lower by 1 %.

    Where the angle is sampled at 20 Hz too, the images of the staircase fall on the sine (0.1 %); the model
    takes them away but for its own error at 115 rad/s.
    """
    close = plant(gain=1.005, dead_time=0.0005, total=1.005, product=1.01)
    truth = with_rates(request_rate, angle_rate, white_std=1e-5, noise_std=0.0, resolution=0.0)
    (one,) = responses(steering_signals(one_sine(10.0, 12.0), truth, 5), close)
    assert one.gain == pytest.approx(abs(transfer(one.frequency)), rel=2e-4)
    assert one.phase == pytest.approx(true_phase(one.frequency), abs=2e-4)


def test_the_fundamental_of_a_staircase_is_that_of_the_sampling_theorem():
    """A sine held for T has the fundamental A sinc(w T / 2), late by T / 2."""
    period, frequency = 0.05, 2 * np.pi / 0.6
    times = period * np.arange(240)  # 20 cycles of 12 commands
    found = held_fundamental(times, 0.4 * np.cos(frequency * times), frequency, (0.0, 12.0))
    half = frequency * period / 2
    assert found == pytest.approx(0.4 * np.sin(half) / half * np.exp(-1j * half), rel=1e-12)


def test_the_fundamental_does_not_depend_on_offset_and_time_origin():
    times = 0.02 * np.arange(400)
    values = 0.3 * np.sin(3.0 * times)
    window = (0.0, 8.0)
    plain = held_fundamental(times, values, 3.0, window)
    assert held_fundamental(times, values + 2.0, 3.0, window) == pytest.approx(plain, abs=1e-12)
    turned = held_fundamental(times, values, 3.0, window, middle=4.0)
    assert turned == pytest.approx(plain * np.exp(3.0j * 4.0), abs=1e-12)


def test_a_linear_actuator_has_no_harmonics(sample_sines):
    """Of a Rayleigh amplitude, the square over the variance of its parts is chi squared of two."""
    for order in (2, 3):
        squares = [
            (one.harmonics[order][0] / one.harmonics[order][1]) ** 2
            for found in sample_sines.values()
            for one in found
        ]
        below = sum(square < 5.991 for square in squares)  # its 95 % point
        assert within(below, len(squares))


@pytest.mark.parametrize("frequency", [1.0, 3.0])
def test_harmonics_of_a_cubic_actuator_are_those_of_the_closed_form(frequency):
    """u + b u³ has (A + 3/4 b A³) at w and -b A³/4 at 3 w; both pass the hold and the actuator."""
    cubic, amplitude, period = 0.4, 0.6, 1 / TRUTH.request.rate
    truth = with_rates(50.0, 100.0, white_std=2e-5, noise_std=0.0, resolution=0.0)
    test = one_sine(frequency, 8.0, amplitude)
    acted = SteeringTest(lambda t: test.command(t) + cubic * test.command(t) ** 3, test.duration)
    signals = replace(steering_signals(acted, truth, 2), request=steering_signals(test, truth, 2).request)
    (one,) = responses(signals)

    def hold(w):
        return np.sinc(w * period / 2 / np.pi)

    fundamental = amplitude + 0.75 * cubic * amplitude**3
    at_three = 0.25 * cubic * amplitude**3 * abs(transfer(3 * frequency)) * hold(3 * frequency)
    expected = at_three / (fundamental * abs(transfer(frequency)) * hold(frequency))
    assert one.harmonics[3][0] == pytest.approx(expected, rel=0.01)
    assert one.harmonics[2][0] < 0.01 * expected
    assert one.gain == pytest.approx(abs(transfer(frequency)) * fundamental / amplitude, rel=1e-3)


def test_a_drift_of_the_sensor_does_not_enter_the_gain():
    signals = steering_signals(one_sine(0.5, 1.5), TRUTH, 4)
    drifting = replace(signals, angle=signals.angle + 0.004 * signals.angle_time)
    (one,) = responses(drifting)
    assert one.gain == pytest.approx(abs(transfer(one.frequency)), abs=4 * one.gain_std)
    assert one.phase == pytest.approx(true_phase(one.frequency), abs=4 * one.phase_std)


def test_jittering_stamps_and_a_gap_in_the_measurement_do_no_harm():
    truth = replace(TRUTH, angle=replace(TRUTH.angle, jitter=0.003))
    signals = steering_signals(one_sine(3.0, 8.0), truth, 6)
    kept = (signals.angle_time < 6.0) | (signals.angle_time > 6.4)
    signals = replace(signals, angle_time=signals.angle_time[kept], angle=signals.angle[kept])
    (one,) = responses(signals, jitter=0.3)
    assert one.gain == pytest.approx(abs(transfer(one.frequency)), abs=4 * one.gain_std)
    assert one.phase == pytest.approx(true_phase(one.frequency), abs=4 * one.phase_std)
    assert one.gain_std < 0.002


def test_harmonics_too_fast_for_the_measurement_are_left_out():
    truth = with_rates(50.0, 8.0)
    (one,) = responses(steering_signals(one_sine(9.0, 30.0), truth, 1))
    assert set(one.harmonics) == {2}
    assert one.gain == pytest.approx(abs(transfer(one.frequency)), abs=4 * one.gain_std)


def test_refuses_a_sine_of_which_the_answer_is_hardly_recorded():
    signals = steering_signals(one_sine(1.0, 3.0), TRUTH, 1)
    ((record, frequency),) = excerpts(signals)
    with pytest.raises(NotIdentifiable, match=r"cycles in \d+ samples of the answer"):
        prepare_sine(record.answer(0.0, record.begin + 3.0), frequency, WRONG)


# --- broadband ------------------------------------------------------------------------------------


def chirp(slow=0.3, fast=15.0, duration=60.0, amplitude=0.4):
    """A sine whose frequency rises exponentially, at rest for 2 s before and 3 s after."""
    rate = np.log(fast / slow) / duration

    def command(t):
        inside = (t >= 2.0) & (t < 2.0 + duration)
        x = np.clip(t - 2.0, 0.0, duration)
        return np.where(inside, amplitude * np.sin(slow / rate * np.expm1(rate * x)), 0.0)

    return SteeringTest(command, duration + 5.0)


def spectrum(signals, end=62.0, model=WRONG):
    (stretch,) = find_stretches(signals.request_time, signals.request, signals.angle_time, signals.angle)
    return h1(excerpt(stretch, 2.0, end), model)


@pytest.fixture(scope="module")
def chirps():
    return [point for seed in range(12) for point in spectrum(steering_signals(chirp(), TRUTH, seed))]


def test_the_spectrum_of_a_chirp_holds_the_truth_although_the_model_is_wrong(chirps):
    gain = sum(abs(p.gain - abs(transfer(p.frequency))) < 1.96 * p.gain_std for p in chirps)
    phase = sum(abs(p.phase - true_phase(p.frequency)) < 1.96 * p.phase_std for p in chirps)
    assert within(gain, len(chirps))
    assert within(phase, len(chirps))


def test_the_spectrum_of_a_chirp_spans_its_frequencies_and_no_others(chirps):
    frequency = np.array([point.frequency for point in chirps])
    assert 0.3 < frequency.min() < 0.8
    assert 10.0 < frequency.max() < 15.5


def test_coherence_is_that_of_the_signal_and_noise_put_in():
    """With a held white request and white noise, (1 - g²) / g² is s² / |G H A|², H the hold."""
    rng = np.random.default_rng(8)
    level, size, period, length = 0.05, 0.3, 0.02, 400.0
    truth = with_rates(50.0, 50.0, white_std=level, noise_std=0.0, resolution=0.0, bias=0.0)
    values = size * rng.standard_normal(int(length / period) + 400)
    test = SteeringTest(lambda t: values[np.floor((t + 4.0) / period).astype(int)], length)
    points = spectrum(steering_signals(test, truth, 1), end=length - 1.0, model=plant())
    inner = [point for point in points if 1.0 < point.frequency < 8.0]
    frequency = np.array([point.frequency for point in inner])
    coherence = np.array([point.coherence for point in inner])
    expected = (level / (size * abs(transfer(frequency)))) ** 2
    assert frequency.size >= 8
    # Some 400 spectra in all: the mean over all bands, weighted by their widths, is known to 5 %.
    ratio = np.average((1 - coherence) / coherence / expected, weights=frequency)
    assert ratio == pytest.approx(1.0, abs=0.15)


def test_noise_without_an_answer_is_refused_and_not_called_a_response():
    signals = steering_signals(chirp(), TRUTH, 1)
    noise = np.random.default_rng(1).normal(0.0, 0.5, signals.angle.size)
    dead = Plant(1e-6, 0.1, 0.3, 0.02)
    with pytest.raises(NotIdentifiable, match="coherence"):
        spectrum(replace(signals, angle=noise), model=dead)


def test_refuses_a_record_too_short_for_a_spectrum():
    signals = steering_signals(chirp(duration=6.0), TRUTH, 1)
    with pytest.raises(NotIdentifiable, match="needed for a spectrum"):
        spectrum(signals, end=8.0)


def test_an_underdamped_actuator_is_measured_as_well():
    resonant = Actuator.from_damping(1.02, 0.08, 6.0, 0.4)
    truth = replace(TRUTH, actuator=resonant)
    model = plant(resonant, gain=0.99, dead_time=0.003, total=1.03, product=0.98)
    segments = [Sine(4.0, 0.3, 8.0), Sine(9.0, 0.3, 12.0)]
    test = SteeringTest(sines(2.0, segments, 1.0), sines_end(2.0, segments, 1.0))
    for one in responses(steering_signals(test, truth, 2), model):
        exact = transfer(one.frequency, resonant)
        assert one.gain == pytest.approx(abs(exact), abs=4 * one.gain_std)
        assert np.exp(1j * one.phase) == pytest.approx(exact / abs(exact), abs=4 * one.phase_std)
