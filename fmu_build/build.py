"""A scene as an FMU for co-simulation."""

from __future__ import annotations

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
from latin_fmu.results.files import written_whole
from latin_fmu.scene.schema import Scene

from .archive import archive
from .contents import Exporter, Files, content_hash, external_dependencies, package_files, scene_files
from .documentation import documentation
from .facts import Facts, identifier_of, suggested_step
from .fmi2_description import fmi2_description
from .fmi3_description import fmi3_description
from .terminals import terminals
from .xml_text import xml_bytes

Fmi = Literal["2", "3"]
MAX_SCALARS = 2000  # more make FMI 2 hosts slow
_SPACE = uuid.UUID("7d1b3c52-6c0e-5f0a-9a43-2f4b8e1d90aa")  # of the tokens made from contents

_SCRIPT = '''\
"""Entry point of the FMU; its name is made from its content."""

from {package}.fmu_build.fmi{fmi} import Fmi{fmi}Adapter
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
