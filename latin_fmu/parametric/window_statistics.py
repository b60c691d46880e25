"""What is kept of one window of a random vibration: moments, extremes, level crossings and the spectrum of each signal.

Signals are the motions of sensors along each axis, displacements relative to the base, tensions of bolts, and of each
contact its normal force, its mean gap, its largest opening and its largest slip. What they do while the motion builds
up is left out.

Levels of crossings are multiples of a power of two next to an eighth of the standard deviation of the window: those of
two windows lie on each other, whatever their sizes are, and any number of windows can be summed up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..latin.outcome import Array, InterfaceHistory, Outcome
from ..results.interface_fields import slip_in_contact
from ..results.quantities import AXES
from ..scene.random_bases import random_bases
from ..scene.schema import Scene

ACCELERATION: Final = "m s-2"
_LEVELS: Final = 8.0  # to a standard deviation, about


@dataclass(frozen=True)
class RunSignal:
    """A scalar over the instants of a run.

    Attributes
    ----------
    name : owner and quantity. unit : UDUNITS, SI. what : in words. values : (n_time,).
    """

    name: str
    unit: str
    what: str
    values: Array


@dataclass(frozen=True)
class WindowEvaluation:
    """How a window is evaluated.

    Attributes
    ----------
    begin : first instant that counts, s. segment : samples of a segment of Welch's estimate. highest : frequency up to
        which spectra are kept, Hz.
    """

    begin: float
    segment: int
    highest: float

    def plain(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


@dataclass(frozen=True)
class WindowSignal:
    """What is kept of a signal.

    Attributes
    ----------
    name, unit, what : of the signal. reference : its value at t = 0, that moments are about. moments : (4,) means of
        the first four powers. ends : smallest and largest value. exponent : of the spacing of the levels, as a power of
        two; None of a constant. first : number of the first level, counted from the reference. crossings : (n_level,)
        how often each was crossed upwards. spectrum : (n_frequency,) Welch's estimate, unit^2 / Hz.
    """

    name: str
    unit: str
    what: str
    reference: float
    moments: Array
    ends: tuple[float, float]
    exponent: int | None
    first: int
    crossings: NDArray[np.int64]
    spectrum: Array

    @staticmethod
    def of(signal: RunSignal, time: Array, how: WindowEvaluation) -> WindowSignal:
        """That of a signal at instants (n_time,), s."""
        from scipy.signal import welch

        reference = float(signal.values[0])
        values = signal.values[time >= how.begin] - reference
        moments = np.array([np.mean(values**power) for power in (1, 2, 3, 4)])
        step = float(time[-1] - time[0]) / (len(time) - 1)
        frequency, spectrum = welch(values, 1.0 / step, nperseg=how.segment, detrend="constant")
        exponent, first, crossings = _crossings(values)
        return WindowSignal(
            signal.name,
            signal.unit,
            signal.what,
            reference,
            moments,
            (reference + float(values.min()), reference + float(values.max())),
            exponent,
            first,
            crossings,
            spectrum[frequency <= how.highest],
        )


def _crossings(values: Array) -> tuple[int | None, int, NDArray[np.int64]]:
    """Exponent of the spacing of the levels, number of the first one, and how often each is crossed upwards."""
    deviation = float(values.std())
    if not deviation > 0.0:
        return None, 0, np.zeros(0, dtype=np.int64)
    exponent = int(np.floor(np.log2(deviation / _LEVELS)))
    # a level is crossed by a step from below it to it or above it
    passed = np.floor(values / 2.0**exponent).astype(np.int64)
    first = int(passed.min())
    change = np.zeros(int(passed.max()) - first + 2, dtype=np.int64)
    rises = passed[1:] > passed[:-1]
    np.add.at(change, passed[:-1][rises] + 1 - first, 1)
    np.add.at(change, passed[1:][rises] + 1 - first, -1)
    return exponent, first, np.cumsum(change)[:-1]


def frequencies(step: float, how: WindowEvaluation) -> Array:
    """Those of the spectra, Hz."""
    every = np.fft.rfftfreq(how.segment, step)
    return np.asarray(every[every <= how.highest])


def window_of(scene: Scene, outcome: Outcome, how: WindowEvaluation) -> list[dict[str, Any]]:
    """What is kept of a run of one window, signal by signal, as plain data of ``WindowSignal``."""
    return [asdict(WindowSignal.of(signal, outcome.time, how)) for signal in signals_of(scene, outcome)]


def signals_of(scene: Scene, outcome: Outcome) -> Iterator[RunSignal]:
    """All signals of a run."""
    time = outcome.time
    for name, driven in random_bases(scene).items():
        what = f"acceleration of {name}, as driven"
        yield RunSignal(f"{name}.acceleration", ACCELERATION, what, driven.size * driven.law.sample(time))
    base = _base_displacement(scene, time)
    for name, sensor in outcome.sensors.items():
        for i, axis in enumerate(AXES):
            if sensor.acceleration is not None:
                what = f"acceleration of {name} along {axis}"
                yield RunSignal(f"{name}.acceleration.{axis}", ACCELERATION, what, sensor.acceleration[:, i])
            if base is not None:
                what = f"displacement of {name} relative to the base along {axis}"
                yield RunSignal(f"{name}.displacement.{axis}", "m", what, sensor.displacement[:, i] - base[:, i])
    for name, bolt in outcome.bolts.items():
        yield RunSignal(f"{name}.tension", "N", f"tension of {name}", bolt.force)
    for name, history in outcome.interfaces.items():
        if history.gap is not None and outcome.interfaces_every == 1:
            yield from _of_contact(name, history, time)


def _of_contact(name: str, history: InterfaceHistory, time: Array) -> Iterator[RunSignal]:
    """Signals of a contact."""
    assert history.gap is not None
    share = history.areas / history.areas.sum()
    way = np.linalg.norm(slip_in_contact(history, time), axis=2)
    yield RunSignal(f"{name}.normal_force", "N", f"normal force of {name}", history.normal_resultant())
    yield RunSignal(f"{name}.gap", "m", f"mean gap of {name}", history.gap @ share)
    yield RunSignal(f"{name}.opening", "m", f"largest gap of a point of {name}", history.gap.max(axis=1))
    yield RunSignal(f"{name}.slip", "m", f"largest slip of a point of {name} since t = 0", way.max(axis=1))


def _base_displacement(scene: Scene, time: Array) -> Array | None:
    """Displacement (n_time, 3) of the base in the run, which integrates the acceleration at its instants; None where
    faces are driven differently."""
    base, *others = random_bases(scene).values()
    if not all(base.moves_like(other) for other in others):
        return None
    step, acceleration = np.diff(time), base.law.sample(time)
    mean = 0.5 * (acceleration[1:] + acceleration[:-1])
    velocity = np.concatenate([[0.0], np.cumsum(step * mean)])
    moved = np.concatenate([[0.0], np.cumsum(step * velocity[:-1] + 0.5 * step**2 * mean)])
    return moved[:, None] * base.direction
