"""Saved states of the FMU."""

from __future__ import annotations

import ctypes
import json

import numpy as np
import pytest

from latin_fmu.cosim.session import Session
from latin_fmu.latin import state_serialization as serialization
from tests.cosim.scenes import blocks

H = 0.6e-6


def test_a_state_holds_outputs_inputs_and_arrays(opened, fmi):
    host = opened(fmi)
    host.start()
    host.set(load__press__value=0.7)
    host.step(0.0, H)
    state, row = host.save(), host.read()
    field = host.array("interface.crush.points.traction", 27) if fmi == "3" else None
    host.set(load__press__value=0.1)
    host.step(H, H)
    host.restore(state)
    assert np.array_equal(host.read(), row)
    assert host.read(["load.press.value"]) == 0.7
    if field is not None:
        assert np.array_equal(host.array("interface.crush.points.traction", 27), field)


def given(host, block: bytes) -> int:
    """Status with which the host can restore these bytes: that of the call that fails, or 0."""
    states = []
    status = host.status(lambda: states.append(host.from_bytes(block)))
    return status or host.status(host.restore, states[0])


def on(host) -> np.ndarray:
    """Outputs after one more step from 2 H."""
    assert host.step(2 * H, 0.7 * H)
    return host.read()


@pytest.fixture
def running(opened, fmi):
    """Two equal instances after a step from 0 to 2 H, and the bytes of a state at H."""
    hosts = opened(fmi), opened(fmi)
    blocks = []
    for host in hosts:
        host.start()
        host.set(load__press__value=0.7)
        assert host.step(0.0, H)
        blocks.append(host.to_bytes(host.save()))
        assert host.step(H, H)
    return *hosts, blocks[0]


def test_damaged_bytes_are_refused_and_nothing_changes(running):
    """Bits flipped, bytes cut, added, doubled, or of something else: none of 1000 is taken for a state."""
    host, other, block = running
    rng, n = np.random.default_rng(16), len(block)
    for i in range(1000):
        damaged = bytearray(block)
        if i % 4 == 0:
            del damaged[int(rng.integers(n)) :]
        elif i % 4 == 1:
            damaged += rng.bytes(int(rng.integers(1, 100)))
        else:
            for at in rng.integers(n, size=1 + i % 3):
                damaged[at] ^= 1 << int(rng.integers(8))
        if bytes(damaged) == block:
            continue
        host.messages.clear()
        assert given(host, bytes(damaged)) == 3
        assert host.messages[-1][0] == 3
        assert "state" in host.messages[-1][2]
    for other_bytes in (b"", b"no state", (2**63 - 1).to_bytes(8, "little") * 20):
        assert given(host, other_bytes) == 3
    assert np.array_equal(on(host), on(other))
    assert host.to_bytes(host.save()) == other.to_bytes(other.save())
    assert given(host, block) == 0


def forged(block: bytes, change) -> bytes:
    """The state with another content, under a header and a checksum that fit."""
    lengths = [int.from_bytes(block[at : at + 8], "little") for at in (48, 56)]
    header = json.loads(block[64 : 64 + lengths[0]])
    payload = block[64 + lengths[0] :]
    kind = json.loads(payload[22 : 22 + int.from_bytes(payload[14:22], "little")])["kind"]
    tree = serialization.decode(payload, kind)
    change(header, tree)
    return serialization.sealed(serialization.encode(tree, kind), header["kind"], header["digest"], header["machine"])


def inside(tree, change) -> None:
    """Change the run inside a state: a tree in a tree in a tree."""

    def opened(holder, name, then):
        payload = holder[name].tobytes()
        kind = json.loads(payload[22 : 22 + int.from_bytes(payload[14:22], "little")])["kind"]
        part = serialization.decode(payload, kind)
        then(part)
        holder[name] = np.frombuffer(serialization.encode(part, kind), dtype=np.uint8)

    opened(tree, "session", lambda session: opened(session["mode"], "run", change))


def session_of(tree, change) -> None:
    payload = tree["session"].tobytes()
    kind = json.loads(payload[22 : 22 + int.from_bytes(payload[14:22], "little")])["kind"]
    part = serialization.decode(payload, kind)
    change(part)
    tree["session"] = np.frombuffer(serialization.encode(part, kind), dtype=np.uint8)


def shorter(holder, name) -> None:
    holder[name] = holder[name][:-1]


def with_nan(holder, name) -> None:
    holder[name] = holder[name].copy()
    holder[name].flat[holder[name].size // 2] = np.nan


def place(name: str) -> slice:
    """Numbers in the state of a run of the blocks: a field of the upper block, or one of the run."""
    session = Session(blocks())
    session.initialize()
    assert session.step(0.0, H)
    image = session._mode.run.run.image
    if name in ("f_hat", "present"):
        return slice(image.run_fields[name], image.run_fields[name] + 1)
    row = image.row(max(range(len(image.propagators)), key=lambda c: image.row(c)["n"]))
    return slice(row[name], row[name] + (row["n"] * row["m"] if name == "u" else 1))


def put(run, name: str, value: float) -> None:
    run["state"] = run["state"].copy()
    run["state"][place(name)] = value


def sunk(run) -> None:
    """The upper block 4 mm inside the lower one."""
    run["state"] = run["state"].copy()
    run["state"][place("u")] -= 4e-3


FORGERIES = {
    "digest": lambda header, _: header.update(digest="0" * 64),
    "kind": lambda header, _: header.update(kind="checkpoint"),
    "no session": lambda _, tree: tree.update(session=None),
    "numbers cut": lambda _, tree: shorter(tree["variables"], "numbers"),
    "numbers nan": lambda _, tree: with_nan(tree["variables"], "numbers"),
    "a string more": lambda _, tree: tree["variables"]["texts"].update({"9999": "x"}),
    "an array that is none": lambda _, tree: tree["variables"]["arrays"].update({"3": np.zeros(4)}),
    "start": lambda _, tree: tree.update(start_time=np.nan),
    "entry missing": lambda _, tree: tree.pop("failure"),
    "row cut": lambda _, tree: session_of(tree, lambda s: shorter(s, "row")),
    "row nan": lambda _, tree: session_of(tree, lambda s: with_nan(s, "row")),
    "load": lambda _, tree: session_of(tree, lambda s: s["loads"]["value"].update(other=1.0)),
    "time": lambda _, tree: session_of(tree, lambda s: s.update(time=-1.0)),
    "gap field": lambda _, tree: session_of(tree, lambda s: with_nan(s["mode"]["fields"]["crush"], "gap")),
    "field cut": lambda _, tree: session_of(tree, lambda s: shorter(s["mode"]["fields"]["crush"], "traction")),
    "negative gap": lambda _, tree: session_of(
        tree, lambda s: s["mode"]["fields"]["crush"].update(gap=s["mode"]["fields"]["crush"]["gap"] - 1e-6)
    ),
    "outputs": lambda _, tree: inside(tree, lambda run: put(run, "present", np.nan)),
    "state cut": lambda _, tree: inside(tree, lambda run: shorter(run, "state")),
    "state nan": lambda _, tree: inside(tree, lambda run: with_nan(run, "state")),
    "an entry less": lambda _, tree: inside(tree, lambda run: run.pop("running")),
    "traction inf": lambda _, tree: inside(tree, lambda run: put(run, "f_hat", np.inf)),
    "at rest": lambda _, tree: inside(tree, lambda run: put(run, "rest", 1.0)),
    "half at rest": lambda _, tree: inside(tree, lambda run: put(run, "rest", 0.5)),
    "turn": lambda _, tree: inside(tree, lambda run: put(run, "turn", 1e9)),
    "a part of a time step": lambda _, tree: session_of(tree, lambda s: s["loads"].update(behind=1.5)),
    "a window": lambda _, tree: session_of(tree, lambda s: s["mode"].update(window=[2, -1])),
    "sunk": lambda _, tree: inside(tree, sunk),
    "negative time steps": lambda _, tree: inside(tree, lambda run: run.update(made=-1)),
    "half a time step": lambda _, tree: inside(tree, lambda run: run.update(made=2.5)),
}


def test_forged_states_are_refused_and_nothing_changes(running):
    """Wrong sizes, numbers that are not finite, gaps, another scene: a checksum that fits does not help."""
    host, other, block = running
    assert given(host, forged(host.to_bytes(host.save()), lambda *_: None)) == 0
    for name, change in FORGERIES.items():
        host.messages.clear()
        with np.errstate(all="ignore"):
            made = forged(block, change)
        assert given(host, made) == 3, name
        assert [level for level, *_ in host.messages] == [3], name
        assert "unexpected" not in host.messages[-1][2], (name, host.messages)
    assert np.array_equal(on(host), on(other))
    assert host.to_bytes(host.save()) == other.to_bytes(other.save())


def test_handles_that_are_none_are_refused(running):
    """A handle that was freed, that was never given, or of another instance that is gone."""
    host, other, _ = running
    freed, kept = host.save(), host.save()
    number = freed.value if hasattr(freed, "value") else freed
    (host.fmu.freeFMUState if host.three else host.fmu.freeFMUstate)(freed)
    for wrong in (number, 12345, 2**62, None):
        host.messages.clear()
        assert host.status(host.restore, ctypes.c_void_p(wrong)) == 3
        assert "never returned, or that was freed" in host.messages[-1][2]
        assert host.status(host.to_bytes, ctypes.c_void_p(wrong)) == 3
    assert host.status(host.restore, kept) == 0
    assert np.array_equal(on(host), on(other))


def test_reset_and_again(opened, fmi):
    host = opened(fmi)
    rows = []
    for _ in range(2):
        host.set(load__press__value=0.7)
        host.start()
        assert host.step(0.0, H)
        rows.append(host.read())
        host.fmu.terminate()
        host.fmu.reset()
    assert np.array_equal(*rows)
