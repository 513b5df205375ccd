"""`live`: uses only past samples, one by one or in chunks of any size, in constant memory.

A one-sided form of :mod:`acromion.fusion.orientation.smoothed`: the acceleration is low-passed in a frame
that turns with the gyroscope, and the filter's state is kept between samples. The weight at age ``s = t /
time_constant_s`` is ``exp(-s) (freshness cos s + sin s)``: a second-order Butterworth low-pass plus a small
share of the newest samples, which the start needs.

The gyroscope's bias is the mean rate of still moments, minus the rotation that gravity shows in them: a slow,
even rotation looks like rest, but its rate is not bias. Until the first still moment, gentle moments are used
instead. After it, the bias is not updated while the arm never rests.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.recording import Float64Array
from acromion.fusion.sensor.model import RADIANS, bend, carry, check_arrays, check_rate, turn_factors
from acromion.fusion.sensor.stillness import RULES

# Indices in the state: filter, previous rate, bias, then the sums of the current moment.
REAL, IMAGINARY, RATE, BIAS, ACC_SUM, ACC_SQUARE, GYR_SUM, GYR_SQUARE, ACC_TREND = range(0, 27, 3)
SAMPLES, GATHERED, STILLS, GENTLES, SIZE = 27, 28, 29, 30, 31


@dataclass(frozen=True, slots=True)
class LiveParameters:
    """Chosen on the even-numbered half of BROAD; the bias is a mean over ``memory_stills`` still moments.

    ``gentle_acc_sd_g`` and ``gentle_gyro_sd_dps`` limit the moments that are used before the first still one.
    They were chosen on skin-mounted sensors of four people and have no effect on BROAD.
    """

    time_constant_s: float = 3.0
    freshness: float = 0.05
    memory_stills: float = 8.0
    gentle_acc_sd_g: float = 0.08
    gentle_gyro_sd_dps: float = 10.0


class LiveVertical:
    """Estimator of the vertical in the sensor frame, updated as samples arrive."""

    def __init__(
        self, rate_hz: float, bias_dps: Float64Array | None = None, parameters: LiveParameters | None = None
    ) -> None:
        """Reset the state; raises UnusableArrays if the rate is not positive."""
        check_rate(rate_hz)
        parameters = parameters or LiveParameters()
        self._rate_hz = rate_hz
        self._state = np.zeros(SIZE)
        if bias_dps is not None:
            self._state[BIAS : BIAS + 3] = bias_dps
            self._state[STILLS] = 1.0
        decay = np.exp(-(1.0 + 1.0j) / (rate_hz * parameters.time_constant_s))
        self._filter = (1.0 / rate_hz, decay.real, decay.imag, parameters.freshness)
        block = float(max(2, round(RULES.still_s * rate_hz)))
        limits = (RULES.acc_sd_g**2, RULES.gyro_sd_dps**2, RULES.largest_bias_dps**2)
        gentle = (parameters.gentle_acc_sd_g**2, parameters.gentle_gyro_sd_dps**2)
        self._still = (block, *limits, parameters.memory_stills, *gentle)

    def update(self, acc_g: ArrayLike, gyr_dps: ArrayLike) -> Float64Array:
        """Process the next samples, shapes (n, 3) or (3,), and return the unit vectors to the zenith, (n, 3).

        If all samples so far are zero, there is no direction and the rows are NaN.

        Raises UnusableArrays.
        """
        acc, gyr = check_arrays(np.atleast_2d(acc_g), np.atleast_2d(gyr_dps), self._rate_hz)
        out = np.empty((len(acc), 3))
        _advance(acc, gyr, self._state, (self._filter, self._still), out)
        return out

    @property
    def bias_dps(self) -> Float64Array:
        """The current estimate of the gyroscope's bias, shape (3,)."""
        return self._state[BIAS : BIAS + 3].copy()

    @property
    def has_rested(self) -> bool:
        """Whether the bias comes from a still moment or was given."""
        return bool(self._state[STILLS] > 0.0)


@kernel
def _advance(acc: Any, gyr: Any, state: Any, settings: Any, out: Any) -> None:  # pragma: no cover
    period_s, keep, mix, freshness = settings[0]
    for k in range(len(acc)):
        _gather(acc, gyr, k, state, settings)
        rate = (
            (gyr[k, 0] - state[BIAS]) * RADIANS,
            (gyr[k, 1] - state[BIAS + 1]) * RADIANS,
            (gyr[k, 2] - state[BIAS + 2]) * RADIANS,
        )
        real = (state[REAL], state[REAL + 1], state[REAL + 2])
        imaginary = (state[IMAGINARY], state[IMAGINARY + 1], state[IMAGINARY + 2])
        if state[SAMPLES] > 0.0:
            turn = bend((state[RATE], state[RATE + 1], state[RATE + 2]), rate, period_s)
            factors = turn_factors(turn)
            real, imaginary = carry(real, turn, factors), carry(imaginary, turn, factors)
        state[SAMPLES] = 1.0
        square = 0.0
        for i in range(3):
            state[RATE + i] = rate[i]
            state[REAL + i] = keep * real[i] - mix * imaginary[i] + acc[k, i]
            state[IMAGINARY + i] = keep * imaginary[i] + mix * real[i]
            out[k, i] = freshness * state[REAL + i] - state[IMAGINARY + i]
            square += out[k, i] * out[k, i]
        for i in range(3):
            out[k, i] = out[k, i] / np.sqrt(square) if square > 1e-12 else np.nan


@inner
def _gather(acc: Any, gyr: Any, sample: int, state: Any, settings: Any) -> None:  # pragma: no cover
    """Add a sample to the current moment; when it is complete, check whether it was still."""
    from_middle = state[GATHERED] - (settings[1][0] - 1.0) / 2.0
    for i in range(3):
        state[ACC_SUM + i] += acc[sample, i]
        state[ACC_TREND + i] += from_middle * acc[sample, i]
        state[ACC_SQUARE + i] += float(acc[sample, i]) ** 2
        state[GYR_SUM + i] += gyr[sample, i]
        state[GYR_SQUARE + i] += float(gyr[sample, i]) ** 2
    state[GATHERED] += 1.0
    if state[GATHERED] >= settings[1][0]:
        _judge(state, settings)
        for place in range(ACC_SUM, ACC_TREND + 3):
            state[place] = 0.0
        state[GATHERED] = 0.0


@kernel
def _judge(state: Any, settings: Any) -> None:  # pragma: no cover
    """If the moment was still, update the bias with its rate; the first still one also sets the vertical."""
    period_s, keep, mix, _ = settings[0]
    block, acc_limit, gyr_limit, bias_limit, memory, gentle_acc_limit, gentle_gyr_limit = settings[1]
    level, acc_total, gyr_total, gravity = 0.0, 0.0, 0.0, 1e-12
    for i in range(3):
        acc_mean, gyr_mean = state[ACC_SUM + i] / block, state[GYR_SUM + i] / block
        level += gyr_mean * gyr_mean
        gravity += acc_mean * acc_mean
        acc_total += state[ACC_SQUARE + i] / block - acc_mean * acc_mean
        gyr_total += state[GYR_SQUARE + i] / block - gyr_mean * gyr_mean
    is_still = acc_total <= acc_limit and gyr_total <= gyr_limit
    is_gentle = state[STILLS] == 0.0 and acc_total <= gentle_acc_limit and gyr_total <= gentle_gyr_limit
    if level > bias_limit or not (is_still or is_gentle):
        return
    kind = STILLS if is_still else GENTLES
    state[kind] += 1.0
    share = 1.0 / min(state[kind], memory)
    # The regression of gravity on time, crossed with gravity: the rotation across gravity, deg/s.
    to_dps = 12.0 / (block * (block * block - 1.0) * period_s * block * gravity * RADIANS)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turn_dps = state[ACC_TREND + j] * state[ACC_SUM + k] - state[ACC_TREND + k] * state[ACC_SUM + j]
        state[BIAS + i] += share * (state[GYR_SUM + i] / block - to_dps * turn_dps - state[BIAS + i])
    for i in range(3):
        if is_still and state[STILLS] == 1.0:
            # The state so far contains the unknown bias: discard it, and set the filter as if the sensor had
            # always rested here.
            settle = 1.0 / ((1.0 - keep) ** 2 + mix * mix)
            state[REAL + i] = settle * (1.0 - keep) * state[ACC_SUM + i] / block
            state[IMAGINARY + i] = settle * mix * state[ACC_SUM + i] / block
            state[RATE + i] = 0.0
