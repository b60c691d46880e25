"""Natural frequencies and shapes of an assembly without loads, its joints open, sticking or bonded.

    K phi = omega^2 M phi    on the motions with C phi = 0

C holds what joints keep together: all components of perfect interfaces; of contacts, at points that are closed at the
start, the normal component and, with friction, the tangential ones (sticking); all components at all points (bonded).
In a scene with bolts, or with a static start, those points are closed that are under pressure when the bolts are tight
and what acts at t = 0 does. The stress of that state has its stiffness where it counts (``statics.prestressed``). With
open joints bolts have no tension, and their shanks are free to slide in the thread
(``bolts``).
Springs of layers add to K. Held and prescribed directions do not move.

Points that are not closed, but by less than ``_NEAR`` of the size of the assembly, are nearly closed: a vibration that
strains the bodies by about as much closes them in a part of its period. It rings between the frequencies with these
points open and those with them closed as well, which are not lower, mode by mode: constraints raise every eigenvalue.

What is kept together is eliminated (``joined_assembly``).

The shapes are those of the undamped assembly with its static stiffness. Where materials have Maxwell branches the
frequency is that of the stiffness at this frequency (``dynamic_stiffness``). The damping ratio that a run of the scene
gives each mode is added (``modal_damping``), and
how a base that moves along an axis excites it: with the rigid translation r of all bodies, held dofs included,

    Gamma = phi^T M r / (phi^T M phi),    effective mass = (phi^T M r)^2 / (phi^T M phi)

for the phi of ``shapes``. The effective masses of all modes add up to the mass that the supports leave free to move.

Results are a table, files for ParaView, and the groups of a file::

    /                      provenance and scene, as attributes
    /modes                 frequency, frequency_closed, rigid, modal_mass, scheme_damping, landing_damping,
                           body_damping (mode), participation, effective_mass (mode, component); joints, interfaces,
                           mass, time_scheme and time_step as attributes
    /substructures/<name>  shape (mode, node, component), and the mesh
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..assembly.problem import DiscretisedProblem
from ..building import clamped, without_scheme
from ..joined.dynamic_stiffness import curve_lines
from ..joined.joined_assembly import JoinedAssembly, Joints, pressed_of, touching
from ..joined.modal_damping import ModalDamping, Modes, modal_damping, run_matrices
from ..latin.assembly import Array
from ..latin.recorder import SubstructureInfo
from ..laws.maxwell_joint import MaxwellJoint
from ..laws.viscous_joint import ViscousJoint
from ..results.dataset import Stored
from ..results.groups import StoredGroup, describe_mesh, in_units, root_attributes
from ..results.quantities import AXES, LABELS, MESH, NODES, columns, named, rows
from ..results.vtk import export_vtu
from ..scene.readable_numbers import aligned, readable
from ..scene.schema import Scene
from ..scene.units import SI, UnitSystem

_NO_DAMPING = 1e-7  # %, round-off
_NO_MASS = 1e-6  # of the assembly, round-off
_EFFECTIVE: Final = "effective mass along x, y, z"
_NEAR = 1e-4  # of the size of the assembly: larger gaps are open
_SAME = 1e-3  # of a frequency: smaller changes are not printed


def vibration_modes(scene: Scene, joints: Joints = "sticking", count: int = 10) -> VibrationModes:
    """Natural frequencies and shapes of the assembly of a scene (module docstring), and the damping ratio of each mode
    in a run with the time scheme and the step of the scene (``VibrationModes.damping``).

    Parameters
    ----------
    joints : of interfaces that may open. count : elastic modes, the lowest ones; rigid motions come in addition.

    Returns
    -------
    Modes with frequencies, Hz, shapes, modal masses, kg, participation factors and effective masses, kg, and
    ``damping``: ratios (n_mode,) of critical ``scheme``, ``landing``, ``bodies``, ``numerical`` (scheme and landing
    layer), and ``remedy``, what lowers the numerical damping where it exceeds 5e-5; None for a quasi-static scene.

    Raises
    ------
    SceneError : the scene cannot be built.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/beam_in_traction/scene.toml")
    >>> modes = latin_fmu.vibration_modes(scene, "open", count=3)
    >>> modes.frequency.size - 3  # rigid motions of the free bars and of their joints
    12
    """
    problem, state = clamped(scene, without_scheme(scene), joints)
    pressed = pressed_of(problem, state)
    joined = JoinedAssembly.of(problem, joints, pressed)
    modes = joined.modes(count)
    matrices = run_matrices(scene, joined.discretised, joined.parts.models)
    damping = None if matrices is None else modal_damping(matrices, modes, joined)
    near = joined.nearly_closed(pressed, state) if joints == "sticking" else {}
    closed = None
    if near:
        units = {unit.name: unit for unit in joined.discretised.units}
        every = {name: pressed.get(name, touching(units[name])) | ~np.isnan(gap) for name, gap in near.items()}
        all_closed = JoinedAssembly.of(joined.discretised, joints, pressed | every)
        closed = all_closed.frequencies(len(modes.omega))
    return _named(joined, modes, damping, joints, near, closed)


def damped(problem: DiscretisedProblem) -> bool:
    """Whether a body or a joint of a discretised scene has damping."""
    models = (model for cls in problem.classes for model in cls.members)
    return any(isinstance(unit.behaviour, ViscousJoint | MaxwellJoint) for unit in problem.units) or any(
        model.modal is not None
        or len(model.branches) > 0
        or (model.damping is not None and bool(model.damping.count_nonzero()))
        for model in models
    )


def _named(
    joined: JoinedAssembly,
    modes: Modes,
    damping: ModalDamping | None,
    joints: str,
    near: Mapping[str, Array],
    closed: Array | None,
) -> VibrationModes:
    """The modes by substructure, the largest nodal displacement of each 1; ``near``, ``closed`` : of
    ``VibrationModes``."""
    parts, scene = joined.parts, joined.discretised.scene
    remarks = joined.remarks
    if joined.discretised.prestress is not None:
        remarks += (f"prestress: {joined.discretised.prestress.words}",)
    full = modes.expansion @ modes.vectors
    omega = modes.omega
    shapes = {}
    frequency = omega / (2 * np.pi)
    if (damped := joined.eigenvalues(modes)) is not None:
        frequency = np.abs(damped) / (2 * np.pi)
    for name, model in parts.models.items():
        nodal = full[parts.where[name]]
        if model.nodal is not None:
            nodal = model.nodal @ nodal
        shapes[name] = nodal.T.reshape(len(omega), len(nodal) // 3, 3)
    size = np.max([np.linalg.norm(s, axis=2).max(axis=1) for s in shapes.values()], axis=0)
    # the modal mass belongs to the scaled shape
    modal = np.einsum("im,im->m", full, parts.mass @ full) / size**2
    pulled = parts.mass @ parts.translations
    participation = (full.T @ pulled) / (size * modal)[:, None]
    return VibrationModes(
        scene=scene.text(),
        name=scene.name,
        joints=joints,
        frequency=frequency,
        static_frequency=omega / (2 * np.pi),
        rigid=np.arange(len(omega)) < modes.n_rigid,
        modal_mass=modal,
        participation=participation,
        mass=parts.total_mass,
        shapes={name: shape / size[:, None, None] for name, shape in shapes.items()},
        meshes=joined.discretised.info,
        remarks=remarks,
        damping=damping,
        curves=tuple(curve_lines(scene.material)),
        units=scene.unit_system,
        near=near,
        frequency_closed=closed,
    )


_MODES: Final = rows(
    """
    frequency  | Hz | mode | natural frequency, 0 for rigid motions
    static_frequency | Hz | mode | the same with the static stiffness | without the rise of moduli with frequency
    frequency_closed | Hz | mode | natural frequency with the nearly closed points closed as well
    rigid      | -  | mode | whether the mode is a rigid motion | | elastic rigid
    modal_mass | kg | mode | modal mass | of the shape whose largest nodal displacement is 1
    participation | 1 | mode component | participation factor | of that shape, for a base that moves along x, y, z
    effective_mass | kg | mode component | effective mass | for a base that moves along x, y, z
    """,
    {"rigid": lambda modes: modes.rigid.astype(np.int8)},
)
"""Of ``VibrationModes``."""
_DAMPING: Final = rows(
    """
    scheme_damping | 1 | mode | damping ratio of the time scheme in a run with the step of the scene \
        | share of critical damping
    landing_damping | 1 | mode | damping ratio of the viscous layer at faces that may open | share of critical damping
    body_damping | 1 | mode | damping ratio of bodies, dampers, viscous joints, absorbing faces, wave ports \
        | share of critical damping
    """,
    {
        "scheme_damping": attrgetter("scheme"),
        "landing_damping": attrgetter("landing"),
        "body_damping": attrgetter("bodies"),
    },
)
"""Of their ``ModalDamping``."""
_SHAPE: Final = rows(
    "shape | 1 | mode node component | displacement in the mode, largest nodal displacement of the assembly 1"
)["shape"]


@dataclass(frozen=True)
class VibrationModes(Stored):
    """Modes of an assembly, undamped, and the damping ratio of each in a run.

    Attributes
    ----------
    scene, name : text and name of the scene. joints : how interfaces that may open were taken.
    frequency : (n_mode,), Hz, 0 for rigid motions, which come first; static_frequency : with the static stiffness.
    rigid : (n_mode,) whether it is one.
    modal_mass : (n_mode,), kg, with shapes whose largest nodal displacement is 1.
    participation : (n_mode, 3), of these shapes for a base that moves along x, y, z. mass : of the assembly, kg.
    shapes : (n_mode, n_node, 3) by substructure. meshes : of the substructures. remarks : on every interface.
    damping : ratios in a run with the time scheme and the step of the scene; None where the scene has no inertia.
    curves : lines on materials whose stiffness depends on frequency. units : system of units of the scene.
    near : gaps (n_point,), m, of nearly closed points, NaN at all others, by interface that has some.
    frequency_closed : (n_mode,), Hz, with these points closed as well, rigid motions among them, NaN where there are
    fewer modes; None where no point is nearly closed.
    """

    scene: str
    name: str
    joints: str
    frequency: Array
    static_frequency: Array
    rigid: NDArray[np.bool_]
    modal_mass: Array
    participation: Array
    mass: float
    shapes: Mapping[str, Array]
    meshes: Mapping[str, SubstructureInfo]
    remarks: tuple[str, ...]
    damping: ModalDamping | None = None
    curves: tuple[str, ...] = ()
    units: UnitSystem = SI
    near: Mapping[str, Array] = field(default_factory=dict)
    frequency_closed: Array | None = None

    @property
    def n_rigid(self) -> int:
        """Number of rigid motions."""
        return int(self.rigid.sum())

    @property
    def effective_mass(self) -> Array:
        """(n_mode, 3), kg, for a base that moves along x, y, z: modal mass times the square of the participation."""
        return self.modal_mass[:, None] * self.participation**2

    def lines(self) -> list[str]:
        """Text: the joints, and a table of the modes."""
        head = f"{self.name}: joints {self.joints}, {self.n_rigid} rigid motion(s), {int((~self.rigid).sum())} mode(s)"
        ratios = {} if self.damping is None else self.damping.columns()
        rises = ["if closed"] if self.rises else []
        rows: list[tuple[str, ...]] = [
            ("mode", "frequency", *rises, "modal mass", *ratios, "moves most", "mean squares along x, y, z", _EFFECTIVE)
        ]
        if self.n_rigid:
            if self.n_rigid > 1:
                number = f"1 to {self.n_rigid}"
            else:
                number = "1"
            carried = self._shares(self.effective_mass[: self.n_rigid].sum(axis=0))
            beside = ["-"] * (len(rows[0]) - 3 - len(rises))
            rows.append((number, "rigid", *self._if_closed(slice(self.n_rigid)), *beside, carried))
        for i in range(self.n_rigid, len(self.frequency)):
            largest = {name: float(np.linalg.norm(shape[i], axis=1).max()) for name, shape in self.shapes.items()}
            squares = sum(np.square(shape[i]).sum(axis=0) for shape in self.shapes.values())
            shares = ", ".join(f"{100 * share:.0f} %" for share in squares / np.sum(squares))
            carried = self._shares(self.effective_mass[i])
            text = f"{self.frequency[i]:.5g} Hz"
            moves = max(largest, key=lambda name: largest[name])
            damped = [f"{ratio[i]:.2g}" if abs(ratio[i]) > _NO_DAMPING else "0" for ratio in ratios.values()]
            rows.append(
                (
                    f"{i + 1}",
                    text,
                    *self._if_closed(slice(i, i + 1)),
                    readable(self.modal_mass[i], self.units.label("kg"), 3),
                    *damped,
                    moves,
                    shares,
                    carried,
                )
            )
        weight = readable(self.mass, self.units.label("kg"), 4)
        total = f"effective masses of these modes: {self._shares(self.effective_mass.sum(axis=0))} of {weight}"
        top = [head, *(f"  {remark}" for remark in self.remarks), ""]
        return [*top, *aligned(rows), total, *self._near_lines(), *self._damping_lines(), *self.curves]

    @property
    def rises(self) -> bool:
        """Whether a frequency is another with the nearly closed points closed."""
        closed = self.frequency_closed
        return closed is not None and bool((~(closed <= (1.0 + _SAME) * self.frequency))[~self.rigid].any())

    def _if_closed(self, modes: slice) -> list[str]:
        """Cell of some modes in the column of the frequencies with the nearly closed points closed; none without
        column."""
        if not self.rises or self.frequency_closed is None:
            return []
        closed = self.frequency_closed[modes]
        largest = float(closed.max())
        if np.isnan(largest):
            return ["none"]
        return [f"{'up to ' if len(closed) > 1 else ''}{largest:.5g} Hz" if largest > 0.0 else "rigid"]

    def _near_lines(self) -> list[str]:
        """Which points are nearly closed, by how much, and what it means for the frequencies."""
        if not self.near:
            return []
        places, metre = [], self.units.label("m")
        for name, gap in self.near.items():
            least, most = (readable(float(f(gap)), metre, 3) for f in (np.nanmin, np.nanmax))
            if least != most:
                size = f"{least} to {most}"
            else:
                size = most
            places.append(f"{name} {int((~np.isnan(gap)).sum())} points by {size}")
        text = f"nearly closed, open by less than {_NEAR:g} of the size of the assembly: {', '.join(places)}"
        if not self.rises:
            return ["", f"{text}; closed, they change no frequency by more than {100 * _SAME:g} %"]
        rule = "a vibration that closes them in a part of its period rings between both frequencies"
        return ["", f"{text}; with them closed: column 'if closed'; {rule}"]

    def _shares(self, masses: Array) -> str:
        """Effective masses (3,) as shares of the mass of the assembly."""
        return ", ".join(
            f"{100 * share:.3g} %" for share in np.where(masses > _NO_MASS * self.mass, masses, 0.0) / self.mass
        )

    def _damping_lines(self) -> list[str]:
        """Scheme and step that the damping ratios are of, and what lowers them."""
        if self.damping is None:
            return ["", "no damping ratios: a quasi-static run has no inertia"]
        step = readable(self.damping.step, "s", 4)
        what = f"damping, % of critical, in a run with steps of {step} and time scheme {self.damping.time_scheme}"
        return ["", what, *([self.damping.remedy] if self.damping.remedy else [])]

    def groups(self) -> dict[str, StoredGroup]:
        """Groups by path: ``modes`` and one for every substructure with its shapes and mesh."""
        number = np.arange(1, len(self.frequency) + 1, dtype=np.int32)
        attrs: dict[str, object] = {"joints": self.joints, "interfaces": "\n".join(self.remarks), "mass": self.mass}
        stored = columns(_MODES, self)
        if self.damping is not None:
            stored += columns(_DAMPING, self.damping)
            attrs |= {"time_scheme": self.damping.time_scheme, "time_step": self.damping.step}
        along = named(LABELS, {"mode": number, "component": AXES})
        root = root_attributes("natural frequencies and shapes", self.name, self.scene)
        groups = {"/": StoredGroup({}, attrs=root), "/modes": StoredGroup.of(stored, along, attrs)}
        for name, shape in self.shapes.items():
            groups[f"/substructures/{name}"] = _shapes(shape, number, self.meshes[name])
        return in_units(groups, self.units)

    def export(self, folder: str | Path) -> Path:
        """Write files for ParaView, in which the number of the mode stands in the place of the time; the .pvd file.

        Raises
        ------
        ResultsError : the folder cannot be used.
        """
        bodies = {path: group for path, group in self.groups().items() if path.startswith("/substructures/")}
        played = {path: group.dataset().rename(mode="time") for path, group in bodies.items()}
        return export_vtu(xr.DataTree.from_dict(played), folder)


def _shapes(shape: Array, number: NDArray[np.int32], mesh: SubstructureInfo) -> StoredGroup:
    """Group of one substructure: its shapes and its mesh."""
    along = [*named(LABELS, {"mode": number, "component": AXES}), *columns(NODES, mesh)]
    group = StoredGroup.of([(_SHAPE, shape), *columns(MESH, mesh)], along)
    describe_mesh(group, mesh.cell_type, "mode")
    return group
