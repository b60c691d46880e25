"""Sensors and spectra of a results file for other programs: comma-separated values, universal files of test software.

A universal file holds datasets between lines ``-1``: number 164 says its units, number 58 is a function of time or
frequency at one point along one axis (Universal File Formats for Modal Analysis Testing, SDRC; UC-SDRL, University of
Cincinnati). Numbers are in SI there, in double precision; functions of time have an even abscissa where all steps are
equal, spectra an uneven one. Sensors are the nodes 1, 2, ... in the order of the file, and the first line of a function
is its name. Pure numbers (``units = "none"``) have user-defined units there, without labels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem
from ..scene.unit_texts import GRAVITY
from ..scene.units import UnitSystem
from ..shock.oscillators import RESPONSES
from .filters import uniform_step
from .groups import units_of
from .quantities import AXES
from .spectra import ShockSpectrum, stored_spectra

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

_MOTIONS: Final = {"displacement": (8, "m"), "velocity": (11, "m s-1"), "acceleration": (12, "m s-2")}
"""Data type of dataset 58 and unit by motion; a filtered one is of the same kind."""
_TIME, _SPECTRUM = 1, 24  # types of functions: time response, shock response spectrum
_ABSCISSA: Final = {_TIME: (17, "Time", "s"), _SPECTRUM: (18, "Frequency", "Hz")}


def acceleration_unit(units: UnitSystem, in_g: bool) -> tuple[float, str]:
    """Factor and unit of accelerations in a table; in g, 9.80665 m s-2, where ``in_g`` or where the units show them so.

    Raises
    ------
    InputError : the results are pure numbers.
    """
    if not (in_g or units.in_g):
        return 1.0, units.label("m s-2")
    if not units.measurable:
        what = "the results have no units, so that accelerations cannot be given in g"
        raise InputError([Problem("--g", what, 'units = "none"', "results of a scene with units", "omit it")])
    return units.size("m s-2") / GRAVITY, "g"


def sensors_as_csv(tree: xr.DataTree, names: Sequence[str], in_g: bool = False) -> str:
    """Motions of sensors at the same instants, one row an instant; accelerations in g where ``in_g``."""
    units, first = units_of(tree.attrs), tree[f"sensors/{names[0]}"]
    head, columns = ["time [s]"], [np.asarray(first["time"].values)]
    for name in names:
        for motion, values, unit in _motions(tree, name):
            if unit == "m s-2":
                factor, label = acceleration_unit(units, in_g)
            else:
                factor, label = 1.0, units.label(unit)
            head += [f"{name} {motion} {axis} [{label}]" for axis in AXES]
            columns += list(factor * values.T)
    rows = [",".join(f"{value:.9g}" for value in row) for row in np.stack(columns, axis=1)]
    return "\n".join([",".join(head), *rows]) + "\n"


def _motions(tree: xr.DataTree, name: str) -> Iterator[tuple[str, Array, str]]:
    """Name, values (n_time, 3) and unit in SI of what the file holds of a sensor."""
    node = tree[f"sensors/{name}"]
    for motion, (_, unit) in _MOTIONS.items():
        for stored in (motion, f"{motion}_filtered"):
            if stored in node:
                yield stored, np.asarray(node[stored].values), unit


class _Function(NamedTuple):
    """A function of dataset 58: its name, type, node and axis 1, 2, 3, data type and unit of values (n,) at x (n,)."""

    name: str
    kind: int
    node: int
    axis: int
    data: int
    unit: str  # NONE of pure numbers
    x: Array
    values: Array


def universal_file(tree: xr.DataTree, names: Sequence[str]) -> str:
    """Motions and stored spectra of sensors as a universal file (module docstring)."""
    units, every = units_of(tree.attrs), list(tree["sensors"].children)
    spectra = stored_spectra(tree)
    lines = _units(units)
    for name in names:
        node, time = 1 + every.index(name), np.asarray(tree[f"sensors/{name}"]["time"].values)
        for motion, values, unit in _motions(tree, name):
            data, size = _MOTIONS[motion.removesuffix("_filtered")][0], units.size(unit)
            if units.measurable:
                label = unit
            else:
                label = "NONE"
            for axis, letter in enumerate(AXES):
                title = f"{name} {motion} {letter}"
                lines += _dataset_58(_Function(title, _TIME, node, axis + 1, data, label, time, size * values[:, axis]))
        if name in spectra:
            lines += _spectrum(name, node, spectra[name][0], units)
    return "\n".join(lines) + "\n"


def _spectrum(name: str, node: int, spectrum: ShockSpectrum, units: UnitSystem) -> Iterator[str]:
    for kind, unit, data in (("acceleration", "m s-2", 12), ("pseudo_velocity", "m s-1", 11)):
        for r, response in enumerate(RESPONSES):
            for axis, letter in enumerate(AXES):
                values = units.size(unit) * getattr(spectrum, kind)[r, :, axis]
                title = f"{name} {response} {kind} {letter} Q {spectrum.quality:g}"
                if units.measurable:
                    label = unit
                else:
                    label = "NONE"
                yield from _dataset_58(
                    _Function(title, _SPECTRUM, node, axis + 1, data, label, spectrum.frequency, values)
                )


def _units(units: UnitSystem) -> list[str]:
    """Dataset 164: SI, lengths, forces and temperatures in units of it, or user-defined ones; temperatures are
    relative."""
    # double precision in universal files has the D of Fortran
    factors = "".join(f"{x:25.17E}".replace("E", "D") for x in (1.0, 1.0, 1.0))
    if units.measurable:
        code, words = 1, "SI: Meter (newton)"
    else:
        code, words = 9, "US: USER_DEFINED"
    return [_BAR, f"{164:6d}", f"{code:10d}{words:20s}{2:10d}", factors, f"{273.15:25.17E}", _BAR]


_BAR: Final = f"{-1:6d}"


def _dataset_58(f: _Function) -> Iterator[str]:
    """Lines of one function; real numbers in double precision, each with its abscissa where that is uneven."""
    step = uniform_step(f.x)
    # 80: the length of a line there
    yield from (_BAR, f"{58:6d}", f.name[:80], "NONE", "NONE", "NONE", "NONE")
    response, reference = f" {f.name.split()[0][:10]:10s}{f.node:10d}{f.axis:4d}", f" {'NONE':10s}{0:10d}{0:4d}"
    yield f"{f.kind:5d}{0:10d}{0:5d}{0:10d}{response}{reference}"
    # 4: real numbers in double precision
    yield f"{4:10d}{len(f.x):10d}{int(step > 0):10d}{f.x[0]:13.5E}{step:13.5E}{0.0:13.5E}"
    abscissa, label, unit = _ABSCISSA[f.kind]
    yield _axis(abscissa, label, unit if f.unit != "NONE" else f.unit)
    yield _axis(f.data, {8: "Displacement", 11: "Velocity", 12: "Acceleration"}[f.data], f.unit)
    yield from (_axis(0, "NONE", "NONE"), _axis(0, "NONE", "NONE"))
    if step:
        words, across = [f"{value:20.12E}" for value in f.values], 4
    else:
        # lines of 80 characters hold two pairs, or four numbers above
        words, across = [f"{x:13.5E}{value:20.12E}" for x, value in zip(f.x, f.values, strict=True)], 2
    yield from ("".join(words[i : i + across]) for i in range(0, len(words), across))
    yield _BAR


def _axis(data: int, label: str, unit: str) -> str:
    """Record of an axis: data type, exponents of length, force and temperature (0: as the type has them), labels."""
    return f"{data:10d}{0:5d}{0:5d}{0:5d} {label:20s} {unit:20s}"
