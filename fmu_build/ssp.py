"""System structure (.ssp): FMUs, their connections and their parameters in one file, valid in SSP 1.0 and in 2.0.

The annotations of type ``org.openmodelica`` name the master of OMSimulator, which refuses a file without them: as an
element for its version 2, as attributes for its version 3, which reads no FMI 3 with structural parameters (give it
FMI 2). Other tools pass them over.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, fromstring

from latin_fmu.errors import InputError, Problem

from .build import write_archive
from .description import xml_bytes
from .parameter_set import NAMESPACES, Row, add_units, parameter_set

Connection = tuple[str, str, str, str]
"""Component and variable it comes from, component and variable it goes to."""

_NAMESPACES = {
    **NAMESPACES,
    "xmlns:oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
_MASTER, _TOLERANCE = "oms-ma", "0.0001"  # fixed steps
_DEFAULT_MASTER = "oms_ma_default"  # of OMSimulator 3, for components that name none
_INTEGERS = ("Integer", "Int32", "UInt64", "Int64")


def write_ssp(
    target: str | Path,
    name: str,
    components: Mapping[str, str | Path],
    connections: Sequence[Connection],
    stop: float,
    parameters: Mapping[str, Mapping[str, float | int | str]] | None = None,
    step: float | None = None,
) -> Path:
    """Write a system structure package; scalar outputs and connected inputs become connectors with units.

    Parameters
    ----------
    name : of the system, an identifier. components : FMUs by name, identifiers. stop : end of the experiment, s.
    parameters : start values of parameters and inputs by component; each becomes a parameter set (.ssv) with units.
    step : communication step, s; a fiftieth of ``stop`` where None.

    Raises
    ------
    InputError : a name that is no identifier; a component, or a variable of one, that is not there; a value of another
        kind than its variable. ResultsError : the file cannot be written.
    """
    models = {component: _Component(component, Path(path)) for component, path in components.items()}
    _check(name, models, connections, parameters or {})
    root = Element("ssd:SystemStructureDescription", {**_NAMESPACES, "version": "1.0", "name": name})
    system = SubElement(root, "ssd:System", {"name": name})
    elements = SubElement(system, "ssd:Elements")
    files: dict[str, bytes] = {}
    used: dict[str, Element] = {}
    for component, model in models.items():
        files[f"resources/{component}.fmu"] = Path(components[component]).read_bytes()
        about = {"name": component, "type": "application/x-fmu-sharedlibrary", "source": f"resources/{component}.fmu"}
        element = SubElement(elements, "ssd:Component", {**about, "implementation": "CoSimulation"})
        # an input without connection keeps its start value; as a connector FMPy would not read the system
        taken = {end for _, _, second, end in connections if second == component}
        connectors = {name: kind for name, kind in model.connectors.items() if kind == "output" or name in taken}
        places = [SubElement(element, "ssd:Connectors")] if connectors else []
        for variable, causality in connectors.items():
            connector = SubElement(places[0], "ssd:Connector", {"name": variable, "kind": causality})
            kind, unit = model.type_of(variable, used)
            SubElement(connector, f"ssc:{kind}", unit)
        if values := (parameters or {}).get(component):
            source = f"resources/{component}.ssv"
            files[source] = _parameter_set(component, model, values)
            SubElement(SubElement(element, "ssd:ParameterBindings"), "ssd:ParameterBinding", {"source": source})
    lines = [SubElement(system, "ssd:Connections")] if connections else []
    for first, output, second, target_input in connections:
        ends = {"startElement": first, "startConnector": output, "endElement": second, "endConnector": target_input}
        SubElement(lines[0], "ssd:Connection", ends)
    size = repr(stop / 50 if step is None else float(step))
    about = {"name": _DEFAULT_MASTER, "method": _MASTER.replace("-", "_"), "fixedStepSize": size}
    master = {
        "description": _MASTER,
        "stepSize": size,
        "absoluteTolerance": _TOLERANCE,
        "relativeTolerance": _TOLERANCE,
    }
    SubElement(_annotated(system, about), "oms:FixedStepMaster", master)
    add_units(root, "ssd:Units", used.values())
    experiment = SubElement(root, "ssd:DefaultExperiment", {"startTime": "0.0", "stopTime": repr(stop)})
    recorded = {"resultFile": f"{name}_res.mat", "loggingInterval": "0.0", "bufferSize": "10", "signalFilter": ".*"}
    _annotated(experiment, recorded)
    files["SystemStructure.ssd"] = xml_bytes(root)
    return write_archive(target, files)


_MOST_XML = 200_000_000  # bytes


class _Component:
    """Variables and units of an FMU, by name."""

    def __init__(self, name: str, fmu: Path) -> None:
        try:
            with zipfile.ZipFile(fmu) as content:
                if (size := content.getinfo("modelDescription.xml").file_size) > _MOST_XML:
                    raise zipfile.BadZipFile(f"modelDescription.xml would unpack to {size} bytes")
                description = fromstring(content.read("modelDescription.xml"))
        except (OSError, KeyError, zipfile.BadZipFile) as error:
            raise InputError([Problem(f"component {name}", f"{fmu}: not an FMU ({error})")], _HEADING) from None
        self.variables = {str(v.get("name")): v for v in description.iterfind("ModelVariables/*")}
        self._units = {str(u.get("name")): u for u in description.iterfind("UnitDefinitions/Unit")}

    def kind_of(self, variable: str) -> str:
        """Type of a variable in SSP: Real, Integer or String, which both versions have."""
        # in FMI 2 the type is an element within the variable, in FMI 3 the variable itself
        element = self.variables[variable]
        if element.tag == "ScalarVariable":
            kind = element[0].tag
        else:
            kind = element.tag
        if kind in _INTEGERS:
            return "Integer"
        if kind == "String":
            return "String"
        return "Real"

    def type_of(self, variable: str, used: dict[str, Element]) -> tuple[str, dict[str, str]]:
        """Type of a variable, and its unit, which is added to those used."""
        element, kind = self.variables[variable], self.kind_of(variable)
        unit = (element[0] if element.tag == "ScalarVariable" else element).get("unit")
        if kind != "Real" or unit is None:
            return kind, {}
        used[unit] = self._units[unit]
        return kind, {"unit": unit}

    @property
    def connectors(self) -> dict[str, str]:
        """Causality of the scalar inputs and outputs, by name."""
        causality = {name: str(v.get("causality", "local")) for name, v in self.variables.items()}
        scalar = {name for name, v in self.variables.items() if v.find("Dimension") is None}
        return {name: kind for name, kind in causality.items() if kind in ("input", "output") and name in scalar}


def _annotated(parent: Element, about: Mapping[str, str]) -> Element:
    """The information of OMSimulator about a system or an experiment."""
    annotation = SubElement(SubElement(parent, "ssd:Annotations"), "ssc:Annotation", {"type": "org.openmodelica"})
    return SubElement(SubElement(annotation, "oms:Annotations"), "oms:SimulationInformation", dict(about))


def _parameter_set(name: str, model: _Component, values: Mapping[str, float | int | str]) -> bytes:
    """The parameter set of a component as .ssv."""
    rows, used = list[Row](), dict[str, Element]()
    for variable, value in values.items():
        kind, about = model.type_of(variable, used)
        rows.append((variable, kind, value, about.get("unit")))
    return parameter_set(name, rows, used.values())


_HEADING = "the system structure cannot be written"


def _check(
    name: str,
    models: Mapping[str, _Component],
    connections: Sequence[Connection],
    parameters: Mapping[str, Mapping[str, float | int | str]],
) -> None:
    """Compare names and values with the FMUs. Raises InputError; all problems are listed."""
    problems = [
        Problem(f"{what} {word!r}", "is not an identifier", None, "letters, digits and _, no digit first")
        for what, word in [("system", name), *(("component", component) for component in models)]
        if not (word.isidentifier() and word.isascii())
    ]
    ends = [pair for c in connections for pair in ((c[0], c[1]), (c[2], c[3]))]
    ends += [(component, variable) for component, values in parameters.items() for variable in values]
    for component, variable in dict.fromkeys(ends):
        if component not in models:
            problems.append(Problem(f"{component}.{variable}", "no such component", None, ", ".join(models) or "none"))
        elif variable not in models[component].variables:
            problems.append(Problem(f"{component}.{variable}", "the FMU has no variable of this name"))
    for first, start, second, end in connections:
        for component, variable, kind in ((first, start, "output"), (second, end, "input")):
            if component in models and models[component].connectors.get(variable, kind) != kind:
                problems.append(Problem(f"{component}.{variable}", f"is no {kind}, where a connection has one"))
    for component, values in parameters.items():
        for variable, value in values.items():
            if component in models and variable in models[component].variables:
                kind = models[component].kind_of(variable)
                fits = {"Real": (float, int), "Integer": (int,), "String": (str,)}[kind]
                # a bool is an int of Python
                if not isinstance(value, fits) or isinstance(value, bool):
                    problems.append(Problem(f"{component}.{variable}", "is of another kind", repr(value), kind))
    if problems:
        raise InputError(problems, _HEADING)
