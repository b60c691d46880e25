"""Damaged input: copies of the shipped models and small files of every kind, changed at random, through the CLI."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from latin_fmu.cli import main

MODELS = Path(__file__).parents[2] / "models"
PIECES = (
    b"",
    b"nan",
    b"-1",
    b"0",
    b"1e400",
    b"[",
    b"]",
    b"{",
    b'"',
    b"=",
    b"\n",
    b"\x00",
    b"\xff\xfe",
    b"#",
    b",",
    b";",
    b"9999999999",
    b"inf",
    b"true",
    b"x",
    b"-",
    b".",
    b"$End",
    b"*",
    b"1e-300",
    b"\xe2\x82\xac",
)

SMALL_SCENE = b"""name = "fuzz"
[material.m]
young_modulus = 1e9
poisson_ratio = 0.3
density = 1000.0
[substructure.a]
material = "m"
mesh = {file = "two.msh"}
[load.push]
face = "a.top"
pressure = 1e5
law = {type = "csv", file = "law.csv"}
[boundary.held]
type = "fixed"
face = "a.bottom"
[time]
end = 1e-3
instants = 3
"""
LAW = b"time,value\n0,0\n1e-4,1\n2e-4,0.5\n1e-3,0\n"


@dataclass(frozen=True)
class Result:
    """What the command line did: exit code, output, files it left."""

    code: int
    said: str
    left: list[str]
    changed: str


def small_mesh() -> bytes:
    """One hexahedron on another, groups a (volume), top and bottom, as meshio writes gmsh 2.2."""
    return (Path(__file__).parent / "two.msh").read_bytes()


def folder(seed: int, home: Path) -> tuple[Path, Path, str]:
    """A folder with one scene and its files, one of them damaged; the scene and what was changed."""
    rng = np.random.default_rng(seed)
    home.mkdir()
    if rng.random() < 0.5:
        (home / "scene.toml").write_bytes(SMALL_SCENE)
        (home / "two.msh").write_bytes(small_mesh())
        (home / "law.csv").write_bytes(LAW)
        scene, names = home / "scene.toml", ["scene.toml", "two.msh", "law.csv"]
    else:
        sources = [
            p for p in sorted(MODELS.glob("*/*.toml")) if not {p.stem, p.parent.name} & {"n08", "n16", "bolted_beam"}
        ]
        source = sources[int(rng.integers(len(sources)))]
        for file in source.parent.iterdir():
            if file.suffix in (".toml", ".msh", ".csv", ".inp"):
                shutil.copy(file, home / file.name)
        scene, names = home / source.name, [source.name]
        names += [file.name for file in home.iterdir() if file.suffix != ".toml"]
    victim = home / str(rng.choice(names))
    content = damaged(victim.read_bytes(), rng)
    victim.write_bytes(content)
    return home, scene, victim.name


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three cuts, overwrites, repeated or dropped lines, or changed numbers."""
    for _ in range(int(rng.integers(1, 4))):
        kind = rng.integers(5)
        start = int(rng.integers(len(content) + 1))
        stop = min(len(content), start + int(rng.integers(0, 30)))
        if kind == 0:
            content = content[:start] + PIECES[int(rng.integers(len(PIECES)))] + content[stop:]
        elif kind == 1:
            content = content[:start]
        elif kind == 2:
            lines = content.split(b"\n")
            where = int(rng.integers(len(lines)))
            lines[where : where + 1] = [] if rng.random() < 0.5 else [lines[where]] * 2
            content = b"\n".join(lines)
        else:
            numbers = list(re.finditer(rb"-?\d+(\.\d+)?(e-?\d+)?", content))
            if numbers:
                hit = numbers[int(rng.integers(len(numbers)))]
                content = content[: hit.start()] + PIECES[int(rng.integers(len(PIECES)))] + content[hit.end() :]
        if not content:
            break
    return content


def attempt(seed: int, home: Path, capsys: object) -> Result:
    """``latin-fmu check`` on a damaged folder (``run`` for the small scene, where it costs nothing)."""
    home, scene, changed = folder(seed, home)
    before = {file.name for file in home.iterdir()}
    small = scene.read_bytes()[:13] == SMALL_SCENE[:13] and b"instants = 3\n" in scene.read_bytes()
    command = ["run", str(scene), "-o", str(home / "out.nc"), "--quiet"] if small else ["check", str(scene)]
    code = main(command)
    said = capsys.readouterr().err  # type: ignore[attr-defined]
    left = sorted({file.name for file in home.iterdir()} - before)
    return Result(code, said, left, changed)
