"""Solve and check a scene: the Python interface, from a scene to its solution."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from .arithmetic import computable
from .assembly.models import KeptOperators
from .assembly.supports import port_lines
from .attempts import standing_run
from .building import discretise
from .checks.mesh_checks import body_lines, body_sizes
from .effects.cost import Prediction, check_memory, memory_line, memory_need
from .interface import Behaviour
from .latin.assembly import InterfaceUnit
from .latin.processes import Processes
from .latin.solver import WindowFields
from .march import Observer, ProgressSink, RunClock, RunOptions
from .remarks import Remark
from .results.checkpoint import Checkpoint
from .results.solution import Solution
from .scene.histories import histories_of, history_lines
from .scene.random_bases import random_lines
from .scene.schema import Scene
from .scene.units import UnitSystem


@computable()
def solve(
    scene: Scene,
    *,
    observer: Observer | None = None,
    progress: ProgressSink | None = None,
    behaviours: Mapping[str, Behaviour] | None = None,
    checkpoint: Checkpoint | None = None,
    stream: Path | None = None,
    kept: KeptOperators | None = None,
    fields: WindowFields | None = None,
    processes: Processes | None = None,
    max_cpu: float | None = None,
) -> Solution:
    """Solve a scene.

    Parameters
    ----------
    scene : from ``load_scene`` or built in Python.
    observer : called after every LATIN iteration with an ``Iteration``.
    progress : called with the progress of the run.
    behaviours : user-defined laws (``interface.laws``), by interface, instead of those that the scene
        names; they are called from Python, point by point in NumPy (``examples/own_law.py``).
    checkpoint : writes checkpoints, and continues from one; the run gives the same bits as an uninterrupted one.
    stream : folder of the results: its free space is checked, and where the histories of the interfaces are large
        (64 MB) they go to a temporary file there: ``Solution.save`` writes them all, energies follow from all of them,
        everything else from at most 20,000 instants. ``Solution.outcome.stream.close()`` removes the file.
    kept : operators of the scene solved before, used where they are equal, and replaced by those of this one.
    fields : first guesses of windows of several instants; see ``latin.windows.WindowFields``.
    processes : over which the substructures are distributed; all of them call this function with the same scene, and
        have the whole solution at its end.
    max_cpu : CPU time that the run may take, its set-up, derivatives and the runs that check them included, s. A run
        that reaches it stops before its next instant, not converged: ``Solution.interrupted`` says so, the results
        until then are kept, and a ``checkpoint`` is written, from which it can be continued. Where it is reached after
        the run, derivatives, or their checks, are left out, with a remark. On several processes: of each of them; all
        stop before the same instant.

    Raises
    ------
    SceneError : the scene cannot be built. A run that does not converge is no error: see ``Solution.converged``.
    SolverError : numbers that cannot be computed with.
    ResultsError : a checkpoint that is damaged, or of another scene, version or machine.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> solution = latin_fmu.solve(scene)
    >>> solution.converged
    True
    >>> solution.interfaces["wall"].impulse(solution.time)[-1].round()
    array([  0.,   0., 198.])
    """
    started = RunClock(max_cpu)
    options = RunOptions(observer, progress, behaviours, checkpoint, stream, kept, fields, processes, max_cpu)
    if scene.differentiated:
        options = replace(options, stream=None)  # derivatives take the histories of all instants from the memory
    ready, run, truncation, _ = standing_run(scene, options, started)
    solution = Solution(
        run.outcome,
        scene.text(),
        scene.name,
        recovered=run.problem.recovered,
        sensor_tables=scene.sensor,
        limit_tables=scene.limit,
        bodies=body_sizes(ready.prediction.discretised.bodies),
        surfaces=scene.output.surfaces,
        units=scene.unit_system,
        truncation=truncation,
    )
    if not scene.differentiated:
        return solution
    from .sensitivities.riders import RIDERS, Ride

    begin = clock.process_time()
    ride = Ride(scene, run, ready.tangent, progress, started, solve)
    for rider in RIDERS:
        solution = rider(solution, ride)
    run.outcome.timings.other += clock.process_time() - begin
    return solution


def check(scene: Scene) -> list[str]:
    """Build a scene without solving it; lines with its sizes and warnings.

    Raises
    ------
    SceneError : the scene cannot be built.

    Examples
    --------
    >>> latin_fmu.check(latin_fmu.load_scene("models/impact_bar/scene.toml"))[0]
    'scene impact_bar: 1 substructure(s) in 1 class(es), 1 interface(s), 400 steps of 0.005 s'
    """
    return checked(scene).text()


class Checked(NamedTuple):
    """What ``check`` finds: lines with the sizes of a scene, the remarks on it, and the sizes as plain data."""

    lines: list[str]
    remarks: tuple[Remark, ...]
    sizes: dict[str, Any]

    def text(self) -> list[str]:
        """The lines with the remarks, and the verdict at the end."""
        verdict = "the scene can be solved" + (", with the warnings above" if self.remarks else "")
        return [*self.lines, *(f"warning: {remark}" for remark in self.remarks), verdict]

    def report(self) -> dict[str, Any]:
        """Plain data: ``scene``, ``steps``, ``step`` (s), ``memory_bytes``, ``classes`` of substructures with unknowns
        and interface channels, ``interfaces``, ``histories`` from files (``SceneHistory.report``), ``warnings``."""
        return self.sizes | {"warnings": [{"code": remark.code, "text": str(remark)} for remark in self.remarks]}


@computable()
def checked(scene: Scene) -> Checked:
    """As ``check``, with the data."""
    discretised = discretise(scene)
    prediction = Prediction(discretised)
    check_memory(prediction, stream=True)  # as the command line runs it
    problem = discretised.build()  # a static start is left to the run
    assembly = problem.assembly
    lines = [
        f"scene {scene.name}: {assembly.n_substructure} substructure(s) in {len(assembly.propagators)} class(es), "
        f"{len(assembly.interfaces)} interface(s), {assembly.n_instant} steps of {assembly.dt:.6g} s"
    ]
    lines += discretised.files
    lines += body_lines(discretised.bodies)
    lines += [
        f"  {', '.join(p.names)}: {p.n_dof} unknowns, {p.n_channel} interface channels" for p in assembly.propagators
    ]
    lines += [_interface_line(u, u.name not in scene.interface, scene.unit_system) for u in assembly.interfaces]
    lines += port_lines(scene, discretised.bodies)
    lines += [cut.line(scene.unit_system) for cut in discretised.cuts.values()]
    lines += history_lines(scene)
    lines += random_lines(scene)
    if discretised.scene.time.start.type == "static":
        lines.append("  start: equilibrium under what acts at t = 0, which the run solves first")
    lines.append(f"  {memory_line(prediction, stream=True)}")
    sizes = {
        "scene": scene.name,
        "steps": assembly.n_instant,
        "step": assembly.dt,
        "memory_bytes": int(memory_need(prediction, stream=True).total),
        "classes": [
            {"substructures": list(p.names), "unknowns": p.n_dof, "interface_channels": p.n_channel}
            for p in assembly.propagators
        ],
        "interfaces": [_interface_sizes(u) for u in assembly.interfaces if not u.attached],
        "histories": [history.report() for history in histories_of(scene)],
    }
    return Checked(lines, problem.warnings, sizes)


def _interface_sizes(unit: InterfaceUnit) -> dict[str, Any]:
    """An interface as plain data; ``gap``: the smallest and the largest one, of an interface that may open."""
    geometry = unit.geometry
    gap = [float(geometry.gap.min()), float(geometry.gap.max())] if unit.behaviour.opens else None
    sizes = {"points": geometry.n_point, "area": float(geometry.areas.sum()), "gap": gap}
    return {"name": unit.name, "behaviour": unit.behaviour.name, "sides": list(unit.sides), **sizes}


def _interface_line(unit: InterfaceUnit, by_search: bool, units: UnitSystem) -> str:
    """Sizes of an interface: points, area, gap, where the points come from; ``by_search``: from a [contact.NAME]."""
    geometry = unit.geometry
    if unit.attached:
        return f"  {unit.attached}: {unit.behaviour.name} between {unit.sides[0]} and {unit.sides[1]}"
    area = geometry.areas.sum()
    line = f"  interface {unit.name}: {unit.behaviour.name}, {geometry.n_point} points, area {area:.6g} {units['m2']}"
    if unit.behaviour.opens:
        gaps = dict.fromkeys(f"{gap:.4g}" for gap in (geometry.gap.min(), geometry.gap.max()))
        line += f", gap {' to '.join(gaps)} {units['m']}"
        if 0 < (closed := int((geometry.gap <= 0.0).sum())) < geometry.n_point:
            line += f", closed at {closed} of them"
        if unit.note:
            line += f" ({unit.note})"
    if geometry.traces[1] is not None:
        line += ", node against node" if geometry.matching else f", points of {unit.sides[geometry.owner]}"
    return line + (", found" if by_search else "")
