"""Files of real programs, written by them and read here: ``python -m tests.mesh_files.real_writers [PROGRAM ...]``.

Each program (a module of ``writers``) is installed into an environment of its own, in a temporary folder, where it
writes the same solids in each of its formats: two bodies, three named faces, cells of every type and order, curved
where they are quadratic. Each file is read as ``latin-fmu check`` reads it. Volumes, first moments and areas of faces
are compared with the integrals of the solid that was written, by scikit-fem. The table goes into docs/mesh_files.md.
Nothing of it runs in CI: the programs are large, and change.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from latin_fmu import load_scene
from latin_fmu.assembly.body import Body
from latin_fmu.building import discretise
from latin_fmu.errors import LatinError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import Mesh, boundary, box_mesh
from tests.fem.meshes import ORIGIN, SIZE, TYPES, typed_box
from tests.fem.surface_integrals import integrals

from .writers.solid import Solid

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "mesh_files.md"
BEGIN, END = "<!-- real_writers: begin -->", "<!-- real_writers: end -->"
PROGRAMS = tuple(sorted(path.stem for path in (HERE / "writers").glob("by_*.py")))
PAIRS = {"hexahedron20 and tetra10": ("hexahedron20", "tetra10"), "pyramid and tetra": ("pyramid", "tetra")}
OWN = "own"
SHIFT = np.array([1.4, 0.1, 0.05])
BEND = 0.08
TOLD = ("belong to no cell", "lie on no solid", "lies on no solid")
PIECES = "pieces without common nodes"
BAD = ("WRONG", "LOST", "TRACEBACK")
SCENE = """
name = "writers"
[material.m]
young_modulus = 210e9
poisson_ratio = 0.3
density = 7800.0
[mesh.file]
file = "{file}"
scale = 1e-3
material = "m"
{keys}
[time]
end = 2e-5
step = 1e-6
"""


@dataclass(frozen=True)
class Original:
    """The bodies of a solid as meshes in m, and the integrals of their surface and of the faces of both together."""

    bodies: dict[str, Mesh]
    volumes: dict[str, np.ndarray] = field(default_factory=dict)
    faces: dict[str, np.ndarray] = field(default_factory=dict)


def bent(mesh: Mesh) -> Mesh:
    """A mesh whose cells of second order are curved by a map of second degree; mm."""
    x, y, z = ((mesh.nodes - ORIGIN) / SIZE).T
    nodes = mesh.nodes.copy()
    if any(block.cells.shape[1] > 8 for block in mesh.blocks):
        nodes += BEND * SIZE * np.stack([y * y - y * x, x * x + 0.5 * z * z, x * y], axis=1)
    return Mesh(nodes, mesh.blocks, mesh.faces)


@cache
def original(name: str) -> Original:
    """The solid of a name: its two bodies, 10 mm wide; "own": the boxes that programs mesh themselves."""
    if name == OWN:
        left = box_mesh(np.zeros(3), np.array([0.010, 0.010, 0.020]), (1, 1, 1))
        right = box_mesh(np.array([0.015, 0.0, 0.0]), np.array([0.007, 0.010, 0.010]), (1, 1, 1))
        boxes = {"left": (left, "foot"), "right": (right, "tip")}
        bodies = {body: Mesh(m.nodes, m.blocks, {face: m.faces["zmin"]}) for body, (m, face) in boxes.items()}
        return Original(bodies, {b: integrals(m.nodes, boundary(m)) for b, m in bodies.items()}, _faces(bodies))
    kinds = PAIRS.get(name, (name, name))
    left, right = (bent(typed_box(kind, (2, 2, 2), shift=0.2)) for kind in kinds)
    right = Mesh(right.nodes * [0.7, 0.9, 1.1] + SHIFT, right.blocks, right.faces)
    named = {"left": (left, {"foot": "zmin", "side": "ymax"}), "right": (right, {"tip": "xmax", "side": "ymax"})}
    bodies = {
        body: Mesh(1e-2 * mesh.nodes, mesh.blocks, {face: mesh.faces[old] for face, old in faces.items()})
        for body, (mesh, faces) in named.items()
    }
    volumes = {body: integrals(mesh.nodes, boundary(mesh)) for body, mesh in bodies.items()}
    return Original(bodies, volumes, _faces(bodies))


def _faces(bodies: dict[str, Mesh]) -> dict[str, np.ndarray]:
    """Integrals over each face, of all bodies together."""
    totals: dict[str, np.ndarray] = {}
    for mesh in bodies.values():
        for name, face in mesh.faces.items():
            totals[name] = totals.get(name, np.zeros(7)) + integrals(mesh.nodes, face)
    return totals


def solid(name: str) -> Solid:
    """The solid as programs get it: one array of nodes, in mm."""
    bodies = original(name).bodies
    starts = dict(zip(bodies, np.cumsum([0, *(mesh.n_node for mesh in bodies.values())]).tolist(), strict=False))
    cells = [(b.cell_type, b.cells + starts[body], body) for body, m in bodies.items() for b in m.blocks]
    faces = [(face, body, m.faces[face]) for body, m in bodies.items() for face in m.faces]
    facets = [(b.kind, b.facets + starts[body], face) for face, body, table in faces for b in table.blocks]
    points = 1e3 * np.concatenate([mesh.nodes for mesh in bodies.values()])
    return Solid(name, points, tuple(cells), tuple(facets))


@dataclass
class Outcome:
    """What became of a file.

    Attributes
    ----------
    word : "read", "refused", "told" (read, and said that cells are missing), "not written", "WRONG", "LOST" or
    "TRACEBACK". bodies, faces : "named", "numbered", "none"; "one" body, or "by type of cells".
    unit : as the file says it. said : reason, or what is printed beside.
    """

    word: str
    said: str = ""
    bodies: str = ""
    faces: str = ""
    unit: str = ""


def outcome(path: Path, name: str, form: dict[str, Any]) -> Outcome:
    """Read a file as a scene of it is read, and compare it with its original."""
    scene = path.with_name("scene.toml")
    scene.write_text(SCENE.format(file=path.name, keys=form["keys"]))
    try:
        found = discretise(load_scene(scene))
    except LatinError as error:
        return Outcome("refused", "; ".join(line.strip() for line in str(error).split("\n")[1:3]))
    except Exception as error:
        return Outcome("TRACEBACK", f"{type(error).__name__}: {error}")
    line = next(text for text in found.files if path.name in text)
    unit = line.partition("(the file says ")[2].partition(")")[0]
    said = " | ".join([line.partition(" m")[2], *map(str, found.remarks)])
    return compared(found.bodies, name, form, unit, said)


def compared(bodies: dict[str, Body], name: str, form: dict[str, Any], unit: str, said: str) -> Outcome:
    """The bodies of a file beside those that were written."""
    wanted, near = original(name), form["near"]
    meshes = {body: Mesh(b.mesh.nodes, b.mesh.blocks, b.mesh.faces) for body, b in bodies.items()}
    got = {body: integrals(mesh.nodes, boundary(mesh)) for body, mesh in meshes.items()}
    own = {body: float(Elements(mesh).volume.sum()) for body, mesh in meshes.items()}
    whole = sum(wanted.volumes.values())
    told = [text for text in TOLD if text in said]
    if not close(sum(got.values()), whole, near) or abs(sum(own.values()) / whole[0] - 1) > near:
        loss = f"volume {sum(own.values()):.9g} for {whole[0]:.9g} m3"
        return Outcome("told", told[0]) if told else Outcome("WRONG", f"{loss} | {said}")
    pairs = [next((b for b in got if close(got[b], v, near)), "") for v in wanted.volumes.values()]
    how = "numbered"
    if len(got) != len(wanted.volumes):
        how = "one" if len(got) == 1 else "by type of cells"
    elif "" in pairs:
        how = "none" if form["bodies"] else "by type of cells"
    elif all(map(str.__contains__, pairs, wanted.volumes)):
        how = "named"
    faces, lost = found_faces(_faces(meshes), wanted.faces, near)
    if (
        (form["faces"] and lost and not told)
        or how == "none"
        or (form["bodies"] and how == "one" and PIECES not in said)
    ):
        return Outcome("LOST", f"faces {', '.join(lost)}; bodies {', '.join(meshes)} | {said}")
    return Outcome("read", said, how, faces, unit)


def found_faces(got: dict[str, np.ndarray], wanted: dict[str, np.ndarray], near: float) -> tuple[str, list[str]]:
    """Whether the faces are there by name or number, and which are not."""
    if all(face in got and close(got[face], value, near) for face, value in wanted.items()):
        return "named", []
    lost = [face for face, value in wanted.items() if not any(close(g, value, near) for g in got.values())]
    return ("none" if len(lost) == len(wanted) else "numbered"), lost


def close(got: np.ndarray, wanted: np.ndarray, near: float) -> bool:
    """Whether integrals agree: volume and first moments, and the vector area; of bodies of 10 mm."""
    length = 1e-2
    return bool((np.abs(got - wanted) <= near * length ** np.array([3, 4, 4, 4, 2, 2, 2])).all())


def environment(module: str, folder: Path) -> Path:
    """Python of an environment in which the program of a module is installed."""
    python = folder / module / "bin" / "python"
    if not python.exists():
        venv.create(folder / module, with_pip=True)
        source = (HERE / "writers" / f"{module}.py").read_text()
        names = source.partition("REQUIRES: Final = (")[2].partition(")")[0].replace('"', "").split(",")
        wanted = [name.strip() for name in names if name.strip()]
        subprocess.run([python, "-m", "pip", "install", "-q", *wanted], check=True)
    return python


def rows(
    module: str, python: Path, folder: Path, only: str = ""
) -> Iterator[tuple[dict[str, Any], dict[str, Outcome]]]:
    """Each format of a program, with the outcome of each solid."""
    command = [python, "-m", "writers.serve", module, folder, *([only] if only else [])]
    subprocess.run(command, check=True, env={"PYTHONPATH": str(HERE), "PATH": "/usr/bin:/bin"}, timeout=3600)
    table = json.loads((folder / f"{module}.json").read_text())
    for form in table["formats"]:
        found = {}
        for name, (file, said) in form["files"].items():
            found[name] = Outcome("not written", said) if said else outcome(folder / file, name, form)
        yield form | {"title": table["title"], "version": table["version"]}, found


def outcomes(module: str, folder: Path, options: argparse.Namespace) -> list[tuple[dict[str, Any], dict[str, Outcome]]]:
    """What became of the files of a program, kept in the folder."""
    place = folder / f"{module}.outcomes.json"
    if options.kept and place.exists():
        table = json.loads(place.read_text())
        return [(form, {name: Outcome(**row) for name, row in found.items()}) for form, found in table]
    python = environment(module, folder / "environments")
    found = list(rows(module, python, folder / "files", options.only))
    place.write_text(json.dumps([(form, {k: v.__dict__ for k, v in row.items()}) for form, row in found], indent=1))
    return found


def grouped(found: dict[str, Outcome]) -> dict[str, list[str]]:
    """Names of the solids by what became of them, in words."""
    texts: dict[str, list[str]] = {}
    for name, result in found.items():
        words = [result.word, f"bodies {result.bodies}", f"faces {result.faces}", result.unit]
        text = ", ".join(words).rstrip(", ") if result.word == "read" else f"{result.word}: {result.said}"
        texts.setdefault(text, []).append(name)
    return texts


REASON = re.compile(
    r"(?:solid\.[\w.]+(?:, line \d+)?: |substructure\.[^:]*: )*(.*?)(?: \(value| \(line|;|: \d+ numbers|$)"
)


def reason(result: Outcome) -> str:
    """Why a file is not read, in the words of the reader."""
    if result.word == "told":
        return "written without some of their nodes or cells, which is told"
    # without the place in the scene, the values and the remedies
    text = re.sub(r"^1\. (mesh|substructure)\.[\w.]+: ", "", result.said)
    text = re.sub("(do not fit each other).*", r"\1", text)
    match = REASON.match(text)
    return (match[1] if match else text)[:110].replace("|", "/").strip()


def cells_of(row: dict[str, Outcome]) -> tuple[str, str]:
    """Types that are read, and those that are written and are not, with the reasons."""
    written = {name: result for name, result in row.items() if result.word != "not written"}
    there = [name for name, result in written.items() if result.word == "read"]
    others: dict[str, list[str]] = {}
    for name, result in written.items():
        if result.word != "read":
            others.setdefault(reason(result), []).append(name)
    there = ["its own boxes" if name == OWN else name for name in there]
    read = "all that it writes" if len(there) == len(written) > 3 else ", ".join(there) or "none"
    return read, "; ".join(f"{', '.join(names)}: {text}" for text, names in others.items())


def table(found: list[tuple[dict[str, Any], dict[str, Outcome]]]) -> str:
    """The rows for the docs; formats of a program that come out alike share one."""
    lines = ["| program | file | cells read | bodies | faces | unit | not read |", "|---|---|---|---|---|---|---|"]
    alike: dict[tuple[str, ...], list[str]] = {}
    for form, row in found:
        if all(result.word == "not written" for result in row.values()):
            continue
        read, rest = cells_of(row)
        good = [result for result in row.values() if result.word == "read"]
        kinds = (
            " or ".join(dict.fromkeys(getattr(r, what) for r in good)) or "-" for what in ("bodies", "faces", "unit")
        )
        alike.setdefault((f"{form['title']} {form['version']}", read, *kinds, rest), []).append(form["label"])
    for (program, *rest), labels in alike.items():
        lines.append(f"| {program} | {'; '.join(labels)} | {' | '.join(rest)} |")
    return "\n".join(lines)


def write_docs(text: str) -> None:
    """Put the table between its marks."""
    page = PAGE.read_text()
    head, _, rest = page.partition(BEGIN)
    _, _, tail = rest.partition(END)
    PAGE.write_text(f"{head}{BEGIN}\n{text}\n{END}{tail}")


def main(arguments: list[str]) -> int:
    """Print what became of each file; 1 where a volume is wrong, or something is lost without a word."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("programs", nargs="*", default=PROGRAMS, help=f"of {', '.join(PROGRAMS)}")
    parser.add_argument("--folder", type=Path, help="for the environments and the files, kept")
    parser.add_argument("--only", default="", help="one format")
    parser.add_argument("--kept", action="store_true", help="take the outcomes that the folder has of an earlier run")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/mesh_files.md")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).absolute()
        files = folder / "files"
        files.mkdir(parents=True, exist_ok=True)
        for name in (*TYPES, *PAIRS, OWN):
            solid(name).save(files / f"{name}.npz")
        bad = 0
        found_all: list[tuple[dict[str, Any], dict[str, Outcome]]] = []
        for module in options.programs:
            for form, found in outcomes(module, folder, options):
                found_all.append((form, found))
                bad += sum(result.word in BAD for result in found.values())
                sys.stdout.write(f"{form['title']} {form['version']} {form['label']}\n")
                for text, names in grouped(found).items():
                    sys.stdout.write(f"    {', '.join(names)}: {text}\n")
                sys.stdout.flush()
    if options.docs:
        write_docs(table(found_all))
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
