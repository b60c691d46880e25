"""Frequency response functions of an assembly whose joints stay as they are: transmissibility, receptance.

    (K + i w C - w^2 M) u = f        on the motions of the clamped assembly (``modes.JoinedAssembly``)

in Ritz coordinates u = Phi q: rigid motions, the elastic modes up to ``_BEYOND`` times the highest frequency, and the
static response to each excitation, as far as these do not hold it (residual vectors; with inertia relief where a motion
is free, ``propagator.reduction``). The static response stands for the modes that are left out: the result is exact at
w = 0, and the error of the rest falls as the fourth power of w over the first frequency left out.

Excitation is a unit force, at a sensor or spread as a load of the scene, or a base: everything that holds the assembly
(fixed, symmetric and driven faces, contacts and bonds with the ground) moves along an axis with the displacement s.
With u = r s + v, r the rigid translation of all bodies,

    (K + i w C - w^2 M) v = (w^2 M - i w C - K) r s,        transmissibility (r s + v) / s

Springs and dashpots between bodies have no part in C r and K r. What leads to the ground has, springs, layers, dashpots
and absorbing faces, and so has damping by the mass: the ground is at rest, as in a run whose driven faces move. Where
springs and layers to the ground are all that holds the assembly along the axis, the ground itself is the base, and C r
and K r are left out, as they are with damping ratios that are given.

C is 2 zeta_j omega_j of each Ritz vector, or what the scene has: Rayleigh damping, modal damping of bodies, dampers,
viscous joints, absorbing faces, wave ports, which may couple the modes. The Maxwell branches of materials make K depend
on w (``dynamic_stiffness``). Friction and the numerical damping of a run are not in it.

Groups of a file::

    /                            frequency; provenance and scene, as attributes
    /drives/<drive>/<sensor>     transmissibility, receptance, mobility or accelerance: magnitude (frequency, component)
                                 under that name, and phase
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final, Literal, get_args

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..building import clamped, without_scheme
from ..errors import InputError, Problem, did_you_mean, listed
from ..joined.dynamic_stiffness import ProjectedStiffness, curve_lines, eigenvalues
from ..joined.joined_assembly import JoinedAssembly, Joints, pressed_of
from ..joined.modal_damping import Modes
from ..latin.assembly import Array
from ..propagator.model import closest_reduced
from ..propagator.reduction import ritz_vectors
from ..results.dataset import Stored
from ..results.groups import StoredGroup, in_units, root_attributes
from ..results.quantities import AXES, LABELS, named, rows
from ..scene.readable_numbers import aligned
from ..scene.schema import Scene
from ..scene.units import SI, UnitSystem, unit_text
from .modes import damped

Kind = Literal["receptance", "mobility", "accelerance"]
Complex = NDArray[np.complex128]
OfFrequency = Callable[[Complex], Complex]
KINDS: Final = get_args(Kind)
BASE: Final = "base"
_POWER: Final = MappingProxyType({"receptance": 0, "mobility": 1, "accelerance": 2})  # of i w
_BEYOND: Final = 1.5  # highest natural frequency of the basis over the highest frequency
_FIRST: Final = 10  # elastic modes that are computed at least, where there are as many
_MOST: Final = 1000
_POINTS: Final = (1, 100_000)
_LOWEST: Final = 0.1  # of the first natural frequency, where no lowest frequency is given
_AT_PEAKS: Final = np.array([-4.0, -2.0, -1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0, 2.0, 4.0])  # half widths of a peak
_SHARE: Final = 1e-6  # of the mass that a base moves
_FREE: Final = 1e-6  # of a translation, that rows of joints and supports leave free
_CANCELLED: Final = 1e-12  # of the forces of a matrix, round-off where they cancel
_AT_ONCE: Final = 2**22  # numbers in the matrices of frequencies that are solved together
_HEADING: Final = "no frequency response"
_UNDAMPED: Final = ("damping", "the scene has none, and without it the peaks are infinite")


def frf(
    scene: Scene,
    drives: Sequence[str] = (),
    frequencies: ArrayLike | None = None,
    *,
    sensors: Sequence[str] = (),
    damping: float | Sequence[float] | None = None,
    kind: Kind = "accelerance",
    joints: Joints = "sticking",
    lowest: float | None = None,
    highest: float | None = None,
    points: int = 400,
) -> FrequencyResponse:
    """Frequency responses of the clamped assembly of a scene (module docstring).

    Parameters
    ----------
    drives : what excites it: "base.x", "base.y", "base.z" (of the base, if a sensor has that name, too); "SENSOR.x",
        ... a unit force there; the name of a load, scaled to a resultant of 1. None given: the base along every axis
        along which something is held.
    frequencies : (n,), Hz, > 0; None: ``points`` of them, and more at the natural frequencies between. sensors : where
        the motion is taken; all where none is given.
    damping : ratio to critical of all modes, or of one after the other, the last one of the rest; None: the damping of
        the scene. kind : of responses to forces: displacement, velocity or acceleration. joints : of interfaces that
        may open.
    lowest : first frequency, Hz; None: a tenth of the first natural one. highest : last frequency, Hz; None: that of
        the tenth mode. points : number of frequencies, by equal factors; more at peaks.

    Returns
    -------
    Responses by drive and sensor, complex (n, 3) along x, y, z: per unit of force, or of the same motion of the base.

    Raises
    ------
    InputError : a drive, sensor, frequency or ratio that does not fit the scene, or no damping at all.
    SceneError : the scene cannot be built.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/lap_joint/shock.toml")
    >>> response = latin_fmu.frf(scene, ["end.z"], [100.0, 1000.0], damping=0.02, kind="receptance")
    >>> response.response["end.z"]["end"].shape
    (2, 3)
    """
    ratios = _checked(scene, drives, sensors, damping, (kind, points, frequencies, lowest, highest))
    excitations = Excitations.of(scene, joints, ratios is None)
    names = list(drives) or excitations.base_motions
    terms = [excitations.terms(name, _POWER[kind], ratios is None) for name in names]
    columns = np.column_stack([column for pairs in terms for _, column in pairs])
    grid = None if frequencies is None else np.asarray(frequencies, dtype=float).ravel()
    if grid is None:
        top = highest
    else:
        top = float(grid.max())
    basis = RitzBasis.of(excitations, columns, top, ratios)
    if grid is None:
        grid = basis.frequencies(lowest, highest, points)
    response: dict[str, dict[str, Complex]] = {name: {} for name in names}
    motions = basis.responses(grid, columns)
    rate, first = (2j * np.pi * grid[:, None]).astype(np.complex128), 0
    for name, pairs in zip(names, terms, strict=True):
        numbers = range(first, first + len(pairs))
        moving = np.sum([of(rate) * motions[:, :, i] for i, (of, _) in zip(numbers, pairs, strict=True)], axis=0)
        first += len(pairs)
        axis = _base_axis(name)
        for sensor in sensors or scene.sensor:
            moved: Complex = moving @ (excitations.rows(sensor) @ basis.vectors).T
            # the base moves by 1
            response[name][sensor] = moved if axis is None else np.eye(3)[axis] + moved
    return FrequencyResponse(
        name=scene.name,
        scene=scene.text(),
        kind=kind,
        joints=joints,
        damping=_in_words(ratios),
        natural_frequency=basis.damped[0] / (2 * np.pi),
        n_static=len(basis.omega) - basis.n_mode,
        frequency=grid,
        response=response,
        curves=tuple(curve_lines(scene.material)) if ratios is None else (),
        units=scene.unit_system,
    )


def _checked(
    scene: Scene,
    drives: Sequence[str],
    sensors: Sequence[str],
    damping: float | Sequence[float] | None,
    options: tuple[str, int, ArrayLike | None, float | None, float | None],
) -> Array | None:
    """Ratios (n,) of the modes, None where they are those of the scene. Raises InputError: what needs no meshes."""
    kind, points, frequencies, lowest, highest = options
    problems, names = [], list(scene.sensor)
    if not names:
        problems.append(Problem("sensor", "the scene has none", remedy="add [sensor.NAME] tables to the scene"))
    places = (f"{name}.{axis}" for name in (BASE, *names) for axis in AXES)
    allowed = [*places, *scene.load]
    for name in drives:
        if name not in allowed:
            what = "neither the base nor a sensor with an axis nor a load"
            problems.append(Problem("drive", what, name, listed(allowed), did_you_mean(name, allowed)))
    for name in sensors if names else ():
        if name not in names:
            what = "no sensor of this name"
            problems.append(Problem("sensor", what, name, listed(names), did_you_mean(name, names)))
    if kind not in KINDS:
        problems.append(Problem("kind", "unknown", kind, ", ".join(KINDS), did_you_mean(kind, KINDS)))
    ratios = None if damping is None else np.atleast_1d(np.asarray(damping, dtype=float))
    if ratios is not None and not (len(ratios) and ((ratios > 0.0) & (ratios < 1.0)).all()):
        problems.append(Problem("damping", "out of range", str(ratios.tolist()), "ratios > 0, < 1"))
    if frequencies is None:
        grid = np.array([])
    else:
        grid = np.asarray(frequencies, dtype=float).ravel()
    ends = np.array([f for f in (lowest, highest) if f is not None], dtype=float)
    for where, values in (("frequencies", grid), ("lowest, highest", ends)):
        if not ((values > 0.0) & np.isfinite(values)).all():
            problems.append(Problem(where, "out of range", str(values.tolist()), "> 0 [Hz]"))
    if frequencies is not None and not len(grid):
        problems.append(Problem("frequencies", "none", None, "one or more"))
    if len(ends) == 2 and not ends[0] < ends[1]:
        problems.append(Problem("lowest", "not below the highest frequency", f"{lowest:g} Hz", f"< {highest:g} Hz"))
    if not _POINTS[0] < points <= _POINTS[1]:
        problems.append(Problem("points", "out of range", str(points), f"2 to {_POINTS[1]}"))
    if problems:
        raise InputError(problems, _HEADING)
    return ratios


def _clear(matrix: sp.csr_array, motion: Array) -> Array:
    """Forces (n,) of a motion (n,) by a matrix, without the round-off of those that cancel."""
    forces = matrix @ motion
    return np.where(np.abs(forces) > _CANCELLED * (abs(matrix) @ np.abs(motion)), forces, 0.0)


def _base_axis(drive: str) -> int | None:
    """Axis of a base motion, None for other drives."""
    place, _, axis = drive.rpartition(".")
    if place == BASE and axis in AXES:
        return AXES.index(axis)
    return None


def _power(n: int) -> OfFrequency:
    """The n-th power."""
    return lambda rate: rate**n


@dataclass(frozen=True)
class Excitations:
    """Forces and motions of places on the dofs of a joined assembly; ``modes`` : rigid motions, the lowest others."""

    joined: JoinedAssembly
    scene: Scene
    modes: Modes

    @staticmethod
    def of(scene: Scene, joints: Joints = "sticking", damped_by_scene: bool = True) -> Excitations:
        """Those of the clamped assembly of a scene, with its lowest modes; ``damped_by_scene`` : whether its damping is
        what damps. Raises InputError: it has none then, or nothing that can move has mass."""
        problem = without_scheme(scene)
        if damped_by_scene and not damped(problem):  # before the bolts are tightened, which takes far longer
            raise InputError.of(_HEADING, *_UNDAMPED, remedy="give a damping ratio of the modes")
        problem, state = clamped(scene, problem, joints)
        joined = JoinedAssembly.of(problem, joints, pressed_of(problem, state))
        excitations = Excitations(joined, scene, joined.modes(_FIRST))
        if not len(excitations.modes.omega):
            raise InputError.of(_HEADING, "modes", "the assembly has none: all that can move has no mass")
        return excitations

    def rows(self, sensor: str) -> Array:
        """Motion of a sensor (3, n) from the dofs."""
        place = self.joined.discretised.sensors[sensor]
        parts = self.joined.parts
        nodal, where = parts.models[place.substructure].nodal, parts.where[place.substructure]
        nodal_rows = place.rows if nodal is None else place.rows @ nodal
        moved = nodal_rows @ self.joined.expansion[where]
        return np.asarray(moved if isinstance(moved, np.ndarray) else moved.toarray())

    def terms(self, drive: str, power: int, damped: bool) -> list[tuple[OfFrequency, Array]]:
        """Functions of i w (n, 1) and forces (n,) that make the response to a drive: a force of unit size, or what the
        motion of a base along an axis does to the motion relative to it.

        ``power`` : of responses to forces. ``damped`` : with the damping of the scene. Raises InputError: nothing is
        held along the axis, or a load has no resultant.
        """
        axis = _base_axis(drive)
        if axis is None:
            return [(_power(power), self.column(drive))]
        if self.carried[axis] > 1.0 - _SHARE:
            what = f"nothing holds the assembly along {AXES[axis]}, so that no base moves it"
            raise InputError([Problem("drive", what, drive, remedy="drive it by a force")], _HEADING)
        terms: list[tuple[OfFrequency, Array]] = [(_power(2), -self._pulled[:, axis])]
        if not self._carried_by_springs(axis):
            joined, along = self.joined, self.joined.parts.translations[:, axis]
            at_rest: list[tuple[OfFrequency, Array]] = [(_power(0), _clear(joined.to_ground, along))]
            if damped:
                at_rest.append((_power(1), _clear(joined.damping, along) + joined.modal_drag(along)))
                at_rest += [(part.branches.rise, _clear(part.stiffness, along)) for part in joined.relaxing_to_ground]
            terms += [(of, -(joined.expansion.T @ force)) for of, force in at_rest if force.any()]
        return terms

    def _carried_by_springs(self, axis: int) -> bool:
        """Whether springs and layers to the ground are all that holds the assembly along an axis."""
        joined, along = self.joined, self.joined.parts.translations[:, [axis]]
        free = closest_reduced(joined.expansion, along)
        if np.abs(along - joined.expansion @ free).max(initial=0.0) >= _FREE:
            return False
        # a body that is held whole has no dofs, but layers on it
        stiffness, motion = joined.vibration.stiffness, free[:, 0]
        rest = stiffness @ motion - joined.expansion.T @ (joined.to_ground @ along[:, 0])
        return bool((np.abs(rest) <= _CANCELLED * (abs(stiffness) @ np.abs(motion))).all())

    def column(self, drive: str) -> Array:
        """Forces (n,) of unit size of a drive at a sensor or of a load. Raises InputError: a load has no resultant."""
        place, _, along = drive.rpartition(".")
        if place in self.scene.sensor and along in AXES:
            # work of a unit force: what gives the motion of the place gives its nodal forces
            forces: Array = self.rows(place)[AXES.index(along)]
            return forces
        return self._load(drive)

    def _load(self, name: str) -> Array:
        """Forces (n,) of a load of the scene with a resultant of 1. Raises InputError: it has none."""
        parts, pattern = self.joined.parts, np.zeros(self.joined.parts.n)
        size = 0.0
        for model in parts.models.values():
            for term in model.loads:
                if term.name == name:
                    pattern[parts.where[model.name]] += term.pattern
                    size += float(np.abs(term.pattern).sum())
        resultant = float(np.linalg.norm(parts.translations.T @ pattern))
        if resultant <= _SHARE * size:
            what = "the load has no resultant, to which its response could refer"
            raise InputError([Problem("drive", what, name, remedy="drive the assembly at a sensor")], _HEADING)
        return np.asarray(self.joined.expansion.T @ pattern) / resultant

    @cached_property
    def _pulled(self) -> Array:
        """M r (n, 3) of the rigid translations of all bodies."""
        parts = self.joined.parts
        return np.asarray(self.joined.expansion.T @ (parts.mass @ parts.translations))

    @cached_property
    def carried(self) -> Array:
        """Share (3,) of the mass that rigid motions carry along each axis."""
        rigid = self.modes.vectors[:, : self.modes.n_rigid]
        # rigid motions are mass-orthonormal: squares are effective masses
        share: Array = np.square(rigid.T @ self._pulled).sum(axis=0) / self.joined.parts.total_mass
        return share

    @property
    def base_motions(self) -> list[str]:
        """Base motions along the axes along which something is held. Raises InputError: there are none."""
        found = [f"{BASE}.{axis}" for axis, share in zip(AXES, self.carried, strict=True) if share <= 1.0 - _SHARE]
        if not found:
            what = "nothing holds the assembly, so that no base moves it"
            raise InputError([Problem("drive", what, remedy="name a sensor with an axis, or a load")], _HEADING)
        return found


@dataclass(frozen=True)
class RitzBasis:
    """Ritz coordinates of a joined assembly.

    Attributes
    ----------
    vectors : (n, m) mass-orthonormal: rigid motions, elastic modes (``n_mode`` of both), static responses.
    omega : (m,), s-1. damping : (m,) of each coordinate or (m, m), s-1. strained : stiffnesses with Maxwell branches.
    """

    vectors: Array
    omega: Array
    damping: Array
    n_rigid: int
    n_mode: int
    strained: tuple[ProjectedStiffness, ...] = ()

    @staticmethod
    def of(excitations: Excitations, forces: Array, highest: float | None, ratios: Array | None) -> RitzBasis:
        """Coordinates for forces (n, n_force) up to a frequency, Hz, that of the last of the lowest modes where None.
        Raises InputError: there is no damping."""
        joined = excitations.joined
        modes = excitations.modes
        count = _FIRST
        top = _BEYOND * (modes.omega[-1] if highest is None else 2 * np.pi * highest)
        # fewer than were requested: the assembly has no more
        while modes.omega[-1] < top and len(modes.omega) - modes.n_rigid >= count and count < _MOST:
            count *= 2
            modes = joined.modes(count)
        rigid, elastic = modes.vectors[:, : modes.n_rigid], modes.vectors[:, modes.n_rigid :]
        size = np.linalg.norm(forces, axis=0)
        # unit columns: M r of a base and a unit force differ by the size of the masses
        values, vectors = ritz_vectors(joined.vibration, rigid, elastic, forces[:, size > 0.0] / size[size > 0.0])
        vectors, omega = np.hstack([rigid, vectors]), np.sqrt(np.concatenate([np.zeros(modes.n_rigid), values]))
        n_mode = len(modes.omega)
        if ratios is not None:
            # the last ratio is that of the rest, static responses included
            number = np.minimum(np.arange(len(values)), len(ratios) - 1)
            ratio = np.concatenate([np.zeros(modes.n_rigid), ratios[number]])
            return RitzBasis(vectors, omega, 2 * ratio * omega, modes.n_rigid, n_mode)
        reduced = [m.name for m in joined.parts.models.values() if m.modal is not None and m.modal_rows is None]
        if reduced:
            what = "modal damping without a limit is that of a reduced basis"
            where, remedy = f"substructure.{reduced[0]}.modal_damping", "give 'below', or a damping ratio of the modes"
            raise InputError([Problem(where, what, remedy=remedy)], _HEADING)
        full = joined.expansion @ vectors
        damping, strained = joined.damping_of(full), tuple(joined.strained_of(full))
        if not (strained or np.abs(damping).max(initial=0.0) > 0.0):
            raise InputError.of(_HEADING, *_UNDAMPED, remedy="give a damping ratio of the modes")
        return RitzBasis(vectors, omega, damping, modes.n_rigid, n_mode, strained)

    @cached_property
    def damped(self) -> tuple[Array, Array]:
        """Natural angular frequencies of the elastic modes, s-1, and their damping ratios."""
        elastic = slice(self.n_rigid, self.n_mode)
        if not self.strained:
            return self.omega[elastic], self.ratio[elastic]
        found = eigenvalues(self.omega, self.damping, self.strained, self.n_mode)[elastic]
        return np.abs(found), -found.real / np.abs(found)

    @property
    def ratio(self) -> Array:
        """Damping ratios (m,), 0 for rigid motions."""
        if self.damping.ndim == 1:
            diagonal = self.damping
        else:
            diagonal = np.diagonal(self.damping)
        # np.where divides for all: 1e-300 keeps rigid motions from a warning
        ratio: Array = np.where(self.omega > 0.0, diagonal / (2 * np.maximum(self.omega, 1e-300)), 0.0)
        return ratio

    def frequencies(self, lowest: float | None, highest: float | None, points: int) -> Array:
        """Frequencies, Hz, by equal factors, and some at each peak. Raises InputError: no elastic mode, bad ends."""
        omega, ratio = self.damped
        natural = omega / (2 * np.pi)
        if not len(natural) and (lowest is None or highest is None):
            raise InputError.of(_HEADING, "frequencies", "the assembly has no elastic mode", remedy="give both ends")
        if highest is None:
            last = float(natural[min(len(natural), _FIRST) - 1])
        else:
            last = highest
        # the highest may be given below the first natural frequency
        if lowest is None:
            first = _LOWEST * min(float(natural[0]), last)
        else:
            first = lowest
        if not first < last:
            what = "not below the highest frequency"
            raise InputError([Problem("lowest", what, f"{first:g} Hz", f"< {last:g} Hz")], _HEADING)
        peaks = (natural[:, None] * (1.0 + ratio[:, None] * _AT_PEAKS)).ravel()
        inside = peaks[(peaks > first) & (peaks < last)]
        return np.unique(np.concatenate([np.geomspace(first, last, points), inside]))

    def responses(self, frequency: Array, forces: Array) -> Complex:
        """Coordinates q (n_frequency, m, n_force) under harmonic forces (n, n_force)."""
        w, load = 2 * np.pi * frequency[:, None], self.vectors.T @ forces
        if self.damping.ndim == 1:
            dynamic = self.omega**2 - w**2 + 1j * w * self.damping
            return np.asarray(load / dynamic[:, :, None])
        m = len(self.omega)
        stiffness, coordinates = np.diag(self.omega**2), []
        for part in np.array_split(w, max(1, len(w) * m * m // _AT_ONCE)):
            square = part[:, :, None] ** 2 * np.eye(m)
            dynamic = stiffness - square + 1j * part[:, :, None] * self.damping
            for strained in self.strained:
                rise = strained.branches.rise((1j * part[:, :, None]).astype(np.complex128))
                dynamic = dynamic + rise * strained.stiffness
            coordinates.append(np.linalg.solve(dynamic, load[None]))
        return np.concatenate(coordinates)


def _in_words(ratios: Array | None) -> str:
    """Where the damping comes from."""
    if ratios is None:
        return "that of the scene"
    each = ", ".join(f"{100 * ratio:.4g}" for ratio in ratios)
    return f"{each} % of critical" + (
        " in each mode" if len(ratios) == 1 else " in the modes, the last one in the rest"
    )


_RESPONSE: Final = rows(
    """
    transmissibility | 1         | frequency component | magnitude of the motion over that of the base
    receptance  | m N-1          | frequency component | magnitude of the displacement per force
    mobility    | m s-1 N-1      | frequency component | magnitude of the velocity per force
    accelerance | m s-2 N-1      | frequency component | magnitude of the acceleration per force
    phase       | rad            | frequency component | phase of the motion | ahead of the excitation
    frequency   | Hz             | frequency           | frequency of the excitation
    """
)
"""Of a drive and a sensor."""


@dataclass(frozen=True)
class FrequencyResponse(Stored):
    """Frequency responses of an assembly with linear joints.

    Attributes
    ----------
    name, scene : of the scene, and its text. kind : of responses to forces. joints : how those that may open were
        taken. damping : in words. natural_frequency : (n,) of the elastic modes of the basis, Hz. n_static : static
        responses beside them.
    frequency : (n_frequency,), Hz. response : complex (n_frequency, 3) along x, y, z, by drive and by sensor.
    curves : lines on materials whose stiffness depends on frequency.
    """

    name: str
    scene: str
    kind: Kind
    joints: str
    damping: str
    natural_frequency: Array
    n_static: int
    frequency: Array
    response: Mapping[str, Mapping[str, Complex]]
    curves: tuple[str, ...] = ()
    units: UnitSystem = SI

    def kind_of(self, drive: str) -> str:
        """Name of the responses to a drive."""
        if _base_axis(drive) is None:
            return self.kind
        return "transmissibility"

    def unit_of(self, drive: str) -> str:
        """Unit (UDUNITS) of the responses to a drive in the system of the scene."""
        return self.units.label(str(_RESPONSE[self.kind_of(drive)].unit))

    def lines(self) -> list[str]:
        """Text: what was done, and the largest responses."""
        f = self.frequency
        head = f"{self.name}: joints {self.joints}, damping: {self.damping}"
        basis = f"{len(self.natural_frequency)} elastic modes"
        if len(self.natural_frequency):
            basis += f" to {self.natural_frequency[-1]:.5g} Hz"
        basis += f" and {self.n_static} static responses; {len(f)} frequencies from {f[0]:.5g} to {f[-1]:.5g} Hz"
        table: list[tuple[str, ...]] = [("drive", "sensor", "response", "largest", "along", "at", "phase")]
        for drive, by_sensor in self.response.items():
            for sensor, response in by_sensor.items():
                at, axis = np.unravel_index(int(np.abs(response).argmax()), response.shape)
                peak = response[at, axis]
                size = f"{abs(peak):.4g} {unit_text(self.unit_of(drive))}".rstrip()
                phase = f"{np.degrees(np.angle(peak)):.0f} deg"
                row = (drive, sensor, self.kind_of(drive), size, AXES[axis], f"{f[at]:.6g} Hz", phase)
                table.append(row)
        return [head, f"  {basis}", "", *aligned(table), *self.curves]

    def report(self) -> dict[str, Any]:
        """Plain data for strict JSON: what the root of a file has, and of each drive its sensors."""
        root, *others = self.groups().items()
        drives: dict[str, dict[str, Any]] = {name: {} for name in self.response}
        for path, group in others:
            drive, _, sensor = path.removeprefix("/drives/").partition("/")
            drives[drive][sensor] = group.report()
        return root[1].report() | {"drives": drives}

    def groups(self) -> dict[str, StoredGroup]:
        """Groups by path: the frequencies, and one for every drive and sensor."""
        title = f"frequency responses, joints {self.joints}, damping: {self.damping}"
        labels = [(_RESPONSE["frequency"], self.frequency), *named(LABELS, {"component": AXES})]
        groups = {"/": StoredGroup.of([], labels, root_attributes(title, self.name, self.scene))}
        for drive, by_sensor in self.response.items():
            for sensor, response in by_sensor.items():
                values = {self.kind_of(drive): np.abs(response), "phase": np.angle(response)}
                groups[f"/drives/{drive}/{sensor}"] = StoredGroup.of(named(_RESPONSE, values))
        return in_units(groups, self.units)

    def as_csv(self) -> str:
        """One row a frequency: magnitude, and phase in degrees, of every drive, sensor and axis."""
        head, table = ["frequency [Hz]"], [self.frequency]
        for drive, by_sensor in self.response.items():
            for sensor, response in by_sensor.items():
                for axis, values in zip(AXES, response.T, strict=True):
                    what = f"{sensor}.{axis} / {drive}"
                    head += [f"{what} {self.kind_of(drive)} [{self.unit_of(drive)}]", f"{what} phase [degree]"]
                    table += [np.abs(values), np.degrees(np.angle(values))]
        lines = [",".join(f"{value:.9g}" for value in row) for row in np.stack(table, axis=1)]
        return "\n".join([",".join(head), *lines]) + "\n"
