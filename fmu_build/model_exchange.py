"""A reduced model of a scene as an FMI 3.0 Model Exchange FMU."""

from __future__ import annotations

import re
from pathlib import Path

import latin_fmu
from latin_fmu.assembly.interfaces import completed
from latin_fmu.model_exchange.equations import Equations
from latin_fmu.model_exchange.reduce import reduced_system
from latin_fmu.model_exchange.system import Names, ReducedSystem
from latin_fmu.model_exchange.variables import names_of
from latin_fmu.results.files import written_whole
from latin_fmu.scene.schema import Scene

from .archive import archive
from .build import binaries, licence, token_of
from .contents import Exporter, Files, content_hash, package_files
from .facts import Facts
from .model_exchange_description import model_exchange_description
from .model_exchange_page import model_exchange_page
from .terminals import terminals
from .xml_text import xml_bytes

TOLERANCE = 1e-5  # of the integrator: beyond it the reduction is the larger error
STEPS = 200  # suggested output interval: the end of the scene over this

_SCRIPT = '''\
"""Entry point of the FMU; its name is made from its content."""

from {package}.fmu_build.model_exchange_adapter import ModelExchangeAdapter
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
    package["fmu_build/model_exchange_adapter.py"] = Path(__file__).with_name("model_exchange_adapter.py").read_bytes()
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
    script = _SCRIPT.format(package=name, exporter=exporter.name, identifier=identifier)
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
