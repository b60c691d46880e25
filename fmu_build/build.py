"""FMUs of a scene: co-simulation (FMI 2.0 or 3.0), by Python or compiled, and a reduced model for Model Exchange (3.0).

An FMU is written whole or not at all. Building twice gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import latin_fmu
from latin_fmu.assembly.build import discretise
from latin_fmu.assembly.interfaces import completed
from latin_fmu.cosim.variable import Variable, table_text
from latin_fmu.cosim.variables import table_of
from latin_fmu.errors import InputError, Problem
from latin_fmu.latin.settings import accuracy_of
from latin_fmu.model_exchange.equations import Equations
from latin_fmu.model_exchange.reduce import names_of, reduced_system
from latin_fmu.scene.schema import Scene

from . import bridge
from .compiled import compiled_run, libraries
from .contents import (
    Files,
    binaries,
    content_hash,
    external_dependencies,
    package_files,
    scene_files,
    with_digests,
    write_archive,
)
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
from .documentation import compiled_page, documentation, model_exchange_page
from .reference import reference_of

Fmi = Literal["2", "3"]
MAX_SCALARS = 2000  # more make FMI 2 hosts slow
TOLERANCE = 1e-5  # of the integrator of a reduced model: with a smaller one the error of the reduction dominates
STEPS = 200  # suggested output intervals of a reduced model


def build_fmu(
    scene: Scene, target: str | Path, fmi: Fmi = "2", extra: Files | None = None, compiled: bool = False, note: str = ""
) -> Path:
    """Write the FMU of a scene for co-simulation.

    Parameters
    ----------
    scene : loads with the law ``input`` become inputs. target : file to write. fmi : "2" (2.0) or "3" (3.0).
    extra : more files, by path inside the archive; by default those of ``reference_of``. compiled : an FMU that needs
        no Python. note : for the documentation of a compiled FMU, HTML.

    Raises
    ------
    InputError : the scene cannot be built, gives too many variables, or cannot be compiled. ModuleNotFoundError : the
        library of the FMU is missing, and a compiler too.
    ResultsError : the file cannot be written.
    """
    files = compiled_files(scene, fmi, note) if compiled else fmu_files(scene, fmi)
    more = reference_of(scene, compiled=compiled).files if extra is None else extra
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


def fmu_files(scene: Scene, fmi: Fmi) -> Files:
    """Every file of the FMU for co-simulation, by path inside the archive."""
    scene = completed(scene)
    problem = discretise(scene).build()  # raises where the scene cannot be built
    n_point = {unit.name: unit.geometry.n_point for unit in problem.assembly.interfaces}
    table = table_of(scene, n_point if fmi == "3" else None)
    _check_size(table, fmi)
    inside = {f"scene/{path}": content for path, content in scene_files(scene).items()}
    resources = {"variables.json": table_text(table).encode(), **inside}
    scene_text = inside["scene/scene.toml"].decode()
    content = _Content(fmi, "CoSimulationAdapter", resources)
    facts = _facts(scene, table, content.token)
    return {
        **content.files(facts),
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
        description=scene.description or f"Impact with frictional contact: {scene.name}",
        stop_time=scene.time.end,
        step_size=suggested_step(scene),
        tolerance=accuracy_of(scene.solver.tolerance),
        units=scene.unit_system,
    )


def _description(facts: Facts, fmi: Fmi) -> bytes:
    return xml_bytes((fmi2_description if fmi == "2" else fmi3_description)(facts))


def compiled_files(scene: Scene, fmi: Fmi, note: str = "") -> Files:
    """Every file of the compiled FMU for co-simulation, by path inside the archive; ``note`` for its documentation."""
    known = libraries()
    scene = completed(scene)
    run = compiled_run(scene, fmi)
    _check_size(run.table, fmi)
    facts = replace(_facts(scene, run.table, run.token), time_step=scene.time.time_step)
    return {
        **_shared_files(facts, fmi),
        **{
            f"binaries/{bridge.PLATFORMS[name][fmi]}/{facts.identifier}.{'dll' if 'windows' in name else 'so'}": code
            for name, code in known.items()
            if fmi in bridge.PLATFORMS[name]
        },
        "resources/image.bin": run.image,
        "resources/variables.bin": run.variables,
        "resources/results.nc": run.results,
        "modelDescription.xml": _description(facts, fmi),
        "documentation/index.html": compiled_page(facts, scene.text(), f"{fmi}.0", note).encode(),
    }


def model_exchange_files(scene: Scene, n_mode: int, n_patch: int) -> Files:
    """Every file of the FMU for Model Exchange, by path inside the archive."""
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
        description=f"Reduced model, for a cross-check: {scene.description or scene.name}",
        stop_time=scene.time.end,
        step_size=scene.time.end / STEPS,
        tolerance=TOLERANCE,
        units=scene.unit_system,
    )
    return {
        **content.files(facts),
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
        self.token = f"{{{token}}}" if fmi == "2" else token

    def files(self, facts: Facts) -> Files:
        """The files that all kinds of FMU run by Python share."""
        return {
            **{f"resources/{path}": content for path, content in self._resources.items()},
            **binaries(self._fmi, facts.identifier),
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
