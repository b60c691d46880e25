"""FMUs of a scene: co-simulation (FMI 2.0 or 3.0), by Python or compiled, and a reduced model for Model Exchange (3.0);
their files: solver, adapter, libraries, scene, documentation.

An FMU is written whole or not at all. Building twice gives the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Literal

import latin_fmu
from latin_fmu.arithmetic import computable
from latin_fmu.assembly.interfaces import completed
from latin_fmu.compiled import library
from latin_fmu.cosim import c_runtime
from latin_fmu.cosim.variable import Variable
from latin_fmu.errors import InputError, Problem, listed
from latin_fmu.latin.settings import accuracy_of
from latin_fmu.mesh_files.formats import suffix_of
from latin_fmu.mesh_files.reading import included_files
from latin_fmu.model_exchange.equations import Equations
from latin_fmu.model_exchange.reduce import names_of, reduced_system
from latin_fmu.results.writing import write_whole
from latin_fmu.scene.schema import Scene

from . import bridge
from .adapter import DIGESTS, CoSimulationAdapter, ModelExchangeAdapter, token_of
from .compiled import compiled_run, hosted_run, libraries
from .description import (
    NAME,
    Facts,
    compiled_page,
    documentation,
    fmi2_description,
    fmi3_description,
    identifier_of,
    model_exchange_description,
    model_exchange_page,
    suggested_step,
    terminals,
    xml_bytes,
)
from .reference import reference_of

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


def binaries(fmi: str, identifier: str, kind: bridge.Kind) -> Files:
    """Libraries of a kind of all platforms there are, under the name of the model; for co-simulation of those whose
    kernels travel, too.

    Raises
    ------
    InputError : there is no such platform. ModuleNotFoundError : with the command that installs what is missing.
    """
    there = bridge.libraries(kind)
    if kind == "maker":
        of_kernels = {name.removesuffix(library.PORTABLE) for name in library.shipped()}
        there = {name: path for name, path in there.items() if name in of_kernels}
    files = {
        f"binaries/{bridge.PLATFORMS[target][fmi]}/{identifier}{path.suffix}": path.read_bytes()
        for target, path in sorted(there.items())
        if fmi in bridge.PLATFORMS[target]
    }
    if not files:
        what, allowed = "has no platform for which there are libraries here", listed(bridge.PLATFORMS)
        remedy = "use FMI 3, or, in a source tree, run: python -m latin_fmu.aot linux-x86_64"
        raise InputError.of("the FMU cannot be built", f"FMI {fmi}", what, listed(there), allowed, remedy)
    return files


def package_files() -> Files:
    """The root package that travels in the FMU: solver and adapters side by side."""
    files: Files = {"__init__.py": b'"""Solver and adapters of an FMU, under a name made from their content."""\n'}
    solver = Path(latin_fmu.__file__).parent
    for path in sorted(solver.rglob("*.py")):
        inside = path.relative_to(solver)
        if inside.parts[0] not in _LEFT_OUT:
            files[f"latin_fmu/{inside.as_posix()}"] = path.read_bytes()
    # the library is recognised by them, and made of them where there is none for a machine
    files |= {f"latin_fmu/cosim/runtime/{path.name}": path.read_bytes() for path in c_runtime.sources()}
    files |= {f"latin_fmu/{path.name}": path.read_bytes() for path in library.shipped().values()}
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
            # a deck keeps the files it includes beside it, under their names
            if names:
                folder = f"{stem}/"
            else:
                folder = ""
            meshes[source] = f"{folder}{stem}{suffix_of(path)}"
            files[meshes[source]] = path.read_bytes()
            for include in names:
                files[f"{folder}{_beside(include, source)}"] = (path.parent / include).read_bytes()
        mesh = body.mesh.model_copy(update={"file": meshes[source]})
        substructures[name] = body.model_copy(update={"mesh": mesh})
    # a folder of operators belongs to the machine of the scene: an FMU writes nowhere
    solver = scene.solver.model_copy(update={"operators": None})
    inside = scene.model_copy(update={"substructure": substructures, "solver": solver})
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
        for name in sorted(files):  # without it names and contents could be exchanged at their border
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
                # the earliest date that a zip can hold
                entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.create_system = 3  # the same bytes on every system
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, files[name])

    write_whole(target, write)
    return Path(target)


Fmi = Literal["2", "3"]
MAX_SCALARS = 2000  # more make FMI 2 hosts slow
TOLERANCE = 1e-5  # of the integrator of a reduced model: with a smaller one the error of the reduction dominates
STEPS = 200  # suggested output intervals of a reduced model


def build_fmu(
    scene: Scene, target: str | Path, fmi: Fmi = "2", extra: Files | None = None, python: bool = False
) -> Path:
    """Write the FMU of a scene for co-simulation.

    Parameters
    ----------
    scene : loads with the law ``input`` become inputs. target : file to write. fmi : "2" (2.0) or "3" (3.0).
    extra : more files, by path inside the archive; by default those of ``reference_of``. python : an FMU that solves
        the scene by a Python of its host; by default it needs none.

    Raises
    ------
    InputError : the scene cannot be built, gives too many variables, or there are no libraries for the FMU;
    NeedsPythonError : it cannot be compiled.
    SolverError : a matrix is singular, numbers overflow.
    ModuleNotFoundError : the library of an FMU with Python is missing, and a compiler too.
    ResultsError : the file cannot be written.
    """
    if python:
        files = fmu_files(scene, fmi)
    else:
        files = compiled_files(scene, fmi)
    if extra is None:
        more = reference_of(scene).files
    else:
        more = extra
    return write_archive(target, {**files, **more})


def build_model_exchange(scene: Scene, target: str | Path, n_mode: int = 12, n_patch: int = 4) -> Path:
    """Write the FMU of a reduced model of a scene for Model Exchange.

    Parameters
    ----------
    scene : loads with the law ``input`` become inputs. target : file to write.
    n_mode : elastic modes per body. n_patch : patches per interface that may open.

    Raises
    ------
    SceneError : the scene cannot be built or has no reduced model. ModuleNotFoundError : the library of the FMU is
        missing, and a compiler too.
    ResultsError : the file cannot be written.
    """
    return write_archive(target, model_exchange_files(scene, n_mode, n_patch))


@computable()
def fmu_files(scene: Scene, fmi: Fmi) -> Files:
    """Every file of the FMU for co-simulation, by path inside the archive."""
    scene = completed(scene)
    run = hosted_run(scene, fmi)  # raises where the scene cannot be built
    _check_size(run.table, fmi)
    inside = {f"scene/{path}": content for path, content in scene_files(scene).items()}
    resources = {"variables.bin": run.variables, "results.nc": run.results, **inside}
    scene_text = inside["scene/scene.toml"].decode()
    content = _Content(fmi, "CoSimulationAdapter", resources)
    facts = _facts(scene, run.table, content.token)
    return {
        **content.files(facts, "maker"),
        "modelDescription.xml": _description(facts, fmi),
        "documentation/index.html": documentation(facts, scene_text, f"{fmi}.0").encode(),
        "documentation/externalDependencies.txt": external_dependencies(),
    }


def _check_size(table: Sequence[Variable], fmi: Fmi) -> None:
    if fmi == "2" and len(table) > MAX_SCALARS:
        too_many = Problem(
            "scene", f"gives {len(table)} variables", None, f"at most {MAX_SCALARS} in FMI 2", "use FMI 3"
        )
        raise InputError([too_many], "the FMU cannot be built")


def _facts(scene: Scene, table: Sequence[Variable], token: str) -> Facts:
    return Facts(
        model=scene.name,
        identifier=identifier_of(scene),
        token=token,
        table=table,
        version=latin_fmu.__version__,
        labels=scene.fmu,
        description=scene.fmu.description or scene.description or f"Impact with frictional contact: {scene.name}",
        stop_time=scene.time.end,
        step_size=suggested_step(scene),
        tolerance=accuracy_of(scene.solver.tolerance),
        units=scene.unit_system,
    )


def _description(facts: Facts, fmi: Fmi) -> bytes:
    return xml_bytes((fmi2_description if fmi == "2" else fmi3_description)(facts))


@computable()
def compiled_files(scene: Scene, fmi: Fmi, note: str = "", portable: bool = False) -> Files:
    """Every file of the compiled FMU for co-simulation, by path inside the archive; ``note`` for its documentation.
    portable : without AVX2.

    Raises
    ------
    NeedsPythonError : the scene cannot be compiled; InputError : it cannot be built, or not here.
    """
    fit = {name: code for name, code in libraries(portable).items() if fmi in bridge.PLATFORMS[name]}
    if not fit:
        remedy = "use FMI 3, or, in a source tree, run: python -m latin_fmu.aot linux-x86_64 windows-x86_64"
        problem = Problem("FMI", "has no platform for the libraries that are here", fmi, None, remedy)
        raise InputError([problem], "the FMU cannot be compiled")
    scene = completed(scene)
    run = compiled_run(scene, fmi)
    _check_size(run.table, fmi)
    facts = replace(_facts(scene, run.table, run.token), time_step=scene.time.time_step)
    return {
        **_shared_files(facts, fmi),
        **{
            f"binaries/{bridge.PLATFORMS[name][fmi]}/{facts.identifier}{library.suffix(name)}": code
            for name, code in fit.items()
        },
        "resources/image.bin": run.image,
        "resources/variables.bin": run.variables,
        "resources/results.nc": run.results,
        "modelDescription.xml": _description(facts, fmi),
        "documentation/index.html": compiled_page(facts, scene.text(), f"{fmi}.0", note).encode(),
    }


def model_exchange_files(scene: Scene, n_mode: int, n_patch: int) -> Files:
    """Every file of the FMU for Model Exchange, by path inside the archive."""
    if scene.fmu.parameters:
        what, remedy = "the reduced model is made for the numbers of the scene", "export an FMU for co-simulation"
        asked = ", ".join(scene.fmu.parameters)
        raise InputError.of("the FMU cannot be made", "fmu.parameters", what, asked, remedy=remedy)
    scene = completed(scene)
    system = reduced_system(scene, n_mode, n_patch)
    equations = Equations(system, scene.output.energy)
    names = names_of(scene, system, equations.start().tolist(), equations.nominals().tolist())
    resources: Files = {"reduced.bin": system.to_bytes(), "variables.json": names.to_text().encode()}
    content = _Content("3", "ModelExchangeAdapter", resources)
    facts = Facts(
        model=f"{scene.name}_reduced",
        identifier=f"{identifier_of(scene)}_reduced",
        token=content.token,
        table=names.table,
        version=latin_fmu.__version__,
        labels=scene.fmu,
        description=f"Reduced model, for a cross-check: {scene.fmu.description or scene.description or scene.name}",
        stop_time=scene.time.end,
        step_size=scene.time.end / STEPS,
        tolerance=TOLERANCE,
        units=scene.unit_system,
    )
    return {
        **content.files(facts, "exchange"),
        "modelDescription.xml": xml_bytes(model_exchange_description(facts, names)),
        "documentation/index.html": model_exchange_page(facts, names, scene.text(), n_mode, n_patch).encode(),
        "documentation/externalDependencies.txt": external_dependencies(reduced=True),
    }


class _Content:
    """Program and data of an FMU, and the token made from them.

    adapter : name of the class that takes the calls of the host. resources : files by path inside ``resources``.
    """

    def __init__(self, fmi: Fmi, adapter: str, resources: Files) -> None:
        self._fmi = fmi
        package = package_files()
        name = f"latin_fmu_{content_hash(package)[:12]}"
        self._resources, token = with_digests(
            {
                "entry.txt": f"{name} {adapter}\n".encode(),
                "version.txt": f"FMI {fmi}\n".encode(),  # FMUs of one scene for two versions are two FMUs
                **resources,
                **{f"{name}/{path}": content for path, content in package.items()},
            }
        )
        # FMI 2 calls it a GUID, which is written in braces
        if fmi == "2":
            self.token = f"{{{token}}}"
        else:
            self.token = token

    def files(self, facts: Facts, kind: bridge.Kind) -> Files:
        """The files that all kinds of FMU run by Python share."""
        return {
            **{f"resources/{path}": content for path, content in self._resources.items()},
            **binaries(self._fmi, facts.identifier, kind),
            **_shared_files(facts, self._fmi),
        }


def _shared_files(facts: Facts, fmi: Fmi) -> Files:
    """Licence, icon and terminals."""
    here = Path(__file__).parent
    icon = (here / "icon.png").read_bytes()
    icons = {"model.png": icon}
    if fmi == "3":
        icons = {
            "terminalsAndIcons/icon.png": icon,
            "terminalsAndIcons/terminalsAndIcons.xml": xml_bytes(terminals(facts)),
        }
    return {"documentation/licenses/license.txt": (here / "license.txt").read_bytes(), **icons}
