"""The files of an FMU: solver, adapter, exporter, scene, documentation; the archive. Equal input gives equal bytes."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import latin_fmu
from latin_fmu.compiled import library
from latin_fmu.results.writing import write_whole
from latin_fmu.scene.schema import Scene

from .adapter import CoSimulationAdapter, ModelExchangeAdapter
from .description import NAME

Files = dict[str, bytes]
"""Contents by path inside the archive."""

_ADAPTERS = ("__init__.py", "adapter.py")
_EXPORTERS = {"2": "pythonfmu", "3": "pythonfmu3"}
_LEFT_OUT = ("cli.py", "__main__.py", "commands", "stability", "aot")  # not run by an FMU
_BARE_INIT = '"""The solver inside an FMU; nothing is imported before it is needed."""\n\n__version__ = "{}"\n'


@dataclass(frozen=True)
class Exporter:
    """An installed exporter: its Python files and its libraries, by path below its folder."""

    name: str
    modules: Files
    libraries: Files

    @classmethod
    def installed(cls, fmi: str) -> Exporter:
        """Read the exporter for FMI "2" or "3".

        Raises ModuleNotFoundError with the command that installs it.
        """
        name = _EXPORTERS[fmi]
        spec = importlib.util.find_spec(name)
        if spec is None or spec.origin is None:
            raise ModuleNotFoundError(f"building FMI {fmi} needs {name}: pip install 'latin-fmu[fmu]'", name=name)
        folder = Path(spec.origin).parent
        modules = {path.name: path.read_bytes() for path in sorted(folder.glob("*.py")) if path.name != "__main__.py"}
        binaries = folder / "resources" / "binaries"
        built = (p for p in sorted(binaries.rglob("*")) if p.suffix in (".so", ".dll", ".dylib"))
        libraries = {path.relative_to(binaries).as_posix(): path.read_bytes() for path in built}
        return cls(name, modules, libraries)

    def binaries(self, identifier: str) -> Files:
        """Libraries of the exporter under the name of the model."""
        return {
            f"binaries/{Path(path).parent.as_posix()}/{identifier}{Path(path).suffix}": content
            for path, content in self.libraries.items()
        }

    def licences(self) -> Files:
        """Licence files of the exporter, as installed."""
        distribution = importlib.metadata.distribution(self.name)
        return {
            f"documentation/licenses/{self.name}/{Path(str(file)).name}": Path(str(file.locate())).read_bytes()
            for file in sorted(distribution.files or [], key=str)
            if Path(str(file)).name.upper().startswith(("LICENSE", "LICENCE", "COPYING", "NOTICE"))
        }


def package_files(exporter: Exporter) -> Files:
    """The root package that travels in the FMU: solver, adapters and exporter side by side."""
    files: Files = {
        "__init__.py": b'"""Solver, adapters and exporter of an FMU, under a name made from their content."""\n'
    }
    solver = Path(latin_fmu.__file__).parent
    for path in sorted(solver.rglob("*.py")):
        inside = path.relative_to(solver)
        if inside.parts[0] not in _LEFT_OUT:
            files[f"latin_fmu/{inside.as_posix()}"] = path.read_bytes()
    files |= {f"latin_fmu/{path.name}": path.read_bytes() for path in library.shipped()}
    files["latin_fmu/__init__.py"] = _BARE_INIT.format(latin_fmu.__version__).encode()
    here = Path(__file__).parent
    files |= {f"fmu_build/{name}": (here / name).read_bytes() for name in _ADAPTERS if (here / name).is_file()}
    return files | {f"{exporter.name}/{name}": content for name, content in exporter.modules.items()}


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
            meshes[source] = f"mesh_{len(meshes) + 1}{Path(source).suffix}"
            files[meshes[source]] = (scene.base_dir / source).read_bytes()
        mesh = body.mesh.model_copy(update={"file": meshes[source]})
        substructures[name] = body.model_copy(update={"mesh": mesh})
    inside = scene.model_copy(update={"substructure": substructures})
    return {"scene.toml": inside.text().encode(), **files}


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
    needed = ModelExchangeAdapter.needed if reduced else _requirements()
    return "\n".join(
        [
            "This FMU runs in the Python of its host (CPython 3.11 or newer, 64 bit), which must have these packages,",
            "installed e.g. with `pip install`:\n",
            *needed,
            f"\n{inside}\n",
        ]
    ).encode()


def _requirements() -> Sequence[str]:
    try:
        required = importlib.metadata.requires("latin-fmu") or []
    except importlib.metadata.PackageNotFoundError:  # run from a source folder
        return CoSimulationAdapter.needed
    return sorted(r for r in required if "extra ==" not in r and not r.startswith("matplotlib"))


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
