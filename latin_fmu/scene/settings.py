"""Tables [time], [output], [accuracy] and [solver]: interval and scheme, what the results keep, accuracy, iteration.

The LATIN iteration does not change the converged result.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator

from ..errors import Problem, did_you_mean, shown
from .fields import Count, Flag, Real, SceneTable, Text, about, by_type, refusal
from .materials import DAMPING_KEYS
from .quantity_table import INTERFACE, QUANTITY_OWNERS
from .raw_scene import (
    CENTRAL,
    RawTable,
    chosen_type,
    exactly_one,
    given,
    moves,
    named_tables,
    number,
    single_table,
    unknown_name,
)

MAX_INSTANTS = 10_000_000
MAX_ITERATIONS = 100_000
"""Of one window; the numbers of every iteration are kept, 0.3 kB each."""
_REDUCIBLE = ("hht", "newmark")  # schemes that the reduced propagator can march
_SHORTEST, _LONGEST = 1e-60, 1e60  # s; squares of steps, and what they divide, are numbers
_STEP_ROUND_OFF = 1e-6


class AutomaticScheme(SceneTable):
    """generalized_alpha where bodies land (a gap, or sides that approach each other), all of them elastic and thick
    enough for a contact layer (at most a quarter of the elements); else hht. The gaps are those of the meshes; a
    warning says where a static start opens or closes faces so that the other choice suits."""

    type: Literal["automatic"] = "automatic"


class HHTTable(SceneTable):
    """Hilber-Hughes-Taylor: gamma = 1/2 - alpha, beta = (1 - alpha)^2 / 4; damps what the mesh does not resolve."""

    type: Literal["hht"] = "hht"
    # stable at any step within these bounds only
    alpha: Annotated[Real, about("0 is undamped, -1/3 damps most", "1", ge=-1 / 3, le=0)] = -0.1


class NewmarkTable(SceneTable):
    """Newmark's family; damped where gamma > 1/2, best with beta = (gamma + 1/2)^2 / 4."""

    type: Literal["newmark"] = "newmark"
    beta: Annotated[Real, about("weight of the new acceleration in the displacement", "1", gt=0, le=0.5)] = 0.25
    # below 1/2 vibrations would grow
    gamma: Annotated[Real, about("weight of the new acceleration in the velocity", "1", ge=0.5, le=1)] = 0.5


class GeneralizedAlphaTable(SceneTable):
    """For bodies that land and fronts through closed joints: massless contact nodes, and a viscous layer of elements at
    faces that may open; stable at any step."""

    type: Literal["generalized_alpha"] = "generalized_alpha"
    rho_inf: Annotated[
        Real, about("1 is undamped, 0.5 damps most what the step does not resolve", "1", ge=0.5, le=1)
    ] = 0.8
    landing_damping: Annotated[
        Real,
        about(
            "impact damping: viscosity of the element layer at impacting faces, per height over wave speed, a fifth of "
            "it at initially closed faces: 0.6 for a smooth contact force (dissipates about h/L of the energy per "
            "impact), 0 to preserve energy and for long runs",
            "1",
            ge=0,
            le=2,
        ),
    ] = 0.6


class MasslessContactTable(SceneTable):
    """Undamped, with massless contact nodes: keeps the energy of bouncing bodies; Courant number at most 0.8."""

    type: Literal["massless_contact"] = "massless_contact"


class CentralDifferenceTable(SceneTable):
    """Explicit, with a lumped mass: the scheme of the explicit propagator; only small steps are stable."""

    type: Literal["central_difference"] = "central_difference"


def _of_its_keys(value: object) -> object:
    """A table without a type that has keys of generalized_alpha is one."""
    if isinstance(value, Mapping) and "type" not in value and set(value) & {"rho_inf", "landing_damping"}:
        return {"type": "generalized_alpha", **value}
    return value


_Scheme = (
    AutomaticScheme | HHTTable | NewmarkTable | GeneralizedAlphaTable | MasslessContactTable | CentralDifferenceTable
)
Scheme = Annotated[
    Annotated[_Scheme, Field(discriminator="type")], BeforeValidator(_of_its_keys), by_type(_Scheme, "hht")
]


class GivenStart(SceneTable):
    """The initial displacements and velocities of the substructures, with no stress but that of preloads."""

    type: Literal["given"] = "given"


class StaticStart(SceneTable):
    """The static equilibrium under all that acts at t = 0: loads at their value there, body forces, preloads,
    prescribed displacements. Displacements, stresses, interface tractions, gaps and the state of friction are taken
    over, so that constant loads cause no motion. Motions of faces and ground begin at t = 0; substructures with an
    initial velocity take no part and start as given; initial displacements of the others are added to the
    equilibrium. Bodies that nothing holds before a gap closes start in their place, and fall from there."""

    type: Literal["static"] = "static"
    increments: Annotated[
        Count, about("steps in which the loads are raised (friction depends on the load path)", "1", ge=1, le=10_000)
    ] = 5


_Start = GivenStart | StaticStart
Start = Annotated[Annotated[_Start, Field(discriminator="type")], by_type(_Start, "static")]


class Time(SceneTable):
    """The interval [0, end], cut into equal steps. It has exactly one of `step` and `instants`."""

    end: Annotated[Real, about("last instant", "s", gt=0)]
    step: Annotated[
        Real | None, about("time step; `end` must be an integer multiple of it (to 1e-6 step)", "s", gt=0)
    ] = None
    instants: Annotated[Count | None, about("number of steps", "1", ge=1, le=MAX_INSTANTS)] = None
    scheme: Annotated[Scheme, about("time scheme; that of the explicit propagator where it is chosen")] = (
        AutomaticScheme()
    )

    start: Annotated[Start, about("initial state: as given, or a static equilibrium")] = GivenStart()

    quasi_static: Annotated[
        Flag,
        about(
            "no inertia: every step is an equilibrium under the loads at its end. For loads that change slowly "
            "compared with the waves; time only orders the increments of load"
        ),
    ] = False

    @property
    def n_step(self) -> int:
        """Number of steps; there are ``n_step + 1`` instants, t = 0 included."""
        if self.instants is not None:
            return self.instants
        assert self.step is not None  # the scene refuses a [time] without either
        return round(self.end / self.step)

    @property
    def time_step(self) -> float:
        """Length of one step, s: ``end / n_step``, so that the last instant is `end` exactly."""
        return self.end / self.n_step


class Output(SceneTable):
    """Interface histories and convergence are always kept; the rest costs memory and is kept on request."""

    fields: Annotated[Flag, about("displacement and velocity history of the substructures")] = False
    stress: Annotated[Flag, about("mean stress of the elements of the substructures")] = False
    nodal_stress: Annotated[
        Flag, about("stress at the nodes, averaged over the elements around; keeps displacements, too")
    ] = False
    principal_stress: Annotated[Flag, about("principal values of the stresses that are kept")] = False
    strain: Annotated[Flag, about("mean strain of the elements; keeps displacements, too")] = False
    surfaces: Annotated[
        Flag, about("pressure, slip and friction energy at the points of interfaces, for maps on their surfaces")
    ] = False
    reactions: Annotated[
        Flag,
        about(
            "resultant force of every boundary that fixes or drives a face of an elastic substructure; nodes with "
            "several boundaries, as on an edge of two faces, contribute to them in equal parts"
        ),
    ] = False
    energy: Annotated[Flag, about("energy balance of the assembly")] = False
    every: Annotated[Count, about("output interval of fields and stress in steps", "1", ge=1)] = 1
    interfaces_every: Annotated[
        Count,
        about(
            "output interval of the histories of the interfaces in steps; forces, contact times and estimates follow "
            "from the stored instants",
            "1",
            ge=1,
        ),
    ] = 1
    sensitivities: Annotated[
        tuple[Text, ...],
        about(
            "parameters by which results are differentiated: dotted names of numbers of the scene, as in `--set`, e.g. "
            '`["interface.joint.friction_coefficient", "bolt.b1.force"]`'
        ),
    ] = ()
    check_sensitivities: Annotated[
        Literal["all", "flagged", "none"],
        about(
            "parameters for which the scene is run again with a value 5 % larger: all, those with a flagged quantity, "
            "or none; flagged changes, and changes contradicted by that run, are taken from it"
        ),
    ] = "all"
    acceleration: Annotated[
        Literal["scene", "g"],
        about(
            "unit in which summary, figures, tables and spectra show accelerations: that of the scene, or g, "
            "9.80665 m/s2; results are stored in the units of the scene"
        ),
    ] = "scene"
    peak_duration: Annotated[
        Real | None,
        about(
            "averaging time of peak_force, the largest mean of the normal force; default: a tenth of the longest "
            "contact of the interface",
            "s",
            gt=0,
        ),
    ] = None

    @property
    def keeps_fields(self) -> bool:
        """Whether displacements and velocities are kept."""
        return self.fields or self.strain or self.nodal_stress

    @property
    def recovers(self) -> bool:
        """Whether stresses or strains are recovered from the kept fields when the results are written."""
        return self.strain or self.nodal_stress or self.principal_stress


class Fmu(SceneTable):
    """Who made an FMU of the scene, its terms of use, and what a host may change; what is left out is absent from the
    FMU. `generationTool` names this package; the licences of the software inside are in `documentation/licenses` of the
    FMU."""

    author: Annotated[Text, about("author of the model, a person or an organisation")] = ""
    version: Annotated[Text, about("version of the model")] = ""
    copyright: Annotated[Text, about("copyright of the model")] = ""
    licence: Annotated[Text, about("licence of the model, attribute `license` of the FMI")] = ""
    description: Annotated[Text, about("description of the model; default: that of the scene")] = ""
    parameters: Annotated[
        tuple[Text, ...],
        about(
            "numbers of the scene that a host sets before a simulation, by their dotted names as in `--set`, e.g. "
            '`["contact.joints.friction_coefficient", "bolt.b1.force"]`; the FMU then needs Python at initialization'
        ),
    ] = ()


def _check_quantity(quantity: str) -> str:
    owner, _, key = quantity.rpartition(".")
    if key not in QUANTITY_OWNERS or "." in owner:
        raise refusal(
            "unknown quantity",
            value=quantity,
            allowed=f"one of {', '.join(QUANTITY_OWNERS)}, after the name of one owner or not",
            remedy=did_you_mean(key, QUANTITY_OWNERS),
        )
    return quantity


Quantity = Annotated[Text, AfterValidator(_check_quantity)]


class Accuracy(SceneTable):
    """Whether `latin-fmu run` estimates its error, and the error that `--accuracy` has to reach."""

    estimate: Annotated[Flag, about("coarser runs give the estimated error of each quantity (`latin-fmu run`)")] = True
    quantity: Annotated[
        Quantity,
        about(
            'quantity that has to reach the target: "impulse" (of every interface that may open), "crush.impulse", '
            '"head.acceleration_peak" (of the sensor head), ...'
        ),
    ] = "impulse"
    target: Annotated[
        Real | None, about("target relative error; mesh, time step and tolerance are then chosen", "1", gt=0, lt=1)
    ] = None


class Effects(SceneTable):
    """Effects of second order that a run has where they count."""

    prestress: Annotated[
        Literal["automatic", "on", "off"],
        about(
            "geometric stiffness of the stress at t = 0 (loads, bolts, heat): parts in tension are stiffer, compressed "
            "ones softer, and slender ones buckle; automatic: of a static start, if it changes a natural frequency of "
            "the clamped assembly by more than 1 %, or if a run without it shows that parts rock on their contacts"
        ),
    ] = "automatic"


class AutomaticPropagator(SceneTable):
    """The one that suits the scene: explicit for central differences, modal where it costs far less and its error is
    below `reduction_error`, else direct."""

    type: Literal["automatic"] = "automatic"


class DirectPropagatorTable(SceneTable):
    """Implicit, factorised once: one forward and one backward substitution per instant."""

    type: Literal["direct"] = "direct"


class ExplicitPropagatorTable(SceneTable):
    """Central differences with a lumped mass: no factorisation, cheap contact. The time step must be below the limit of
    stability (about the smallest element over the wave speed; an error states the limit). Its time scheme is
    "central_difference"; gaps are those half a step after the instants. Because of the lumped mass it is less accurate
    than the direct propagator on coarse meshes."""

    type: Literal["explicit"] = "explicit"


class ReducedPropagatorTable(SceneTable):
    """A few vibration modes of each substructure and its exact static response to interface tractions and loads: small
    dense matrices. The modes cost more than one linear run, so that this propagator suits repeated substructures,
    parameter studies, long runs and FMUs. The response above the modes is lost; a warning states how much that is."""

    type: Literal["reduced"] = "reduced"
    modes: Annotated[Count, about("elastic modes of each substructure", "1", ge=0, le=10_000)] = 50


class ModalPropagatorTable(SceneTable):
    """Vibration modes of the whole assembly, tied at its joints, and the static relative motions of its contacts: what
    an instant costs depends on the contacts, not on the mesh. For bolted assemblies in steps longer than waves take
    through an element. What modes above `highest` and waves inside a body do is lost; taken by `automatic`, how much
    that is is estimated. A scene that asks for more than this march has is marched body by body, and a remark says
    why; in sessions and FMUs it is refused."""

    type: Literal["modal"] = "modal"
    highest: Annotated[
        Real | None,
        about(
            "frequency up to which modes are taken; without it a fifth of the inverse of the step; modes above 0.38 "
            "times that inverse are never taken",
            "Hz",
            gt=0,
        ),
    ] = None


class CgPropagatorTable(SceneTable):
    """As direct, by conjugate gradients instead of factors, for models whose factors exceed the memory. Slower."""

    type: Literal["cg"] = "cg"


_Propagator = (
    AutomaticPropagator
    | DirectPropagatorTable
    | ExplicitPropagatorTable
    | ReducedPropagatorTable
    | ModalPropagatorTable
    | CgPropagatorTable
)
Propagator = Annotated[Annotated[_Propagator, Field(discriminator="type")], by_type(_Propagator, "automatic")]


STATIC_TOLERANCE = 1e-5
"""Default tolerance without inertia."""
WHOLE: Literal["whole"] = "whole"
_FACTOR = "factor on k; it changes the number of iterations, not the converged result"


class _Scaled(SceneTable):
    type: str
    factor: Annotated[Real, about(_FACTOR, "1", gt=0)] = 1.0


class Automatic(_Scaled):
    """Own wave impedance where the step resolves the wave, the discrete admittance where it does not."""

    type: Literal["automatic"] = "automatic"


class Impedance(_Scaled):
    """Wave impedance of each side's own material: rho c_p (normal), rho c_s (tangential)."""

    type: Literal["impedance"] = "impedance"


class Uniform(SceneTable):
    """The same k on every interface."""

    type: Literal["uniform"] = "uniform"
    normal: Annotated[Real, about("k along the normal", "Pa s m-1", gt=0)]
    tangential: Annotated[Real, about("k along the tangents", "Pa s m-1", gt=0)]
    factor: Annotated[Real, about(_FACTOR, "1", gt=0)] = 1.0


class Diagonal(_Scaled):
    """Inverse of the diagonal of the discrete admittance of one instant."""

    type: Literal["diagonal"] = "diagonal"


class RowTable(_Scaled):
    """Discrete resistance of a face to a uniform velocity, spread by area."""

    type: Literal["row"] = "row"


class AndersonTable(SceneTable):
    """Anderson acceleration on the incoming quantity F + k W."""

    type: Literal["anderson"] = "anderson"
    depth: Annotated[Count, about("number of former iterations combined", "1", ge=1, le=100)] = 6


class NoAcceleration(SceneTable):
    """The plain iteration of the paper."""

    type: Literal["none"] = "none"


def _check_window(value: object) -> object:
    if value == WHOLE and isinstance(value, str):
        return value
    if isinstance(value, int) and not isinstance(value, bool) and value >= 1:
        return value
    remedy = did_you_mean(value, (WHOLE,))
    raise refusal("not a window", value=value, allowed=f'an integer >= 1, or "{WHOLE}"', remedy=remedy)


class OperatorFolder(SceneTable):
    """Folder in which factors and dense matrices of interfaces are kept: a run of the same bodies, steps and search
    directions reads them, whatever its loads, friction, gaps and bolt forces are. Results are the same to the last
    bit. It may be shared by runs at the same time; an entry that is damaged, or of another version, is made anew."""

    folder: Annotated[
        Text,
        about("relative to the scene file, and below its folder unless --set names it; made where it does not exist"),
    ]
    limit: Annotated[Real, about("size of all entries; the ones used longest ago are removed", "GB", gt=0)] = 10.0


_Direction = Automatic | Impedance | Uniform | Diagonal | RowTable
SearchDirection = Annotated[Annotated[_Direction, Field(discriminator="type")], by_type(_Direction, "automatic")]
_Acceleration = AndersonTable | NoAcceleration
Acceleration = Annotated[Annotated[_Acceleration, Field(discriminator="type")], by_type(_Acceleration, "anderson")]
Window = Annotated[
    int | Literal["whole"],
    PlainValidator(_check_window, json_schema_input_type=Annotated[int, Field(ge=1)] | Literal["whole"]),
]


class Solver(SceneTable):
    """Settings of the iteration; the defaults suit most scenes."""

    tolerance: Annotated[
        Real,
        about("on the amplitude of the error indicator, sqrt(eta); 1e-5 with quasi_static = true", "1", gt=0, lt=1),
    ] = 1e-3
    force_tolerance: Annotated[
        Real | None, about("on the interface force residual; default: 10 * tolerance", "1", gt=0)
    ] = None
    max_iterations: Annotated[Count, about("of one window", "1", ge=1, le=MAX_ITERATIONS)] = 200
    search_direction: Annotated[SearchDirection, about("the parameter k of the method")] = Automatic()
    acceleration: Annotated[Acceleration, about("acceleration of the iteration")] = AndersonTable()
    relaxation: Annotated[Real, about("1: none; 1/2: the most robust", "1", gt=0, le=1)] = 1.0
    window: Annotated[
        Window, about('instants solved together: an integer >= 1, or "whole" for the whole interval', "1")
    ] = 1
    skip_at_rest: Annotated[
        Literal["off", "exact", "round_off", "tolerance"],
        about(
            "substructures at rest are not solved as long as the tractions on them are exactly zero (exact), or below "
            "1e-13 (round_off) or tolerance / 100 (tolerance) of the largest tractions that the loads can cause; "
            "unless off, a run also omits substructures that are never touched"
        ),
    ] = "round_off"
    skip_unchanged: Annotated[
        bool,
        about(
            "in an iteration, the previous solve of a substructure is reused where its interface load has changed by "
            "less than tolerance / 100"
        ),
    ] = True
    newton: Annotated[
        bool,
        about(
            "Newton steps on the interfaces complete instants with slow convergence (long steps with slip, statics); "
            "no effect with acceleration none and in longer windows"
        ),
    ] = True
    bonds: Annotated[
        Literal["direct", "iterate"],
        about(
            "perfect interfaces: if possible and predicted to be cheaper, the direct march (time integration) treats "
            "the bonded bodies as one substructure, without iteration; otherwise they are iterated like other "
            "interfaces"
        ),
    ] = "direct"
    start: Annotated[
        Literal["sequential", "zero"],
        about(
            "first guess of windows of several instants: one-step windows to a tenth of the tolerance, or zero fields"
        ),
    ] = "sequential"

    propagator: Annotated[Propagator, about("how substructures are integrated in time")] = AutomaticPropagator()
    reduction_error: Annotated[
        Real,
        about(
            "largest error of any quantity with which `automatic` integrates an assembly by its modes", "1", gt=0, lt=1
        ),
    ] = 0.02
    precision: Annotated[
        Literal["float64", "float32"],
        about(
            "precision of the factors of the direct propagator; float32 halves their memory and changes results by "
            "1e-8 to 1e-5; forces and momentum then balance to 1e-6"
        ),
    ] = "float64"
    interface_operator: Annotated[
        Literal["automatic", "dense", "exact", "sparse"],
        about(
            "how direct propagators compute the interface response of a substructure: dense: by dense matrices, for "
            "small interfaces; exact: by substitution through the adjacent part of its factor, for large interfaces; "
            "sparse: by sparse tables, truncated at a tenth of the tolerance and corrected by the exact motion at the "
            "end of every instant, if steps are short (otherwise exact); automatic: the cheapest of these. The "
            "converged result is the same within the tolerance"
        ),
    ] = "automatic"
    share_identical: Annotated[
        bool, about("identical substructures share one factorisation and are solved together: faster, same results")
    ] = True

    operators: Annotated[OperatorFolder | None, about("folder that stores factors for later runs; default: none")] = (
        None
    )
    threads: Annotated[
        int,
        Field(ge=1, le=256),
        about(
            "threads of set-up, static start and march, one per core: they share the substructures, the points of the "
            "interfaces and the blocks of large factors; useful from some thousands of unknowns; results are "
            "bit-identical",
            "1",
        ),
    ] = 1


# -- checks of these tables with each other and with others ---
def settings_problems(raw: Any) -> Iterator[Problem]:
    """Problems of [time], [solver], [accuracy] and [output] of a scene as written, with other tables."""
    yield from _time_problems(single_table(raw, "time"))
    yield from _propagator_problems(raw)
    yield from _accuracy_problems(raw)
    yield from _static_problems(raw)
    yield from _output_problems(single_table(raw, "output"), raw.get("units"))


def _output_problems(output: RawTable, units: object) -> Iterator[Problem]:
    if output.get("acceleration") == "g" and units == "none":
        what = "the numbers of the scene have no units, so that accelerations cannot be shown in g"
        yield Problem("output.acceleration", what, "g", '"scene"', "omit it")
    every = number(output, "interfaces_every")
    if output.get("energy") is True and every is not None and every > 1:
        yield Problem(
            "output.interfaces_every",
            "the energies of the interfaces need every instant (output.energy = true)",
            f"{every:g}",
            "1",
            "omit one of the two",
        )


def _accuracy_problems(raw: Any) -> Iterator[Problem]:
    """The owner of the quantity aimed at must exist."""
    quantity = single_table(raw, "accuracy").get("quantity")
    name = ""
    if isinstance(quantity, str):
        name = quantity
    owner, _, key = name.rpartition(".")
    kind = QUANTITY_OWNERS.get(key, INTERFACE)
    owners = named_tables(raw, kind)
    if kind == INTERFACE and named_tables(raw, "contact"):
        return  # interfaces are found on the meshes
    if owner and owner not in owners:
        yield unknown_name("accuracy.quantity", kind, owner, owners)


def _time_problems(time: RawTable) -> Iterator[Problem]:
    if not time:
        return
    yield from exactly_one(time, "time", "step", "instants")
    end = number(time, "end")
    step = number(time, "step")
    instants = number(time, "instants")
    if end is not None and instants is not None and end > 0.0 and instants > 0.0:
        yield from _length_problems("time.end", end, end / instants)
    if given(time, "instants") or end is None or step is None or end <= 0.0 or step <= 0.0:
        return
    ratio = end / step
    if not ratio <= MAX_INSTANTS:  # NaN, too
        yield Problem("time.step", f"more than {MAX_INSTANTS} steps", shown(step), None, "a longer step")
        return
    yield from _length_problems("time.step", step, step)
    n_step = max(1, round(ratio))
    if abs(ratio - n_step) > _STEP_ROUND_OFF:
        yield Problem(
            "time.end",
            f"not an integer number of steps ({ratio:.9g})",
            shown(end),
            f"a multiple of step = {step:.12g}",
            f"nearest: end = {n_step * step:.12g}, or instants = {n_step} instead of step",
        )


def _length_problems(where: str, value: float, step: float) -> Iterator[Problem]:
    if not _SHORTEST <= step <= _LONGEST:
        allowed = f"steps of {_SHORTEST:g} to {_LONGEST:g} s"
        yield Problem(where, "step length out of range", shown(value), allowed)


def with_defaults(raw: Any) -> Any:
    """The scene with the defaults that depend on other keys: without inertia a tighter tolerance, because set-up takes
    most of the time there; with the explicit propagator its time scheme; with bolts, and in motion with temperatures
    unless an initial state is read, a static start."""
    heated = named_tables(raw, "temperature") and not given(raw, "initial_state")  # which brings its own start
    # without inertia loads and temperatures come in its increments
    strained = named_tables(raw, "bolt") or (heated and not _is_static(raw))
    if strained and (time := single_table(raw, "time")) and not given(time, "start"):
        raw = {**raw, "time": {**time, "start": {"type": "static"}}}
    time, solver = single_table(raw, "time"), single_table(raw, "solver")
    if _is_static(raw) and not given(solver, "tolerance"):
        return {**raw, "solver": {**solver, "tolerance": STATIC_TOLERANCE}}
    chosen = given(time, "scheme") and chosen_type(time, "scheme") != "automatic"
    if chosen_type(single_table(raw, "solver"), "propagator") != "explicit" or not time or chosen:
        return raw
    return {**raw, "time": {**time, "scheme": CENTRAL}}


def _is_static(raw: Any) -> bool:
    """Whether a readable scene is without inertia."""
    readable = isinstance(raw, Mapping) and isinstance(raw.get("solver", {}), Mapping)
    return readable and single_table(raw, "time").get("quasi_static") is True


def _propagator_problems(raw: Any) -> Iterator[Problem]:
    """Propagators and time schemes that exclude each other."""
    kind = chosen_type(single_table(raw, "solver"), "propagator")
    scheme = chosen_type(single_table(raw, "time"), "scheme")
    if kind == "explicit" and scheme not in (None, "automatic", CENTRAL):
        yield Problem(
            "solver.propagator",
            "the explicit propagator has its own time scheme",
            shown(scheme),
            f'time.scheme = "{CENTRAL}", or none',
            "omit time.scheme, or choose another propagator",
        )
    if kind == "reduced" and scheme not in (None, "automatic", CENTRAL, *_REDUCIBLE):
        yield Problem(
            "solver.propagator",
            "the reduced propagator needs a scheme in which every node has mass",
            shown(scheme),
            " or ".join(f'time.scheme = "{name}"' for name in _REDUCIBLE),
            "choose another time scheme or propagator",
        )
    precision = single_table(raw, "solver").get("precision")
    if precision == "float32" and (scheme == CENTRAL or kind in ("explicit", "reduced", "cg")):
        yield Problem(
            "solver.precision",
            "only the direct propagator has factors with a precision",
            shown(precision),
            'solver.propagator = "direct" or "automatic"',
            "omit solver.precision",
        )
    form, window = (single_table(raw, "solver").get(name) for name in ("interface_operator", "window"))
    if form == "sparse" and (window not in (None, 1) or _is_static(raw)):
        what = "a force reaches the points around it only within an instant, and not without inertia"
        remedy = 'use solver.interface_operator = "exact" or "automatic"'
        yield Problem("solver.interface_operator", what, shown(form), "solver.window = 1, with inertia", remedy)
    if form in ("exact", "sparse") and (scheme == CENTRAL or kind in ("explicit", "reduced", "cg")):
        yield Problem(
            "solver.interface_operator",
            "substitution through factors requires the direct propagator",
            shown(form),
            'solver.propagator = "direct" or "automatic"',
            "omit solver.interface_operator",
        )
    if scheme == CENTRAL and kind not in (None, "automatic", "explicit"):
        yield Problem(
            "time.scheme",
            "central differences need the explicit propagator",
            shown(kind),
            'solver.propagator = "explicit" or "automatic"',
            "choose another time scheme, or that propagator",
        )


def _static_problems(raw: Any) -> Iterator[Problem]:
    """All contradictions of a scene as written with ``time.quasi_static``."""
    time = single_table(raw, "time")
    if time.get("quasi_static") is not True:
        return
    scheme = time.get("scheme")
    if scheme is not None and chosen_type(time, "scheme") != "automatic":  # but for the default
        yield _refused("time.scheme", "a time scheme integrates inertia", scheme, "omit the scheme")
    start = time.get("start")
    start_type = start
    if isinstance(start, dict):
        start_type = start.get("type", "static")
    if start_type == "static" and not named_tables(raw, "bolt"):  # bolts are tightened before the first increment
        yield _refused("time.start", "every step is an equilibrium already", start, "omit the start")
    motion = single_table(raw, "motion")
    if moves(motion.get("velocity")):
        yield _refused("motion.velocity", "a velocity needs inertia", motion["velocity"], "remove it")
    for name, table in named_tables(raw, "substructure").items():
        for key in ("initial_velocity", "initial_spin"):
            if moves(table.get(key)):
                yield _refused(f"substructure.{name}.{key}", "a velocity needs inertia", table[key], "remove it")
    for name, table in named_tables(raw, "boundary").items():
        if table.get("type") == "absorbing":
            yield _refused(
                f"boundary.{name}",
                "an absorbing boundary acts on velocities only",
                "absorbing",
                "remove it, or fix the face",
            )
        elif table.get("type") == "acceleration":
            what = "an acceleration needs inertia"
            yield _refused(
                f"boundary.{name}", what, "acceleration", "load the bodies by [gravity], or displace the face"
            )
    for name, table in named_tables(raw, "material").items():
        for key in DAMPING_KEYS:
            if table.get(key):
                yield _refused(f"material.{name}.{key}", "damping acts on rates", table[key], "remove it")
    for kind in ("spring", "interface"):
        for name, table in named_tables(raw, kind).items():
            if given(table, "damping_ratios"):
                value = table["damping_ratios"]
                yield _refused(f"{kind}.{name}.damping_ratios", "damping acts on rates", value, "remove it")
    if given(raw, "damping"):
        yield _refused("damping", "damping acts on rates", raw["damping"], "remove it")
    yield from _solver_problems(single_table(raw, "solver"))


def _solver_problems(solver: RawTable) -> Iterator[Problem]:
    if given(solver, "window") and solver["window"] != 1:
        yield _refused("solver.window", "load increments are solved one by one", solver["window"], "omit the window")
    kind = chosen_type(solver, "propagator")
    if kind not in (None, "automatic", "direct"):
        yield _refused(
            "solver.propagator", "static steps are solved by the direct propagator", kind, "omit the propagator"
        )


def _refused(where: str, what: str, value: object, remedy: str) -> Problem:
    return Problem(
        where, f"{what}: not with quasi_static = true", shown(value), None, f"{remedy}, or omit quasi_static"
    )
