"""The library of compiled kernels: complete, equal to Python, refused where it does not fit."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy.sparse as sp

import latin_fmu
from latin_fmu.aot import declared, linking
from latin_fmu.cholesky import substitution as sweeps
from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.cholesky.many_columns import MANY
from latin_fmu.cholesky.substitution import LANES, SPARE
from latin_fmu.compiled import declare, fields, library
from latin_fmu.compiled.declare import Entry, MismatchError, Signature, address
from latin_fmu.interface import BEHAVIOURS
from latin_fmu.kernels import inputs, sparse_response
from latin_fmu.kernels.acceleration import Anderson
from latin_fmu.laws.dispatch import LAWS, law_tangents
from latin_fmu.propagator import stable_step
from latin_fmu.propagator.interface_matrices import project

ROOT = Path(__file__).parents[1]


class Pair(NamedTuple):
    """An array and a number."""

    values: Any
    factor: float


PAIR = fields(Pair, "f8[:, ::1], f8")
RECORD = np.dtype([("n", np.int64), ("x", np.float64)])


# what a signature accepts, and how it is handed over


@pytest.mark.parametrize(
    ("text", "arguments", "slots"),
    [
        ("i8, f8, b1", (3, 0.5, True), [3, 0.5, 1]),
        ("i8", (np.int64(-2),), [-2]),
        ("f8[::1] -> i8", (np.arange(3.0),), ["address", 3]),
        ("i8[:, ::1], i8", (np.zeros((2, 5), dtype=np.int64), 1), ["address", 2, 5, 1]),
        ("u4[::1]", (np.zeros(0, dtype=np.uint32),), ["address", 0]),
        ("Pair, rows[::1]", (Pair(np.ones((1, 2)), 2.0), np.zeros(4, RECORD)), ["address", 1, 2, 2.0, "address", 4]),
    ],
)
def test_arguments_are_packed_without_copies(text, arguments, slots):
    signature = Signature(text, {"Pair": PAIR, "rows": RECORD})
    packed = signature.pack(arguments)
    assert len(packed) == 8 * len(slots)
    arrays = [a for a in flat(arguments) if isinstance(a, np.ndarray)]
    for i, slot in enumerate(slots):
        kind = np.float64 if isinstance(slot, float) else np.int64
        expected = arrays.pop(0).ctypes.data if slot == "address" else slot
        assert np.frombuffer(packed, kind)[i] == expected


def flat(arguments: Any) -> Iterator[Any]:
    """Arguments with tuples taken apart."""
    for argument in arguments:
        if isinstance(argument, tuple):
            yield from flat(argument)
        else:
            yield argument


@pytest.mark.parametrize(
    ("text", "argument"),
    [
        ("f8[::1]", np.zeros(3, dtype=np.float32)),
        ("f8[::1]", np.zeros((3, 3))),
        ("f8[:, ::1]", np.zeros((3, 4)).T),
        ("f8[::1]", np.zeros(6)[::2]),
        ("f8[::1]", [1.0, 2.0]),
        ("i8[::1]", np.zeros(3, dtype=np.int32)),
        ("i8", 0.5),
        ("f8", "a"),
        ("Pair", (np.zeros((1, 1)), 1.0)),
        ("Pair", Pair(np.zeros(3), 1.0)),
        ("rows[::1]", np.zeros(3, dtype=[("n", np.int64), ("y", np.float64)])),
    ],
)
def test_other_arguments_are_refused(text, argument):
    with pytest.raises(MismatchError):
        Signature(text, {"Pair": PAIR, "rows": RECORD}).pack((argument,))
    with pytest.raises(MismatchError, match="declared"):
        Signature("i8", {}).pack((1, 2))


def test_an_address_is_that_of_the_numbers():
    whole = np.arange(10.0)
    assert address(whole[3:]) == whole.ctypes.data + 24
    fixed = whole.copy()
    fixed.flags.writeable = False
    assert address(fixed) == fixed.ctypes.data


@pytest.mark.parametrize("text", ["f8[:, :]", "f16", "f8[::1] i8", "rows", "f8 -> f8[::1]", "Pair[::1]"])
def test_a_signature_that_cannot_be_read_is_refused(text):
    with pytest.raises(ValueError, match="signature"):
        Signature(text, {"Pair": PAIR, "rows": RECORD})
    with pytest.raises(ValueError, match="2 fields"):
        fields(Pair, "f8")


# the library


def test_the_library_holds_every_entry():
    opened = library.loaded()
    assert opened is not None
    items = list(declared())
    assert len(items) > 15
    for item in items:
        for number in range(len(item.signatures)):
            assert hasattr(opened, f"{item.symbol}_{number}"), f"{item.symbol}_{number}"
    assert len({item.symbol for item in items}) == len(items)


def test_a_build_refuses_slices_with_a_step():
    lowering, types = pytest.importorskip("latin_fmu.aot.lowering"), pytest.importorskip("numba").types
    lowering._without_step(None, None, types.slice2_type, None)
    with pytest.raises(TypeError, match="slice with a step"):
        lowering._without_step(None, None, types.slice3_type, None)


def test_signatures_have_the_arguments_of_their_functions():
    for item in declared():
        wanted = item.py_func.__code__.co_argcount
        assert {len(s.arguments) for s in item.signatures} == {wanted}, item.symbol


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("two_specimen_crushing/scene", "6e-6"),
        pytest.param("impact_bar/scene", "2.0", marks=pytest.mark.slow),
        pytest.param("stacked_blocks/n02", "1e-5", marks=pytest.mark.slow),
    ],
)
def test_a_run_needs_no_numba(name, end, tmp_path):
    """In a process of its own: numba is not even imported, and nothing is written but the result."""
    code = (
        "import sys, latin_fmu\n"
        "from latin_fmu.cli import main\n"
        "main(['run', sys.argv[1], '-o', sys.argv[2], '--set', sys.argv[3]])\n"
        "assert 'numba' not in sys.modules and 'llvmlite' not in sys.modules\n"
    )
    home = tmp_path / "home"
    home.mkdir()
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": str(home), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [
            sys.executable,
            "-B",
            "-c",
            code,
            str(ROOT / "models" / f"{name}.toml"),
            str(tmp_path / "out.nc"),
            f"time.end={end}",
        ],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert not list(home.rglob("*"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["home", "out.nc"]


# every entry against its Python function
ACTIONS = "kernels_entries_call"  # the whole iteration: see the test of whole runs in Python


class Recorder:
    """Runs the library and, on copies of the first arguments, the Python function of every entry that is called."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, each: int = 2) -> None:
        self.checked: dict[str, int] = {}
        self._call, self._each, self._inside = Entry.__call__, each, False
        monkeypatch.setattr(Entry, "__call__", self._checked(self))
        monkeypatch.setattr(declare.Kernel, "__call__", lambda kernel, *arguments: kernel.py_func(*arguments))

    @staticmethod
    def _checked(recorder: Recorder) -> Callable[..., Any]:
        def call(kernel: Entry, *arguments: Any) -> Any:
            return recorder.call(kernel, arguments)

        return call

    def call(self, kernel: Entry, arguments: tuple[Any, ...]) -> Any:
        """Both, and compare all that they return and leave in their arguments."""
        if self._inside:  # called by another kernel in Python
            return kernel.py_func(*arguments)
        seen = self.checked.get(kernel.symbol, 0)
        if kernel.symbol == ACTIONS or seen >= self._each or not in_python(kernel):
            return self._call(kernel, *arguments)
        copies, moved = copied(arguments), copied(arguments)
        with np.errstate(all="ignore"):  # memory between the fields holds anything, signalling NaN too
            for array in flat(moved):  # how far round-off in the arguments goes
                if isinstance(array, np.ndarray) and array.dtype.kind == "f":
                    array *= 1.0 + 1e-14 * np.random.default_rng(0).standard_normal(array.shape)
        actual = self._call(kernel, *arguments)
        self._inside = True
        with np.errstate(all="ignore"):
            expected = kernel.py_func(*copies)
            kernel.py_func(*moved)
        self._inside = False
        assert actual == (expected if expected is None else pytest.approx(expected, rel=1e-12)), kernel.symbol
        for one, other, beside in zip(flat(arguments), flat(copies), flat(moved), strict=True):
            if isinstance(one, np.ndarray) and one.dtype.fields is None:
                limit = 0.0
                if one.dtype.kind == "f" and one.size:
                    eps = 20 * np.finfo(one.dtype).eps
                    limit = eps * np.abs(other).max() + 10 * np.abs(other - beside).max()
                np.testing.assert_allclose(one, other, rtol=0.0, atol=limit, err_msg=kernel.symbol)
        self.checked[kernel.symbol] = seen + 1
        return actual


def copied(arguments: Any) -> Any:
    """Arguments of their own for another call."""
    if isinstance(arguments, np.ndarray):
        return arguments.copy()
    if isinstance(arguments, tuple):
        made = [copied(a) for a in arguments]
        return type(arguments)(*made) if hasattr(arguments, "_fields") else tuple(made)
    return arguments


def in_python(kernel: Any, above: tuple[Any, ...] = ()) -> bool:
    """Whether a kernel and those that it calls can run uncompiled."""
    for name in kernel.py_func.__code__.co_names:
        used = kernel.py_func.__globals__.get(name)
        if isinstance(used, declare.Intrinsic) and used.in_python is None:
            return False
        if isinstance(used, declare.Kernel) and used not in above and not in_python(used, (*above, kernel)):
            return False
    return True


CRUSHING = {"time.end": "1.5e-6"}
RUNS = (
    ("two_specimen_crushing/scene", CRUSHING),
    ("two_specimen_crushing/soft", CRUSHING),
    ("stacked_blocks/n02", {"time.end": "1e-5"}),
    ("two_specimen_crushing/scene", {**CRUSHING, "solver.window": "whole"}),
    ("two_specimen_crushing/scene", {**CRUSHING, "solver.precision": "float32"}),
    ("stacked_blocks/n02", {"time.end": "4e-6", "time.scheme.type": "central_difference", "time.step": "2e-8"}),
)


def settings(changes: dict[str, str]) -> list[str]:
    """Changes as they are given on the command line."""
    return [f"{name}={value}" for name, value in changes.items()]


def test_every_entry_equals_its_python_function(monkeypatch):
    recorder = Recorder(monkeypatch)
    for name, changes in RUNS:
        scene = latin_fmu.load_scene(ROOT / "models" / f"{name}.toml", settings(changes))
        latin_fmu.solve(scene)
    chain = sp.diags_array([-np.ones(399), 2.1 * np.ones(400), -np.ones(399)], offsets=[-1, 0, 1]).tocsr()
    stable_step.largest_eigenvalue(chain, np.ones(400))
    for kind in (np.float64, np.float32):
        factor = CholeskyFactor(chain, np.array([0, 7, 399]), dtype=kind)
        factor.solve(np.ones((400, 2)))
        shape, tile = factor.symbolic, np.random.default_rng(1).normal(size=400 * LANES)
        for sweep in (sweeps.forward_tile, sweeps.backward_tile):
            pattern = (shape.first, shape.row_start, shape.rows, shape.panel_start, shape.face_start)
            sweep(True, *pattern, factor.panels, tile, np.zeros(SPARE * LANES))
        face = CholeskyFactor(chain, np.zeros(0, dtype=np.int64), dtype=kind, face=np.arange(300, 310))
        shape, four = face.symbolic, np.random.default_rng(4).normal(size=4 * 400)
        pattern = (shape.first, shape.row_start, shape.rows, shape.panel_start, shape.face_start)
        sweeps.forward_four(*pattern, face.panels, four)
        face.face_solve(np.random.default_rng(6).normal(size=(10, MANY)))
        face.face_inverse(sp.csr_array(sp.diags_array((np.arange(400) // 10 == 30).astype(float))))
    accelerated = Anderson(np.ones(7), 3, 0.8)
    for q in np.random.default_rng(2).normal(size=(3, 7)):
        accelerated.next(q, -0.1 * q)
    for width in (1, 2, 3):  # two points with a run of components each
        starts, runs = np.array([0, 1, 2]), np.array([0, 2 * width, width, width])
        values = np.random.default_rng(5).normal(size=3 * width * width).astype(np.float32)
        sparse_response.multiply(2, width, starts, runs, values, np.arange(2.0 * width), np.zeros(2 * width))
    kinds = np.array([0, 1])
    for rule in range(4):
        given = np.array([1.0, 2.0]), np.array([0.5, -1.0]), np.linspace(0.0, 1.0, inputs.N_MEMORY * 2), kinds
        inputs.interpolate(*given, 1e-3, 1e-4, rule, 0.0, 0.0, np.zeros((2, 6)))
        inputs.rates(*given, 1e-3, rule, np.zeros(2))
        inputs.accept(*given, 1e-3, 1e-4, rule, 5, 5, 0.0, 0.0)
    jump = np.random.default_rng(3).normal(size=(6, 3))
    for law in BEHAVIOURS.values():
        behaviour = law()
        normalised_gap = jump[:, : behaviour.n_component] if behaviour.elastic else np.abs(jump[:, 0])
        points = behaviour.point_parameters(6)
        behaviour.local(jump[:, : behaviour.n_component], np.ones((6, 2)), normalised_gap, 2.0, points)
        if law.name in LAWS:
            law_tangents(LAWS[law.name], jump, np.ones((6, 2)), normalised_gap, 2.0, points)
    runnable = {item.symbol for item in declared() if isinstance(item, Entry) and in_python(item)} - {ACTIONS}
    assert len(runnable) > 10
    assert runnable <= recorder.checked.keys(), runnable - recorder.checked.keys()


# where the library does not fit


@pytest.fixture
def tree(tmp_path) -> Path:
    """A copy of the package."""
    shutil.copytree(library.PACKAGE, tmp_path / "latin_fmu", ignore=shutil.ignore_patterns("__pycache__", "_kernels*"))
    return tmp_path / "latin_fmu"


def the_file() -> Path:
    """The library in use."""
    name = library.file_name(library.target())
    return next(f / name for f in (library.PACKAGE, library.PACKAGE.parent / "build") if (f / name).is_file())


def test_a_library_of_other_sources_is_refused(tree):
    assert isinstance(library.opened(the_file(), tree), ctypes.CDLL)
    sources, _ = library.manifest(library.opened(the_file(), tree))  # type: ignore[arg-type]
    assert {source.parts[0] for source in sources} >= {"compiled", "propagator"}
    for change in ("# a comment\n", None):
        changed = tree / sources[-1]
        if change is None:
            changed.unlink()
        else:
            changed.write_text(changed.read_text() + change)
        assert "other sources" in str(library.opened(the_file(), tree))


def test_the_docstring_of_a_folder_is_no_source(tree):
    folder = tree / "kernels" / "__init__.py"
    sources = library.sources_of(tree)
    assert Path("kernels/records.py") in sources
    assert Path("kernels/__init__.py") not in sources
    folder.write_text(folder.read_text() + "NUMBER = 1\n")
    assert library.sources_of(tree) == sorted([*sources, Path("kernels/__init__.py")])


def test_files_that_are_no_library_are_refused(tmp_path):
    broken = tmp_path / "_kernels.so"
    broken.write_bytes(b"nothing")
    assert "cannot be loaded" in str(library.opened(broken, library.PACKAGE))
    assert "cannot be loaded" in str(library.opened(tmp_path / "missing.so", library.PACKAGE))


def test_another_processor_is_refused(monkeypatch):
    class Old(ctypes.CDLL):
        latin_fmu_fits = staticmethod(lambda: 0)

    monkeypatch.setattr(library.ctypes, "CDLL", Old)
    assert "AVX2" in str(library.opened(the_file(), library.PACKAGE))


RUN = """
import sys
sys.modules["numba"] = sys.modules["llvmlite"] = None
from latin_fmu.cli import main
coarse = [f"substructure.{body}.box.elements=[1, 1, 1]" for body in ("lower", "upper")]
words = [word for setting in ("time.end=6e-7", *coarse) for word in ("--set", setting)]
sys.exit(main(["run", *sys.argv[1:], "--no-estimate", "--quiet", *words]))
"""


def run_of(tree: Path, **environment: str) -> tuple[int, str]:
    """Exit code of a run by a copy of the package without numba, and what it says."""
    scene = ROOT / "models" / "two_specimen_crushing" / "scene.toml"
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(scene), "-o", str(tree.parent / "out.nc")],
        capture_output=True,
        text=True,
        check=False,
        cwd=tree.parent,
        env={**os.environ, "PYTHONPATH": str(tree.parent), **environment},
    )
    return done.returncode, done.stderr


def test_a_run_without_a_library_says_where_it_was_looked_for(tree):
    """In an installation, and in a source tree, where a command makes it."""
    code, said = run_of(tree)
    assert code == 2
    name = library.file_name(library.target())
    assert f"no run is possible: 1 problem\n  1. {name}: the library of compiled kernels is not in {tree};" in said
    assert f"install the wheel of this version for {library.target()}" in said
    (tree.parent / "hatch_build.py").touch()
    code, said = run_of(tree)
    assert code == 2
    assert f"is not in {tree} nor in {tree.parent / 'build'}; run python -m latin_fmu.aot there" in said
    assert "pip install -e '.[kernels]'" in said
    assert "Traceback" not in said
    assert not (tree.parent / "out.nc").exists()


def test_a_changed_kernel_is_run_by_no_old_library(tree):
    """A library is taken from ``build/`` until a kernel changes; then a run names the command that makes it anew."""
    (tree.parent / "hatch_build.py").touch()
    (tree.parent / "build").mkdir()
    copy = tree.parent / "build" / the_file().name
    shutil.copy(the_file(), copy)
    assert run_of(tree) == (0, "")
    law = tree / "laws" / "contact.py"
    law.write_text(law.read_text() + "# changed\n")
    code, said = run_of(tree)
    assert code == 2
    assert f"1. {copy}: the library of compiled kernels was made from other sources than those in {tree};" in said
    assert "run python -m latin_fmu.aot there" in said


def test_a_debugger_needs_no_library(tree):
    """Plain Python, kernels of the set-up included."""
    assert run_of(tree, LATIN_FMU_COMPILE="setup") == (0, "")


def test_arguments_that_no_signature_describes_are_refused_by_name():
    with pytest.raises(MismatchError, match="project: argument 3: an array of float32, 1-D; declared: float64, 1-D"):
        project(np.arange(3), np.arange(2), np.ones(2, dtype=np.float32), 2.0, np.eye(2), np.empty((2, 2)))


# what a kernel may need


def compiled_object(text: str) -> bytes:
    """An ELF object of LLVM's text."""
    llvm = pytest.importorskip("llvmlite.binding")
    lowering = pytest.importorskip("latin_fmu.aot.lowering")
    return bytes(lowering.emit(llvm.parse_assembly(text), linking.TARGETS["linux-x86_64"]))


CALL = "declare void @{0}()\ndefine void @entry() {{ call void @{0}() ret void }}"


def test_a_symbol_that_is_not_on_the_list_is_refused_by_name():
    linking.check(compiled_object(CALL.format("memset")))
    with pytest.raises(linking.ForbiddenSymbolError, match="PyObject_Print"):
        linking.check(compiled_object(CALL.format("PyObject_Print")))
    with pytest.raises(ValueError, match="ELF"):
        linking.check(b"MZ")


def test_a_kernel_that_prints_does_not_pass_the_build(tmp_path):
    """The build of a package with such an entry, up to the check."""
    code = (
        "from latin_fmu.aot import linking, lowering\n"
        "from latin_fmu.compiled import entry\n"
        "@entry('i8')\n"
        "def talk(n):\n"
        "    print(n)\n"
        "target = linking.TARGETS['linux-x86_64']\n"
        "whole = lowering.joined(*lowering.lower(lowering.start(), [talk]))\n"
        "lowering.optimise(whole, target)\n"
        "try:\n"
        "    linking.check(lowering.emit(whole, target))\n"
        "except linking.ForbiddenSymbolError as error:\n"
        "    print(error)\n"
    )
    file = tmp_path / "talk.py"
    file.write_text(code)
    done = subprocess.run(
        [sys.executable, str(file)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    named = done.stdout.split(";")[0].removeprefix("the kernels need ").strip().split(", ")
    assert "numba_gil_ensure" in named
    assert not linking.STUB & set(named)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "tag", "kinds"),
    [
        ("", "manylinux_2_17_x86_64", {"so"}),
        ("windows-x86_64 linux-x86_64", "win_amd64", {"so", "dll"}),
        ("none", "none-any", set()),
    ],
)
def test_wheels(target, tag, kinds, tmp_path):
    """An isolated build without a compiler on the path, the size of the wheel, and what it holds."""
    if not sys.platform.startswith("linux") or library.target() != "linux-x86_64":
        pytest.skip("expects the names of Linux on x86-64")
    tree = tmp_path / "tree"
    shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", "build", ".venv*", "__pycache__"))
    environment = {**os.environ, "PATH": "/bin-without-compilers", "HOME": str(tmp_path), "LATIN_FMU_TARGET": target}
    environment.pop("PYTHONPATH", None)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(tmp_path), "."]
    subprocess.run(command, cwd=tree, env=environment, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert tag in wheel.name
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        sizes = {entry.filename: entry.compress_size for entry in archive.infolist()}
    of_models = sum(size for name, size in sizes.items() if name.startswith("latin_fmu/models/"))
    assert of_models <= 1_050_000  # nine tenths of it the meshes of three models of minutes
    assert wheel.stat().st_size - of_models <= 2_000_000
    assert {"latin_fmu/py.typed", "fmu_build/py.typed"} <= set(names)
    libraries = [name for name in names if "_kernels-" in name]
    models = {f"latin_fmu/{path.relative_to(ROOT).as_posix()}" for path in ROOT.glob("models/**/*.*")}
    assert {name for name in names if name.startswith("latin_fmu/models/")} == {m for m in models if ".nc" not in m}
    assert {name.split(".")[-1] for name in libraries} == kinds
    for kind in ("_maker-", "_exchange-"):
        assert {name.split(".")[-1] for name in names if kind in name} == kinds
    assert "latin_fmu/pictures/viewer.html" in names
    if not target:
        run_the_first_commands(wheel, tmp_path)


def run_the_first_commands(wheel, folder):
    """``demo`` and the commands that it prints, from the wheel alone in an empty folder."""
    home, empty = folder / "home", folder / "empty"
    empty.mkdir()
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(home), str(wheel)]
    subprocess.run(install, check=True)
    environment = {**os.environ, "PYTHONPATH": str(home)}
    for words in (
        ["demo", "hammer_on_plate"],
        ["run", "hammer_on_plate/scene.toml", "-o", "hammer_on_plate.nc"],
        ["plot", "hammer_on_plate.nc", "-o", "hammer_on_plate.png"],
    ):
        subprocess.run([sys.executable, "-m", "latin_fmu", *words], cwd=empty, env=environment, check=True)
    assert {p.name for p in empty.iterdir()} == {"hammer_on_plate", "hammer_on_plate.nc", "hammer_on_plate.png"}
