"""The report of a results file as one HTML page."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from ..effects.explanation import explain
from ..errors import InputError, Problem, ResultsError
from ..pictures.assembly_picture import assembly_figure
from ..reader import stored_scene
from ..results.summary import stored_summary
from ..scene.schema import Scene
from .markup import picture, whole_page
from .sections import RunContent, sections


def report_page(tree: xr.DataTree, folder: Path) -> str:
    """The report of a run as HTML that needs no other file.

    Parameters
    ----------
    tree : of its results file. folder : that the mesh files of its scene are relative to; without them the report has
        neither a picture of the assembly nor the list of effects, and says so.

    Raises
    ------
    ResultsError : the file holds no run, or one of a version that did not keep its summary.

    Examples
    --------
    >>> from latin_fmu.report.document import report_page
    >>> solution = latin_fmu.solve(latin_fmu.load_scene("models/impact_bar/scene.toml"))
    >>> report_page(solution.to_datatree(), folder).startswith("<!DOCTYPE html>")
    True
    """
    if "status" not in tree.attrs or "scene" not in tree.attrs:
        what = "holds no run: a report is of the results of latin-fmu run"
        raise _refused(tree, what, "latin-fmu run SCENE -o OUT.nc, then latin-fmu report OUT.nc")
    summary = stored_summary(tree)
    if not summary:
        raise _refused(tree, "was written by a version that did not keep the summary", "run its scene again")
    return whole_page(str(tree.attrs.get("scene_name", "run")), [*sections(_content(tree, folder))])


def _refused(tree: xr.DataTree, what: str, remedy: str) -> ResultsError:
    source = str(tree.encoding.get("source", "results"))
    return ResultsError([Problem(source, what, None, "a results file of a run", remedy)], "no report")


def _content(tree: xr.DataTree, folder: Path) -> RunContent:
    summary = stored_summary(tree)
    try:
        scene = stored_scene(str(tree.attrs["scene"]), folder)
    except InputError as error:
        return RunContent(tree, summary, None, f"the scene of the file cannot be read: {_said(error)}")
    try:
        return _built(tree, scene)
    except InputError as error:
        folder_said = f"files are looked for in {folder}; --folder names another one"
        return RunContent(tree, summary, scene, unbuilt=f"{_said(error)} ({folder_said})")


def _built(tree: xr.DataTree, scene: Scene) -> RunContent:
    """With what needs the meshes."""
    explanation = explain(scene)
    figure = assembly_figure(scene, [])
    caption = "Parts of the assembly, in place and apart, with interfaces, supports, loads and motions"
    return RunContent(tree, stored_summary(tree), scene, explanation=explanation, picture=picture(figure, caption))


def _said(error: Exception) -> str:
    """An error in one line."""
    problems = getattr(error, "problems", ())
    return "; ".join(problem.what for problem in problems) or str(error)
