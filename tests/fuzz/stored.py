"""Damaged files that the package itself wrote: results, studies, checkpoints, FMUs. What is read equals the whole file.

Damage is what disks and transfers do: flipped bits, cuts, swapped blocks of bytes.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.cli import main
from latin_fmu.errors import InputError
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.results.files import open_results, readable

from ..cosim.scenes import blocks
from .changes import Rng

Content = Mapping[str, np.ndarray]
Attempt = Callable[[Rng, Path], None]
SCENE = (Path(__file__).parent / "one.toml").read_text()
RUN = ["output.fields=true", "output.energy=true", "output.surfaces=true", "time.instants=12"]
VARY = {"interface.crush.friction_coefficient": [0.1, 0.3], "load.press.pressure": [1e7, 1e8]}
BLOCKS = (16, 64, 512, 4096)  # bytes that change places
STOPPED = 5  # instants before the checkpoint


def damaged(content: bytes, rng: Rng) -> bytes:
    """One to eight flipped bits, a cut, or two blocks of bytes in each other's place."""
    kind, changed = int(rng.integers(3)), bytearray(content)
    if kind == 0:
        for _ in range(int(rng.integers(1, 9))):
            changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        del changed[int(rng.integers(len(changed))) :]
    else:
        size = min(int(rng.choice(BLOCKS)), len(changed) // 2)
        a, b = (int(rng.integers(len(changed) - size)) for _ in range(2))
        changed[a : a + size], changed[b : b + size] = changed[b : b + size], changed[a : a + size]
    return bytes(changed)


@contextmanager
def silent() -> Iterator[tuple[io.StringIO, io.StringIO]]:
    """Standard streams that are kept."""
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as errors:
        yield out, errors


def command(*words: str) -> int:
    """Exit code of the command line; 2 comes with one sentence that is no traceback."""
    with silent() as (_, errors):
        code = main(list(words))
    said = errors.getvalue()
    assert "Traceback" not in said, said
    assert code != 2 or said.count("latin-fmu: ") == 1, said
    return code


@cache
def whole(kind: str) -> Mapping[str, bytes]:
    """Whole files of a kind, by name."""
    with TemporaryDirectory() as name, silent():
        folder = Path(name)
        (folder / "scene.toml").write_text(SCENE)
        scene = latin_fmu.load_scene(folder / "scene.toml", RUN)
        if kind == "results":
            latin_fmu.solve(scene).save(folder / "out.nc")
        elif kind == "study":
            latin_fmu.sweep(scene, VARY, folder / "out.nc", histories=True)
        elif kind == "checkpoint":
            stop = iter([False] * STOPPED + [True] * 100)
            unsaid = Checkpoint(folder / "out.nc.checkpoint", 2, stop=lambda: next(stop), log=lambda _: None)
            latin_fmu.solve(scene, checkpoint=unsaid)
        else:
            build_fmu(blocks(), folder / "blocks.fmu", "2", python=True)
        (folder / "scene.toml").unlink()
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def content_of(path: Path) -> Content:
    """All values of a results file."""
    found = {}
    tree = open_results(path)
    try:
        with readable(path):
            for node in tree.subtree:
                for name, variable in node.to_dataset(inherit=False).variables.items():
                    if not str(name).startswith("cpu_seconds"):
                        found[f"{node.path}/{name}"] = np.asarray(variable.values)
    finally:
        tree.close()
    return found


@cache
def expected(kind: str) -> Content:
    """Values of the whole file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "out.nc"
        path.write_bytes(whole(kind)["out.nc"])
        return content_of(path)


def assert_same(found: Content, kind: str) -> None:
    known = expected(kind)
    assert set(found) == set(known)
    for name, values in known.items():
        assert found[name].shape == values.shape, name
        assert np.array_equal(found[name], values, equal_nan=values.dtype.kind == "f"), name


def file_of_results(kind: str) -> Attempt:
    """A results file, opened in Python and on the command line."""

    def attempt(rng: Rng, folder: Path) -> None:
        path = folder / "out.nc"
        path.write_bytes(damaged(whole(kind)["out.nc"], rng))
        try:
            assert_same(content_of(path), kind)
        except InputError:
            assert command("plot", str(path), "-o", str(folder / "out.png")) == 2
            assert not (folder / "out.png").exists()

    return attempt


def checkpoint(rng: Rng, folder: Path) -> None:
    """One of the files of a checkpoint; continued, or refused with nothing written."""
    files = dict(whole("checkpoint"))
    assert {"out.nc.checkpoint", "out.nc.checkpoint.histories"} <= set(files)
    if rng.random() < 0.7:  # the generation before would take its place
        files.pop("out.nc.checkpoint.previous", None)
    victim = sorted(files)[int(rng.integers(len(files)))]
    files[victim] = damaged(files[victim], rng)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    (folder / "scene.toml").write_text(SCENE)
    words = [word for setting in RUN for word in ("--set", setting)]
    code = command("run", str(folder / "scene.toml"), "-o", str(folder / "out.nc"), "--resume", "--quiet", *words)
    assert code in (0, 2)
    if code == 0:
        found = content_of(folder / "out.nc")
        assert_same({name: found[name] for name in expected("results")}, "results")
    else:
        assert not (folder / "out.nc").exists()
        assert {name: (folder / name).read_bytes() for name in files} == files


def fmu(rng: Rng, folder: Path) -> None:
    """An FMU, simulated."""
    (folder / "blocks.fmu").write_bytes(damaged(whole("fmu")["blocks.fmu"], rng))
    code = command("simulate", str(folder / "blocks.fmu"), "-o", str(folder / "out.csv"))
    assert code in (0, 2)
    assert (folder / "out.csv").exists() == (code == 0)


STORED: dict[str, Attempt] = {
    "results": file_of_results("results"),
    "study": file_of_results("study"),
    "checkpoint": checkpoint,
    "whole_fmu": fmu,
}
