"""Table [solver]: the LATIN iteration, which does not change the converged result, and the propagators."""

from typing import Annotated, Literal

from pydantic import Field, PlainValidator

from ..errors import did_you_mean
from .fields import Count, Real, Table, about, by_type, refusal


class AutomaticPropagator(Table):
    """The one that suits the time scheme: explicit for central differences, else direct."""

    type: Literal["automatic"] = "automatic"


class DirectPropagator(Table):
    """Implicit, factorised once: one forward and one backward substitution per instant."""

    type: Literal["direct"] = "direct"


class ExplicitPropagator(Table):
    """Central differences with a lumped mass: no factorisation, cheap contact. The time step must be below the limit of
    stability (about the smallest element over the wave speed; an error states the limit). Its time scheme is
    "central_difference"; gaps are those half a step after the instants. Because of the lumped mass it is less accurate
    than the direct propagator on coarse meshes."""

    type: Literal["explicit"] = "explicit"


class ReducedPropagator(Table):
    """A few vibration modes of each substructure and its exact static response to interface tractions and loads: small
    dense matrices. The modes cost more than one linear run, so that this propagator suits repeated substructures,
    parameter studies, long runs and FMUs. The response above the modes is lost; a warning states how much that is."""

    type: Literal["reduced"] = "reduced"
    modes: Annotated[Count, about("elastic modes of each substructure", "1", ge=0, le=10_000)] = 50


class CgPropagator(Table):
    """As direct, by conjugate gradients instead of factors, for models whose factors exceed the memory. Slower."""

    type: Literal["cg"] = "cg"


_Propagator = AutomaticPropagator | DirectPropagator | ExplicitPropagator | ReducedPropagator | CgPropagator
Propagator = Annotated[Annotated[_Propagator, Field(discriminator="type")], by_type(_Propagator, "automatic")]


STATIC_TOLERANCE = 1e-5
"""Default tolerance without inertia."""
WHOLE: Literal["whole"] = "whole"
_FACTOR = "factor on k; it changes the number of iterations, not the converged result"


class Automatic(Table):
    """Own wave impedance where the step resolves the wave, the discrete admittance where it does not."""

    type: Literal["automatic"] = "automatic"
    factor: Annotated[Real, about(_FACTOR, "1", gt=0)] = 1.0


class Impedance(Table):
    """Wave impedance of each side's own material: rho c_p (normal), rho c_s (tangential)."""

    type: Literal["impedance"] = "impedance"
    factor: Annotated[Real, about(_FACTOR, "1", gt=0)] = 1.0


class Uniform(Table):
    """The same k on every interface."""

    type: Literal["uniform"] = "uniform"
    normal: Annotated[Real, about("k along the normal", "Pa s m-1", gt=0)]
    tangential: Annotated[Real, about("k along the tangents", "Pa s m-1", gt=0)]
    factor: Annotated[Real, about(_FACTOR, "1", gt=0)] = 1.0


class Diagonal(Table):
    """Inverse of the diagonal of the discrete admittance of one instant."""

    type: Literal["diagonal"] = "diagonal"
    factor: Annotated[Real, about(_FACTOR, "1", gt=0)] = 1.0


class Row(Table):
    """Discrete resistance of a face to a uniform velocity, spread by area."""

    type: Literal["row"] = "row"
    factor: Annotated[Real, about(_FACTOR, "1", gt=0)] = 1.0


class Anderson(Table):
    """Anderson acceleration on the incoming quantity F + k W."""

    type: Literal["anderson"] = "anderson"
    depth: Annotated[Count, about("number of former iterations combined", "1", ge=1, le=100)] = 6


class NoAcceleration(Table):
    """The plain iteration of the paper."""

    type: Literal["none"] = "none"


def _check_window(value: object) -> object:
    if value == WHOLE and isinstance(value, str):
        return value
    if isinstance(value, int) and not isinstance(value, bool) and value >= 1:
        return value
    remedy = did_you_mean(value, (WHOLE,)) if isinstance(value, str) else None
    raise refusal("not a window", value=value, allowed=f'a whole number >= 1, or "{WHOLE}"', remedy=remedy)


_Direction = Automatic | Impedance | Uniform | Diagonal | Row
SearchDirection = Annotated[Annotated[_Direction, Field(discriminator="type")], by_type(_Direction, "automatic")]
_Acceleration = Anderson | NoAcceleration
Acceleration = Annotated[Annotated[_Acceleration, Field(discriminator="type")], by_type(_Acceleration, "anderson")]
Window = Annotated[
    int | Literal["whole"],
    PlainValidator(_check_window, json_schema_input_type=Annotated[int, Field(ge=1)] | Literal["whole"]),
]


class Solver(Table):
    """Settings of the iteration; the defaults suit most scenes."""

    tolerance: Annotated[
        Real,
        about("on the amplitude of the error indicator, sqrt(eta); 1e-5 with quasi_static = true", "1", gt=0, lt=1),
    ] = 1e-3
    force_tolerance: Annotated[
        Real | None, about("on the interface force residual; 10 * tolerance where left out", "1", gt=0)
    ] = None
    max_iterations: Annotated[Count, about("of one window", "1", ge=1)] = 200
    search_direction: Annotated[SearchDirection, about("the parameter k of the method")] = Automatic()
    acceleration: Annotated[Acceleration, about("acceleration of the iteration")] = Anderson()
    relaxation: Annotated[Real, about("1 is none, 1/2 is the safe one", "1", gt=0, le=1)] = 1.0
    window: Annotated[
        Window, about('instants solved together: a whole number >= 1, or "whole" for the interval in one piece', "1")
    ] = 1
    skip_at_rest: Annotated[
        Literal["off", "exact", "round_off", "tolerance"],
        about(
            "substructures still at rest are not solved while the tractions on them are exactly zero (exact), or below "
            "1e-13 (round_off) or tolerance / 100 (tolerance) of the largest tractions that the loads can cause"
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
            "instants in which the iteration is slow (long steps with slip, statics) are ended by Newton steps on the "
            "interfaces; without effect with acceleration none and in longer windows"
        ),
    ] = True
    bonds: Annotated[
        Literal["direct", "iterate"],
        about("where all interfaces are perfect and window = 1: one linear solve per instant, or the iteration"),
    ] = "direct"
    start: Annotated[
        Literal["sequential", "zero"],
        about(
            "first guess of windows of several instants: one-step windows to a tenth of the tolerance, or zero fields"
        ),
    ] = "sequential"

    propagator: Annotated[Propagator, about("how substructures are integrated in time")] = AutomaticPropagator()
    precision: Annotated[
        Literal["float64", "float32"],
        about("of the factors of the direct propagator; float32 halves their memory and moves results by 1e-8 to 1e-6"),
    ] = "float64"
    interface_operator: Annotated[
        Literal["automatic", "dense", "exact"],
        about(
            "how direct propagators solve with the interfaces of a substructure: by dense matrices, which suits small "
            "interfaces; exactly, by substitution through the part of its factor next to them, which suits large ones; "
            "or by what costs less. The converged result is the same"
        ),
    ] = "automatic"
    share_identical: Annotated[
        bool, about("identical substructures share one factorisation and are solved together: faster, same results")
    ] = True

    threads: Annotated[
        int,
        Field(ge=1, le=256),
        about(
            "cores that solve substructures in parallel (windows of one instant); of use from some thousands of "
            "unknowns per substructure; results are the same to the last bit",
            "1",
        ),
    ] = 1
