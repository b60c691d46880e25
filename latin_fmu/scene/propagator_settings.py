"""Key `propagator` of [solver]: how the substructures are marched from instant to instant."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from .fields import Table, tagged_or


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


Propagator = Annotated[
    Annotated[AutomaticPropagator | DirectPropagator | ExplicitPropagator, Field(discriminator="type")],
    BeforeValidator(
        tagged_or("automatic"),
        json_schema_input_type=Literal["automatic", "direct", "explicit"]
        | AutomaticPropagator
        | DirectPropagator
        | ExplicitPropagator,
    ),
]
