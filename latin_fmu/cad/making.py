"""From a CAD file to a mesh, in the process that is made for it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from ..errors import MeshError
from .cutting import CutPlane, cut_assembly
from .facts import CadAssembly, CadPart
from .geometry import WITHOUT_UNIT, read_solids, start
from .imprint import faces_of, split_faces
from .labels import named, part_order
from .meshing import Mesher, MeshWishes, part_size
from .neighbours import Skins, find_pairs
from .screws import find_screws
from .step_text import UNITS, StepText, read_step_text

_INSTALL: Final = (
    'pip install "latin-fmu[meshes]"; where a library of the system is missing: apt install libglu1-mesa libxcursor1 '
    "libxft2 libxinerama1 (Debian, Ubuntu), dnf install mesa-libGLU libXcursor libXft libXinerama (Fedora)"
)
_WOUND: Final = 3.0  # times around a part, from which on an edge is a helix
_SMALL: Final = 0.1  # of the size: faces below that are told


@dataclass(frozen=True)
class MeshJob:
    """What the process is to do.

    Attributes
    ----------
    source, target : CAD file and mesh. unit : of length, in the place of that of the file; None where the file says.
    wishes : sizes. before : parts of the file as they were read before, whose names stay. planes : of symmetry, which
        cut the assembly.
    """

    source: Path
    target: Path
    unit: str | None = None
    wishes: MeshWishes = field(default_factory=MeshWishes)
    before: Sequence[CadPart] = field(default_factory=list)
    planes: Sequence[CutPlane] = ()


def mesh_assembly(job: MeshJob) -> CadAssembly:
    """Read a CAD file, mesh its parts, write the mesh.

    Raises
    ------
    MeshError : gmsh is missing; a file that cannot be read, holds no solids or names no unit; a part without a
        mesh.
    """
    gmsh = _library(job.source)
    clock = time.process_time()
    said = StepText()
    if job.source.suffix.lower() in (".step", ".stp"):
        said = read_step_text(job.source)
    unit, factor = _unit(job, said)
    start(gmsh)
    parts, left = read_solids(gmsh, job.source, said)
    parts = [replace(part, name=name) for part, name in zip(parts, named(parts, job.before), strict=True)]
    assembly = CadAssembly(job.source.name, unit, factor, sorted(parts, key=part_order), left_out=left)
    assembly.screws = find_screws(assembly.parts, unit in ("in", "ft"), factor)
    if job.planes:
        _cut(gmsh, assembly, job.planes)
    skins = Skins(gmsh, faces_of(gmsh, {part.name: part.number for part in assembly.parts}))
    assembly.pairs = find_pairs(gmsh, assembly.parts, skins, job.wishes.touch)
    assembly.remarks += _remarks(assembly, job.wishes)
    read = time.process_time()
    numbers, kept = split_faces(gmsh, assembly.parts, assembly.pairs)
    assembly.remarks += kept
    mesher = Mesher(gmsh, assembly, numbers, Skins(gmsh, faces_of(gmsh, numbers)), job.wishes)
    split = time.process_time()
    try:
        assembly.counts = mesher.mesh()
    except Exception as error:  # the library raises plain exceptions
        raise MeshError.of("not meshed", job.source.name, f"{error}", remedy=_finer(gmsh, numbers)) from None
    if bare := [name for name, number in numbers.items() if not len(gmsh.model.mesh.getElements(3, number)[1])]:
        raise MeshError.of("not meshed", job.source.name, "parts without cells", ", ".join(bare), remedy=_REPAIR)
    assembly.faces = mesher.name_groups()
    mesher.write(job.target)
    assembly.seconds = {"reading": read - clock, "splitting": split - read, "meshing": time.process_time() - split}
    return assembly


def _cut(gmsh: Any, assembly: CadAssembly, planes: Sequence[CutPlane]) -> None:
    """Leave one side of the planes."""
    half = cut_assembly(gmsh, assembly.parts, assembly.screws, planes)
    assembly.whole, assembly.parts, assembly.screws = assembly.parts, half.parts, half.screws
    assembly.symmetry = half.faces
    assembly.remarks += half.remarks


_REPAIR: Final = "simplify or repair the part in CAD, or change its edges: --size"


def _finer(gmsh: Any, numbers: dict[str, int]) -> str:
    """What may help, with the parts that have no cells yet."""
    bare = [name for name, number in numbers.items() if not len(gmsh.model.mesh.getElements(3, number)[1])]
    return f"{_REPAIR}; without cells: {', '.join(bare[:5])}"


def _library(source: Path) -> Any:
    """The module of gmsh.

    Raises
    ------
    MeshError : it, or a library of the system that it loads, is missing.
    """
    try:
        import gmsh
    except ImportError as error:
        what = f"reading CAD needs gmsh, which is not installed ({error})"
    except OSError as error:
        what = f"gmsh does not find a library of the system: {error}"
    else:
        return gmsh
    raise MeshError.of("not meshed", source.name, what, remedy=_INSTALL)


def _unit(job: MeshJob, said: StepText) -> tuple[str, float]:
    """Unit of the file, and m for a unit of the mesh.

    Raises
    ------
    MeshError : the format names none, and the user neither.
    """
    own = said.unit or "mm"
    if job.source.suffix.lower() in WITHOUT_UNIT:
        if job.unit is None:
            what = "the format names no unit of length"
            raise MeshError.of("unreadable CAD", job.source.name, what, None, ", ".join(UNITS), "name it: --unit mm")
        return job.unit, UNITS[job.unit]
    if job.unit is None:
        return own, 1e-3
    # the library has converted from the unit of the file to mm
    return job.unit, float(f"{1e-3 * UNITS[job.unit] / UNITS[own]:.9g}")


def _remarks(assembly: CadAssembly, wishes: MeshWishes) -> Iterator[str]:
    """What is said of parts: faces that are small beside the edges of the mesh, edges that wind around them, mirror
    images of others."""
    for part in assembly.parts:
        size = part_size(part, wishes)
        if part.smallest < _SMALL * size:
            edges = f"below a tenth of its edges of {size:.3g} mm"
            yield f"{part.name}: its smallest face is {part.smallest:.3g} mm, {edges}"
        if part.turns > _WOUND:
            edge = f"an edge of {part.longest:.4g} mm winds around it (a spring, or a thread drawn in full)"
            yield f"{part.name}: {edge}; a plain shank in the place of a thread needs a tenth of the mesh"
    yield from mirror_images(assembly.parts)


def mirror_images(parts: Sequence[CadPart]) -> Iterator[str]:
    """Parts that are mirror images of others: of their volume and surface, and of the other hand."""
    for i, part in enumerate(parts):
        if part.handedness:
            of = next((p for p in parts[:i] if p.same_shape(part) and p.handedness), None)
            if of is not None and of.handedness != part.handedness:
                yield f"{part.name} is the mirror image of {of.name}"
