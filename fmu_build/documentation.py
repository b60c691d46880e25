"""documentation/index.html of an FMU: what it is, how it is used, its variables, its scene."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from latin_fmu.model_exchange.equations import Names
from latin_fmu.scene.units import SI

from .description import Facts

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
<li>With <code>resultsFile</code> a netCDF file is written at termination; it holds accepted steps only. With
<code>estimateError = 1</code> its group <code>accuracy</code> holds the estimated error of each quantity (impulse,
contact instants, ...): the exchanged loads are run again with a coarser mesh and time step, which takes a fifth of the
simulation time for solids, the whole of it for bars. Single outputs have no estimate, because it needs the
whole history.</li>
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
<p>The kernels are inside, compiled for the kind of machine on which this FMU was made, if the package there held
them. On others, and on processors without AVX2 and FMA, numba compiles them at the first step (two to three minutes)
and keeps them, by content, in the folder <code>latin-fmu</code> of the user's cache (<code>~/.cache</code>): another
extraction does not compile again. The environment variable <code>LATIN_FMU_CACHE</code> names another folder, 0 keeps
nothing; <code>LATIN_FMU_COMPILE=0</code> is for debugging: plain Python, thousands of times slower.</p>
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
<li>Saved states carry a digest of the FMU and a checksum. A state that is damaged, of another FMU, or was freed is an
error; the instance goes on from where it was.</li>
<li>Instances of one process share the factors; each has a state of its own. Instances may run in threads of their
own.</li>
<li>Where <a href="fmi-ls-ref.txt">fmi-ls-ref.txt</a> is beside this page, the FMU carries a reference run.</li>
</ul>
<h2>What it cannot do</h2>
<ul>
<li>Error estimates and directional derivatives: use the
FMU made without <code>--compiled</code>, or the program itself.</li>
<li>A time step at which neither the iteration nor Newton's method ends: it is discarded. The program that made the FMU
has fall-backs for it.</li>
<li>Run on a processor without AVX2 and FMA: instantiation fails with a message.</li>
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
    return None if unit is None else facts.units.label(unit)


def _units(facts: Facts) -> str:
    return "SI units" if facts.units is SI else f"Units {facts.units.name}"


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
    return "" if value is None else escape(str(value))
