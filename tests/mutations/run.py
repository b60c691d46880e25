"""Break single expressions of the numerical sources and run the tests: ``python -m tests.mutations.run``.

Each mutant is written into a copy of the package; a change of a kernel rebuilds the library of kernels from that copy.
A mutant is red when a test fails, the process ends or exceeds its time. One that does not compile is no mutant: the
next of the draw takes its place. Those that stay green are compared with ``survivors.toml``, which explains them.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from latin_fmu.compiled import library

from .generator import Mutant, all_sites, drawn

ROOT = Path(__file__).parents[2]
SEED, COUNT, LEAST_RED = 1, 60, 57
COPIED = ("latin_fmu", "fmu_build", "tests", "models", "examples", "docs")
TESTS = {  # by folder: what fails soonest comes first
    "laws": ("interface latin", "verification"),
    "kernels": (
        "latin propagator interface",
        "verification",
        "cosim model_exchange test_segments.py test_same_bits.py",
    ),
    "interface": ("interface latin", "verification"),
    "time_scheme": ("time_scheme propagator latin", "verification"),
    "propagator": ("propagator latin", "verification", "cosim model_exchange scene test_memory.py test_same_bits.py"),
    "assembly": (
        "latin scene test_segments.py",
        "verification",
        "fem test_explain.py cosim test_memory.py test_cli.py",
    ),
}
NEVER = ("mutations", "fuzz", "test_architecture.py", "test_kernels_library.py")  # they say nothing about numbers
LONGEST = 480  # s of processor time for each group of tests; with unchanged sources they take up to 160
LONGEST_REST = 1200  # s for the other quick tests together, which run where those of the folder notice nothing
MEMORY = 8 << 30  # bytes of address space: a wrong size is an error, not the end of the machine


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant: ``red``, ``green`` or ``invalid`` (it does not compile), and the test that failed."""

    mutant: Mutant
    colour: str
    reason: str


class Copy:
    """A copy of the source tree in which one file at a time is changed; ``plain`` : nothing is compiled."""

    def __init__(self, folder: Path, plain: bool = False) -> None:
        self.folder, self.plain = folder, plain
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("pyproject.toml", "mkdocs.yml", "CITATION.cff", "README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
            shutil.copy(ROOT / name, folder)
        (folder / "build").mkdir()
        for path in (ROOT / "build").glob("_kernels*"):
            shutil.copy(path, folder / "build")

        self._compiler: subprocess.Popen[str] | None = None
        package = folder / "latin_fmu"
        self._compiled = {source.as_posix() for source in library.sources_of(package)}

    def build(self, mutant: Mutant) -> str:
        """Compile the kernels with a mutant; the message of the compiler where it fails."""
        self._compiler = self._compiler or self._started()
        request = {"file": mutant.file, "function": mutant.function}
        assert self._compiler.stdin is not None
        self._compiler.stdin.write(json.dumps(request) + "\n")
        self._compiler.stdin.flush()
        return self._answer(self._compiler)

    def _started(self) -> subprocess.Popen[str]:
        command = [sys.executable, "-B", str(Path(__file__).with_name("compiler.py"))]
        compiler = subprocess.Popen(
            command, cwd=self.folder, env=self._environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._answer(compiler)
        return compiler

    @staticmethod
    def _answer(compiler: subprocess.Popen[str]) -> str:
        assert compiler.stdout is not None
        line = compiler.stdout.readline()
        if not line:
            raise SystemExit("the sources as they are do not compile")
        return str(json.loads(line))

    def close(self) -> None:
        """End the compiler."""
        if self._compiler is not None:
            self._compiler.communicate()

    def test(self, groups: Sequence[str], longest: float = LONGEST) -> str:
        """Run groups of tests; the first failure, empty where there is none."""
        for group in groups:
            tests = [f"tests/{name}" for name in group.split()]
            try:
                done = self._python(
                    ["-m", "pytest", "-x", "-q", "--tb=line", "-p", "no:cacheprovider", *tests], longest
                )
            except subprocess.TimeoutExpired:
                return "no end"
            if done.returncode:
                failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return failed[0].partition(" - ")[0] if failed else f"the process ends with {done.returncode}"
        return ""

    def judge(self, mutant: Mutant, groups: Sequence[str] | None = None) -> Verdict:
        """Apply a mutant, compile, run groups of tests (those of its folder, then all others) and restore."""
        path = self.folder / "latin_fmu" / mutant.file
        source = path.read_text(encoding="utf-8")
        library = {p: p.read_bytes() for p in (self.folder / "build").glob("_kernels*")}
        try:
            path.write_text(mutant.applied(source), encoding="utf-8")
            if not self.plain and mutant.file in self._compiled and (refused := self.build(mutant)):
                return Verdict(mutant, "invalid", refused[:100])
            folder = mutant.file.partition("/")[0]
            failed = self.test(groups or TESTS[folder])
            if not failed and groups is None:
                failed = self.test((rest(folder),), LONGEST_REST)
            return Verdict(mutant, "red" if failed else "green", failed)
        finally:
            path.write_text(source, encoding="utf-8")
            for place, content in library.items():
                place.write_bytes(content)

    def _environment(self) -> dict[str, str]:
        others = {k: v for k, v in os.environ.items() if not k.startswith("LATIN_FMU_")}
        others |= {"LATIN_FMU_COMPILE": "setup"} if self.plain else {}
        return others | {"PYTHONPATH": str(self.folder), "OMP_NUM_THREADS": "1"}

    def _python(self, arguments: Sequence[str], seconds: float) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-B", *arguments],
            cwd=self.folder,
            env=self._environment(),
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=20 * seconds,  # of a process that sleeps; on a busy machine one that computes gets its time
            preexec_fn=lambda: _limit(int(seconds)),
        )


def _limit(seconds: int) -> None:
    """Limits of the process of a mutant, which may loop for ever or allocate without end."""
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def rest(folder: str) -> str:
    """The quick tests that are not among those of a folder."""
    used = {*" ".join(TESTS[folder]).split(), *NEVER, "conftest.py", "__pycache__"}
    return " ".join(sorted(path.name for path in (ROOT / "tests").iterdir() if path.name not in used))


def explained() -> dict[tuple[str, str, str, str], str]:
    """Why a mutant that no test fails on is no fault, by its file, function and expressions."""
    table = tomllib.loads((Path(__file__).parent / "survivors.toml").read_text(encoding="utf-8"))
    return {(s["file"], s["function"], s["before"], s["after"]): s["reason"] for s in table.get("survivor", [])}


def verdicts(seed: int, count: int, skip: int = 0, baseline: bool = True) -> Iterator[Verdict]:
    """Verdicts on the mutants of a seed, the first ``skip`` of the draw left out, until ``count`` compile."""
    with tempfile.TemporaryDirectory() as folder, closing(Copy(Path(folder))) as copy:
        every = dict.fromkeys((*(group for groups in TESTS.values() for group in groups), rest("kernels")))
        for group in every if baseline else ():
            if failed := copy.test((group,), LONGEST_REST):
                raise SystemExit(f"the sources as they are fail {failed}")
        valid = 0
        for mutant in itertools.islice(drawn(ROOT / "latin_fmu", seed), skip, None):
            verdict = copy.judge(mutant)
            valid += verdict.colour != "invalid"
            yield verdict
            if valid == count:
                return


def quick_mutants() -> list[tuple[Mutant, str]]:
    """Mutants of ``quick.toml`` and the tests that each must fail.

    Raises
    ------
    LookupError : the source of one has changed.
    """
    named = tomllib.loads((Path(__file__).parent / "quick.toml").read_text(encoding="utf-8"))["mutant"]
    every = {mutant.key: mutant for site in all_sites(ROOT / "latin_fmu") for mutant in site}
    keys = [(m["file"], m["function"], m["before"], m["after"]) for m in named]
    if gone := [key for key in keys if key not in every]:
        raise LookupError(f"quick.toml names expressions that are no longer there: {gone}")
    return [(every[key], m["tests"]) for key, m in zip(keys, named, strict=True)]


def quick_verdicts() -> Iterator[Verdict]:
    """Verdicts on the mutants of ``quick.toml``, each by its own tests; nothing is compiled."""
    with tempfile.TemporaryDirectory() as folder, closing(Copy(Path(folder), plain=True)) as copy:
        for mutant, tests in quick_mutants():
            yield copy.judge(mutant, (tests,))


def say(text: str) -> None:
    """Print a line at once: a run takes an hour."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main() -> int:
    """Print one line for each mutant and the counts; 1 where too few are red or a survivor is not explained."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--quick", action="store_true", help="25 mutants that need no compilation: minutes")
    parser.add_argument("--skip", type=int, default=0, help="leave out the first mutants of the draw")
    parser.add_argument(
        "--no-baseline", action="store_true", help="do not run the tests on the unchanged sources first"
    )
    given = parser.parse_args()
    known, counts, unknown = explained(), dict.fromkeys(("red", "green", "invalid"), 0), 0
    run = quick_verdicts() if given.quick else verdicts(given.seed, given.count, given.skip, not given.no_baseline)
    for verdict in run:
        m, began = verdict.mutant, time.strftime("%H:%M:%S")
        counts[verdict.colour] += 1
        unknown += verdict.colour == "green" and m.key not in known
        reason = known.get(m.key, "NOT EXPLAINED") if verdict.colour == "green" else verdict.reason
        place = f"{m.file}:{m.line} {m.function}"
        say(f"{began} {verdict.colour:7s} {place}  [{m.before}] -> [{m.after}]  {reason}")
    say(f"{counts['red']} red, {counts['green']} green, {unknown} of them not explained; {counts['invalid']} invalid")
    if given.quick:
        return int(counts["green"] > 0)
    return int(unknown > 0 or counts["green"] > given.count * (COUNT - LEAST_RED) / COUNT)


if __name__ == "__main__":
    raise SystemExit(main())
