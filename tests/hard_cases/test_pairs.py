"""Time schemes, propagators and drivers in pairs: each value of one occurs with each of the others, or is refused.

A driver is what goes through the instants: the whole run, an observed one, segments, a run that goes on from a
checkpoint, a session, an FMU with Python and a compiled one, two processes. All run the same kernels, so that each is
compared with the whole run of the same scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.assembly.propagator_choice import PROPAGATORS
from latin_fmu.compiled import library
from latin_fmu.cosim import Session
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, Description, column, half_sine
from latin_fmu.time_scheme import SCHEMES
from tests.fmu.host import Host
from tests.test_processes import MPIEXEC, mpiexec

Array = np.ndarray
INSTANTS, PART, STEP = 60, 10, 2e-7
NAMES = [f"interface.meet.force[{i}]" for i in (1, 2, 3)]
REFUSED = {  # pairs of a scheme and a propagator: words of the message
    **{
        (s, "explicit"): "the explicit propagator has its own time scheme" for s in SCHEMES if s != "central_difference"
    },
    **{("central_difference", p): "central differences need the explicit propagator" for p in ("direct", "cg")},
    ("central_difference", "reduced"): "central differences need the explicit propagator",
    **{
        (s, "reduced"): "needs a scheme in which every node has mass" for s in ("generalized_alpha", "massless_contact")
    },
}
ROWS = (  # a covering array of the pairs of schemes and propagators, each line with every scheme and every propagator
    ("generalized_alpha direct", "hht reduced", "newmark cg", "massless_contact direct", "central_difference explicit"),
    ("generalized_alpha cg", "hht direct", "newmark reduced", "massless_contact direct", "central_difference explicit"),
    ("generalized_alpha direct", "hht cg", "newmark reduced", "massless_contact cg", "central_difference explicit"),
    ("generalized_alpha direct", "hht reduced", "newmark direct", "massless_contact cg", "central_difference explicit"),
)


def scene_of(scheme: str, propagator: str) -> latin_fmu.Scene:
    """A steel block thrown askew on one of aluminium, and pressed: it lands, rubs and comes off."""
    edge = (0.01,) * 3
    low = Box(ALUMINIUM, edge, (2, 2, 2))
    up = Box(STEEL, edge, (2, 2, 2), velocity=(2.0, 0.0, -4.0))
    solver: Description = {"propagator": {"type": "reduced", "modes": 20} if propagator == "reduced" else propagator}
    scene = column(
        {"low": low, "up": up},
        {"meet": {"friction_coefficient": 0.3}},
        {"end": INSTANTS * STEP, "instants": INSTANTS, "scheme": scheme},
        gap=2e-6,
        boundary={"base": {"type": "fixed", "face": "low.zmin"}},
        load={"press": {"face": "up.zmax", "pressure": 1e8, "law": half_sine(6e-6)}},
        solver=solver,
    )
    return latin_fmu.scene_from_dict(scene)


@cache
def whole(scheme: str, propagator: str) -> Array:
    """Force of the contact in the whole run, (n_time, 3)."""
    solution = latin_fmu.solve(scene_of(scheme, propagator))
    assert solution.converged, solution.status
    return solution.interfaces["meet"].force()


# -- drivers: force at the instants that they give, and their numbers ------------------------------------------------
def observed(scene: latin_fmu.Scene, _: Path) -> Array:
    return latin_fmu.solve(scene, observer=lambda _: None).interfaces["meet"].force()


def segments(scene: latin_fmu.Scene, _: Path) -> Array:
    run, parts = SegmentedRun(scene), []
    for end in range(PART, INSTANTS + 1, PART):
        part = run.advance(end * STEP, PART).interfaces["meet"].force()
        parts.append(part[1 if parts else 0 :])
    return np.concatenate(parts)


def continued(scene: latin_fmu.Scene, folder: Path) -> Array:
    looks: list[int] = []
    stop = Checkpoint(folder / "c", every=PART, stop=lambda: bool(looks.append(1)) or len(looks) > 2)
    assert not latin_fmu.solve(scene, checkpoint=stop).complete
    again = Checkpoint(folder / "c", resume=True, log=lambda _: None)
    return latin_fmu.solve(scene, checkpoint=again).interfaces["meet"].force()


def in_session(scene: latin_fmu.Scene, _: Path) -> Array:
    session, rows = Session(scene), []
    session.initialize()
    for i in range(0, INSTANTS, PART):
        report = session.step(i * STEP, PART * STEP)
        assert report, report.message
        rows.append(session.values(NAMES))
    return np.array(rows)


def in_fmu(scene: latin_fmu.Scene, folder: Path, compiled: bool = False) -> Array:
    host = Host(build_fmu(scene, folder / "pair.fmu", "2", python=not compiled), folder / "instance")
    try:
        host.start()
        rows = []
        for i in range(0, INSTANTS, PART):
            assert host.step(i * STEP, PART * STEP), host.messages
            rows.append(host.read(NAMES))
    finally:
        host.close()
    return np.array(rows)


def in_compiled_fmu(scene: latin_fmu.Scene, folder: Path) -> Array:
    return in_fmu(scene, folder, compiled=True)


def on_two_processes(scene: latin_fmu.Scene, folder: Path) -> Array:
    (folder / "scene.toml").write_text(scene.text())
    done = mpiexec(folder, 2, ("run", "scene.toml", "--quiet", "--no-estimate", "-o", "out.nc"))
    if "[2]" in done.stderr:
        raise latin_fmu.InputError.of("refused", "mpiexec", done.stderr)
    tree = latin_fmu.open_results(folder / "out.nc")
    force = tree["interfaces/meet"]["force"].values.copy()
    tree.close()
    return np.asarray(force)


Driver = Callable[[latin_fmu.Scene, Path], Array]
DRIVERS: dict[str, tuple[Driver, float]] = {  # and how far from the whole run it may be: 0: the same bits; else the
    # round-off of times that are cut, which conjugate gradients enlarge to their tolerance
    "observer": (observed, 0.0),
    "segments": (segments, 1e-11),
    "checkpoint": (continued, 0.0),
    "session": (in_session, 1e-11),
    "FMU": (in_fmu, 1e-11),
    "compiled FMU": (in_compiled_fmu, 1e-11),
    "processes": (on_two_processes, 1e-11),
}
UNABLE = {  # pairs of a driver and a propagator: words of the message; the scheme takes the direct propagator there
    ("processes", "cg"): "conjugate gradients run in one process",
    ("compiled FMU", "cg"): "has a propagator that runs in Python",
}


def cases() -> Iterator[tuple[str, str, str]]:
    """Scheme, propagator and driver of each scene."""
    for number, driver in enumerate(DRIVERS):
        for row in ROWS[number % len(ROWS)]:
            scheme, propagator = row.split()
            yield scheme, "direct" if (driver, propagator) in UNABLE else propagator, driver


def test_each_pair_occurs_or_is_refused() -> None:
    made = list(cases())
    lists = {"scheme": list(SCHEMES), "propagator": list(PROPAGATORS), "driver": list(DRIVERS)}
    for (a, first), (b, second) in (((0, "scheme"), (1, "propagator")), ((0, "scheme"), (2, "driver"))):
        wanted = set(product(lists[first], lists[second])) - REFUSED.keys()
        assert {(c[a], c[b]) for c in made} == wanted
    pairs = {(driver, propagator) for _, propagator, driver in made}
    assert pairs == set(product(lists["driver"], lists["propagator"])) - UNABLE.keys()


@pytest.mark.parametrize(
    ("scheme", "propagator", "driver"),
    [
        pytest.param(*case, marks=pytest.mark.slow) if case[2] == "processes" and "direct" not in case else case
        for case in cases()
    ],
)
def test_a_driver_gives_the_whole_run(scheme: str, propagator: str, driver: str, tmp_path: Path) -> None:
    if driver == "processes" and MPIEXEC is None:
        pytest.skip("there is no mpiexec: pip install latin-fmu[mpi]")
    if driver == "compiled FMU" and library.loaded() is None:
        pytest.skip("there is no library of the kernels")
    take, allowed = DRIVERS[driver]
    expected = whole(scheme, propagator)
    found = take(scene_of(scheme, propagator), tmp_path)
    if len(found) != len(expected):
        expected = expected[PART::PART]
    assert np.abs(expected).max() > 100.0
    assert np.abs(found - expected).max() <= allowed * np.abs(expected).max()


@pytest.mark.parametrize(("scheme", "propagator"), REFUSED)
def test_pairs_that_are_refused(scheme: str, propagator: str) -> None:
    with pytest.raises(latin_fmu.SceneError, match=REFUSED[scheme, propagator]):
        scene_of(scheme, propagator)


@pytest.mark.parametrize(("driver", "propagator"), UNABLE)
def test_drivers_that_cannot(driver: str, propagator: str, tmp_path: Path) -> None:
    with pytest.raises(latin_fmu.InputError, match=UNABLE[driver, propagator]):
        DRIVERS[driver][0](scene_of("hht", propagator), tmp_path)
