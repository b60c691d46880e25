"""The estimated error of what a session solved: the same as a plain run, judged by coarser ones."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from typing import TYPE_CHECKING

from ..accuracy.estimate import estimate_error
from ..accuracy.resolution import with_tolerance
from ..assembly.segments import Segment
from ..results.estimates import ErrorEstimate
from ..results.quantities_of_interest import FLOOR
from ..results.solution import Solution
from ..scene.point_laws import TableLaw
from ..scene.schema import Scene
from .exchange_dataset import joined
from .loads import Curve, curves_of
from .prescribed import Prescribed
from .settings import Settings
from .windowed import Windowed

if TYPE_CHECKING:
    from .session import Session

_SAME_STEP = 1e-6


def session_error(session: Session, engine: Windowed | Prescribed | None) -> ErrorEstimate:
    """Estimated relative error of every quantity of the interval solved.

    The loads set from outside become tables of what was set, jumps at communication points included; the coarser runs
    then are runs of a plain scene (see ``estimate_error``). Steps inside the communication steps must be equal; what
    comes after the first other one is left out, and told.
    """
    if engine is None or engine.run is None:
        return _none("nothing was solved")
    if isinstance(engine, Prescribed):
        segments = [] if engine.segment is None else [engine.segment]
        curves = session.given_curves()
    else:
        steps = list(session.chain)
        segments = [step.segment for step in steps if step.segment is not None]
        if not segments or len(segments) < len(steps) or segments[0].time[0] > 0.0:
            return _none("the steps from the start on are not known: nothing was solved, or a state was restored")
        curves = curves_of(steps, session.settings.interpolation, session.given_curves())
    equal = list(takewhile(lambda s: abs(_step(s) / _step(segments[0]) - 1.0) <= _SAME_STEP, segments))
    scene = plain_scene(session.scene, session.settings, curves, equal)
    found = estimate_error(
        scene, Solution(joined(equal, engine.run.timings, engine.run.problem.warnings), scene.text(), scene.name)
    )
    if len(equal) == len(segments):
        return found
    remark = f"steps of unequal length: estimated up to {equal[-1].time[-1]:.6g} s after the start"
    return ErrorEstimate(found.quantities, (*found.remarks, remark), found.cpu, found.floor)


def plain_scene(scene: Scene, settings: Settings, curves: dict[str, Curve], segments: Sequence[Segment]) -> Scene:
    """The scene with the loads that were set, over the instants of equal segments from the start on."""
    loads = {
        name: load.model_copy(update={"law": TableLaw(times=curves[name][0], values=curves[name][1])})
        if name in curves
        else load
        for name, load in scene.load.items()
    }
    n = sum(len(segment.time) - 1 for segment in segments)
    time = scene.time.model_copy(update={"end": float(segments[-1].time[-1]), "step": None, "instants": n})
    changes: dict[str, object] = {"load": loads, "time": time}
    if settings.tolerance is not None:
        changes["solver"] = with_tolerance(scene, settings.tolerance)
    return scene.model_copy(update=changes)


def _step(segment: Segment) -> float:
    return float(segment.time[-1] - segment.time[0]) / (len(segment.time) - 1)


def _none(why: str) -> ErrorEstimate:
    return ErrorEstimate((), (f"no estimate: {why}",), 0.0, FLOOR)
