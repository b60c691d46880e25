"""Validation of an FMU: fmpy, the XML schemas, and ``fmutool`` where it is installed. All problems are listed."""

from __future__ import annotations

import io
import shutil
import subprocess
import zipfile
from importlib import util
from pathlib import Path

_SCHEMAS = {"2.0": "fmi2/fmi2ModelDescription.xsd", "3.0": "fmi3/fmi3ModelDescription.xsd"}
_TERMINALS = "fmi3/fmi3TerminalsAndIcons.xsd"


def validate(fmu: str | Path) -> list[str]:
    """Problems of an FMU; empty where there are none.

    Raises ModuleNotFoundError without fmpy and lxml (``pip install 'latin-fmu[fmu]'``).
    """
    from fmpy.validation import validate_fmu

    found = [f"fmpy: {problem}" for problem in validate_fmu(str(fmu))]
    return found + schema_problems(fmu)


def schema_problems(fmu: str | Path) -> list[str]:
    """What the schemas of the standard say about modelDescription.xml and terminalsAndIcons.xml."""
    from lxml import etree

    spec = util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("validation needs fmpy: pip install 'latin-fmu[fmu]'", name="fmpy")
    schemas = Path(spec.origin).parent / "schema"
    found = []
    with zipfile.ZipFile(fmu) as archive:
        description = archive.read("modelDescription.xml")
        version = str(etree.fromstring(description).get("fmiVersion"))
        checks = {"modelDescription.xml": _SCHEMAS[version]}
        if "terminalsAndIcons/terminalsAndIcons.xml" in archive.namelist():
            checks["terminalsAndIcons/terminalsAndIcons.xml"] = _TERMINALS
        for name, schema in checks.items():
            validator = etree.XMLSchema(etree.parse(schemas / schema))
            validator.validate(etree.parse(io.BytesIO(archive.read(name))))
            found += [f"{name}: line {e.line}: {e.message}" for e in validator.error_log]
    return found


def fmutool_report(fmu: str | Path, tool: str = "fmutool") -> str | None:
    """Output of ``fmutool -check``; None where it is not installed."""
    found = shutil.which(tool)
    if found is None:
        return None
    done = subprocess.run(
        [found, "-input", str(fmu), "-check"], capture_output=True, text=True, check=False, timeout=120
    )
    return done.stdout + done.stderr
