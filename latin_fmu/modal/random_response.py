"""Linear response of an assembly to a random vibration of its base: modes about the clamped state, whose joints stay.

With the frequency response H to an acceleration of the base (``frequency_response``: Ritz coordinates with static
responses) and its one-sided density S, a linear response has the density and the mean square

    G(f) = |H(f)|^2 S(f),        integral of G.

The frequencies follow each resonance by the tangent of equal angles, in which its curve is a straight line, so that the
trapezoidal rule over them has four digits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..latin.assembly import Array
from ..results.quantities import AXES
from ..scene.boundaries import Boundary, Fixed, Symmetry
from ..scene.random_bases import RandomBase, random_bases
from ..scene.schema import Scene
from ..shock.random_motion import AccelerationDensity
from .frequency_response import BASE, Excitations, RitzBasis

Complex = NDArray[np.complex128]
DECAY: Final = 20.0
"""Factor by which free vibrations have decayed when a motion counts as stationary: 1/400 of a mean square is left."""
SHIFTED: Final = 0.5
"""Largest shift of a frequency by time steps, over the damping ratio of the mode, that is not remarked on."""
_ANGLES: Final = np.linspace(-0.4995 * np.pi, 0.4995 * np.pi, 241)  # of the phase of a resonance
_BETWEEN: Final = 2000  # frequencies by equal factors
_BEYOND: Final = 1.2  # of the highest frequency of the excitation: modes that are excited
_POWER: Final = 2  # of responses to forces, which are not asked for here


@dataclass(frozen=True)
class LinearSignal:
    """Linear response of a signal.

    Attributes
    ----------
    rms : root mean square, in the unit of the signal. spectrum : (n,) density at the frequencies, unit^2 / Hz.
    """

    rms: float
    spectrum: Array


@dataclass(frozen=True)
class LinearResponse:
    """Linear response to a random vibration.

    Attributes
    ----------
    frequency : (n,), Hz. signals : by owner and quantity. natural : (n_mode,) natural frequencies of the damped modes
        that are excited, Hz, and ratio : (n_mode,) of their damping to critical, > 0.
    """

    frequency: Array
    signals: Mapping[str, LinearSignal]
    natural: Array
    ratio: Array

    @property
    def slowest(self) -> float | None:
        """Smallest decay rate of the excited modes, s-1; None where none is excited."""
        if not len(self.natural):
            return None
        return float((2.0 * np.pi * self.natural * self.ratio).min())

    def shifted(self, step: float) -> tuple[float, float] | None:
        """Frequency, Hz, and relative error of it of the mode in the band that time steps, s, shift most beside its
        width; None where none is shifted by more than ``SHIFTED`` of its damping ratio.

        The average acceleration method gives a mode the frequency omega (1 - (omega step)^2 / 12) (Hughes, The Finite
        Element Method, 9.3), and the half-power bandwidth is twice the damping ratio.
        """
        inside = self.natural <= self.frequency[-1]
        natural, ratio = self.natural[inside], self.ratio[inside]
        shifts = (2.0 * np.pi * natural * step) ** 2 / 12.0
        if not (shifts > SHIFTED * ratio).any():
            return None
        worst = int(np.argmax(shifts / ratio))
        return float(natural[worst]), float(shifts[worst])

    @property
    def settled(self) -> float:
        """Time in which free vibrations decay by ``DECAY``, s."""
        if self.slowest is None:
            return 0.0
        return float(np.log(DECAY)) / self.slowest

    @property
    def bandwidth(self) -> float | None:
        """Smallest half-power bandwidth of the excited modes, Hz."""
        if self.slowest is None:
            return None
        return self.slowest / np.pi


def random_response(scene: Scene) -> LinearResponse:
    """The linear response of a scene to its random vibrations (module docstring).

    Returns
    -------
    Accelerations of sensors along each axis, their displacements relative to the base, and tensions of bolts.

    Raises
    ------
    InputError : a scene without random vibration, or whose supports do not all follow it; no damping.
    SceneError : the scene cannot be built.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("examples/random_vibration.toml")
    >>> response = random_response(scene)
    >>> 0.0 < response.settled < scene.time.end
    True
    """
    base = _base(scene)
    direction, density = base.direction, base.motion.density
    excitations = Excitations.of(scene)
    axes = np.flatnonzero(direction)
    terms = [excitations.terms(f"{BASE}.{AXES[i]}", _POWER, True) for i in axes]
    columns = np.column_stack([column for pairs in terms for _, column in pairs])
    basis = RitzBasis.of(excitations, columns, density.ends[1], None)
    grid = _grid(basis, density)
    rate = (2j * np.pi * grid[:, None]).astype(np.complex128)
    motions = basis.responses(grid, columns)
    # each term is of a displacement of 1 along its axis
    sizes = [direction[i] for i, pairs in zip(axes, terms, strict=True) for _ in pairs]
    laws = [of for pairs in terms for of, _ in pairs]
    moved = sum(size * of(rate) * motions[:, :, k] for k, (size, of) in enumerate(zip(sizes, laws, strict=True)))
    signals: dict[str, LinearSignal] = {}
    for name, response in _responses(excitations, basis, moved, rate, direction).items():
        spectrum = np.abs(response) ** 2 * density.at(grid)
        signals[name] = LinearSignal(float(np.sqrt(np.trapezoid(spectrum, grid))), spectrum)
    omega, ratio = basis.damped
    excited = (omega < _BEYOND * 2.0 * np.pi * density.ends[1]) & (ratio > 0.0)
    return LinearResponse(grid, signals, omega[excited] / (2.0 * np.pi), ratio[excited])


def _responses(
    excitations: Excitations, basis: RitzBasis, moved: Complex, rate: Complex, direction: Array
) -> dict[str, Complex]:
    """Responses (n,) of signals per acceleration of the base; ``moved`` : Ritz coordinates (n, m) of the motion
    relative to the base per displacement of it."""
    made: dict[str, Complex] = {}
    for sensor in excitations.scene.sensor:
        at = moved @ (excitations.rows(sensor) @ basis.vectors).T
        for i, axis in enumerate(AXES):
            made[f"{sensor}.acceleration.{axis}"] = direction[i] + at[:, i]
            made[f"{sensor}.displacement.{axis}"] = at[:, i] / rate[:, 0] ** 2
    joined = excitations.joined
    for name, cut in joined.discretised.cuts.items():
        body = cut.table.substructure
        pulled = cut.pattern @ (joined.expansion[joined.parts.where[body]] @ basis.vectors)
        rise = joined.parts.models[body].branches.rise(rate[:, 0])
        made[f"{name}.tension"] = -(1.0 + rise) * (moved @ pulled) / rate[:, 0] ** 2
    return made


def _grid(basis: RitzBasis, density: AccelerationDensity) -> Array:
    """Frequencies, Hz, in the band of the excitation (module docstring)."""
    omega, ratio = basis.damped
    lowest, highest = density.ends
    natural = omega / (2.0 * np.pi)
    peaks = natural[:, None] * (1.0 + ratio[:, None] * np.tan(_ANGLES))
    every = np.concatenate([np.geomspace(lowest, highest, _BETWEEN), density.frequency, peaks.ravel()])
    return np.unique(every[(every >= lowest) & (every <= highest)])


def _base(scene: Scene) -> RandomBase:
    """The motion of the base.

    Raises
    ------
    InputError : there is none, or something is held or driven otherwise.
    """
    bases, heading = random_bases(scene), "no linear answer"
    if not bases:
        remedy = 'give a boundary of type = "acceleration" the law {type = "psd", file = "..."}'
        raise InputError.of(heading, "boundary", "the scene has no random vibration", remedy=remedy)
    base = next(iter(bases.values()))
    for name, boundary in scene.boundary.items():
        if not (base.moves_like(bases[name]) if name in bases else _lets_move(boundary, base.direction)):
            what = "does not follow the base, all of which moves as one in the linear answer"
            raise InputError.of(heading, f"boundary.{name}", what)
    return base


def _lets_move(boundary: Boundary, direction: Array) -> bool:
    """Whether a boundary lets its face follow a motion of the base, along a direction (3,)."""
    if isinstance(boundary, Fixed):
        held = [AXES.index(component) for component in boundary.components]
        return boundary.axes is None and not direction[held].any()
    return isinstance(boundary, Symmetry)
