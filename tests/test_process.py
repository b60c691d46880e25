"""The process of the command line: closed and full streams, signals, surroundings with little in them."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from latin_fmu import open_results

from .test_cli import SCENE

ROOT = Path(__file__).parents[1]
MAIN = "import sys; from latin_fmu.cli import main; print('ready', file=sys.stderr, flush=True); sys.exit(main())"

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a POSIX shell")


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a scene."""
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def environment(**more: str) -> dict[str, str]:
    """Surroundings of a process: those of the tests, and some more."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


def shell(place: Path, line: str, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    """A shell line in which ``latin-fmu`` is the command line."""
    line = line.replace("latin-fmu", f"{sys.executable} -m latin_fmu")
    given = environment() if env is None else env
    return subprocess.run(
        ["sh", "-c", line], cwd=place, env=given, capture_output=True, text=True, check=False, timeout=600
    )


def converged(file: Path) -> bool:
    """Whether a results file can be read and holds a run that converged."""
    tree = open_results(file)
    try:
        return bool(tree.attrs["converged"])
    finally:
        tree.close()


@pytest.mark.parametrize("closed", [">&- 2>&- <&-", "> /dev/full 2>&1"])
def test_streams_that_are_closed_or_full_change_nothing(place: Path, closed: str) -> None:
    done = shell(place, f"latin-fmu run scene.toml -o a.nc --no-estimate {closed}")
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert converged(place / "a.nc")


def test_closed_streams_keep_the_exit_codes_of_errors(place: Path) -> None:
    assert shell(place, "latin-fmu run nothing.toml >&- 2>&-").returncode == 2
    assert shell(place, "latin-fmu run scene.toml --set solver.max_iterations=1 >&- 2> /dev/full").returncode == 1


def test_a_reader_that_goes_changes_nothing(place: Path) -> None:
    done = shell(place, "(latin-fmu reference; echo $? >&2) | head -1")
    assert done.stderr.strip() == "0"


def test_interruptions_at_any_time_leave_no_traceback(place: Path) -> None:
    """From the first moment of the command line on, imports included."""
    draw = random.Random(16)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
        process = subprocess.Popen(
            [sys.executable, "-c", MAIN, "run", "scene.toml", "--set", "time.end=1", "--set", "time.instants=500000"],
            cwd=place,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stderr is not None
        assert process.stderr.readline() == "ready\n"
        time.sleep(draw.uniform(0.0, 1.0))
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 128 + number, errors
        assert "Traceback" not in errors
        assert "Exception ignored" not in errors


FIRST = """
import builtins, os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts what runs behind with it ignored
from latin_fmu.__main__ import main
load = builtins.__import__

def interrupting(name, *given, **named):
    if name == "cli":
        os.kill(os.getpid(), signal.SIGINT)
    return load(name, *given, **named)

builtins.__import__ = interrupting
main()
"""


def test_an_interruption_before_the_command_line_is_there(place: Path) -> None:
    """While its modules are loaded."""
    done = subprocess.run([sys.executable, "-c", FIRST], cwd=place, env=environment(), capture_output=True, check=False)
    assert done.returncode == -signal.SIGINT
    assert done.stderr == b""


BOTH_DRAFTED = """
import os, sys, time
from pathlib import Path
from latin_fmu.cli import main
from latin_fmu.results import writing
flush = writing._flush

def waiting(draft):
    Path("drafted", str(os.getpid())).touch()
    while len(os.listdir("drafted")) < 2:
        time.sleep(0.01)
    flush(draft)

writing._flush = waiting
sys.exit(main())
"""


def test_two_processes_on_one_output(place: Path) -> None:
    """Each has written its draft before one of them is renamed."""
    (place / "drafted").mkdir()
    command = [sys.executable, "-c", BOTH_DRAFTED, "run", "scene.toml", "-o", "a.nc", "--quiet", "--no-estimate"]
    both = [subprocess.Popen(command, cwd=place, env=environment()) for _ in range(2)]
    assert [process.wait(100) for process in both] == [0, 0]
    assert converged(place / "a.nc")
    assert sorted(path.name for path in place.iterdir()) == ["a.nc", "drafted", "scene.toml"]


def test_no_home_no_cache_no_terminal_locale_c(place: Path) -> None:
    """Home and cache that cannot be written to (a file stands in their place), no terminal, locale C."""
    (place / "file").write_text("")
    blocked = str(place / "file" / "below")
    env = environment(HOME=blocked, XDG_CACHE_HOME=blocked)
    env |= {"MPLCONFIGDIR": blocked, "LC_ALL": "C", "TERM": "dumb", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = shell(place, "latin-fmu run scene.toml -o a.nc --no-estimate && latin-fmu plot a.nc -o a.png", env)
    assert done.returncode == 0, done.stderr
    assert converged(place / "a.nc")
    assert (place / "a.png").stat().st_size > 10_000
    del env["HOME"]
    done = shell(place, "latin-fmu run scene.toml -o b.nc --no-estimate", env)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def test_a_clock_that_jumps_changes_no_number(place: Path) -> None:
    """The wall clock goes back by a year and the monotonic clocks stand still or leap, from call to call. Without the
    error estimate, which depends on the time that the run took."""
    jumps = (
        "import sys, time, itertools; n = itertools.count(); real = time.time; "
        "time.time = lambda: real() - 3e7 * (next(n) % 2); "
        "time.perf_counter = lambda: 1e3 * (next(n) // 7); time.process_time = lambda: 1e3 * (next(n) // 5); "
        "time.monotonic = lambda: 1e5 * (next(n) // 3); "
        "from latin_fmu.cli import main; sys.exit(main())"
    )
    for name, code in (("a.nc", "import sys; from latin_fmu.cli import main; sys.exit(main())"), ("b.nc", jumps)):
        command = [sys.executable, "-c", code, "run", "scene.toml", "-o", name, "--quiet", "--no-estimate"]
        subprocess.run(command, cwd=place, env=environment(), check=True)
    first, second = (open_results(place / name) for name in ("a.nc", "b.nc"))
    for path in (node.path for node in first.subtree):
        assert first[path].to_dataset(inherit=False).equals(second[path].to_dataset(inherit=False)), path
    first.close()
    second.close()


@pytest.mark.parametrize(
    ("command", "output"),
    [
        ("run scene.toml -o link.nc", "link.nc"),
        ("modes scene.toml -o scene.toml", "scene.toml"),
        ("plot scene.toml -o scene.toml", "scene.toml"),
        ("fmu scene.toml -o ./scene.toml", "scene.toml"),
        ("simulate x.fmu --input scene.toml -o scene.toml", "scene.toml"),
        ("simulate out.csv", "out.csv"),
    ],
)
def test_no_output_takes_the_place_of_an_input(place: Path, command: str, output: str) -> None:
    (place / "link.nc").symlink_to(place / "scene.toml")
    (place / "out.csv").write_text("an input")
    done = shell(place, f"latin-fmu {command}")
    assert done.returncode == 2
    assert f"{output}: this file is an input, the output would replace it; name another file" in done.stderr
    assert (place / "scene.toml").read_text() == SCENE
    assert (place / "out.csv").read_text() == "an input"


def test_places_that_are_no_file(place: Path) -> None:
    """A folder that is not there yet, a pipe under the name of the standard output, a current folder that is gone."""
    done = shell(place, "latin-fmu run scene.toml -o new/")
    assert (done.returncode, done.stdout) == (2, "")
    assert "'new/' names a folder; name a file in it" in done.stderr
    done = shell(place, "(latin-fmu run scene.toml -o /dev/stdout; echo $? >&2) | cat")
    assert "/dev/stdout: this is a pipe, a file is needed; name a file, e.g. " in done.stderr
    assert done.stderr.endswith("\n2\n")
    (place / "gone").mkdir()
    done = shell(place, "cd gone; rmdir ../gone; latin-fmu run ../scene.toml")
    assert done.returncode == 2
    assert "current folder: cannot be used: No such file or directory; change to a folder that exists" in done.stderr
    assert [path.name for path in place.iterdir()] == ["scene.toml"]


def test_files_that_may_not_grow(place: Path) -> None:
    """Checkpoints that cannot be written cost nothing; results that cannot be written are reported."""
    settings = "--set solver.window=1 --checkpoint 5"
    done = shell(place, f"ulimit -f 4; latin-fmu run scene.toml -o a.nc {settings}")
    assert done.returncode == 4, done.stderr
    assert "the checkpoint could not be written, the run continues: " in done.stderr
    assert "a.nc: writing failed: " in done.stderr
    assert "Traceback" not in done.stderr
    assert "converged: " in done.stdout


def test_little_memory_is_a_sentence(place: Path) -> None:
    """Libraries that cannot be loaded (OpenBLAS does not end where its buffer does not fit), arrays that cannot be
    made: where it happens depends on the system."""
    codes = set()
    for limit in (100_000, 180_000, 255_000, 320_000, 350_000, 420_000, 500_000):
        done = shell(place, f"ulimit -v {limit}; latin-fmu run scene.toml -o a.nc --quiet --no-estimate")
        assert "Traceback" not in done.stderr, done.stderr
        assert done.returncode in (0, 2, 5), (limit, done.stderr)
        assert done.returncode != 5 or "latin-fmu: insufficient memory: " in done.stderr
        codes.add(done.returncode)
    assert codes >= {0, 5}


def test_names_beyond_ascii_in_the_locale_c(place: Path) -> None:
    """Written under the bytes of the name; reading is refused, for the netCDF library cannot write the name. Streams
    that cannot write it either."""
    env = environment(LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0", PYTHONIOENCODING="ascii")
    folder = place / "Zürich 衝撃"
    folder.mkdir()
    (folder / "szene é.toml").write_text(SCENE)
    os.rename(place / "scene.toml", folder / "b.toml")
    for name in ("b", "szene é"):
        run = f"latin-fmu run '../{folder.name}/{name}.toml' -o '../{folder.name}/{name}.nc' --no-estimate"
        done = shell(folder, run, env)
        assert done.returncode == 0, done.stderr
        assert converged(folder / f"{name}.nc")
    done = shell(folder, "latin-fmu plot 'szene é.nc' -o b.png", env)
    assert done.returncode == 2
    assert "szene" in done.stderr
    assert "cannot write this name in the encoding of the locale (ascii); set LC_ALL=C.UTF-8" in done.stderr
