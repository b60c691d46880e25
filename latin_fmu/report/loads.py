"""What acts on the assembly of a scene: histories at the instants of the run, and spectra of accelerations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from ..latin.outcome import Array
from ..pictures.load_picture import ActingHistory
from ..results.spectra import LINES, ShockSpectrum, shock_response_spectrum
from ..scene.histories import laws_of
from ..scene.laws import ConstantLaw, SrsLaw, sampled
from ..scene.readable_numbers import readable
from ..scene.schema import Scene, faces_of
from ..scene.sensors import Spectrum, highest_frequency
from ..scene.unit_texts import words_for
from ..shock.specification import Specification

_ACCELERATION: Final = "m s-2"
_SPEED: Final = "m s-1"


def acting(scene: Scene) -> list[ActingHistory]:
    """Loads, driven faces and body loads that are not zero, over the instants of the run; a speed has the spectrum of
    its slopes."""
    return [_history(scene, *of) for of in laws_of(scene) if of[3]]


def varies(history: ActingHistory) -> bool:
    """Whether it changes during the run."""
    return bool(np.ptp(history.values) > 0.0)


def load_rows(scene: Scene, histories: list[ActingHistory]) -> list[tuple[str, ...]]:
    """Table of what acts: key of the scene, quantity, where, law, largest value and when."""
    rows: list[tuple[str, ...]] = [("acts", "quantity", "on", "law", "largest", "at")]
    laws = {_owner(where): law for where, law, _, _ in laws_of(scene)}
    for history in histories:
        i = int(np.abs(history.values).argmax())
        law = laws[history.name]
        kind = "constant" if isinstance(law, ConstantLaw) else str(getattr(law, "type", "law"))
        when = readable(float(history.time[i]), "s", 3) if varies(history) else "always"
        largest = readable(float(history.values[i]), history.unit)
        rows.append((history.name, history.what, _place(scene, history.name), kind, largest, when))
    return rows


def _owner(where: str) -> str:
    return where.removesuffix(".law")


def _place(scene: Scene, where: str) -> str:
    """Face or body that a law acts on, as the scene has it."""
    kind, _, rest = where.partition(".")
    table = getattr(scene, kind, None)
    if isinstance(table, dict) and rest in table:
        found = table[rest]
        place = getattr(found, "face", None) or getattr(found, "substructure", None)
        return str(place or ", ".join(getattr(found, "faces", ())) or "-")
    return rest or "all bodies"


def _history(scene: Scene, where: str, law: object, unit: str, size: float) -> ActingHistory:
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    values = size * sampled(law, time)  # type: ignore[arg-type]
    units = scene.unit_system
    spectrum = None
    if not scene.time.quasi_static and np.ptp(values) > 0.0:
        spectrum = _spectrum(values, float(time[1]), unit, law)
    what = words_for(unit).removeprefix("an ").removeprefix("a ")
    shown, of = units.shown(unit), units.shown(_ACCELERATION)
    return ActingHistory(_owner(where), what, shown, time, values, spectrum, of, _specified(law))


def _spectrum(values: Array, step: float, unit: str, law: object) -> ShockSpectrum | None:
    """Spectrum of an acceleration, or of the slopes of a speed; None of anything else."""
    if unit == _SPEED:
        values = np.append(np.diff(values), 0.0) / step
    elif unit != _ACCELERATION:
        return None
    quality = float(getattr(law, "quality", 10.0))
    request = Spectrum(quality=quality, highest=highest_frequency(step))
    frequencies = request.frequencies(step, step * (len(values) - 1))
    if not frequencies:
        return None
    return shock_response_spectrum(values, step, frequencies, quality, interpolation=LINES)


def _specified(law: object) -> Specification | None:
    """Breakpoints of the scene; those of a file are not stored with the results."""
    if isinstance(law, SrsLaw) and len(law.frequency):
        return Specification.of(law.frequency, law.acceleration, law.quality)
    return None


def support_rows(scene: Scene) -> Iterator[tuple[str, ...]]:
    """Table of the supports: name, type, faces, components."""
    yield "support", "type", "on", "components"
    for name, boundary in scene.boundary.items():
        yield name, boundary.type, ", ".join(faces_of(boundary)), ", ".join(getattr(boundary, "components", ())) or "-"
