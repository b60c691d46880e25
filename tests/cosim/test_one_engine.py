"""One implementation of a communication step: what it enters, in which language its messages are, how it is stopped."""

from __future__ import annotations

import ast
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings, c_runtime

from .scenes import blocks

PACKAGE = Path(latin_fmu.__file__).parent
H = 1e-6
WORDS = 5
"""Consecutive words from which on two sentences are one."""


def constant_blocks() -> latin_fmu.Scene:
    """The blocks without a law that varies."""
    law = {"type": "input", "start_value": 0.25}
    return blocks(load={"press": {"face": "upper.zmax", "pressure": 100e6, "law": law}})


def test_a_step_enters_two_files_of_python_and_one_of_c() -> None:
    session, entered = Session(blocks()), set[str]()
    session.initialize()
    assert session.step(0.0, H)

    def look(frame, event, _argument) -> None:  # type: ignore[no-untyped-def]
        if event == "call" and frame.f_code.co_filename.startswith(str(PACKAGE)):
            entered.add(f"{Path(frame.f_code.co_filename).name}")

    sys.setprofile(look)
    try:
        report = session.step(H, H)
    finally:
        sys.setprofile(None)
    assert report
    assert entered == {"session.py", "engine.py"}
    text = {path.name: path.read_text() for path in c_runtime.sources()}
    of_a_step = ("latin_fmu_step(", "int64_t march(", "int advanced(", "int marched(", "int64_t communicated(")
    for function in of_a_step:
        assert [name for name in text if re.search(rf"^[^\s/#].*{re.escape(function)}.*\)$", text[name], re.M)] == [
            "run.c"
        ]


def sentences_of_c() -> Iterator[str]:
    for path in c_runtime.sources():
        code = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.S)
        for literal in re.finditer(r'"(?:[^"\\]|\\.)*"(?:\s*"(?:[^"\\]|\\.)*")*', code):
            yield "".join(re.findall(r'"((?:[^"\\]|\\.)*)"', literal[0]))


def sentences_of_python() -> Iterator[tuple[str, str]]:
    """Strings in calls that refuse or raise, of co-simulation."""
    refusing = ("Problem", "Error", "refused", "_refused", "_missing", "bad")
    for path in [*(PACKAGE / "cosim").rglob("*.py"), PACKAGE.parent / "fmu_build" / "compiled.py"]:
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call) or not ast.unparse(node.func).endswith(refusing):
                continue
            for part in ast.walk(node):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield path.name, part.value


def runs(sentence: str) -> set[tuple[str, ...]]:
    words = re.sub(r"%[-+ 0-9.*l]*[a-z]|[^a-zA-Z']+", " ", sentence).lower().split()
    return {tuple(words[i : i + WORDS]) for i in range(len(words) - WORDS + 1)}


def test_no_message_is_written_in_two_languages() -> None:
    known = {words: sentence for sentence in sentences_of_c() for words in runs(sentence)}
    assert len(known) > 500
    twins = [
        (file, sentence, known[words])
        for file, sentence in sentences_of_python()
        for words in runs(sentence)
        if words in known
    ]
    assert not twins, twins


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a signal between C and Python
def test_a_long_step_is_interrupted_and_changes_nothing() -> None:
    session = Session(constant_blocks())
    session.initialize()
    before = session.snapshot()
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    # a process that was started in the background ignores it
    before_test = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            session.step(0.0, 20_000 * H)  # 100,000 time steps
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before_test)
    assert session.snapshot() == before
    assert session.step(0.0, H)


def test_an_error_in_python_ends_the_step_alone(monkeypatch) -> None:
    """Of what the kernels call; the engine goes on from the state before."""
    scene = blocks(solver={"propagator": "cg"})
    session, other = Session(scene), Session(scene)
    for one in (session, other):
        one.initialize()
    run = session._solver.run
    assert run is not None
    factor = type(run.image.propagators[0].operators.factor)

    def fails(*_: object) -> None:
        raise ZeroDivisionError("of a test")

    with monkeypatch.context() as patched:
        patched.setattr(factor, "backward", fails)
        with pytest.raises(ZeroDivisionError, match="of a test"):
            session.step(0.0, H)
    for one in (session, other):
        assert one.step(0.0, H)
    assert np.array_equal(session.row, other.row)


def test_laws_and_factors_of_python_are_called() -> None:
    """Conjugate gradients, to their own tolerance, give the forces of the factor."""
    rows = []
    for propagator in ("direct", "cg"):
        session = Session(blocks(solver={"propagator": propagator}))
        session.initialize()
        for i in range(5):
            assert session.step(i * H, H)
        rows.append(session.values([f"interface.crush.force[{k}]" for k in (1, 2, 3)]))
    assert rows[1] == pytest.approx(rows[0], abs=1e-6 * np.abs(rows[0]).max())
    assert not np.array_equal(*rows)


def test_what_is_recorded_does_not_change_the_numbers() -> None:
    plain, kept = (Session(blocks(), Settings(keep=keep)) for keep in (False, True))
    for session in (plain, kept):
        session.initialize()
        for i in range(6):
            session.set_load("press", 0.2 + 0.1 * i, 0.1 / H)
            assert session.step(i * H, H)
    assert np.array_equal(plain.row, kept.row)
    force = kept.dataset()["interfaces/crush"]["force"].values[-1]
    assert plain.values([f"interface.crush.force[{k}]" for k in (1, 2, 3)]) == pytest.approx(force, rel=1e-12)


def test_no_library_and_no_compiler_is_said(monkeypatch) -> None:
    monkeypatch.setattr(c_runtime, "_digest_in", lambda _: "of other files")
    monkeypatch.setattr(c_runtime.shutil, "which", lambda _: None)
    monkeypatch.setattr(c_runtime, "find_spec", lambda _: None)
    monkeypatch.setattr(c_runtime, "digest", lambda: "0" * 64)  # of no library that is there
    c_runtime.loaded.cache_clear()
    try:
        session = Session(blocks())
        with pytest.raises(latin_fmu.errors.InputError, match=r"is missing, and there is no C compiler.*ziglang"):
            session.initialize()
    finally:
        c_runtime.loaded.cache_clear()


def test_kernels_outside_the_library_make_the_same_steps() -> None:
    """As plain Python, for a debugger."""
    code = (
        "from latin_fmu.cosim import Session\n"
        "from tests.cosim.scenes import bar\n"
        "session = Session(bar())\n"
        "session.initialize()\n"
        "assert all(session.step(0.02 * i, 0.02) for i in range(4))\n"
        "print(session.row.tolist())\n"
    )
    rows = []
    for compiled in ("", "setup"):
        environment = {**os.environ, "LATIN_FMU_COMPILE": compiled}
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        rows.append(np.array(ast.literal_eval(done.stdout)))
    assert rows[1] == pytest.approx(rows[0], rel=1e-11, abs=1e-9)
