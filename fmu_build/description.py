"""Descriptions of an FMU: modelDescription.xml (FMI 2.0, 3.0, Model Exchange), terminalsAndIcons.xml and
documentation/index.html (what it is, how it is used, its variables, its scene).

They carry no date: equal contents give equal bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from math import prod
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from latin_fmu.cosim.variable import UNITS, Variable
from latin_fmu.model_exchange.equations import Local, Names
from latin_fmu.scene.schema import Scene
from latin_fmu.scene.settings import Fmu
from latin_fmu.scene.unit_texts import GRAVITY
from latin_fmu.scene.units import ACCELERATION, SI, UnitSystem, unit_text

NAME = "latin_fmu"
LOG_CATEGORIES = {
    "logAll": "All messages",
    "logStatusWarning": "Settings that were adjusted, inputs that have no effect",
    "logStatusDiscard": "Steps that were not made, where a shorter one or another input may help: why, and what to do",
    "logStatusError": "Initialization that failed, steps that cannot be made, states that cannot be used",
    "logStatusFatal": "Nothing can be done any more",
}


@dataclass(frozen=True)
class Facts:
    """Facts of one FMU.

    Attributes
    ----------
    model : name of the model, that of the scene. identifier : name of the binaries. token : digest of the content.
    description : text. stop_time, step_size : of the default experiment, s. tolerance : relative accuracy that
    belongs to the tolerance of the scene. table : the variables; their order is the value reference.
    units : of the scene; hosts convert them by the factors of the description.
    version : of the package. labels : author, version, copyright and licence of the model, absent where empty.
    time_step : of a compiled FMU, which needs no Python, s; None for others.
    """

    model: str
    identifier: str
    token: str
    description: str
    version: str
    stop_time: float
    step_size: float
    tolerance: float
    table: Sequence[Variable]
    labels: Fmu
    time_step: float | None = None
    units: UnitSystem = SI

    def unit_name(self, unit: str) -> str:
        """What the FMI calls a unit of the table (UDUNITS, SI) in the units of the scene."""
        return unit_name(self.units, unit)

    def references(self) -> dict[str, int]:
        """Value reference by name."""
        return {variable.name: number for number, variable in enumerate(self.table)}


def unit_name(units: UnitSystem, unit: str) -> str:
    """What the FMI calls a unit of SI (UDUNITS) in a system of units."""
    if units.name == SI.name:
        return UNITS[unit].name
    return unit_text(units.label(unit)).replace(" ", ".") or "1"


def unit_definitions(units: UnitSystem, used: Iterable[str | None]) -> list[Element]:
    """Definitions of units of SI (UDUNITS), of those of the table, in a system of units; each name once."""
    wanted, defined = set(used), dict[str, Element]()
    for key, unit in UNITS.items():
        name = unit_name(units, key)
        # of another system two units of the table may have one name
        if key not in wanted or name in defined:
            continue
        defined[name] = Element("Unit", {"name": name})
        if units.measurable:
            base = {base: str(power) for base, power in unit.exponents.items()}
            size = units.size(key)
            SubElement(defined[name], "BaseUnit", base | ({} if size == 1.0 else {"factor": repr(size)}))
            if key == ACCELERATION:
                SubElement(defined[name], "DisplayUnit", {"name": "g", "factor": repr(size / GRAVITY)})
    return [*defined.values()]


def identifier_of(scene: Scene) -> str:
    """The name of the scene as one word: of the binaries and the files of the reference run."""
    return re.sub(r"\W", "_", scene.name)


def suggested_step(scene: Scene) -> float:
    """Suggested communication step, s: about a fiftieth of the interval, a whole number of time steps."""
    n = scene.time.n_step
    parts = next((p for p in range(min(50, n), 0, -1) if n % p == 0), 1)
    return scene.time.end / parts


def xml_bytes(root: Element) -> bytes:
    """The document as indented UTF-8; equal trees give equal bytes."""
    indent(root)
    text: bytes = tostring(root, encoding="utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text + b"\n"


def _text(value: float | int | str) -> str:
    """A value with all its digits."""
    # float(): the repr of a number of NumPy is "np.float64(1.0)"
    if isinstance(value, float):
        return repr(float(value))
    return str(value)


def _root(facts: Facts, fmi: str, kind: str, abilities: dict[str, str], units: Iterable[str | None] = ()) -> Element:
    """The description up to its variables: kind of FMU, units of the table and ``units``, log, default experiment."""
    if fmi == "2.0":
        token = "guid"
    else:
        token = "instantiationToken"
    about = facts.labels
    labels = {"author": about.author, "version": about.version, "copyright": about.copyright, "license": about.licence}
    description = {
        "fmiVersion": fmi,
        "modelName": facts.model,
        token: facts.token,
        "description": facts.description,
        **{name: text for name, text in labels.items() if text},
        "generationTool": f"{NAME} {facts.version}",
        "variableNamingConvention": "structured",
    }
    root = Element("fmiModelDescription", description)
    if facts.time_step is None:
        needs_tool = "true"
    else:
        needs_tool = "false"
    shared = {"needsExecutionTool": needs_tool, "canBeInstantiatedOnlyOncePerProcess": "false"}
    SubElement(root, kind, {"modelIdentifier": facts.identifier, **shared, **abilities})
    definitions = SubElement(root, "UnitDefinitions")
    definitions.extend(unit_definitions(facts.units, (*(variable.unit for variable in facts.table), *units)))
    categories = SubElement(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        SubElement(categories, "Category", {"name": name, "description": meaning})
    numbers = {"stopTime": facts.stop_time, "tolerance": facts.tolerance, "stepSize": facts.step_size}
    experiment = {"startTime": "0.0", **{key: repr(number) for key, number in numbers.items()}}
    SubElement(root, "DefaultExperiment", experiment)
    return root


def _identity(variable: Variable, reference: int) -> dict[str, str]:
    """Attributes of a variable that FMI 2 and FMI 3 share, without those of its values."""
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
    }
    if variable.causality == "output":
        return {**attributes, "initial": "calculated"}
    return attributes


def _values(variable: Variable, facts: Facts) -> dict[str, str]:
    """Attributes of the values of a variable: unit, range, nominal, start."""
    attributes = {}
    if variable.kind == "real" and variable.unit is not None:
        attributes["unit"] = facts.unit_name(variable.unit)
        if variable.unit == ACCELERATION and facts.units.in_g:
            attributes["displayUnit"] = "g"
    for key, value in (("min", variable.minimum), ("max", variable.maximum), ("nominal", variable.nominal)):
        if value is not None:
            attributes[key] = _text(float(value) if variable.kind == "real" else int(value))
    if variable.start is not None:
        attributes["start"] = _text(variable.start)
    return attributes


def _initial_dependencies(variable: Variable, places: dict[str, int]) -> str:
    """Variables an output depends on at initialization, by the numbers the version of the FMI uses."""
    return " ".join(str(places[name]) for name in variable.initial_dependencies)


def _dependencies(variable: Variable, table: Sequence[Variable], places: dict[str, int]) -> str:
    """Inputs that an output at the end of a step depends on, likewise: those of its directional derivatives."""
    if not variable.follows_inputs:
        return ""
    return " ".join(str(places[other.name]) for other in table if other.causality == "input")


# -- co-simulation ------------------------------------------------------------------------------------------------
def fmi2_description(facts: Facts) -> Element:
    """modelDescription.xml of FMI 2.0 for co-simulation; the table must hold scalars only."""
    types = {"real": "Real", "integer": "Integer", "string": "String"}
    abilities = {
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    root = _root(facts, "2.0", "CoSimulation", abilities)
    variables = SubElement(root, "ModelVariables")
    places: dict[str, int] = {}
    for number, variable in enumerate(facts.table):
        if variable.causality != "independent":  # optional in FMI 2, and some hosts require a start value for it
            element = SubElement(variables, "ScalarVariable", _identity(variable, number))
            SubElement(element, types[variable.kind], _values(variable, facts))
            # FMI 2: an index, from 1, among the variables that are listed
            places[variable.name] = len(places) + 1
    structure = SubElement(root, "ModelStructure")
    now, start = SubElement(structure, "Outputs"), SubElement(structure, "InitialUnknowns")
    for variable in facts.table:
        if variable.causality == "output":
            place = str(places[variable.name])
            # empty: depends on nothing; without the attribute it would depend on everything
            SubElement(now, "Unknown", {"index": place, "dependencies": _dependencies(variable, facts.table, places)})
            SubElement(start, "Unknown", {"index": place, "dependencies": _initial_dependencies(variable, places)})
    return root


def fmi3_description(facts: Facts) -> Element:
    """modelDescription.xml of FMI 3.0 for co-simulation."""
    abilities = {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "canHandleVariableCommunicationStepSize": "true",
        "providesDirectionalDerivatives": "true",
    }
    if facts.time_step is not None:
        abilities["fixedInternalStepSize"] = repr(facts.time_step)
    abilities["mightReturnEarlyFromDoStep"] = "true"  # after a contact event
    root = _root(facts, "3.0", "CoSimulation", abilities)
    places = facts.references()
    variables = SubElement(root, "ModelVariables")
    counts = {v.name: int(v.start or 0) for v in facts.table if v.kind == "count"}
    for variable in facts.table:
        _add_variable(variables, places, variable, facts)
        if variable.is_array and variable.start is not None:  # one start value an element: some hosts need them all
            n = prod(size if isinstance(size, int) else counts[size] for size in variable.dimensions)
            variables[-1].set("start", " ".join([_text(variable.start)] * n))
    structure = SubElement(root, "ModelStructure")
    outputs = [variable for variable in facts.table if variable.causality == "output"]
    for tag in ("Output", "InitialUnknown"):
        for variable in outputs:
            if tag == "Output":
                depends = _dependencies(variable, facts.table, places)
            else:
                depends = _initial_dependencies(variable, places)
            SubElement(structure, tag, {"valueReference": str(places[variable.name]), "dependencies": depends})
    return root


def _add_variable(parent: Element, references: dict[str, int], variable: Variable, facts: Facts) -> None:
    types = {"real": "Float64", "integer": "Int32", "string": "String", "count": "UInt64"}
    attributes = _identity(variable, references[variable.name]) | _values(variable, facts)
    # FMI 3: a string has its start value in an element of its own
    start = attributes.pop("start", "") if variable.kind == "string" else None
    element = SubElement(parent, types[variable.kind], attributes)
    for size in variable.dimensions:
        if isinstance(size, int):
            place = {"start": str(size)}
        else:
            place = {"valueReference": str(references[size])}
        SubElement(element, "Dimension", place)
    if start is not None:
        SubElement(element, "Start", {"value": start})


# -- Model Exchange -----------------------------------------------------------------------------------------------
def model_exchange_description(facts: Facts, names: Names) -> Element:
    """modelDescription.xml of FMI 3.0 for Model Exchange; ``facts.table`` is that of ``names``."""
    abilities = {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "needsCompletedIntegratorStep": "false",
    }
    root = _root(facts, "3.0", "ModelExchange", abilities, (local.unit for local in names.locals))
    variables = SubElement(root, "ModelVariables")
    references = facts.references()
    for reference, variable in enumerate(facts.table):
        _add_variable(variables, references, variable, facts)
        # states are outputs, whose start would be calculated
        if reference in names.states:
            variables[-1].set("initial", "exact")
            variables[-1].set("start", "0.0")
    for reference, local in enumerate(names.locals, len(facts.table)):
        SubElement(variables, "Float64", _local(reference, local, facts))
    structure = SubElement(root, "ModelStructure")  # without dependencies: everything may depend on everything
    outputs = [i for i, variable in enumerate(facts.table) if variable.causality == "output"]
    derivatives = range(names.derivatives, names.derivatives + len(names.states))
    # states have exact start values: they are no unknowns of the initialization
    calculated = [i for i in outputs if i not in names.states]
    for tag, unknowns in (
        ("Output", outputs),
        ("ContinuousStateDerivative", derivatives),
        ("InitialUnknown", [*calculated, *derivatives]),
        ("EventIndicator", range(names.indicators, names.count)),
    ):
        for reference in unknowns:
            SubElement(structure, tag, {"valueReference": str(reference)})
    return root


def _local(reference: int, local: Local, facts: Facts) -> dict[str, str]:
    attributes = {
        "name": local.name,
        "valueReference": str(reference),
        "description": local.description,
        "causality": "local",
        "variability": "continuous",
        "initial": "calculated" if local.start is None else "exact",
        "unit": facts.unit_name(local.unit),
    }
    numbers = {"nominal": local.nominal, "start": local.start, "derivative": local.derivative_of}
    return attributes | {key: _text(number) for key, number in numbers.items() if number is not None}


# -- terminals ----------------------------------------------------------------------------------------------------
_TERMINAL = re.compile(r"(load|interface|sensor|port|bolt)\.(\w+)\.(.+)")


def terminals(facts: Facts) -> Element:
    """terminalsAndIcons.xml (FMI 3.0): one terminal per load, interface, sensor, port and bolt, matched by name."""
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    picture = SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    SubElement(picture, "CoordinateSystem", {**square, "suggestedScalingFactorTo_mm": "0.1"})
    SubElement(picture, "Icon", square)
    by_name: dict[str, Element] = {}
    for variable in facts.table:
        match = _TERMINAL.fullmatch(variable.name)
        if match is None or variable.causality not in ("input", "output"):
            continue
        kind, name, member = match.groups()
        key = f"{kind}.{name}"
        about = {"name": key, "matchingRule": "bus", "terminalKind": f"latin_fmu.{kind}"}
        terminal = by_name.setdefault(key, Element("Terminal", {**about, "description": f"{kind} {name} of the scene"}))
        signal = {"variableName": variable.name, "memberName": member, "variableKind": "signal"}
        SubElement(terminal, "TerminalMemberVariable", signal)
    if by_name:
        SubElement(root, "Terminals").extend(by_name.values())
    return root


_STYLE = (
    "body{font-family:sans-serif;max-width:70em;margin:2em auto;line-height:1.4}"
    "table{border-collapse:collapse}"
    "td,th{border:1px solid #bbb;padding:.2em .5em;text-align:left;vertical-align:top}code{background:#eee}"
)

_USE = """\
<h2>Use</h2>
<ul>
<li><b>Windowed</b> (<code>mode = 0</code>): set <code>load.NAME.value</code> and <code>load.NAME.rate</code>, make a
step of any length. The state stays on the grid of time steps of <code>timeStep</code>, at the last instant not beyond
the communication point (<code>innerTime</code>), and is carried on.
Saving and restoring the state (serialised or not) is exact to the last bit.</li>
<li>A host that sets no rate sets <code>load.NAME.value</code> at the start of every step. The load then goes on as the
straight line through its last two values (<code>inputInterpolation = 3</code>). It is held over the first step, which
has no value before it, and over a step that begins with a jump: a change of the value after two equal ones. A
load with kinks or jumps at other places overshoots there by one step: hold it (0), or set rates. Once a rate other than
0 was set, the rates of this load count.</li>
<li><b>Prescribed</b> (<code>mode = 1</code>): load histories are given up front by <code>historyFile</code> (a CSV file
with a header <code>time,NAME,...</code>, a netCDF file, or the CSV table itself with semicolons or line breaks between
its rows, <code>time,NAME;0,0;1e-6,1</code>) or, in FMI 3, by the arrays <code>history.time</code> and
<code>load.NAME.history</code>, whose last row is repeated up to their size; the whole interval
[0, <code>endTime</code>] is solved when initialization ends and played back at any communication step. The arrays
<code>interface.NAME.window</code> of FMI 3 hold the whole interval before the first step. In FMI 2 play back in steps
of the time step, which solves nothing, or name a <code>resultsFile</code>: it holds the whole interval also where the
simulation is terminated right after initialization.</li>
<li>A step that was not made where a shorter one or another input may help (no convergence, an input that is not
finite, a changed input in prescribed mode) is <b>discarded</b>: the status is Discard, the simulation is not reported
as terminated, a message in the log gives the reason, the state is as before. If the host continues as if the step
had been made, the next step is an <b>error</b>; if it ends the simulation there, so is the termination.</li>
<li>A failure during initialization (a missing file, a parameter out of range, no convergence in prescribed mode) is an
error of the function that ends the initialization, with a message in the log, whether or not the host
enables debug logging.</li>
<li>Saved states carry a digest of the scene, a version and a checksum. A state that is damaged, of another scene,
or was freed is an error; the instance goes on from where it was.</li>
<li>The stop time is not needed. The tolerance of the importer is a relative accuracy: the error of the iteration is a
tenth of it, the tolerance on sqrt(eta) a fifth. It replaces the parameter <code>tolerance</code>, which is on sqrt(eta)
itself.</li>
<li>Energies are outputs where the scene says <code>output.energy = true</code>: their terms are computed at every
instant, which can take longer than the solution itself.</li>
<li>With <code>resultsFile</code> a netCDF file is written at termination; it holds accepted steps only.</li>
<li>An interface that can open counts its contact events: <code>touches</code>, <code>separations</code>, and
<code>slips</code> (all points in contact slip after one stuck). <code>lastTouch</code>, <code>lastSeparation</code> and
<code>lastSlip</code> are the instants of the last ones, found inside the time step by a straight line through gap,
normal force, or ratio of tangential to normal force; 0 before the first. In FMI 3 a step ends early, with the time step
of the first event in it, where the host allows it (<code>earlyReturnAllowed</code>).</li>
<li>A load in the scene should have the expected size, so that its amplitude is about 1: tolerances are relative to the
loads of the scene, and a load of 1 Pa times 10<sup>8</sup> needs more digits than double precision has.</li>
<li>A port <code>port.NAME</code> has inputs and outputs along the global axes, of the mean motion of its
face: <code>force[i]</code>, <code>moment[i]</code>, <code>displacement[i]</code>, <code>velocity[i]</code>,
<code>rotation[i]</code>, <code>angularVelocity[i]</code>, i = 1, 2, 3; the rate of an input is
<code>forceRate[i]</code>. A wave port takes <code>incident[i]</code> = F + Z v, Z its <code>impedance[i]</code>, and
gives <code>reflected[i]</code>, to be connected to <code>incident[i]</code> of the other port. A wave without a rate is
the straight line from the last value to the value set, whatever <code>inputInterpolation</code> but 0.</li>
<li>The scene's own time laws count from the start of the simulation.</li>
<li>The FMU can be extracted to any path, spaces and letters outside ASCII included.</li>
<li>Where <a href="fmi-ls-ref.txt">fmi-ls-ref.txt</a> is beside this page, the FMU carries a reference run.</li>
</ul>
<h2>What it needs</h2>
<p>A Python on the importer's side with the packages of <code>externalDependencies.txt</code>; the solver itself is
inside. An importer that is no Python starts the one that the environment variable <code>LATIN_FMU_PYTHON</code> names,
else <code>python3</code> on its path. Tried on Linux, x86-64; the libraries for Windows (x86-64), macOS (arm64) and
Linux (aarch64) are compiled from the same source, where the package that made the FMU holds them.</p>
<p>The kernels are inside, compiled for the platforms of the folder <code>binaries</code>; on a processor that they do
not fit (x86-64 without AVX2 and FMA, say), initialization ends with an error that says so.
<code>LATIN_FMU_COMPILE=setup</code> is for debugging: the march as plain Python, thousands of times slower.</p>
"""

_COMPILED = """\
<h2>What it is</h2>
<p>The solver as machine code, with the factors and the state of the scene below in two files. It needs the C library of
the system alone: no Python, no package, no compiler, no file outside of the folder it is extracted to. Its results
equal those of the program that made it, to round-off.</p>
<h2>Use</h2>
<ul>
<li><b>Windowed</b> (<code>mode = 0</code>): set <code>load.NAME.value</code> and <code>load.NAME.rate</code>, make
a step of any length. The state stays on the grid of time steps of <code>timeStep</code>, at the last instant not beyond
the communication point (<code>innerTime</code>), and is carried on.
Saving and restoring the state (serialised or not) is exact to the last bit. A load that is never given a rate goes on
as the straight line through its last two values (<code>inputInterpolation = 3</code>).</li>
<li><b>Prescribed</b> (<code>mode = 1</code>): load histories are given up front by <code>historyFile</code> (path of a
CSV file with a header <code>time,NAME,...</code>, or that table itself with semicolons or line breaks between its rows:
<code>time,NAME;0,0;1e-6,1</code>) or, in FMI 3, by the arrays <code>history.time</code> and
<code>load.NAME.history</code>. The interval [0, <code>endTime</code>] is solved when initialization ends and played
back at any communication step.</li>
<li><code>timeStep</code>, <code>tolerance</code> and <code>maxIterations</code> are constants: another value needs
other factors, which are computed when an FMU is made. The tolerance of the importer has no effect, and a warning says
so.</li>
<li>A step that was not made where another one or another input may help is <b>discarded</b>: the status is Discard, the
simulation is not reported as terminated, a message gives the reason, the state is as before. If the host continues as
if the step had been made, the next step is an <b>error</b>; if it ends the simulation, so is the termination.</li>
<li>A failure during initialization (a parameter out of range, no convergence in prescribed mode) is an error of the
function that ends the initialization.</li>
<li><b>Directional derivatives</b> are those of outputs at the end of the last step by value and rate of inputs over it,
for the contact states that it has; those of shares, counters, largest values and the
course of the solver are 0.</li>
<li>Saved states carry a digest of the FMU and a checksum. A state that is damaged, of another FMU, or was freed is an
error; the instance goes on from where it was.</li>
<li>Instances of one process share the factors; each has a state of its own. Instances may run in threads of their
own.</li>
<li>Where <a href="fmi-ls-ref.txt">fmi-ls-ref.txt</a> is beside this page, the FMU carries a reference run.</li>
</ul>
<h2>What it cannot do</h2>
<ul>
<li>Error estimates: use an FMU made with <code>--python</code>, or the program itself.</li>
<li>A time step at which neither the iteration nor Newton's method ends, nor a new iteration with relaxation 1/2: it is
discarded. The program that made the FMU has further fall-backs for it.</li>
<li>Run on an x86-64 processor without AVX2 and FMA, unless it was made with <code>--portable</code>: instantiation
fails with a message.</li>
</ul>
<p>Run on Linux, x86-64. The library for Windows (x86-64) is compiled and linked from the same source.</p>
"""

_REDUCED_MODEL = """\
<h2>What it is</h2>
<p>A <b>reduced</b> model of the scene below, as ordinary differential equations with state and time events. It is
meant to <b>cross-check</b> the co-simulation FMU of the same scene, which solves the full mesh by the LATIN method:
the two share meshes and matrices, but neither contact laws nor time integration.</p>
<ul>
<li>Every body moves in {n_mode} elastic modes, its rigid motions, and its static shapes under the loads and the
interface forces. Bonded substructures are one body.</li>
<li>Faces in contact are cut into {n_patch} patches (fewer where a face has fewer nodes) of uniform pressure.</li>
<li>Contact is a stiff spring with damping: patches penetrate by 1/<code>contactStiffness</code> of the static
shortening of the two bodies. Friction is Coulomb's, but sticking patches creep at less than
<code>slidingVelocity</code>.</li>
<li>Patches open, close, stick and slip at state events; the time laws of the scene jump at time events.</li>
</ul>
<h2>Accuracy</h2>
<p>Impulses, momentum, and the times of contact and separation agree with the full model within a few per cent.
Fronts of waves, pressures at points, and what happens after many bounces do not: modes above the last one are
missing. Compare two numbers of modes before using a detail. (Patches were fine enough for the loads: with contacts
closed, the deflection under each is that of the mesh within 10 %.)</p>
<h2>Use</h2>
<ul>
<li>Any importer with an integrator for stiff systems and root finding (e.g. CVode, BDF); relative tolerance 1e-5.</li>
<li>A load with the law <code>input</code> is <code>value + rate * (t - time it was set)</code>: an importer that hands
inputs over at every evaluation leaves <code>rate</code> at 0.</li>
<li>Time counts from 0; the laws of the scene do too.</li>
<li>An input that is not a finite number is logged as an error, derivatives become NaN and the next event ends the
simulation. Saving and restoring the state (serialised or not) is exact.</li>
</ul>
"""


def documentation(facts: Facts, scene_text: str, version: str) -> str:
    """Page of an FMU for co-simulation; ``version`` is that of the FMI."""
    return _co_simulation_page(facts, scene_text, version, _USE)


def compiled_page(facts: Facts, scene_text: str, version: str, note: str = "") -> str:
    """Page of a compiled FMU for co-simulation; ``version`` is that of the FMI, ``note`` a further passage."""
    return _co_simulation_page(facts, scene_text, version, _COMPILED + note)


def _unit(facts: Facts, unit: str | None) -> str | None:
    if unit is None:
        return None
    return facts.units.label(unit)


def _units(facts: Facts) -> str:
    if facts.units.name == SI.name:
        return "SI units"
    return f"Units {facts.units.name}"


def _co_simulation_page(facts: Facts, scene_text: str, version: str, use: str) -> str:
    rows = [
        (v.name, v.causality, v.kind, _unit(facts, v.unit), v.start, " x ".join(map(str, v.dimensions)), v.description)
        for v in facts.table
    ]
    about = (
        f"FMI {version} for co-simulation, made by latin_fmu {facts.version}. Impact of elastic bodies with frictional "
        f"contact by the LATIN method. {_units(facts)}."
    )
    note = (
        "<p>Components are counted from 1, along x, y, z. A load is its amplitude here: it multiplies the pressure or "
        "traction of the scene.</p>\n"
    )
    columns = ("name", "causality", "type", "unit", "start", "size", "meaning")
    return _page(facts, about, f"{use}<h2>Variables</h2>\n{note}", columns, rows, scene_text)


def model_exchange_page(facts: Facts, names: Names, scene_text: str, n_mode: int, n_patch: int) -> str:
    """Page of an FMU for Model Exchange."""
    rows: list[Sequence[object]] = [
        (v.name, v.causality, _unit(facts, v.unit), v.start, v.description) for v in names.table
    ]
    for local in names.locals:
        start = None if local.start is None else f"{local.start:g}"
        rows.append((local.name, "local", _unit(facts, local.unit), start, local.description))
    about = (
        f"FMI 3.0 for Model Exchange, made by latin_fmu {facts.version}. {_units(facts)}; components are counted from "
        "1, along x, y, z."
    )
    use = f"{_REDUCED_MODEL.format(n_mode=n_mode, n_patch=n_patch)}<h2>Variables</h2>\n"
    return _page(facts, about, use, ("name", "causality", "unit", "start", "meaning"), rows, scene_text)


def _page(
    facts: Facts, about: str, use: str, columns: Sequence[str], rows: Sequence[Sequence[object]], scene_text: str
) -> str:
    """The page; names of variables stand in the first column of ``rows``."""
    header = "".join(f"<th>{column}</th>" for column in ("reference", *columns))
    table = "\n".join(
        f"<tr><td>{number}</td><td><code>{_cell(name)}</code></td>"
        + "".join(f"<td>{_cell(value)}</td>" for value in values)
        + "</tr>"
        for number, (name, *values) in enumerate(rows)
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(facts.model)}</title>\n'
        f"<style>{_STYLE}</style></head><body>\n<h1>{escape(facts.model)}</h1>\n<p>{escape(facts.description)}</p>\n"
        f"<p>{about}</p>\n{use}<table><tr>{header}</tr>\n{table}\n</table>\n<h2>Scene</h2>\n"
        f"<pre>{escape(scene_text)}</pre>\n</body></html>\n"
    )


def _cell(value: object) -> str:
    if value is None:
        return ""
    return escape(str(value))
