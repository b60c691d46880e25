"""The band of frequencies in which [damping] holds its ratio, where the scene does not name it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..errors import Problem, SceneError
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from ..scene.sensors import LowPass
from ..scene.strain_damping import WIDEST
from .modal_damping import Modes

_BELOW: Final = 3.0  # lowest natural frequency over the lower end
_LEAST: Final = 10.0  # upper over lower end at least
_CONTENT: Final = 0.99  # share of the energy of a load below its highest frequency


@dataclass(frozen=True)
class DampingBand:
    """Ends of a band, Hz, and where they come from, in words."""

    ends: tuple[float, float]
    words: str


def band_of(scene: Scene, modes: Modes) -> DampingBand:
    """Band from a third of the lowest natural frequency to the highest one that spectra, filters or loads ask for.

    Raises
    ------
    SceneError : there is no elastic mode.
    """
    elastic = modes.omega[modes.n_rigid :]
    if not len(elastic):
        what, remedy = "the assembly has no elastic mode that would give the band", "give damping.band"
        raise SceneError([Problem("damping.band", what, remedy=remedy)], "the scene cannot be built")
    first = float(elastic[0]) / (2.0 * np.pi)
    low = first / _BELOW
    highest, source = max(_asked(scene), default=(0.0, ""))
    high = min(max(highest, _LEAST * low), WIDEST * low)
    if high != highest:
        source = f"{high / low:g} times the lower end"
    words = f"from a third of the lowest natural frequency, {first:.4g} Hz, to {high:.4g} Hz ({source})"
    return DampingBand((low, high), words)


def _asked(scene: Scene) -> Iterator[tuple[float, str]]:
    """Highest frequencies that a scene asks for, Hz, and by what."""
    step = scene.time.end / scene.time.n_step
    for name, sensor in scene.sensor.items():
        if sensor.spectrum is not None:
            yield sensor.spectrum.frequencies(step, scene.time.end)[-1], f"spectrum of sensor {name}"
        if isinstance(sensor.filter, LowPass):
            yield sensor.filter.cutoff, f"filter of sensor {name}"
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    laws = dict(scene.force_laws)
    laws |= {f"boundary {n}": b.law for n, b in scene.boundary.items() if hasattr(b, "law")}
    for name, law in laws.items():
        if isinstance(law, InputLaw):
            continue
        energy = np.abs(np.fft.rfft(law.sample(time))) ** 2
        if len(energy) > 1 and energy[1:].any():
            below = np.cumsum(energy[1:]) / energy[1:].sum()
            number = 1 + int(np.searchsorted(below, _CONTENT))
            yield number / (scene.time.end + step), f"content of {name}"
