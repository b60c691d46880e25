"""Small files of every format, how they are changed, and how they are read: as a user's input is, to the end."""

from __future__ import annotations

import io
import math
import shutil
import tomllib
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import fmpy
import meshio
import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import described
from latin_fmu.cli import main
from latin_fmu.commands.fmu import read_columns
from latin_fmu.cosim import Session
from latin_fmu.errors import LatinError
from latin_fmu.latin.state_serialization import decode, encode, opened, sealed
from latin_fmu.scene.laws import sampled_impulse_error
from latin_fmu.stability.scenes import STEEL, Box, column

from ..cosim.scenes import blocks
from ..fem.conftest import write_msh
from ..mesh_files.decks import cube, instances_deck, keywords_deck, nastran_deck, surfaces_deck, systems_deck
from ..mesh_files.test_formats import exodus
from ..mesh_files.test_kratos import mdpa
from ..mesh_files.test_med import write_med
from ..mesh_files.test_readers import dyna_cube, netgen, unv_cube, unv_group
from . import changes
from .changes import Rng
from .stored import STORED

Attempt = Callable[[Rng, Path], None]
"""Uses one damaged input in a folder; what is wrong with it is a ``LatinError``."""

HERE = Path(__file__).parent
LAW = b"# a law\ntime, value\n0, 0\n1e-4, 1\n2e-4, 0.5\n1e-3, 0\n"
RECORDER = "Zeit (ms);p [²]\r\nms;\r\n".encode("latin-1") + b"".join(b"0,%d;1,%d\r\n" % (i, i) for i in range(10))
FUNCTION = "\n".join(
    [
        *["    -1", "    58", "push", "NONE", "NONE", "NONE", "NONE"],
        "    1         0    0         0 NONE               7   3 NONE               0   0",
        "         4        12         1  0.00000E+00  1.00000E-04  0.00000E+00",
        "        17    0    0    0 Time                 s                   ",
        "        15    0    0    0 Pressure             NONE                ",
        *["         0    0    0    0 NONE                 NONE                "] * 2,
        *["".join(f"{0.1 * i:20.12E}" for i in range(4))] * 3,
        "    -1",
    ]
).encode()
PACKED = FUNCTION.replace(b"    58", b"    58b     1     2          11          96     0     0           0           0")
PACKED = b"\n".join([*PACKED.split(b"\n")[:13], np.arange(12.0).tobytes() + b"\n    -1", b""])
COLUMNS = b"time,load.press.value\n0,0\n1e-6,1\n1e-3,0.5\n"


@dataclass(frozen=True)
class Files:
    """Files of one format.

    Attributes
    ----------
    samples : whole files by name. change : damages the bytes of one. read : uses a file to the end.
    """

    samples: Callable[[], Mapping[str, bytes]]
    change: Callable[[bytes, Rng], bytes]
    read: Callable[[Path], None]

    def __call__(self, rng: Rng, folder: Path) -> None:
        """One of the samples, changed, written under its name and read."""
        whole = kept(self.samples)
        name = list(whole)[int(rng.integers(len(whole)))]
        (folder / name).write_bytes(self.change(whole[name], rng))
        self.read(folder / name)

    def read_whole(self, folder: Path) -> None:
        """All samples as they are."""
        for name, content in kept(self.samples).items():
            (folder / name).write_bytes(content)
            self.read(folder / name)


@cache
def kept(samples: Callable[[], Mapping[str, bytes]]) -> Mapping[str, bytes]:
    """What a function returns, made once."""
    return samples()


def solved(tables: dict[str, Any], folder: Path, cells: int = 100, instants: int = 4) -> None:
    """Check a scene, and solve it where it is small; what converges is finite."""
    scene = latin_fmu.scene_from_dict(tables, folder)
    if cells_of(scene) > cells or scene.time.n_step > 1000:
        return
    latin_fmu.check(scene)
    if scene.time.n_step <= instants and scene.solver.max_iterations <= 100:
        outcome = latin_fmu.solve(scene).outcome
        assert not outcome.converged or all(np.isfinite(h.traction).all() for h in outcome.interfaces.values())


def cells_of(scene: latin_fmu.Scene) -> int:
    """Cells of the boxes of a scene."""
    return sum(math.prod(body.box.elements) for body in scene.substructure.values() if body.box is not None)


def read_by_command(path: Path) -> None:
    """A scene through the command line: solved where it is small, else checked; refused with exit code 2, in words, and
    without a file."""
    command, before = ["check", str(path)], set(path.parent.iterdir())
    with suppress(LatinError):
        scene = latin_fmu.load_scene(path)
        if cells_of(scene) <= 100 and scene.time.n_step <= 4 and scene.solver.max_iterations <= 100:
            command = ["run", str(path), "-o", str(path.parent / "out.nc"), "--quiet"]
    said = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(said):
        code = main(command)
    left = {file.name for file in set(path.parent.iterdir()) - before}
    assert code in (0, 1, 2), (code, said.getvalue())
    assert "Traceback" not in said.getvalue(), said.getvalue()
    assert left <= ({"out.nc"} if code < 2 else set()), (code, left)
    assert code < 2 or "latin-fmu: " in said.getvalue(), said.getvalue()


def read_mesh(path: Path) -> None:
    """All parts of a mesh file as substructures of a scene."""
    time = {"end": 2e-6, "instants": 2}
    mesh = {"m": {"file": path.name, "material": "steel"}}
    solved({"name": "parts", "material": {"steel": STEEL.table()}, "mesh": mesh, "time": time}, path.parent)


def read_law(path: Path) -> None:
    """A table as inputs of an FMU, and as the law of a load."""
    with suppress(LatinError):
        read_columns(path)
    load = {"push": {"face": "a.zmax", "pressure": 1e5, "law": {"type": "csv", "file": path.name}}}
    tables = column({"a": Box(STEEL, elements=(1, 1, 1))}, {}, {"end": 1e-3, "instants": 3}, load=load)
    scene = latin_fmu.scene_from_dict(tables, path.parent)
    sampled_impulse_error(scene.load["push"].law, np.linspace(0.0, 1e-3, 4))
    latin_fmu.check(scene)


def read_scene(path: Path) -> None:
    """A scene file, checked and solved; its text is the scene again."""
    scene = latin_fmu.load_scene(path)
    text = scene.text()
    assert latin_fmu.scene_from_dict(tomllib.loads(text), path.parent) == scene
    with np.errstate(all="ignore"):  # numbers may overflow, as on the command line: what counts is the outcome
        solved(tomllib.loads(text), path.parent)


def written_meshes(suffix: str) -> Mapping[str, bytes]:
    """The cube of eight cells as meshio writes it, as text and binary, in old and new versions of a format."""
    box = cube()
    cells = [("hexahedron", box.blocks[0].cells), ("quad", box.faces["zmax"].blocks[0].facets)]
    tags = [np.repeat([1, 2], 4), np.full(4, 3)]
    mesh = meshio.Mesh(box.nodes, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags})
    mesh.field_data = {"low": np.array([1, 3]), "up": np.array([2, 3]), "top": np.array([3, 2])}
    plain = meshio.Mesh(box.nodes, cells, cell_data={"part": tags})
    versions = {"msh": ("gmsh22",), "vtk": ("vtk42", "vtk"), "vtu": ("vtu",), "xdmf": ("xdmf",)}[suffix]
    result = {}
    noise = io.StringIO()  # "ASCII files are only meant for debugging"
    with TemporaryDirectory() as folder, redirect_stderr(noise), redirect_stdout(noise):
        for version in versions:
            for binary in (False, True) if suffix != "xdmf" else ():
                path = Path(folder) / f"{version}{'b' * binary}.{suffix}"
                meshio.write(path, mesh if suffix == "msh" else plain, version, binary=binary)
                result[path.name] = path.read_bytes()
        if suffix == "xdmf":
            plain.write(Path(folder) / "cube.xdmf", data_format="XML")
            result["cube.xdmf"] = (Path(folder) / "cube.xdmf").read_bytes()
        if suffix == "msh":  # meshio writes no groups into version 4
            path = Path(folder) / "gmsh41.msh"
            groups = {"low": cells[0][1][:4], "up": cells[0][1][4:], "top": cells[1][1]}
            write_msh(path, box.nodes, {n: ("quad" if n == "top" else "hexahedron", c) for n, c in groups.items()})
            result[path.name] = path.read_bytes()
    return result


def exodus_file() -> Mapping[str, bytes]:
    """The cube as two blocks with side sets."""
    with TemporaryDirectory() as folder:
        return {"cube.e": exodus(Path(folder) / "cube.e").read_bytes()}


def med_file() -> Mapping[str, bytes]:
    """The cube as two groups of cells with a group of facets."""
    box = cube()
    facets = box.faces["zmax"].blocks[0].facets
    cells = {"HE8": (box.blocks[0].cells, np.repeat([-1, -5], 4)), "QU4": (facets, np.full(4, -2))}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "cube.med"
        write_med(path, box.nodes, cells, {-1: ["low"], -2: ["top"], -5: []}, unit="mm")
        return {path.name: path.read_bytes()}


def text_meshes() -> Mapping[str, bytes]:
    """Small meshes in the text formats that the package reads itself."""
    box = cube()
    cells, count = (box.blocks[0].cells + 1).tolist(), len(box.nodes)
    points = [" ".join(map(repr, x)) for x in box.nodes.tolist()]
    rows = [" ".join(map(str, cell)) for cell in cells]
    medit = ["MeshVersionFormatted 2", "Dimension 3", "Vertices", str(count), *(f"{x} 1" for x in points)]
    medit += ["Hexahedra", "8", *(f"{row} {1 + i // 4}" for i, row in enumerate(rows)), "End", ""]
    su2 = ["NDIME= 3", "NELEM= 8", *(f"12 {' '.join(str(n - 1) for n in c)} {i}" for i, c in enumerate(cells))]
    su2 += [f"NPOIN= {count}", *(f"{x} {i}" for i, x in enumerate(points))]
    su2 += ["NMARK= 1", "MARKER_TAG= foot", "MARKER_ELEMS= 1", "9 0 1 4 3", ""]
    texts = {
        "cube.unv": unv_cube(unv_group(1, "low", [(8, 1), (8, 2), (8, 3), (8, 4)])),
        "cube.k": dyna_cube(),
        "two.vol": netgen(True),
        "cube.mesh": "\n".join(medit),
        "cube.su2": "\n".join(su2),
        "cube.mdpa": mdpa(box),
    }
    return {name: text.encode() for name, text in texts.items()}


def scene_texts() -> Mapping[str, bytes]:
    """Scenes that use most tables, small enough to be solved."""
    return {path.name: path.read_bytes() for path in sorted(HERE.glob("*.toml"))}


def scene_tables(rng: Rng, folder: Path) -> None:
    """A scene as nested tables of Python, which hold types that no file has."""
    texts = list(kept(scene_texts).values())
    tables = tomllib.loads(texts[int(rng.integers(len(texts)))].decode())
    with np.errstate(all="ignore"):
        solved(changes.tables(tables, rng), folder)


@cache
def _state() -> bytes:
    session = Session(blocks())
    session.initialize()
    assert session.step(0.0, 0.4e-6)
    return sealed(session.snapshot(), "state", "digest")


def session_state(rng: Rng, folder: Path) -> None:
    """The state of a session as it leaves the process: any damage is noticed."""
    del folder
    damaged = changes.binary(_state(), rng)
    if damaged != _state():
        with pytest.raises(LatinError):
            opened(damaged, "state", "digest")


def tree(rng: Rng, folder: Path) -> None:
    """Bytes of a tree of values and arrays, as reduced models and states have them."""
    del folder
    values = {"a": np.arange(6.0).reshape(2, 3), "b": [1.5, None, "text", True], "c": {"d": np.arange(3)}}
    decode(changes.binary(encode(values, "kind"), rng), "kind")


def fmus() -> Mapping[str, bytes]:
    """FMUs for FMI 2 and 3 without binaries, and with the small files only: what is read before an instance is made."""
    result = {}
    with TemporaryDirectory() as folder:
        for fmi in "23":
            path = build_fmu(blocks(), Path(folder) / f"blocks{fmi}.fmu", fmi, python=True)
            members = changes.members(path.read_bytes())
            small = {name: content for name, content in members.items() if len(content) < 30_000}
            names = ["modelDescription.xml", *sorted(small)[:6], *(n for n in small if n.endswith((".json", ".toml")))]
            kept_members = [(name, members[name]) for name in dict.fromkeys(names)]
            result[path.name] = changes.packed(kept_members)
    return result


def read_fmu(path: Path) -> None:
    """Description and extraction, up to the library that would be loaded."""
    description = described(path)
    assert description.modelVariables
    before, target = set(path.parent.iterdir()), path.parent / "unpacked"
    fmpy.extract(str(path), target)
    assert set(path.parent.iterdir()) == before | {target}
    shutil.rmtree(target)


FORMATS: dict[str, Attempt] = {
    "msh": Files(partial(written_meshes, "msh"), changes.either, read_mesh),
    "vtk": Files(partial(written_meshes, "vtk"), changes.either, read_mesh),
    "vtu": Files(partial(written_meshes, "vtu"), changes.either, read_mesh),
    "inp": Files(
        lambda: {
            "surfaces.inp": surfaces_deck().encode(),
            "instances.inp": instances_deck().encode(),
            "keywords.inp": keywords_deck().encode(),
        },
        changes.text,
        read_mesh,
    ),
    "bdf": Files(
        lambda: {"cube.bdf": nastran_deck().encode(), "systems.bdf": systems_deck().encode()}, changes.text, read_mesh
    ),
    "xdmf": Files(partial(written_meshes, "xdmf"), changes.text, read_mesh),
    "med": Files(med_file, changes.binary, read_mesh),
    "text": Files(text_meshes, changes.text, read_mesh),
    "exodus": Files(exodus_file, changes.binary, read_mesh),
    "csv": Files(lambda: {"law.csv": LAW, "columns.csv": COLUMNS, "recorder.csv": RECORDER}, changes.text, read_law),
    "uff": Files(lambda: {"text.uff": FUNCTION, "binary.uff": PACKED}, changes.either, read_law),
    "toml": Files(scene_texts, changes.text, read_scene),
    "command": Files(scene_texts, changes.text, read_by_command),
    "fmu": Files(fmus, changes.archive(changes.member), read_fmu),
    "tables": scene_tables,
    "state": session_state,
    "tree": tree,
    **STORED,
}
