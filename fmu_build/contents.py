"""The files of an FMU: solver, adapter, libraries, scene, documentation; the archive. Equal input gives equal bytes."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

import latin_fmu
from latin_fmu.compiled import library
from latin_fmu.errors import InputError, Problem
from latin_fmu.mesh_files.reading import included_files
from latin_fmu.results.writing import write_whole
from latin_fmu.scene.schema import Scene

from . import bridge
from .adapter import DIGESTS, CoSimulationAdapter, ModelExchangeAdapter, token_of
from .description import NAME

Files = dict[str, bytes]
"""Contents by path inside the archive."""

_ADAPTERS = ("__init__.py", "adapter.py")
_LEFT_OUT = ("cli.py", "__main__.py", "commands", "stability", "aot", "models")  # not run by an FMU
_DEPENDENCIES = """\
This FMU runs in a CPython of its host, 3.11 or newer, 64 bit, that has these packages, installed e.g. with
`pip install`:

{}

{}

A host that is itself a Python (a script, or a program that has one inside) uses that Python. For any other host the
FMU starts one: the Python that the environment variable LATIN_FMU_PYTHON names (path of the executable, also of a
virtual environment), else `python3` (Windows: `python`) on the path. It must have a shared library, as the Pythons of
Linux distributions, python.org and conda do. No other variable is needed, neither LD_PRELOAD nor PYTHONHOME.
"""
_BARE_INIT = '"""The solver inside an FMU; nothing is imported before it is needed."""\n\n__version__ = "{}"\n'


def binaries(fmi: str, identifier: str) -> Files:
    """Libraries of all platforms there are, under the name of the model.

    Raises ModuleNotFoundError with the command that installs what is missing.
    """
    return {
        f"binaries/{bridge.PLATFORMS[target][fmi]}/{identifier}{path.suffix}": path.read_bytes()
        for target, path in sorted(bridge.libraries().items())
        if fmi in bridge.PLATFORMS[target]
    }


def package_files() -> Files:
    """The root package that travels in the FMU: solver and adapters side by side."""
    files: Files = {"__init__.py": b'"""Solver and adapters of an FMU, under a name made from their content."""\n'}
    solver = Path(latin_fmu.__file__).parent
    for path in sorted(solver.rglob("*.py")):
        inside = path.relative_to(solver)
        if inside.parts[0] not in _LEFT_OUT:
            files[f"latin_fmu/{inside.as_posix()}"] = path.read_bytes()
    files |= {f"latin_fmu/{path.name}": path.read_bytes() for path in library.shipped()}
    files["latin_fmu/__init__.py"] = _BARE_INIT.format(latin_fmu.__version__).encode()
    here = Path(__file__).parent
    return files | {f"fmu_build/{name}": (here / name).read_bytes() for name in _ADAPTERS}


def scene_files(scene: Scene) -> Files:
    """The effective scene and its meshes; meshes get plain names beside it."""
    meshes: dict[str, str] = {}
    files: Files = {}
    substructures = {}
    for name, body in scene.substructure.items():
        if body.mesh is None:
            substructures[name] = body
            continue
        source = body.mesh.file
        if source not in meshes:
            path = scene.base_dir / source
            stem, names = f"mesh_{len(meshes) + 1}", included_files(path)
            folder = f"{stem}/" if names else ""  # a deck keeps the files it includes beside it, under their names
            meshes[source] = f"{folder}{stem}{path.suffix}"
            files[meshes[source]] = path.read_bytes()
            for include in names:
                files[f"{folder}{_beside(include, source)}"] = (path.parent / include).read_bytes()
        mesh = body.mesh.model_copy(update={"file": meshes[source]})
        substructures[name] = body.model_copy(update={"mesh": mesh})
    inside = scene.model_copy(update={"substructure": substructures})
    return {"scene.toml": inside.text().encode(), **files}


def _beside(name: str, source: str) -> str:
    """Path of an included file below the folder of its deck. Raises InputError for a file elsewhere."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name:
        raise InputError(
            [
                Problem(
                    source,
                    "includes a file outside of its folder, which cannot travel in an FMU",
                    name,
                    "a file in the folder of the deck, or below",
                    "copy the file there, or join the two",
                )
            ],
            "the FMU cannot be built",
        )
    return path.as_posix()


def content_hash(*groups: Mapping[str, bytes]) -> str:
    """Digest of names and contents."""
    digest = hashlib.sha256()
    for files in groups:
        for name in sorted(files):
            digest.update(f"{name}\0{len(files[name])}\0".encode())
            digest.update(files[name])
    return digest.hexdigest()


def external_dependencies(reduced: bool = False) -> bytes:
    """documentation/externalDependencies.txt; ``reduced``: of a reduced model."""
    program = f"{NAME} {latin_fmu.__version__}"
    inside = f"The solver ({program}) itself is inside the FMU."
    if reduced:
        inside = (
            f"The reduced model, computed when the FMU was made, and the program that runs it ({program}) are inside."
        )
    needed = (ModelExchangeAdapter if reduced else CoSimulationAdapter).needed
    return _DEPENDENCIES.format("\n".join(f"{name}>={least}" for name, least in needed.items()), inside).encode()


def with_digests(resources: Files) -> tuple[Files, str]:
    """Files of the folder ``resources`` with a list of their digests, and the token made from the list."""
    digests = {path: hashlib.sha256(content).hexdigest() for path, content in sorted(resources.items())}
    listed = json.dumps(digests, indent=0).encode()
    return {**resources, DIGESTS: listed}, token_of(listed)


def write_archive(target: str | Path, files: Mapping[str, bytes]) -> Path:
    """Write a deflated zip without dates: modelDescription.xml first, then by name; the bytes depend on ``files`` only.

    Raises ResultsError where it cannot be written; a file at ``target`` is whole or not there.
    """

    def write(draft: Path) -> None:
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for name in sorted(files, key=lambda name: (name != "modelDescription.xml", name)):
                entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.create_system = 3  # the same bytes on every system
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, files[name])

    write_whole(target, write)
    return Path(target)
