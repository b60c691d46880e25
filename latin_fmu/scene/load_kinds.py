"""Kinds of loads on faces: each says its keys, nodal forces, size, arrow and words itself.

`Load` has the keys of all kinds and acts as the one whose keys are given; nothing else branches on kinds. Nodal forces
of tractions t are f_a = int psi_a t dA, with the areas int psi_a dA and int psi_a n dA of the face.
"""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import Problem
from .fields import Face, Real, SceneTable, Vector, about
from .raw_scene import RawTable, given

Array = NDArray[np.float64]
GlobalVector = tuple[float, float, float]


class LoadedFace(Protocol):
    """The face of a load."""

    @property
    def points(self) -> Array:
        """Nodes (n, 3), m."""

    @property
    def areas(self) -> Array:
        """int psi_a dA (n,), m2."""

    @property
    def vector_areas(self) -> Array:
        """int psi_a n dA (n, 3), m2, n outwards."""

    @property
    def area(self) -> float:
        """Sum of the areas, m2."""

    @property
    def node_area(self) -> float:
        """Area around the nodes, m2, > 0 for edges and points, too."""

    @property
    def centre(self) -> Array:
        """Mean place by area (3,), m."""

    def couple(self, moment: Sequence[float]) -> Array:
        """Nodal forces (n, 3), N, without resultant that have this moment (3,), N m, and grow from the centre."""


@dataclass(frozen=True)
class LoadEstimate:
    """What a load does to its body.

    Attributes
    ----------
    body : name. stress : largest traction, in words. strain : the same over Young's modulus. small : whether that is
        less than any load has. mean : of the law over the run. si : whether the scene is in SI.
    """

    body: str
    stress: str
    strain: float
    small: bool
    mean: float
    si: bool


class LoadKind(SceneTable):
    """A kind of load on a face. A class of it has its keys as fields, all optional; its docstring is what the reference
    of the scene file says.

    Attributes
    ----------
    chosen_by : keys that choose this kind, the first one where several are given; the law multiplies it.
    """

    chosen_by: ClassVar[tuple[str, ...]] = ()

    face: Annotated[Face, about('the loaded face, "substructure.face"')]

    @classmethod
    def chosen_key(cls, table: RawTable) -> str | None:
        """Key by which a load as written is of this kind; None where it is not."""
        return next((key for key in cls.chosen_by if given(table, key)), None)

    @classmethod
    def key_problems(cls, _table: RawTable, _where: str, _others: Sequence[str], /) -> Iterator[Problem]:
        """Keys of a load as written, at this place, that do not go together; the last argument: keys given that choose
        other kinds."""
        yield from ()

    @abstractmethod
    def to_global(self, vector: GlobalVector) -> GlobalVector:
        """Global components of a vector given along the axes of the load."""

    @abstractmethod
    def nodal_forces(self, face: LoadedFace, /) -> Array:
        """Forces (n, 3) on the nodes of the face along the global axes where the law is 1, N."""

    @abstractmethod
    def largest_traction(self, face: LoadedFace, /) -> float:
        """Size of the largest traction where the law is 1, Pa."""

    @abstractmethod
    def arrow(self, normal: Array, /) -> Array:
        """Direction (3,) of the arrow of a picture, of any length; ``normal`` : mean one of the face, outwards."""

    def turns(self) -> bool:
        """Whether its tractions turn the face beside what their resultant does."""
        return False

    def doubts(self, _estimate: LoadEstimate, /) -> Iterator[str]:
        """What speaks against its numbers, in words."""
        yield from ()

    def mean_traction(self, face: LoadedFace) -> Array:
        """Resultant over the area (3,) where the law is 1, Pa: parts on opposite facets cancel."""
        mean: Array = self.nodal_forces(face).sum(axis=0) / face.area
        return mean


class PressureLoad(LoadKind):
    """A `pressure` is positive in compression: its traction is -p n, n the outward normal."""

    chosen_by: ClassVar[tuple[str, ...]] = ("pressure",)

    pressure: Annotated[Real | None, about("pressure, positive in compression", "Pa")] = None

    @classmethod
    def key_problems(cls, table: RawTable, where: str, _others: Sequence[str], /) -> Iterator[Problem]:
        """A pressure has no axes."""
        if given(table, "pressure") and given(table, "axes"):
            what = "a pressure acts along the normal"
            yield Problem(f"{where}.axes", what, None, "with 'traction' or 'force'", "omit the axes")

    def nodal_forces(self, face: LoadedFace, /) -> Array:
        """Against the outward normals."""
        return -(self.pressure or 0.0) * face.vector_areas

    def largest_traction(self, _face: LoadedFace, /) -> float:
        """The size of the pressure."""
        return abs(self.pressure or 0.0)

    def arrow(self, normal: Array, /) -> Array:
        """Against the normal; a pressure of 0 is drawn as if positive."""
        direction: Array = -np.sign(self.pressure or 1.0) * normal
        return direction

    def doubts(self, estimate: LoadEstimate, /) -> Iterator[str]:
        """One in another unit, or one that pulls."""
        if not self.pressure:
            return
        if estimate.small:
            text = f"a pressure of {estimate.stress} strains {estimate.body} by {estimate.strain:.1g} only"
            remedy = "if it is in MPa, write it in Pa"
            if not estimate.si:
                remedy = "check its unit"
            yield f"{text}: {remedy}"
        if self.pressure * estimate.mean < 0.0:
            text = "its pressure is negative: it pulls at the face (suction)"
            yield f"{text}; change the sign if compression is intended"


class TractionLoad(LoadKind):
    """A `traction` is the same on the whole face."""

    chosen_by: ClassVar[tuple[str, ...]] = ("traction",)

    traction: Annotated[Vector | None, about("traction along x, y, z", "Pa")] = None

    def nodal_forces(self, face: LoadedFace, /) -> Array:
        """Traction times area."""
        forces: Array = face.areas[:, None] * self._along()
        return forces

    def largest_traction(self, _face: LoadedFace, /) -> float:
        """The length of the traction."""
        return float(np.linalg.norm(self._along()))

    def arrow(self, _normal: Array, /) -> Array:
        """Along the traction."""
        return self._along()

    def _along(self) -> Array:
        """The traction along the global axes (3,), Pa."""
        return np.asarray(self.to_global(self.traction or (0.0, 0.0, 0.0)), dtype=float)


class ResultantLoad(LoadKind):
    """A `force` is spread evenly over the face; at a `point` off its centre, and a `moment`, alone or with a force, by
    tractions that grow from the centre, as through a distributing coupling."""

    chosen_by: ClassVar[tuple[str, ...]] = ("force", "moment")

    force: Annotated[Vector | None, about("resultant force along x, y, z", "N")] = None
    moment: Annotated[Vector | None, about("resultant moment about x, y, z at the point of the force", "N m")] = None
    point: Annotated[Vector | None, about("point of the force; default: the centre of the face", "m")] = None

    @classmethod
    def key_problems(cls, table: RawTable, where: str, others: Sequence[str], /) -> Iterator[Problem]:
        """No moment and no point of another kind."""
        for key in ("moment", "point"):
            if given(table, key) and others:
                what = f"a {others[0]} has no {key}"
                yield Problem(f"{where}.{key}", what, None, "with 'force'", f"leave out {key!r} or {others[0]!r}")

    def nodal_forces(self, face: LoadedFace, /) -> Array:
        """The force by area, and a couple for the moment about the centre."""
        forces: Array = face.areas[:, None] * np.asarray(self._mean(face.area))
        if self.moment is not None or self.point is not None:
            forces += face.couple(self._moment_about(face.centre))
        return forces

    def largest_traction(self, face: LoadedFace, /) -> float:
        """Force over area; moment over area times length, the root of the area."""
        uniform = float(np.linalg.norm(self._mean(face.area)))
        return float(uniform + np.linalg.norm(self.moment or 0.0) / face.area**1.5)

    def arrow(self, _normal: Array, /) -> Array:
        """Along the force, along the moment where there is none."""
        if self.force is None:
            shown = self.moment
        else:
            shown = self.force
        return np.asarray(self.to_global(shown or (0.0, 0.0, 0.0)), dtype=float)

    def turns(self) -> bool:
        """With a moment."""
        return self.moment is not None

    def _mean(self, area: float) -> GlobalVector:
        """Traction of the force, Pa."""
        x, y, z = self.force or (0.0, 0.0, 0.0)
        return self.to_global((x / area, y / area, z / area))

    def _moment_about(self, centre: Array) -> tuple[float, ...]:
        """Moment about the centre of the face, N m: M + r x F, r the arm of the point."""
        moment = self.to_global(self.moment or (0.0, 0.0, 0.0))
        force = self.to_global(self.force or (0.0, 0.0, 0.0))
        about_centre = np.add(moment, np.cross(np.subtract(self.point or centre, centre), force))
        return tuple(about_centre.tolist())
