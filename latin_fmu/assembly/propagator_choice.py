"""Propagators by name, and which of them marches the substructures of a scene: sizes and memory of its operators, and
its stable step.

Before a pattern is analysed the size of its factor follows from the number n of unknowns: those of three-dimensional
meshes in nested dissection hold about 21 n^(4/3) entries (George 1973 for the power).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np

from ..errors import Problem, SceneError
from ..latin.processes import distributed
from ..machine import in_threads, memory_room
from ..propagator import StaticPropagator
from ..propagator.base import Propagator
from ..propagator.direct import CgPropagator, DirectPropagator
from ..propagator.explicit import ExplicitPropagator
from ..propagator.interface_sweeps import Interfaces, flops, in_form, long_steps, swept_shape, takes_sweeps
from ..propagator.model import Array, SubstructureModel
from ..propagator.reduced import ReducedPropagator
from ..scene import settings as tables
from ..scene.raw_scene import CENTRAL
from ..scene.schema import Scene
from ..time_scheme import QuasiStatic, TimeScheme
from .models import KeptOperators, ModelClass

AVAILABLE: Final = 0.7  # part of the memory of the machine that operators may take
_CELL_BYTES = 20e3  # of matrices while they are assembled, per hexahedron, at least
_ENTRIES = 21.0  # of a factor, see the module docstring
_SPARSE_BYTES = 12  # per entry of a sparse matrix
_STATE_VECTORS = 12  # per member: displacement, velocity, acceleration, loads and work space

Kind = Literal["direct", "explicit", "reduced", "cg"]


DENSE: Final = Interfaces("dense")
_OF_BODIES: Final = (CENTRAL, "generalized_alpha", "massless_contact")  # schemes that take mass from nodes of faces


@dataclass(frozen=True)
class PropagatorSettings:
    """Settings of the propagators of a run.

    Attributes
    ----------
    kind : registry key. modes : elastic modes of each reduced substructure. precision : of the direct factors.
    interfaces : how direct propagators solve with them.
    """

    kind: Kind = "direct"
    modes: int = 50
    precision: Literal["float64", "float32"] = "float64"
    interfaces: Interfaces = field(default_factory=Interfaces)


Members = Sequence[SubstructureModel]
Maker = Callable[[Members, TimeScheme, float, PropagatorSettings, Propagator | None], Propagator]
"""From members with equal operators, time scheme, step (s), settings, and a propagator with the same operators to share
them with, where the kind can. Energies are accounted for whether they are kept or not: the iteration stops by them."""


def _direct(
    members: Members, scheme: TimeScheme, dt: float, settings: PropagatorSettings, twin: Propagator | None
) -> Propagator:
    if settings.precision != "float64":
        members = [m.with_factor(settings.precision) for m in members]
    members = in_form(members, settings.interfaces)
    return DirectPropagator(members, scheme, dt, True, twin if isinstance(twin, DirectPropagator) else None)


def _reduced(
    members: Members, scheme: TimeScheme, dt: float, settings: PropagatorSettings, twin: Propagator | None
) -> Propagator:
    if members[0].nodal is not None:  # a rigid body has nothing to reduce
        return DirectPropagator(members, scheme, dt, True)
    if not isinstance(twin, ReducedPropagator):
        twin = None
    return ReducedPropagator(members, scheme, dt, True, settings.modes, twin)


PROPAGATORS: Mapping[str, Maker] = MappingProxyType(
    {
        "direct": _direct,
        "explicit": lambda members, scheme, dt, *_: ExplicitPropagator(members, scheme, dt, True),
        "reduced": _reduced,
        "cg": lambda members, scheme, dt, *_: CgPropagator(members, scheme, dt, True),
    }
)


def _loads_suffice(propagator: Propagator, scheme: TimeScheme, dt: float) -> bool:
    """Whether the test of the work of errors needs the work of the loads alone: where no reaction of a prescribed
    motion does work. All energies take a product with K more (explicit: two), up to half of a short step; the account
    of longer ones is kept, since it shows where numbers run out of digits."""
    moved = propagator.members[0].imposed_pattern.shape[1] > 0
    operators = propagator.operators
    return not moved and not long_steps(scheme.operator(dt), operators.mass, operators.stiffness)


@dataclass(frozen=True)
class ClassSize:
    """Sizes of the operators of a class of identical substructures.

    Attributes
    ----------
    unknowns, interface, channels : of one member: unknowns, those at interfaces, interface degrees of freedom.
    members : number of substructures. stiffness, mass, damping : entries of the matrices.
    factor, flops : entries of the Cholesky factor and multiplications that make it, interface block excluded.
    swept : entries of the factor that a substitution on the interfaces reads; 0 where they have dense matrices.
    product : entries, of eight bytes, that a product of the iteration reads where they have none. columns : solved for
    to fill tables of the interfaces. modal : modes in modal damping that has a limit.
    """

    unknowns: int
    interface: int
    channels: int
    members: int
    stiffness: int
    mass: int
    damping: int
    factor: float
    flops: float
    swept: float = 0.0
    product: float = 0.0
    columns: float = 0.0
    modal: int = 0

    @property
    def sparse(self) -> int:
        """Entries of stiffness, mass and damping matrix."""
        return self.stiffness + self.mass + self.damping

    def basis(self, modes: int) -> int:
        """Vectors of a reduced substructure with so many elastic ``modes``."""
        return min(self.channels + modes, self.unknowns)


def factor_bytes(unknowns: int) -> float:
    """Size of a Cholesky factor by the law of the module docstring, without an analysis of the pattern."""
    return float(8 * _ENTRIES * unknowns ** (4 / 3))


def class_size(model: SubstructureModel, members: int, interfaces: Interfaces = DENSE) -> ClassSize:
    """Sizes of a class of so many members like ``model``; ``interfaces`` : how they are solved with."""
    mass = damping = 0
    if model.mass is None:
        stiffness = model.reduced_stiffness
    else:
        reduced_mass, reduced_damping, stiffness = model.reduced
        mass, damping = reduced_mass.nnz, 0 if reduced_damping is None else reduced_damping.nnz
    n = stiffness.shape[0]
    last, trace, rank = model.at_interface
    factor = multiplications = swept = 0.0
    if takes_sweeps(model, interfaces):
        shape = swept_shape(model)
        factor = float(shape.panel_start[-1])
        multiplications = flops(shape)
        swept = float(shape.face_entries)
    elif n:
        from ..cholesky.symbolic import Pattern, shared_analysis

        pattern = shared_analysis(Pattern(stiffness, last, rank))
        factor, multiplications = float(pattern.panel_start[-1]), flops(pattern)
    sizes = n, len(last), trace.shape[0], members, stiffness.nnz, mass, damping
    if model.modal_rows is None:
        modal = 0
    else:
        modal = len(model.modal_rows)
    # a product by substitution reads the face forward and backward
    return ClassSize(*sizes, factor, multiplications, swept, 2.0 * swept, modal=modal)


def divided(
    scene: Scene, classes: list[ModelClass], processes: int
) -> tuple[list[ModelClass], tuple[int, ...], tuple[int, ...]]:
    """Classes of which each belongs to one process, the process of each, and the number of the class it is a part of;
    for one process the classes, and nothing more."""
    if processes == 1:
        return classes, (), ()
    costs = [_march_cost(scene, c.members[0]) for c in classes for _ in c.members]
    ranks = iter(distributed(costs, processes))
    parts = list[ModelClass]()
    owner = list[int]()
    part_of = list[int]()
    first: list[int] = []  # part of each class
    for number, c in enumerate(classes):
        of_members = np.array([next(ranks) for _ in c.members])
        first.append(len(parts))
        for rank in np.unique(of_members):
            picked = np.flatnonzero(of_members == rank)
            twin = None
            if c.twin is not None:
                twin = first[c.twin]
            # parts of one class share the operators of its first part
            if len(parts) > first[-1]:
                twin = first[-1]
            parts.append(replace(c, members=[c.members[m] for m in picked], channels=c.channels[:, picked], twin=twin))
            owner.append(int(rank))
            part_of.append(number)
    return parts, tuple(owner), tuple(part_of)


def _march_cost(scene: Scene, model: SubstructureModel) -> float:
    """Numbers that an instant of a substructure reads, about: those of the sweeps twice, and of its interface matrices
    in a few iterations."""
    settings = propagator_settings(scene)
    size = class_size(model, 1, interfaces_of(scene))
    if settings.kind == "explicit":
        return float(size.sparse + 4 * size.channels**2 + size.unknowns)
    if settings.kind == "reduced":
        return float(size.basis(settings.modes) ** 2 + 4 * size.channels**2 + size.unknowns)
    return 2.0 * size.factor + 2.0 * size.interface**2 + 4.0 * (size.swept or size.channels**2) + size.sparse


def operator_bytes(size: ClassSize, settings: PropagatorSettings) -> float:
    """Memory of the operators and states of a class, bytes."""
    factor = (4.0 if settings.precision == "float32" else 8.0) * size.factor
    interface, condensed = 8.0 * size.interface**2, 8.0 * size.channels**2
    if size.swept and settings.kind == "direct":
        # the dashpots are in a second factor, in single precision: dense matrices there are none
        interface, condensed = 0.5 * factor, 0.0
    modal = 8.0 * size.modal * (3 * size.unknowns + size.interface)
    size_by_kind = {
        "direct": factor + 2 * interface + modal,
        "explicit": 0.0,
        "reduced": 2 * factor + 8.0 * size.unknowns * size.basis(settings.modes),
        "cg": 2 * interface + modal,
    }[settings.kind]
    # per member: operators are shared, states are not
    states = 8.0 * _STATE_VECTORS * size.members * size.unknowns
    return size_by_kind + 4 * condensed + _SPARSE_BYTES * size.sparse + states


def fitting(classes: list[ModelClass], settings: PropagatorSettings, memory: float | None = None) -> PropagatorSettings:
    """The settings, or conjugate gradients where a direct march does not fit in the memory.

    Parameters
    ----------
    classes : of substructures. settings : as requested. memory : bytes; None: of this machine (0: not known).
    """
    # by the machine, not by what others take at present: a scene keeps its propagator, and so its numbers
    room = AVAILABLE * (memory_room(now=False)[0] if memory is None else memory)
    if settings.kind != "direct" or not room:
        return settings
    if sum(factor_bytes(c.members[0].expansion.shape[1]) for c in classes) < 0.3 * room:  # far from the limit
        return settings
    needed = sum(
        operator_bytes(class_size(c.members[0], len(c.members), settings.interfaces), settings) for c in classes
    )
    if needed > room:
        return replace(settings, kind="cg")
    return settings


def made_propagators(
    scene: Scene,
    classes: list[ModelClass],
    scheme: TimeScheme,
    dt: float,
    springs: Array,
    store: KeptOperators | None = None,
    statics: dict[bytes, list[tuple[float, Any]]] | None = None,
) -> tuple[list[Propagator], list[str]]:
    """Propagators of the classes, and remarks on the choice.

    Parameters
    ----------
    dt : time step, s. springs : without inertia, stiffness per area of the side of every channel (n_flat,), Pa m-1.
    store : operators of a scene solved before, used where they are equal and replaced by those made here.
    statics : operators of static problems by ``ModelClass.key``, used again and added to.

    Raises
    ------
    SceneError : the step is longer than the stable one.
    """
    settings, remarks = chosen_propagators(scene, classes)
    made_with = (scheme, dt, settings)

    def make(c: ModelClass, twin: Propagator | None) -> Propagator:
        if twin is None and store is not None:
            twin = store.twin(c.members[0], made_with)
        if not isinstance(scheme, QuasiStatic):
            one = PROPAGATORS[settings.kind](c.members, scheme, dt, settings, twin)
            # the work of the loads is needed to judge the errors (``indicator.work_of_error``)
            one.loads_only = not scene.output.energy and _loads_suffice(one, scheme, dt)
            return one
        stiffness = springs[c.channels[:, 0]]
        operators = None
        if isinstance(twin, StaticPropagator):
            operators = twin.shared(stiffness)
        if statics is not None:
            operators = statics.setdefault(c.key, [])
        members = in_form(c.members, interfaces_of(scene))
        return StaticPropagator(members, dt, scene.output.energy, stiffness, operators)

    # those with operators of their own, then those that take them from another
    alone = [i for i, c in enumerate(classes) if c.twin is None]
    first = dict(zip(alone, in_threads(scene.solver.threads, lambda i: make(classes[i], None), alone), strict=True))
    propagators: list[Propagator] = []
    for i, c in enumerate(classes):
        propagators.append(first[i] if c.twin is None else make(c, propagators[c.twin]))
    if store is not None:
        store.replace([c.members[0] for c in classes], propagators, made_with)
    if problems := unstable_steps(propagators, scene, dt):
        raise SceneError(problems, "the scene cannot be built")
    return propagators, remarks


def chosen_propagators(scene: Scene, classes: list[ModelClass]) -> tuple[PropagatorSettings, list[str]]:
    """Settings of the propagators, and warnings about an automatic choice."""
    requested = propagator_settings(scene)
    if scene.time.quasi_static or not isinstance(scene.solver.propagator, tables.AutomaticPropagator):
        return requested, []
    chosen = fitting(classes, requested)
    if chosen.kind == requested.kind:
        return requested, []
    return chosen, ["the factors do not fit in the memory of this machine: slower conjugate gradients are used"]


def by_modes(scene: Scene, restricted: bool) -> tuple[bool, list[str]]:
    """Whether an assembly is to be marched by its modes, and why it is not although the scene asks for it;
    ``restricted`` : as for ``modes_refused``."""
    if not isinstance(scene.solver.propagator, tables.ModalPropagatorTable):
        return False, []
    reasons = modes_refused(scene, restricted)
    return not reasons, reasons


def modes_refused(scene: Scene, restricted: bool) -> list[str]:
    """Why an assembly cannot be marched by its modes; ``restricted`` : whether the caller takes laws of its own,
    several processes, or looks at iterates."""
    reasons = {
        "without inertia there are no modes": scene.time.quasi_static,
        f"time.scheme {scene.time.scheme.type} is one of bodies": scene.time.scheme.type in _OF_BODIES,
        "modes do not represent the dashpots of an absorbing face": any(
            b.type == "absorbing" for b in scene.boundary.values()
        )
        or any(port.causality == "wave" for port in scene.port.values()),
        "windows of several instants are marched body by body": scene.solver.window != 1,
        "user-defined laws, observers and several processes need the march of single bodies": restricted,
    }
    return [reason for reason, holds in reasons.items() if holds]


def interfaces_of(scene: Scene) -> Interfaces:
    """How the interfaces of directly marched substructures are solved with; dense where none are."""
    requested = scene.solver.propagator.type
    direct = requested in ("direct", "modal") or (requested == "automatic" and scene.time.scheme.type != CENTRAL)
    if not (direct or scene.time.quasi_static):
        return DENSE
    one_solve = scene.solver.bonds == "direct" and all(i.behaviour == "perfect" for i in scene.joints.values())
    short = scene.solver.window == 1 and not one_solve
    return Interfaces(scene.solver.interface_operator, scene.time.time_step if short else None)


def propagator_settings(scene: Scene) -> PropagatorSettings:
    """Settings of the propagators that the scene requests, whether they fit into memory or not."""
    requested = scene.solver.propagator
    if isinstance(requested, tables.ReducedPropagatorTable):
        return PropagatorSettings("reduced", modes=requested.modes)
    if isinstance(requested, tables.ModalPropagatorTable):  # where the assembly is not marched by its modes
        return PropagatorSettings("direct", precision=scene.solver.precision, interfaces=interfaces_of(scene))
    automatic: Kind = "explicit"
    if scene.time.scheme.type != CENTRAL:
        automatic = "direct"
    if isinstance(requested, tables.AutomaticPropagator):
        kind: Kind = automatic
    else:
        kind = requested.type
    return PropagatorSettings(kind, precision=scene.solver.precision, interfaces=interfaces_of(scene))


def box_memory(scene: Scene) -> list[Problem]:
    """A problem where the meshes and matrices of boxes alone do not fit in the memory that the process may take."""
    room, limit = memory_room()
    boxes = {(b.box.size, b.box.elements): n for n, b in scene.substructure.items() if b.box is not None}
    cells = {name: math.prod(elements) for (_, elements), name in boxes.items()}
    needed = _CELL_BYTES * sum(cells.values())
    if not limit or needed <= room:
        return []
    name = max(cells, key=cells.__getitem__)
    # cells per body if all were alike
    largest = max(1, int((room / _CELL_BYTES / len(cells)) ** (1 / 3)))
    return [
        Problem(
            f"substructure.{name}.box.elements",
            f"the matrices of {cells[name]} elements need more than the available memory",
            f"at least {needed / 1e9:.3g} GB",
            f"{max(room, 0.0) / 1e9:.3g} GB ({limit})",
            f"use fewer elements, e.g. [{largest}, {largest}, {largest}]",
        )
    ]


def unstable_steps(propagators: list[Propagator], scene: Scene, dt: float) -> list[Problem]:
    """A problem where the step ``dt`` (s) is longer than the stable one of an explicit propagator."""
    explicit = [p for p in propagators if isinstance(p, ExplicitPropagator)]
    if all(p.stability.allows(dt) for p in explicit):
        return []
    shortest = min(explicit, key=lambda p: p.stability.longest)
    longest = shortest.stability.longest
    key = "time.step"
    if scene.time.step is None:
        key = "time.instants"
    return [
        Problem(
            key,
            f"the step is longer than the stable one of the explicit propagator (substructure {shortest.names[0]})",
            f"a step of {dt:.6g} s",
            f"at most {longest:.6g} s",
            f"give [time] instants = {int(np.ceil(scene.time.end / longest))} or more, "
            "or choose an implicit propagator",
        )
    ]
