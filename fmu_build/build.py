"""A scene as an FMU for co-simulation."""

from __future__ import annotations

import re
import uuid
from pathlib import Path
from typing import Literal

import latin_fmu
from latin_fmu.assembly.build import discretise
from latin_fmu.assembly.interfaces import completed
from latin_fmu.cosim.variable import table_text
from latin_fmu.cosim.variables import table_of
from latin_fmu.errors import InputError, Problem
from latin_fmu.latin.settings import accuracy_of
from latin_fmu.model_exchange.equations import Equations
from latin_fmu.model_exchange.reduce import reduced_system
from latin_fmu.model_exchange.system import Names, ReducedSystem
from latin_fmu.model_exchange.variables import names_of
from latin_fmu.results.files import written_whole
from latin_fmu.scene.schema import Scene

from .contents import Exporter, Files, archive, content_hash, external_dependencies, package_files, scene_files
from .description import (
    Facts,
    fmi2_description,
    fmi3_description,
    identifier_of,
    model_exchange_description,
    suggested_step,
    terminals,
    xml_bytes,
)
from .documentation import documentation, model_exchange_page

Fmi = Literal["2", "3"]
MAX_SCALARS = 2000  # more make FMI 2 hosts slow
_SPACE = uuid.UUID("7d1b3c52-6c0e-5f0a-9a43-2f4b8e1d90aa")  # of the tokens made from contents

_SCRIPT = '''\
"""Entry point of the FMU; its name is made from its content."""

from {package}.fmu_build.adapter import Fmi{fmi}Adapter
from {package}.{exporter}.fmi{fmi}slave import Fmi{fmi}Slave


class {identifier}(Fmi{fmi}Adapter, Fmi{fmi}Slave):
    package = "{package}"
    held = [globals()] * 8
'''


def build_fmu(scene: Scene, target: str | Path, fmi: Fmi = "2", extra: Files | None = None) -> Path:
    """Write the FMU of a scene; it is complete or not there. Building twice gives the same bytes.

    Parameters
    ----------
    scene : loads with the law ``input`` become inputs. target : file to write. fmi : "2" (2.0) or "3" (3.0).
    extra : more files, by path inside the archive (the cross-check).

    Raises
    ------
    InputError : the scene cannot be built, or gives too many variables. ModuleNotFoundError : the exporter is missing.
    ResultsError : the file cannot be written.
    """
    path = Path(target)
    content = archive({**fmu_files(scene, fmi), **(extra or {})})
    with written_whole(path) as draft:
        Path(draft).write_bytes(content)
    return path


def fmu_files(scene: Scene, fmi: Fmi) -> Files:
    """Every file of the FMU, by path inside the archive."""
    exporter = Exporter.installed(fmi)
    scene = completed(scene)
    built = discretise(scene).build()  # also shows that it can be built
    n_point = {unit.name: unit.geometry.n_point for unit in built.assembly.interfaces}
    table = table_of(scene, n_point if fmi == "3" else None)
    if fmi == "2" and len(table) > MAX_SCALARS:
        problem = Problem(
            "scene", f"gives {len(table)} variables", None, f"at most {MAX_SCALARS} in FMI 2", "use FMI 3"
        )
        raise InputError([problem], "the FMU cannot be built")
    package, inside = package_files(exporter), scene_files(scene)
    name = f"latin_fmu_{content_hash(package)[:12]}"
    variables = table_text(table).encode()
    token = content_hash(package, inside, {"variables": variables, "fmi": fmi.encode()})
    identifier = identifier_of(scene)
    facts = Facts(
        model=scene.name,
        identifier=identifier,
        token=token_of(token, fmi),
        table=table,
        version=latin_fmu.__version__,
        description=scene.description or f"Impact with frictional contact: {scene.name}",
        stop_time=scene.time.end,
        step_size=suggested_step(scene),
        tolerance=accuracy_of(scene.solver.tolerance),
    )
    script = _SCRIPT.format(package=name, fmi=fmi, exporter=exporter.name, identifier=identifier)
    slave = f"slave_{token[:16]}"
    description = (fmi2_description if fmi == "2" else fmi3_description)(facts)
    return {
        "modelDescription.xml": xml_bytes(description),
        "resources/slavemodule.txt": slave.encode(),
        f"resources/{slave}.py": script.encode(),
        "resources/variables.json": variables,
        **{f"resources/{name}/{path}": content for path, content in package.items()},
        **{f"resources/scene/{path}": content for path, content in inside.items()},
        **binaries(exporter, identifier),
        **_documents(facts, inside["scene.toml"].decode(), exporter, fmi),
    }


def token_of(digest: str, fmi: Fmi) -> str:
    """A token from a digest of the content, as the FMI writes it."""
    made = uuid.uuid5(_SPACE, digest)
    return f"{{{made}}}" if fmi == "2" else str(made)


def binaries(exporter: Exporter, identifier: str) -> Files:
    """The libraries of the exporter under the name of the model."""
    return {
        f"binaries/{Path(path).parent.as_posix()}/{identifier}{Path(path).suffix}": content
        for path, content in exporter.libraries.items()
    }


def _documents(facts: Facts, scene_text: str, exporter: Exporter, fmi: Fmi) -> Files:
    here = Path(__file__).parent
    icon = (here / "icon.png").read_bytes()
    page = documentation(facts, scene_text, f"{fmi}.0").encode()
    documents: Files = {
        "documentation/index.html": page,
        "documentation/externalDependencies.txt": external_dependencies().encode(),
        "documentation/licenses/license.txt": licence().encode(),
        **exporter.licences(),
    }
    if fmi == "2":
        return {**documents, "model.png": icon}
    return {
        **documents,
        "terminalsAndIcons/icon.png": icon,
        "terminalsAndIcons/terminalsAndIcons.xml": xml_bytes(terminals(facts)),
    }


def licence() -> str:
    """Licence of the package."""
    return (Path(__file__).parent / "license.txt").read_text(encoding="utf-8")


# -- A reduced model of a scene as an FMI 3.0 Model Exchange FMU.
TOLERANCE = 1e-5  # of the integrator: beyond it the reduction is the larger error
STEPS = 200  # suggested output interval: the end of the scene over this

_MODEL_EXCHANGE_SCRIPT = '''\
"""Entry point of the FMU; its name is made from its content."""

from {package}.fmu_build.adapter import ModelExchangeAdapter
from {package}.{exporter}.fmi3slave import Fmi3SlaveBase


class {identifier}(ModelExchangeAdapter, Fmi3SlaveBase):
    package = "{package}"
    held = [globals()] * 8
'''
_NEEDS = """\
This FMU runs in the Python of its host (CPython 3.11 or newer, 64 bit), which must have these packages,
installed e.g. with `pip install`:

numpy
pydantic

The reduced model, computed when the FMU was made, and the program that runs it ({name} {version}) are inside.
"""


def build_model_exchange(scene: Scene, target: str | Path, n_mode: int = 12, n_patch: int = 4) -> Path:
    """Write the Model Exchange FMU of a scene; it is complete or not there. Building twice gives the same bytes.

    Parameters
    ----------
    scene : loads with the law ``input`` become inputs. target : file to write.
    n_mode : elastic modes per body. n_patch : patches per interface that may open.

    Raises
    ------
    SceneError : the scene cannot be built or has no reduced model. ModuleNotFoundError : the exporter is missing.
    ResultsError : the file cannot be written.
    """
    path = Path(target)
    content = archive(model_exchange_files(scene, n_mode, n_patch))
    with written_whole(path) as draft:
        Path(draft).write_bytes(content)
    return path


def model_exchange_files(scene: Scene, n_mode: int, n_patch: int) -> Files:
    """Every file of the FMU, by path inside the archive."""
    exporter = Exporter.installed("3")
    scene = completed(scene)
    system = reduced_system(scene, n_mode, n_patch)
    names = _names(scene, system)
    package = package_files(exporter)
    name = f"latin_fmu_{content_hash(package)[:12]}"
    inside: Files = {"reduced.bin": system.to_bytes(), "variables.json": names.to_text().encode()}
    token = content_hash(package, inside, {"scene": scene.text().encode()})
    identifier = re.sub(r"\W", "_", scene.name) + "_reduced"
    facts = Facts(
        model=f"{scene.name}_reduced",
        identifier=identifier,
        token=token_of(token, "3"),
        table=names.table,
        version=latin_fmu.__version__,
        description=f"Reduced model, for a cross-check: {scene.description or scene.name}",
        stop_time=scene.time.end,
        step_size=scene.time.end / STEPS,
        tolerance=TOLERANCE,
    )
    script = _MODEL_EXCHANGE_SCRIPT.format(package=name, exporter=exporter.name, identifier=identifier)
    slave = f"slave_{token[:16]}"
    here = Path(__file__).parent
    return {
        "modelDescription.xml": xml_bytes(model_exchange_description(facts, names)),
        "resources/slavemodule.txt": slave.encode(),
        f"resources/{slave}.py": script.encode(),
        **{f"resources/{path}": content for path, content in inside.items()},
        **{f"resources/{name}/{path}": content for path, content in package.items()},
        **binaries(exporter, identifier),
        "documentation/index.html": model_exchange_page(facts, names, scene.text(), n_mode, n_patch).encode(),
        "documentation/externalDependencies.txt": _NEEDS.format(
            name="latin_fmu", version=latin_fmu.__version__
        ).encode(),
        "documentation/licenses/license.txt": licence().encode(),
        **exporter.licences(),
        "terminalsAndIcons/icon.png": (here / "icon.png").read_bytes(),
        "terminalsAndIcons/terminalsAndIcons.xml": xml_bytes(terminals(facts)),
    }


def _names(scene: Scene, system: ReducedSystem) -> Names:
    equations = Equations(system, scene.output.energy)
    return names_of(scene, system, equations.start().tolist(), equations.nominals().tolist())
