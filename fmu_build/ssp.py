"""System structure (.ssp, SSP 1.0): FMUs and their connections in one file."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, fromstring

from .contents import write_archive
from .description import xml_bytes

Connection = tuple[str, str, str, str]
"""Component and variable it comes from, component and variable it goes to."""

_SSP = "http://ssp-standard.org/SSP1"
_SSD, _SSC = f"{_SSP}/SystemStructureDescription", f"{_SSP}/SystemStructureCommon"


def write_ssp(
    target: str | Path, name: str, components: Mapping[str, str | Path], connections: Sequence[Connection], stop: float
) -> Path:
    """Write a system structure package; connected variables become connectors.

    components : FMUs by name. stop : end of the default experiment, s.

    Raises ResultsError where the file cannot be written, KeyError for a variable that its FMU does not have.
    """
    names = {"xmlns:ssd": _SSD, "xmlns:ssc": _SSC, "version": "1.0", "name": name}
    root = Element("ssd:SystemStructureDescription", names)
    system = SubElement(root, "ssd:System", {"name": name})
    elements = SubElement(system, "ssd:Elements")
    files: dict[str, bytes] = {}
    for component, path in components.items():
        source = f"resources/{component}.fmu"
        files[source] = Path(path).read_bytes()
        element = SubElement(
            elements, "ssd:Component", {"name": component, "type": "application/x-fmu-sharedlibrary", "source": source}
        )
        connectors = SubElement(element, "ssd:Connectors")
        causalities = _causalities(Path(path))
        for variable in _connected(component, connections):
            connector = SubElement(connectors, "ssd:Connector", {"name": variable, "kind": causalities[variable]})
            SubElement(connector, "ssc:Real")
    lines = SubElement(system, "ssd:Connections")
    for first, output, second, given in connections:
        ends = {"startElement": first, "startConnector": output, "endElement": second, "endConnector": given}
        SubElement(lines, "ssd:Connection", ends)
    SubElement(root, "ssd:DefaultExperiment", {"startTime": "0.0", "stopTime": repr(stop)})
    files["SystemStructure.ssd"] = xml_bytes(root)
    return write_archive(target, files)


def _connected(component: str, connections: Sequence[Connection]) -> list[str]:
    return list(dict.fromkeys(v for c in connections for n, v in ((c[0], c[1]), (c[2], c[3])) if n == component))


def _causalities(fmu: Path) -> dict[str, str]:
    with zipfile.ZipFile(fmu) as content:
        description = fromstring(content.read("modelDescription.xml"))
    variables = description.find("ModelVariables")
    assert variables is not None
    return {str(v.get("name")): str(v.get("causality", "local")) for v in variables}
