"""FMUs of a scene: co-simulation (FMI 2.0 or 3.0), and a reduced model for Model Exchange (FMI 3.0).

An FMU is written whole or not at all. Building twice gives the same bytes.
"""

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
from latin_fmu.model_exchange.equations import Equations
from latin_fmu.model_exchange.reduce import reduced_system
from latin_fmu.model_exchange.variables import names_of
from latin_fmu.scene.schema import Scene

from .contents import Exporter, Files, content_hash, external_dependencies, package_files, scene_files, write_archive
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
TOLERANCE = 1e-5  # of the integrator of a reduced model: with a smaller one the error of the reduction dominates
STEPS = 200  # suggested output intervals of a reduced model
_SPACE = uuid.UUID("7d1b3c52-6c0e-5f0a-9a43-2f4b8e1d90aa")  # of the tokens made from contents

_SCRIPT = '''\
"""Entry point of the FMU; its name is made from its content."""

from {package}.fmu_build.adapter import {adapter}
from {package}.{exporter}.fmi{fmi}slave import {slave}


class {identifier}({adapter}, {slave}):
    package = "{package}"
    held = [globals()] * 8
'''


def build_fmu(scene: Scene, target: str | Path, fmi: Fmi = "2", extra: Files | None = None) -> Path:
    """Write the FMU of a scene for co-simulation.

    Parameters
    ----------
    scene : loads with the law ``input`` become inputs. target : file to write. fmi : "2" (2.0) or "3" (3.0).
    extra : more files, by path inside the archive (the cross-check).

    Raises
    ------
    InputError : the scene cannot be built, or gives too many variables. ModuleNotFoundError : the exporter is missing.
    ResultsError : the file cannot be written.
    """
    return write_archive(target, {**fmu_files(scene, fmi), **(extra or {})})


def build_model_exchange(scene: Scene, target: str | Path, n_mode: int = 12, n_patch: int = 4) -> Path:
    """Write the FMU of a reduced model of a scene for Model Exchange.

    Parameters
    ----------
    scene : loads with the law ``input`` become inputs. target : file to write.
    n_mode : elastic modes per body. n_patch : patches per interface that may open.

    Raises
    ------
    SceneError : the scene cannot be built or has no reduced model. ModuleNotFoundError : the exporter is missing.
    ResultsError : the file cannot be written.
    """
    return write_archive(target, model_exchange_files(scene, n_mode, n_patch))


def fmu_files(scene: Scene, fmi: Fmi) -> Files:
    """Every file of the FMU for co-simulation, by path inside the archive."""
    exporter = Exporter.installed(fmi)
    scene = completed(scene)
    problem = discretise(scene).build()  # raises where the scene cannot be built
    n_point = {unit.name: unit.geometry.n_point for unit in problem.assembly.interfaces}
    table = table_of(scene, n_point if fmi == "3" else None)
    if fmi == "2" and len(table) > MAX_SCALARS:
        too_many = Problem(
            "scene", f"gives {len(table)} variables", None, f"at most {MAX_SCALARS} in FMI 2", "use FMI 3"
        )
        raise InputError([too_many], "the FMU cannot be built")
    inside = {f"scene/{path}": content for path, content in scene_files(scene).items()}
    resources = {"variables.json": table_text(table).encode(), **inside}
    scene_text = inside["scene/scene.toml"].decode()
    content = _Content(exporter, fmi, resources, scene_text)
    facts = Facts(
        model=scene.name,
        identifier=identifier_of(scene),
        token=content.token,
        table=table,
        version=latin_fmu.__version__,
        description=scene.description or f"Impact with frictional contact: {scene.name}",
        stop_time=scene.time.end,
        step_size=suggested_step(scene),
        tolerance=accuracy_of(scene.solver.tolerance),
    )
    return {
        **content.files(facts, f"Fmi{fmi}Adapter", f"Fmi{fmi}Slave"),
        "modelDescription.xml": xml_bytes((fmi2_description if fmi == "2" else fmi3_description)(facts)),
        "documentation/index.html": documentation(facts, scene_text, f"{fmi}.0").encode(),
        "documentation/externalDependencies.txt": external_dependencies(),
    }


def model_exchange_files(scene: Scene, n_mode: int, n_patch: int) -> Files:
    """Every file of the FMU for Model Exchange, by path inside the archive."""
    exporter = Exporter.installed("3")
    scene = completed(scene)
    system = reduced_system(scene, n_mode, n_patch)
    equations = Equations(system, scene.output.energy)
    names = names_of(scene, system, equations.start().tolist(), equations.nominals().tolist())
    resources: Files = {"reduced.bin": system.to_bytes(), "variables.json": names.to_text().encode()}
    content = _Content(exporter, "3", resources, scene.text())
    facts = Facts(
        model=f"{scene.name}_reduced",
        identifier=f"{identifier_of(scene)}_reduced",
        token=content.token,
        table=names.table,
        version=latin_fmu.__version__,
        description=f"Reduced model, for a cross-check: {scene.description or scene.name}",
        stop_time=scene.time.end,
        step_size=scene.time.end / STEPS,
        tolerance=TOLERANCE,
    )
    return {
        **content.files(facts, "ModelExchangeAdapter", "Fmi3SlaveBase"),
        "modelDescription.xml": xml_bytes(model_exchange_description(facts, names)),
        "documentation/index.html": model_exchange_page(facts, names, scene.text(), n_mode, n_patch).encode(),
        "documentation/externalDependencies.txt": external_dependencies(reduced=True),
    }


class _Content:
    """Program and data of an FMU, and the token made from them.

    resources : files by path inside the folder ``resources``. scene_text : shown in the documentation.
    """

    def __init__(self, exporter: Exporter, fmi: Fmi, resources: Files, scene_text: str) -> None:
        self._exporter, self._fmi, self._resources = exporter, fmi, resources
        self._package = package_files(exporter)
        self._name = f"latin_fmu_{content_hash(self._package)[:12]}"
        self._digest = content_hash(self._package, resources, {"scene": scene_text.encode(), "fmi": fmi.encode()})
        made = uuid.uuid5(_SPACE, self._digest)
        self.token = f"{{{made}}}" if fmi == "2" else str(made)

    def files(self, facts: Facts, adapter: str, slave: str) -> Files:
        """The files that all kinds of FMU share; the entry script joins an adapter to a class of the exporter."""
        exporter, module, identifier = self._exporter, f"slave_{self._digest[:16]}", facts.identifier
        script = _SCRIPT.format(
            package=self._name,
            adapter=adapter,
            exporter=exporter.name,
            fmi=self._fmi,
            slave=slave,
            identifier=identifier,
        )
        here = Path(__file__).parent
        icon = (here / "icon.png").read_bytes()
        icons = {"model.png": icon}
        if self._fmi == "3":
            icons = {
                "terminalsAndIcons/icon.png": icon,
                "terminalsAndIcons/terminalsAndIcons.xml": xml_bytes(terminals(facts)),
            }
        return {
            "resources/slavemodule.txt": module.encode(),
            f"resources/{module}.py": script.encode(),
            **{f"resources/{path}": content for path, content in self._resources.items()},
            **{f"resources/{self._name}/{path}": content for path, content in self._package.items()},
            **exporter.binaries(identifier),
            **exporter.licences(),
            "documentation/licenses/license.txt": (here / "license.txt").read_bytes(),
            **icons,
        }
