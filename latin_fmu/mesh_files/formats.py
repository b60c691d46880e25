"""The table of mesh formats: suffixes of a file, and what reads it; a row for each format.

Several formats share a suffix: the first row that knows the beginning of the file counts, else the first row that does
not look at it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .abaqus import read_abaqus
from .abaqus_cards import is_abaqus
from .ansys import is_archive, read_ansys
from .cgns import read_cgns
from .content import Include, MeshContent
from .exodus import read_exodus
from .gmsh import is_gmsh, read_gmsh
from .kratos import read_mdpa
from .library import read_with_library
from .lsdyna import read_lsdyna
from .med import read_med
from .nastran import read_nastran
from .nastran_entries import is_nastran
from .plain_text import read_medit, read_netgen, read_su2
from .unv import read_unv
from .vtk_files import read_vtk
from .xdmf import read_xdmf

_BEGINNING: Final = 20_000  # bytes
_LIBRARY: Final = "meshlane or meshio"


@dataclass(frozen=True)
class Format:
    """A format of mesh files.

    Attributes
    ----------
    name : what people call it. suffixes : in small letters, with the dot.
    read : content of a file. deck : content of a text that may include other files, in place of ``read``.
    library : what ``read`` takes the file apart with, in a process with limits; empty: it is read here.
    knows : whether the beginning of a file is of this format; None: it is not looked at.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path], MeshContent] | None = None
    deck: Callable[[str, str, Include], MeshContent] | None = None
    library: str = ""
    knows: Callable[[bytes], bool] | None = None


def _text(start: bytes) -> str:
    return start.decode("utf-8-sig", "replace")


def _is_abaqus_deck(start: bytes) -> bool:
    """Whether a file begins as a deck of Abaqus does, also as cgx writes it to a file NAME.msh."""
    return is_abaqus(_text(start))


def _is_nastran_deck(start: bytes) -> bool:
    """Whether a file begins as a deck of Nastran does."""
    return is_nastran(_text(start))


FORMATS: Final = (
    Format("gmsh", (".msh",), read_gmsh, knows=is_gmsh),
    Format("Abaqus, CalculiX", (".inp", ".msh"), deck=read_abaqus, knows=_is_abaqus_deck),
    Format("Abaqus, CalculiX", (".inp",), deck=read_abaqus),
    Format("Ansys", (".cdb", ".dat", ".inp"), read_ansys, library="mapdl-archive", knows=is_archive),
    Format("Ansys", (".cdb",), read_ansys, library="mapdl-archive"),
    Format("LS-DYNA", (".k", ".key", ".dyn"), deck=read_lsdyna),
    Format("Nastran", (".dat",), deck=read_nastran, knows=_is_nastran_deck),
    Format("Nastran", (".bdf", ".nas", ".fem"), deck=read_nastran),
    Format("Exodus", (".e", ".exo", ".ex2", ".g", ".gen"), read_exodus, library="netCDF4"),
    Format(
        "VTK", (".vtu", ".vtk", ".vtkhdf", ".vts", ".vtr", ".vti"), read_vtk, library="vtk, else meshlane or meshio"
    ),
    Format("MED (Salome)", (".med",), read_med, library="h5py"),
    Format("XDMF", (".xdmf", ".xmf"), read_xdmf, library="h5py"),
    Format("CGNS", (".cgns",), read_cgns, library="h5py"),
    Format("medit", (".mesh",), read_medit),
    Format("medit, binary", (".meshb",), read_with_library, library=_LIBRARY),
    Format("SU2", (".su2",), read_su2),
    Format("Netgen", (".vol", ".vol.gz"), read_netgen),
    Format("universal file", (".unv",), read_unv),
    Format("MOAB", (".h5m",), read_with_library, library=_LIBRARY),
    Format("Kratos", (".mdpa",), read_mdpa),
    Format("FLAC3D", (".f3grid",), read_with_library, library=_LIBRARY),
    Format("UGRID", (".ugrid",), read_with_library, library=_LIBRARY),
    Format("AVS-UCD", (".avs",), read_with_library, library=_LIBRARY),
    Format("DOLFIN", (".xml",), read_with_library, library=_LIBRARY),
    Format("HMF", (".hmf",), read_with_library, library=_LIBRARY),
    Format("PERMAS", (".post", ".post.gz", ".dato", ".dato.gz"), read_with_library, library=_LIBRARY),
    Format("TetGen", (".ele", ".node"), read_with_library, library=_LIBRARY),
    Format("Tecplot", (".tec", ".dat"), read_with_library, library=_LIBRARY),
)
"""Every format that is read."""

CAD: Final = frozenset(
    {
        ".step",
        ".stp",
        ".iges",
        ".igs",
        ".brep",
        ".x_t",
        ".x_b",
        ".sldprt",
        ".sldasm",
        ".fcstd",
        ".ipt",
        ".prt",
        ".catpart",
    }
)
"""Suffixes of files that hold a geometry and no mesh."""

MESHED: Final = ".msh"
"""Suffix of the meshes that are made of CAD files."""

SURFACES: Final = frozenset({".stl", ".obj", ".off", ".ply", ".wkt", ".svg"})
"""Suffixes of files that hold surfaces and no solid cells."""


def suffix_of(path: Path) -> str:
    """The suffix of a file in small letters; of a packed one the two last."""
    name = path.name.lower()
    suffixes = [suffix for row in FORMATS for suffix in row.suffixes if name.endswith(suffix)]
    return max(suffixes, key=len, default=path.suffix.lower())


def format_of(path: Path) -> Format | None:
    """The format of a file by its suffix and, where formats share it, its beginning; None where none takes it."""
    suffix = suffix_of(path)
    rows = [row for row in FORMATS if suffix in row.suffixes]
    if not any(row.knows for row in rows):
        if rows:
            return rows[0]
        return None
    with path.open("rb") as file:
        start = file.read(_BEGINNING)
    matches = [row for row in rows if row.knows is not None and row.knows(start)]
    # a damaged file is for the first row, whose message says what it should be
    return (matches or [row for row in rows if row.knows is None] or rows)[0]


def known_suffixes() -> str:
    """All suffixes for a message, those that people use most first."""
    return ", ".join(dict.fromkeys(suffix[1:] for row in FORMATS for suffix in row.suffixes))
