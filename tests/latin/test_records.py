"""Records and pools: every field documented, every array in its pool, none on another's numbers; snapshots are copies.

Each number of the blocks belongs to one field, by the declarations of the records (pool and shape), and kernels write
none that belongs to no field.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from latin_fmu.building import build
from latin_fmu.compiled import PLAIN
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.kernels import entries, records
from latin_fmu.kernels.energy import FIELDS
from latin_fmu.kernels.energy_parts import N_TERM
from latin_fmu.kernels.instants import OPENINGS
from latin_fmu.kernels.records import CLASS_FIELDS, GROUP_FIELDS, RUN_FIELDS, RUN_NUMBERS
from latin_fmu.kernels.tasks import CHUNK
from latin_fmu.kernels.team import LINE, PARTS
from latin_fmu.propagator import layout
from latin_fmu.propagator.class_record import BlockLayout
from latin_fmu.reader import scene_from_dict
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine
from tests.alone import alone_of
from tests.scenes import given_motion

Tables = dict[str, Any]
POOLS = ("constants", "direction", "histories", "state", "work", "output")
MOVING = POOLS[2:]


def blocks(n: int, **solver: Any) -> Tables:
    """Blocks alike, side by side on the ground, pressed and sheared one more than the other; one on top of the first.

    Those that have nothing on top are one class of n - 1 members.
    """
    names = [f"b{i}" for i in range(n)]
    contact, pressed = {"friction_coefficient": 0.3}, [("top", "zmax"), *((name, "xmax") for name in names)]
    block = Box(STEEL, (0.01,) * 3, (2,) * 3)
    tables = column(
        {"b0": block, "top": block},
        {"meeting": contact},
        {"end": 2.4e-6, "instants": 12},
        load={
            f"press_{name}": {
                "face": f"{name}.{side}",
                "traction": [2e7 * i, 1e7, -1e8 - 1e7 * i],
                "law": half_sine(3e-6),
            }
            for i, (name, side) in enumerate(pressed)
        },
        solver=solver,
        output={"energy": True},
    )
    top = tables["substructure"]["top"]
    tables["substructure"] = {"top": top, **{n: block.table((0.02 * i, 0.0, 0.0)) for i, n in enumerate(names)}}
    tables["interface"] |= {f"floor_{name}": {"sides": [f"{name}.zmin", "ground"], **contact} for name in names}
    return tables


def plain(_: Tables) -> None:
    """As it is."""


def driven(tables: Tables) -> None:
    """Moving ground, faces whose motion is given, damping."""
    law = {"type": "half_sine", "duration": 2e-6}
    tables["interface"]["floor_b0"]["ground_velocity"] = {"direction": [0.0, 0.0, 1.0], "amplitude": 3.0, "law": law}
    tables["boundary"] = {
        f"drive_{name}": given_motion(f"{name}.xmin", [1.0 + i], law)
        for i, name in enumerate(sorted(tables["substructure"]))
    }
    tables["material"]["steel"] |= {"frame": "absolute", "rayleigh_mass": 1e3, "rayleigh_stiffness": 1e-9}


def massless(tables: Tables) -> None:
    """Surface without mass."""
    tables["time"]["scheme"] = {"type": "massless_contact"}


def landing(tables: Tables) -> None:
    """Contact nodes without mass, and a viscous layer behind them."""
    tables["time"]["scheme"] = {"type": "generalized_alpha"}
    tables["output"] = {"energy": True}


def frictionless(tables: Tables) -> None:
    """Normal channels alone, whose sliding is read from the bodies."""
    for interface in tables["interface"].values():
        interface["friction_coefficient"] = 0.0


def layers(tables: Tables) -> None:
    """Soft contact and a bonded layer."""
    tables["interface"]["meeting"] |= {"behaviour": "soft_contact", "normal_stiffness": 2e15}
    tables["interface"]["floor_b0"] = {
        "sides": ["b0.zmin", "ground"],
        "behaviour": "elastic_layer",
        "normal_stiffness": 1e15,
        "tangential_stiffness": 3e14,
    }


def bonded(tables: Tables) -> None:
    """Perfect interfaces, solved at once."""
    for name, interface in tables["interface"].items():
        tables["interface"][name] = {"sides": interface["sides"], "behaviour": "perfect"}


def static(tables: Tables) -> None:
    """Without inertia, on elastic layers."""
    for name, interface in tables["interface"].items():
        tables["interface"][name] = {
            "sides": interface["sides"],
            "behaviour": "elastic_layer",
            "normal_stiffness": 1e13,
            "tangential_stiffness": 3e12,
        }
    tables["time"] = {"end": 1.0, "instants": 6, "quasi_static": True}
    for load in tables["load"].values():
        load["law"] = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}


CASES: list[tuple[Tables, Callable[[Tables], None]]] = [
    *((blocks(n), change) for n in (1, 3, 10) for change in (plain, driven)),
    (blocks(2, window=4), driven),
    (blocks(4, window="whole"), layers),
    (blocks(3), massless),
    (blocks(3), landing),
    *((blocks(n), frictionless) for n in (1, 4)),
    (blocks(3), layers),
    (blocks(2), bonded),
    (blocks(2), static),
    *((blocks(n, interface_operator="sparse"), driven) for n in (2, 4)),
    (blocks(3, propagator={"type": "reduced", "modes": 12}), driven),
    *((blocks(n, propagator="explicit"), driven) for n in (1, 4)),
    (blocks(3, propagator="cg", window=3), plain),
]


def made(tables: Tables, change: Callable[[Tables], None]) -> Any:
    """A run of a changed scene at t = 0."""
    from latin_fmu.latin.outcome import Timings
    from latin_fmu.latin.recorder import Recorder
    from latin_fmu.latin.windows import Run

    tables = {key: dict(value) if isinstance(value, dict) else value for key, value in tables.items()}
    change(tables)
    problem = build(scene_from_dict(tables))
    return Run(problem.assembly, problem.settings, Recorder(problem.assembly, problem.output, problem.info), Timings())


@pytest.mark.parametrize("fields", [CLASS_FIELDS, GROUP_FIELDS, RUN_FIELDS, RUN_NUMBERS])
def test_every_field_is_documented(fields: Any) -> None:
    names = [name for name, _ in fields]
    assert len(set(names)) == len(names)
    for name, meaning in fields:
        assert len(meaning) > 7 or meaning in ("members", "points p", "their number", "their size"), name
        pool = meaning.split(" ")[0].rstrip(",")
        if pool in POOLS:  # an array: its pool, its shape
            assert re.search(
                r"\(.*\)|first number|: panels|: columns|: rows|: the entries|: C = |state \(|int64", meaning
            ), name
    assert records.CLASS.names == tuple(name for name, _ in CLASS_FIELDS)
    assert records.GROUP.names == tuple(name for name, _ in GROUP_FIELDS)
    assert records.RUN.names == tuple(name for name, _ in RUN_FIELDS + RUN_NUMBERS)


def arrays(image: Any) -> Iterator[tuple[str, str, int, int]]:
    """Name, declared pool, first number and size of the arrays of the moving block that have a place of their own."""
    chunks = sum(-(-int(group["n_point"]) // CHUNK) for group in image.groups)
    tasks = max([len(image.classes), PARTS, chunks, *(int(row["n_piece"]) for row in image.classes)])
    run = plainly(image.run[0])
    parts = [("run", layout.RUN, run)]
    parts += [(f"class {c}", layout.CLASS, plainly(row)) for c, row in enumerate(image.classes)]
    parts += [(f"group {g}", layout.GROUP, plainly(group)) for g, group in enumerate(image.groups)]
    for who, fields, record in parts:
        sizes = layout.sizes_of(record, run, image.rows, len(image.classes), tasks)
        for pool, some in fields.items():
            for field, size in zip(some.arrays, some.sizes(sizes), strict=True):
                if size or field.elsewhere is None:
                    yield f"{who}: {field.name}", pool, int(record[field.name]), size


def plainly(record: Any) -> dict[str, Any]:
    """The numbers of a record by name."""
    return {name: record[name].item() for name in record.dtype.names}


def test_declarations_that_cannot_be_read_are_refused() -> None:
    found = layout.declared([("a", "work (3,): b"), ("n", "number")])
    assert [(pool, field.name) for pool, some in found.items() for field in some.arrays] == [("work", "a")]
    for meaning in ("work (3: b", "state, int32 (3,): b", "output (3,) where n: b"):
        with pytest.raises(ValueError, match="cannot be read"):
            layout.declared([("a", meaning)])


def test_shapes_conditions_and_places_elsewhere() -> None:
    fields = layout.declared(
        [("a", "work (2, p): b"), ("b", "work (N,) if shared else a: b"), ("c", "work (w,) if shared: d")]
    )["work"]
    run: dict[str, Any] = {"n_flat": 5, "longest_window": 7, "n_point": 3}
    for shared, expected in ((0, [6, 0, 0]), (1, [6, 5, 7])):
        sizes = layout.sizes_of(run | {"shared": shared}, run, 1)
        assert fields.sizes(sizes) == expected
        record: dict[str, Any] = {}
        fields.place(BlockLayout(), record, sizes)
        assert (record["b"] == record["a"]) == (shared == 0)


@pytest.mark.parametrize(("tables", "change"), CASES)
def test_arrays_lie_in_their_pools_and_do_not_overlap(tables: Tables, change: Callable[[Tables], None]) -> None:
    image = made(tables, change).image
    image._write_records()
    owner = np.full(len(image.moving), -1)
    ends: dict[str, list[int]] = {pool: [] for pool in MOVING}
    fields = list(arrays(image))
    for number, (name, pool, first, size) in enumerate(fields):
        assert pool in MOVING, name
        assert first % LINE == 0, name
        assert 0 <= first <= first + size <= len(image.moving), name
        taken = owner[first : first + size]
        assert (taken == -1).all(), f"{name} lies on {fields[int(taken.max(initial=0))][0]}"
        taken[:] = number
        if size:
            ends[pool] += [first, first + size]
    # one range each: state, work, output, and what drives the run behind them
    assert min(ends["state"]) == 0
    assert max(ends["state"]) <= len(image.state) <= min(ends["work"])
    assert max(ends["work"]) <= min(ends["output"])
    histories = [int(row["constant"]) for row in image.classes]
    assert max(ends["output"]) <= min(histories)
    for row in image.classes:  # the motion is part of the state of its class, in order
        size = int(row["n"] * row["m"])
        places = [int(row[name]) for name in ("rest", "u", "v", "a", "residual")]
        assert places[0] == row["state"]
        assert all(b - a >= size for a, b in pairwise(places[1:]))
        assert places[-1] + size <= row["state"] + row["n_state"]
        if row["accounted"]:
            assert row["energy"] == row["totals"]
            assert row["totals"] + N_TERM * row["m"] <= row["past"]
            wide = int((row["n"] + row["n_motion"]) * row["m"])
            assert row["past"] + FIELDS * wide <= row["turn"] < row["energy"] + row["n_energy"] <= row["turn"] + LINE


@pytest.mark.parametrize(("tables", "change"), CASES)
def test_constants_lie_in_their_block(tables: Tables, change: Callable[[Tables], None]) -> None:
    """Positions of matrices in compressed rows are within the block, in numbers of their kind, and fit."""
    image = made(tables, change).image
    image._write_records()
    pools = image.pools
    for row in image.classes:
        n, m = int(row["n"]), int(row["m"])
        assert sorted(pools.fixed_int[row["order"] : row["order"] + n].tolist()) == list(range(n))
        for name in ("mass", "stiffness", "damping", "trace", "spread", "probe"):
            rows = int(row[f"{name}_rows"])
            if rows == 0:
                continue
            starts = pools.fixed_int[row[f"{name}_starts"] : row[f"{name}_starts"] + rows + 1]
            assert starts[0] == 0
            assert (np.diff(starts) >= 0).all()
            end = int(row[f"{name}_columns"]) + int(starts[-1])
            assert end <= len(pools.fixed_col)
            assert int(row[f"{name}_values"]) + int(starts[-1]) <= len(pools.fixed)
            columns = pools.fixed_col[row[f"{name}_columns"] : end]
            limit = {"trace": row["n_inner"], "spread": row["n_channel"]}.get(name, n)
            assert columns.max(initial=0) < limit
        channels = pools.fixed_int[row["channels"] : row["channels"] + int(row["n_channel"]) * m]
        assert len(set(channels.tolist())) == len(channels)
        assert channels.max(initial=0) < image.n_flat
        for name in ("force", "inertia", "velocity", "displacement", "acceleration", "work"):
            terms = int(row[f"{name}_terms"])
            if terms:
                starts = pools.moving_int[row[f"{name}_starts"] : row[f"{name}_starts"] + terms + 1]
                end = int(row[f"{name}_amplitudes"]) + terms * int(image.run[0]["n_time"])
                assert end <= len(image.moving)
                assert int(row[f"{name}_values"]) + int(starts[-1]) <= len(image.moving)


def test_what_is_not_a_field_is_never_written_or_read() -> None:
    """Numbers between the arrays are marked with NaN before a run: none of them changes, none gets into the result."""
    for tables, change in (CASES[2], CASES[3], CASES[7], CASES[10]):
        if PLAIN and change is not plain:
            continue
        bare, marked = made(tables, change), made(tables, change)
        image = marked.image
        image._write_records()
        own = np.zeros(image._tail, dtype=bool)
        for _, _, first, size in arrays(image):
            own[first : first + size] = True
        gaps = np.flatnonzero(~own)
        assert len(gaps)
        marks = np.full(len(gaps), 0x7FF8DEADBEEFCAFE, dtype=np.int64)
        image.moving.view(np.int64)[gaps] = marks
        work = [(f, s) for _, pool, f, s in arrays(image) if pool == "work"]
        run = image.run[0]
        kept = [(int(run[name]), 8) for name in ("measure", "counts")]
        kept += [(int(row[name]), 1) for row in image.classes for name in ("marched", "known")]
        for first, size in work:  # scratch holds nothing that a run depends on
            if (first, size) not in kept and first not in [at for at, _ in kept]:
                image.moving[first : first + size] = np.nan
        for run_ in (bare, marked):
            run_.all()
        np.testing.assert_array_equal(image.moving.view(np.int64)[gaps], marks)
        np.testing.assert_array_equal(bare.recorder.rows.f_hat, marked.recorder.rows.f_hat)
        np.testing.assert_array_equal(bare.recorder.rows.w_hat, marked.recorder.rows.w_hat)
        assert all(w.converged for w in marked.windows)


@pytest.mark.parametrize(("tables", "change"), CASES)
def test_a_snapshot_is_a_copy_of_the_state(tables: Tables, change: Callable[[Tables], None]) -> None:
    """Run, copy the range of the state, go on, put it back, go on again: the same bits, energies included."""
    run = made(tables, change)
    half = run.assembly.n_instant // 2
    length = run.settings.window or half
    instants = half // length * length

    def on() -> dict[str, Any]:
        begun = run.assembly.instant
        for number in range(instants // length):
            run.advance(length, number, 100)
        first, last = begun + 1, run.assembly.instant
        assert last == begun + instants
        state = {"state": run.image.state.copy(), "f": run.recorder.rows.f_hat[first : last + 1].copy()}
        for c, p in enumerate(run.assembly.propagators):
            state |= {f"{c} {term}": values for term, values in alone_of(p).totals.items()}
        return state

    on()
    kept, begun, seen = run.image.state.copy(), run.assembly.instant, run.recorder.n_kept
    first = on()
    run.image.state[:] = kept
    run._set_instant(begun)
    run.recorder.n_kept = seen
    again = on()
    assert np.abs(first["f"]).max() > 0.0
    for name, values in first.items():
        np.testing.assert_array_equal(values, again[name], err_msg=name)


def test_propagators_stand_in_the_image() -> None:
    """Their motion is a view of it, not a copy."""
    run = made(*CASES[2])
    for c, p in enumerate(run.assembly.propagators):
        at = int(run.image.classes[c]["u"])
        assert np.shares_memory(p.state.u, run.image.moving)
        np.testing.assert_array_equal(p.state.u.ravel(), run.image.moving[at : at + p.state.u.size])
    run.image.call(entries.BEGIN, 1, 1, OPENINGS)
    assert all(p.instant == 0 for p in run.assembly.propagators)


def test_segments_keep_what_they_use_and_no_more() -> None:
    """The image does not grow from segment to segment: a co-simulation has thousands."""
    tables = blocks(2)
    tables["load"]["press_top"]["law"] = {"type": "input"}
    run = SegmentedRun(scene_from_dict(tables))
    sizes = []
    for i in range(4):
        run.advance((i + 1) * 1e-6, 5, {"press_top": np.full(6, 1.0 + i)})
        assert run.run is not None
        image = run.run.image
        sizes.append((len(image.moving), len(image.fixed), image.n_fixed))
    assert len(set(sizes[1:])) == 1


def test_a_run_that_stops_keeps_the_state_before_the_instant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of windows of one instant: nothing is kept for the start of a window there, and nothing is put back."""
    monkeypatch.setattr("latin_fmu.latin.solver.HOPELESS", 0.0)
    tables = blocks(2, max_iterations=2, newton=False, acceleration="none", tolerance=1e-12)
    run = made(tables, plain)
    image = run.image
    before = [image.class_field(c, "rest", int(row["n_state"])).copy() for c, row in enumerate(image.classes)]
    run.all()
    assert run.stopped
    assert run.assembly.instant == 0
    for c, state in enumerate(before):
        assert np.array_equal(image.class_field(c, "rest", len(state)), state)
