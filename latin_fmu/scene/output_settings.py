"""Table [output]: what the results keep besides the interface histories."""

from __future__ import annotations

from typing import Annotated

from .fields import Count, Flag, Table, about


class Output(Table):
    """Interface histories and convergence are always kept; the rest costs memory and is asked for."""

    fields: Annotated[Flag, about("displacement and velocity history of the substructures")] = False
    stress: Annotated[Flag, about("mean stress of the elements of the substructures")] = False
    nodal_stress: Annotated[
        Flag, about("stress at the nodes, averaged over the elements around; keeps displacements, too")
    ] = False
    principal_stress: Annotated[Flag, about("principal values of the stresses that are kept")] = False
    strain: Annotated[Flag, about("mean strain of the elements; keeps displacements, too")] = False
    energy: Annotated[Flag, about("energy balance of the assembly")] = False
    every: Annotated[Count, about("fields and stress are kept every so many steps", "1", ge=1)] = 1

    @property
    def keeps_fields(self) -> bool:
        """Whether displacements and velocities are kept."""
        return self.fields or self.strain or self.nodal_stress

    @property
    def recovers(self) -> bool:
        """Whether more is found from what is kept when the results are written."""
        return self.strain or self.nodal_stress or self.principal_stress
