"""Key `propagator` of [solver]: how the substructures are marched from instant to instant."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from .fields import Count, Table, about, tagged_or


class AutomaticPropagator(Table):
    """The one that suits the time scheme: explicit for central differences, else direct."""

    type: Literal["automatic"] = "automatic"


class DirectPropagator(Table):
    """Implicit, factorised once: one forward and one backward substitution per instant."""

    type: Literal["direct"] = "direct"


class ExplicitPropagator(Table):
    """Central differences with a lumped mass: no factor, contact costs next to nothing, the step must be stable
    (about the smallest element over the wave speed; the message says how long it may be). Its time scheme is
    "central_difference"; gaps are those half a step after the instants. Less accurate than the direct one on coarse
    meshes, where the lumped mass is felt."""

    type: Literal["explicit"] = "explicit"


class ReducedPropagator(Table):
    """A few vibration modes of each substructure and the exact static answers to interface tractions and loads: dense
    and small. The modes cost more than one linear run, so that they pay for repeated substructures, studies,
    long runs and FMUs. What the mesh resolves beyond the modes is lost: the run says how much is felt."""

    type: Literal["reduced"] = "reduced"
    modes: Annotated[Count, about("elastic modes of each substructure", "1", ge=0, le=10_000)] = 50


class CgPropagator(Table):
    """The direct march without a factor: conjugate gradients, for what does not fit in memory. Same answer; slower."""

    type: Literal["cg"] = "cg"


_Choice = AutomaticPropagator | DirectPropagator | ExplicitPropagator | ReducedPropagator | CgPropagator
Propagator = Annotated[
    Annotated[_Choice, Field(discriminator="type")],
    BeforeValidator(
        tagged_or("automatic"),
        json_schema_input_type=Literal["automatic", "direct", "explicit", "reduced", "cg"] | _Choice,
    ),
]
