"""Table [sensor.NAME]: a point whose motion is told, e.g. to the neighbours in a co-simulation."""

from __future__ import annotations

from typing import Annotated

from .fields import Name, Table, Vector, about


class Sensor(Table):
    """Displacement and velocity of the node of a substructure nearest to a point."""

    substructure: Annotated[Name, about("name of a [substructure.NAME] table")]
    point: Annotated[Vector, about("where to measure, before any motion", "m")]
