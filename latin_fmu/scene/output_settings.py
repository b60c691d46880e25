"""Table [output]: what the results keep besides the interface histories."""

from __future__ import annotations

from typing import Annotated

from .fields import Count, Flag, Table, about


class Output(Table):
    """Interface histories and convergence are always kept; the rest costs memory and is asked for."""

    fields: Annotated[Flag, about("displacement and velocity history of the substructures")] = False
    stress: Annotated[Flag, about("stress history of the substructures")] = False
    energy: Annotated[Flag, about("energy balance of the assembly")] = False
    every: Annotated[Count, about("fields and stress are kept every so many steps", "1", ge=1)] = 1
