"""Nothing is written beside the arrays that the march knows by their addresses, and nothing read there.

Every array lies between two zones of known content, which are NaN as floating-point numbers: what is written into them
shows, what is read from them spoils the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import latin_fmu
from latin_fmu.assembly.segments import SegmentedRun
from latin_fmu.compiled import COMPILES
from latin_fmu.latin.compiled_run import CompiledRun
from latin_fmu.latin.recorder import Recorder
from latin_fmu.march import classes, groups, work
from latin_fmu.march.views import address

pytestmark = pytest.mark.skipif(not COMPILES, reason="compilation is off")

Tables = dict[str, Any]
_ZONE = 8192  # bytes
_MARK = np.tile(np.frombuffer(b"\xfe\xca\xef\xbe\xad\xde\xf8\x7f", np.uint8), _ZONE // 8)  # a NaN


class Guard:
    """Copies of arrays between zones; ``broken`` names those beside which something was written."""

    def __init__(self) -> None:
        self._blocks: list[tuple[str, NDArray[np.uint8]]] = []
        self.members: set[int] = set()  # of the classes seen

    def copy(self, name: str, array: NDArray[Any]) -> NDArray[Any]:
        """A guarded copy."""
        block = np.concatenate([_MARK, np.empty(array.nbytes, np.uint8), _MARK])
        self._blocks.append((name, block))
        own: NDArray[Any] = block[_ZONE : _ZONE + array.nbytes].view(array.dtype).reshape(array.shape)
        own[...] = array
        return own

    def broken(self) -> list[str]:
        """Names."""
        return sorted(
            {n for n, b in self._blocks if not ((b[:_ZONE] == _MARK).all() and (b[-_ZONE:] == _MARK).all())}
        )

    def moved(self, who: str, row: Any, arrays: list[NDArray[Any]]) -> Iterator[tuple[str, NDArray[Any]]]:
        """Guarded copies of arrays whose addresses are in a row, with their names there; the row then knows those."""
        for i, array in enumerate(arrays):
            if array.size:
                (name,) = [n for n in row.dtype.names if row[n] == address(array)]
                arrays[i] = self.copy(f"{who}: {name}", array)
                row[name] = address(arrays[i])
                yield name, arrays[i]

    def spaced(self, sizes: Mapping[str, int]) -> tuple[dict[str, int], int]:
        """As ``classes.places``, with zones behind."""
        starts, end = PLACES({name: size + _ZONE // 8 for name, size in sizes.items()})
        self._behind = {name: starts[name] + size for name, size in sizes.items()}
        return starts, end

    def mark(self, who: str, block: NDArray[Any]) -> None:
        """Fill the zones behind the arrays of a block."""
        for name, at in self._behind.items():
            zone = block.view(np.uint8)[8 * at :][:_ZONE]
            zone[:] = _MARK
            self._blocks.append((f"{who}: {name}", zone))


PLACES = classes.places


@pytest.fixture
def guard(monkeypatch: pytest.MonkeyPatch) -> Guard:
    """Guards all that the marches of this test work on."""
    kept = Guard()
    table, make, record = classes.ClassTable, work.make_work, Recorder.__init__
    build, point, scratch, begin = table.__init__, table._point, table._scratch, table.begin
    fill, enter = groups.GroupTable.__init__, CompiledRun.begin

    def guarded_build(self: Any, *arguments: Any) -> None:
        build(self, *arguments)
        self._rest = kept.copy("rest", self._rest)
        for row, rest in zip(self.rows, self._rest, strict=True):
            row["rest"] = address(rest)
        kept.members |= set(self.rows["m"].tolist())

    def guarded_point(self: Any, found: Any, name: str, array: NDArray[Any]) -> None:
        in_block = name == classes.STATE[0]
        point(self, found, name, array if in_block else kept.copy(f"class {len(self._state)}: {name}", array))

    def guarded_scratch(self: Any, found: Any) -> None:
        scratch(self, found)
        kept.mark(f"class {len(self._state) - 1}", self._state[-1].base)

    def guarded_begin(self: Any, n_time: int) -> None:
        begin(self, n_time)
        for c, row in enumerate(self.rows):
            for name, own in kept.moved(f"class {c}", row, self._begun[c]):
                if name == "probed":
                    self.probed[c] = own

    def guarded_fill(self: Any, *arguments: Any) -> None:
        fill(self, *arguments)
        for g, row in enumerate(self.rows):
            for name, own in kept.moved(f"group {g}", row, self._alive[g]):
                if name in ("gap", "reach"):
                    (self.gaps if name == "gap" else self.reaches)[g] = own

    def guarded_record(self: Any, *arguments: Any) -> None:
        record(self, *arguments)
        self.f_hat, self.w_hat = kept.copy("f_hat", self.f_hat), kept.copy("w_hat", self.w_hat)
        self.gaps = [None if gap is None else kept.copy("gaps", gap) for gap in self.gaps]

    def guarded_enter(self: Any, recorder: Recorder) -> None:
        for name in ("_errors", "_mismatches", "_counts", "_bonds", "_gap_start"):
            setattr(self, name, kept.copy(name, getattr(self, name)))
        enter(self, recorder)

    def guarded_work(*sizes: int) -> work.Work:
        return work.Work(*(kept.copy(name, array) for name, array in make(*sizes)._asdict().items()))

    monkeypatch.setattr(classes, "places", kept.spaced)
    monkeypatch.setattr(work, "make_work", guarded_work)
    monkeypatch.setattr(groups.GroupTable, "__init__", guarded_fill)
    monkeypatch.setattr(Recorder, "__init__", guarded_record)
    monkeypatch.setattr(CompiledRun, "begin", guarded_enter)
    for name, guarded in (
        ("__init__", guarded_build), ("_point", guarded_point), ("_scratch", guarded_scratch), ("begin", guarded_begin)
    ):  # fmt: skip
        monkeypatch.setattr(table, name, guarded)
    return kept


def blocks(n: int, behaviour: str = "contact", friction: float = 0.3, **solver: Any) -> Tables:
    """Blocks alike, side by side on the ground, pressed and sheared one more than the other; one on top of the first.

    Those that have nothing on top are one class, (n - 1) members.
    """
    contact: Tables = {"behaviour": behaviour}
    if behaviour == "contact":
        contact["friction_coefficient"] = friction
    size = {"size": [0.01, 0.01, 0.01], "elements": [2, 2, 2]}
    names = [f"b{i}" for i in range(n)]
    return {
        "name": "blocks",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            "top": {"material": "steel", "box": {"origin": [0.0, 0.0, 0.01], **size}},
            **{
                name: {"material": "steel", "box": {"origin": [0.02 * i, 0.0, 0.0], **size}}
                for i, name in enumerate(names)
            },
        },
        "interface": {
            "meeting": {"sides": ["b0.zmax", "top.zmin"], **contact},
            **{f"floor_{name}": {"sides": [f"{name}.zmin", "ground"], **contact} for name in names},
        },
        "load": {
            f"press_{name}": {
                "face": f"{name}.{side}", "traction": [2e7 * i, 1e7, -1e8 - 1e7 * i],
                "law": {"type": "half_sine", "duration": 3e-6},
            }
            for i, (name, side) in enumerate([("top", "zmax"), *((name, "xmax") for name in names)])
        },
        "time": {"end": 2.4e-6, "instants": 12},
        "solver": solver,
    }  # fmt: skip


def plain(_: Tables) -> None:
    """As it is."""


def driven(tables: Tables) -> None:
    """Moving ground, and faces whose motion is given."""
    law = {"type": "half_sine", "duration": 2e-6}
    tables["interface"]["floor_b0"]["ground_velocity"] = {
        "direction": [0.0, 0.0, 1.0], "amplitude": 3.0, "law": law,
    }  # fmt: skip
    tables["boundary"] = {
        f"drive_{name}": {
            "type": "velocity", "face": f"{name}.xmin", "components": ["x"], "value": [1.0 + i], "law": law,
        }
        for i, name in enumerate(sorted(tables["substructure"]))
    }  # fmt: skip


def damped(tables: Tables) -> None:
    """Damping and quiet boundaries."""
    tables["boundary"] = {
        f"quiet_{name}": {"type": "absorbing", "face": f"{name}.ymax"} for name in ("top", "b0")
    }
    tables["material"]["steel"] |= {"rayleigh_mass": 1e3, "rayleigh_stiffness": 1e-9}


def massless(tables: Tables) -> None:
    """Surface without mass."""
    tables["time"]["scheme"] = {"type": "massless_contact"}


def kept(tables: Tables) -> None:
    """Fields and energies."""
    tables["output"] = {"fields": True, "energy": True, "every": 5}


def thrown(tables: Tables) -> None:
    """Open at first; the others rest until then."""
    tables["substructure"]["top"]["initial_velocity"] = [1.0, 0.0, -20.0]
    tables["interface"]["meeting"]["gap"] = 1e-6
    tables["load"] = {}


CASES: list[tuple[Tables, Callable[[Tables], None]]] = [
    *((blocks(n), change) for n in (1, 3, 10) for change in (plain, driven, damped)),
    *((blocks(n, friction=0.0), plain) for n in (1, 4)),
    *((blocks(n, propagator="reduced"), change) for n in (1, 4) for change in (plain, driven, damped)),
    *((blocks(n, propagator="explicit"), change) for n in (1, 4) for change in (plain, damped)),
    (blocks(3), massless),
    (blocks(4, threads=2), kept),
    (blocks(4), thrown),
    *((blocks(3, kind), plain) for kind in ("perfect", "no_slip")),
]


@pytest.mark.parametrize(("tables", "change"), CASES)
def test_nothing_beside_the_arrays(
    tables: Tables, change: Callable[[Tables], None], request: pytest.FixtureRequest
) -> None:
    change(tables)
    bare = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    guard: Guard = request.getfixturevalue("guard")
    guarded = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    assert guard.members == {1, len(tables["substructure"]) - 2 or 1}
    assert guard.broken() == []
    assert guarded.converged
    for name, history in bare.interfaces.items():
        other = guarded.interfaces[name]
        np.testing.assert_array_equal(history.traction, other.traction)
        np.testing.assert_array_equal(history.velocity, other.velocity)


def test_segments_keep_what_they_use_and_no_more(guard: Guard) -> None:
    """Arrays of the segments before are let go: a co-simulation has thousands."""
    tables = blocks(2, friction=0.0)
    tables["load"]["press_top"]["law"] = {"type": "input"}
    run = SegmentedRun(latin_fmu.scene_from_dict(tables))
    counts = []
    for i in range(4):
        run.advance((i + 1) * 1e-6, 5, {"press_top": np.full(6, 1.0 + i)})
        march = run._run._compiled if run._run is not None else None
        assert march is not None
        counts.append(len(march._classes._alive) + sum(map(len, march._classes._begun)))
    assert counts == sorted(counts, reverse=True)  # loads end
    assert guard.broken() == []
