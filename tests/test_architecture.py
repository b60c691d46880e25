"""Rules of the house that a reader relies on: one direction of imports, pure numerical layers, no hidden state."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from statistics import median

import pytest

import latin_fmu
from latin_fmu import inside

PACKAGE = Path(__file__).parents[1] / "latin_fmu"
MODULES = tuple(sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")))
SOURCES = (*sorted(PACKAGE.rglob("*.py")), *sorted((PACKAGE.parent / "fmu_build").rglob("*.py")))
TESTS = tuple(sorted(Path(__file__).parent.rglob("*.py")))
LONGEST_FILE, LONGEST_BODY, SMALLEST_MEDIAN = 800, 60, 200  # lines
MOST_FROM_INSIDE = 80  # names of the solver that tools take
LONGEST_CLASS, MOST_METHODS, MOST_PARAMETERS, MOST_OF_KERNEL = 250, 20, 7, 12

# Each layer may import those before it, never its own neighbours or those after it.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("errors", "remarks", "machine", "file_digest"),
    ("compiled",),
    ("operator_store", "arithmetic"),
    ("shock",),
    ("scene",),
    ("mesh_files",),
    ("reader", "tables"),
    ("cholesky", "laws"),
    ("kernels",),
    ("fem", "interface", "time_scheme"),
    ("cad",),
    ("propagator",),
    ("latin",),
    ("results",),
    ("assembly",),
    ("joined",),
    ("statics",),
    ("checks",),
    ("building", "march"),
    ("modal", "sensitivities"),
    ("run_quantities",),
    ("pictures", "effects", "decks"),
    ("attempts",),
    ("api",),
    ("accuracy",),
    ("cosim", "stability", "parametric", "calibration", "report"),
    ("model_exchange", "aot"),
    ("commands",),
    ("cli",),
    ("__init__", "__main__", "inside"),
)
NUMERICAL = ("cholesky", "laws", "kernels", "fem", "interface", "time_scheme", "propagator", "latin")
MAPPED = (
    "cad",
    "checks",
    "cosim",
    "kernels",
    "latin",
    "propagator",
    "shock",
    "statics",
)  # rooms whose docstring lists their modules
FOREIGN = {"xarray", "netCDF4", "pydantic", "matplotlib", "fmpy", "pythonfmu", "pythonfmu3", "typer", "meshio"}
FILE_CALLS = {
    "open",
    "read_text",
    "read_bytes",
    "write_text",
    "write_bytes",
    "load",
    "save",
    "savez",
    "loadtxt",
    "savetxt",
    "genfromtxt",
    "fromfile",
    "tofile",
    "mkdir",
    "unlink",
}
SPEAKERS = ("cli.py", "__main__.py", "commands")  # where printing belongs
MUTABLE_CALLS = {"dict", "list", "set", "bytearray", "defaultdict", "OrderedDict", "Counter", "deque"}


@cache
def tree(module: Path) -> ast.Module:
    """Syntax tree of a module, of the package where its path is relative."""
    return ast.parse((PACKAGE / module).read_text(encoding="utf-8"))


@cache
def nodes(module: Path) -> tuple[ast.AST, ...]:
    """All nodes of that tree."""
    return tuple(ast.walk(tree(module)))


def top(module: Path) -> str:
    """Package or module right below ``latin_fmu``."""
    return module.parts[0].removesuffix(".py")


def relative_imports(module: Path, loading: bool = False) -> Iterator[tuple[str, ...]]:
    """What a module imports from the package, as paths below ``latin_fmu``; ``loading``: when it is loaded only."""
    here = module.parts[:-1]
    for node in module_level(tree(module).body) if loading else nodes(module):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = here[: len(here) - node.level + 1]
            if node.module:
                yield (*base, *node.module.split("."))
            else:
                yield from ((*base, alias.name) for alias in node.names)


def absolute_imports(module: Path) -> Iterator[str]:
    """First names of what a module imports from elsewhere."""
    for node in nodes(module):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            yield node.module.split(".")[0]


def called(module: Path) -> Iterator[tuple[str, int]]:
    """Names of the functions and methods a module calls, with lines."""
    for node in nodes(module):
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Name):
                yield node.func.id, node.lineno
            elif isinstance(node.func, ast.Attribute):
                of = node.func.value
                if not (isinstance(of, ast.Name) and of.id == "builder"):  # instructions of the compiler's back end
                    yield node.func.attr, node.lineno


def numerical(module: Path) -> bool:
    return top(module) in NUMERICAL


def test_there_is_something_to_check() -> None:
    assert len(MODULES) > 40
    assert {top(m) for m in MODULES} >= {*NUMERICAL, "scene", "results", "api", "cli"}


def test_imports_go_one_way() -> None:
    level = {name: i for i, layer in enumerate(LAYERS) for name in layer}
    unknown = {top(m) for m in MODULES} - level.keys()
    assert not unknown, f"give a layer to {unknown}"
    wrong = [
        f"{module} imports {'.'.join(target)}"
        for module in MODULES
        for target in relative_imports(module)
        if target[0] in level and target[0] != top(module) and level[target[0]] >= level[top(module)]
    ]
    assert not wrong, "\n".join(wrong)


def test_modules_do_not_import_each_other_in_circles() -> None:
    """Imports inside functions and for types count: they are circles for a reader."""
    names = {m.with_suffix("").parts: m for m in MODULES}
    names |= {m.parts[:-1]: m for m in MODULES if m.name == "__init__.py" and len(m.parts) > 1}
    needs = {m: {names[t] for t in relative_imports(m) if t in names} - {m} for m in MODULES}
    done: set[Path] = set()

    def visit(module: Path, path: tuple[Path, ...]) -> None:
        assert module not in path, f"circle: {' -> '.join(map(str, (*path, module)))}"
        if module not in done:
            for other in needs[module]:
                if other.name != "__init__.py":  # a package gathers its modules
                    visit(other, (*path, module))
            done.add(module)

    for module in MODULES:
        visit(module, ())


def test_tools_take_from_inside_what_is_listed() -> None:
    """``latin_fmu.inside`` lists what tools take of the solver: no other name, and none that no tool takes."""
    taken: dict[str, set[str]] = {}
    for path in SOURCES:
        inner = path.is_relative_to(PACKAGE)
        if (top(path.relative_to(PACKAGE)) if inner else path.relative_to(PACKAGE.parent).parts[0]) not in inside.TOOLS:
            continue
        here = path.relative_to(PACKAGE).parts[:-1] if inner else ()
        for node in nodes(path):
            if not isinstance(node, ast.ImportFrom) or node.module is None:
                continue
            words = tuple(node.module.split("."))
            if node.level:
                words = (*here[: len(here) - node.level + 1], *words)
            elif words[0] != "latin_fmu":
                continue
            else:
                words = words[1:]
            if words and words[0] in inside.ROOMS:
                taken.setdefault(".".join(words), set()).update(alias.name for alias in node.names)
    listed = {module: set(names) for module, names in inside.NAMES.items()}
    assert taken == listed
    assert sum(map(len, listed.values())) <= MOST_FROM_INSIDE


def test_the_description_of_a_scene_is_data() -> None:
    """What the user describes depends on no mesh, operator or solver: ``scene`` imports itself, ``errors``, and the
    histories that ``shock`` makes of a specification."""
    wrong = [
        f"{module} imports {'.'.join(target)}"
        for module in MODULES
        if top(module) == "scene"
        for target in relative_imports(module)
        if target[0] not in ("scene", "errors", "shock")
    ]
    assert not wrong, "\n".join(wrong)


def test_numerical_layers_import_no_files_plots_or_schemas() -> None:
    wrong = [
        f"{module} imports {name}"
        for module in MODULES
        if numerical(module)
        for name in absolute_imports(module)
        if name in FOREIGN
    ]
    assert not wrong, "\n".join(wrong)


def test_numerical_layers_open_no_files() -> None:
    wrong = [
        f"{module}:{line} calls {name}"
        for module in MODULES
        if numerical(module)
        for name, line in called(module)
        if name in FILE_CALLS
    ]
    assert not wrong, "\n".join(wrong)


def test_only_the_command_line_prints() -> None:
    wrong = [
        f"{module}:{line} calls {name}"
        for module in MODULES
        if module.parts[0] not in SPEAKERS
        for name, line in called(module)
        if name in ("print", "input", "pprint")
    ]
    assert not wrong, "\n".join(wrong)


def test_imports_inside_the_package_are_relative() -> None:
    """So that the package can be loaded under another name."""
    wrong = [str(module) for module in MODULES if "latin_fmu" in absolute_imports(module)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", ["numerics_v2"])
def test_package_loads_under_another_name(tmp_path: Path, name: str) -> None:
    shutil.copytree(PACKAGE, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        f"import sys, {name}; assert {name}.load_scene; "
        "assert not [m for m in sys.modules if m.split('.')[0] == 'latin_fmu']"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def module_level(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements run at import, also those under if, try and with, but for TYPE_CHECKING."""
    for node in body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        yield node
        for field in ("body", "orelse", "finalbody"):
            if isinstance(node, ast.If | ast.Try | ast.With | ast.For):
                yield from module_level(getattr(node, field, []))


def mutable(value: ast.expr | None) -> bool:
    """A literal, comprehension or call that makes a container anyone could change."""
    if isinstance(value, ast.Dict | ast.List | ast.Set | ast.DictComp | ast.ListComp | ast.SetComp):
        return True
    return isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id in MUTABLE_CALLS


def test_no_state_at_module_level() -> None:
    """Containers of a module are tuples, frozensets, MappingProxyType, or at least declared Final."""
    wrong = []
    for module in MODULES:
        for node in module_level(tree(module).body):
            if not isinstance(node, ast.Assign | ast.AnnAssign) or not mutable(node.value):
                continue
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            final = isinstance(node, ast.AnnAssign) and "Final" in ast.unparse(node.annotation)
            names = [t.id for t in targets if isinstance(t, ast.Name)]
            if names != ["__all__"] and not final:
                wrong.append(f"{module}:{node.lineno} {', '.join(names)}")
    assert not wrong, "\n".join(wrong)


def test_no_globals_are_assigned() -> None:
    wrong = [f"{module}:{node.lineno}" for module in MODULES for node in nodes(module) if isinstance(node, ast.Global)]
    assert not wrong, "\n".join(wrong)


def test_no_bare_except() -> None:
    wrong = [
        f"{module}:{node.lineno}"
        for module in MODULES
        for node in nodes(module)
        if isinstance(node, ast.ExceptHandler) and node.type is None
    ]
    assert not wrong, "\n".join(wrong)


def test_options_are_named() -> None:
    """No ``**options`` that would swallow a typo, below the layers that hand them to a checked scene."""
    wrong = [
        f"{module}:{node.lineno} {node.name}"
        for module in MODULES
        if numerical(module) or top(module) in ("scene", "results", "api")
        for node in nodes(module)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.args.kwarg is not None
    ]
    assert not wrong, "\n".join(wrong)


def public(body: list[ast.stmt], prefix: str = "") -> Iterator[tuple[str, ast.FunctionDef | ast.ClassDef]]:
    """Public functions and classes of a module, and public methods of public classes."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from public(node.body, f"{prefix}{node.name}.")


def test_everything_public_has_a_docstring() -> None:
    wrong = [str(module) for module in MODULES if not ast.get_docstring(tree(module))]
    wrong += [
        f"{module}:{node.lineno} {name}"
        for module in MODULES
        for name, node in public(tree(module).body)
        if not ast.get_docstring(node)
    ]
    assert not wrong, "\n".join(wrong)


def test_no_path_of_a_machine_in_the_sources() -> None:
    marks = ("/home/", "/work/", "/opt/", "/Users/", "C:\\\\")
    wrong = [
        f"{module}: {mark}"
        for module in MODULES
        for mark in marks
        if mark in (PACKAGE / module).read_text(encoding="utf-8")
    ]
    assert not wrong, "\n".join(wrong)


def functions() -> Iterator[tuple[Path, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Functions and methods of the package and of the builder of FMUs."""
    for path in SOURCES:
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield path, node


def test_files_and_functions_fit_a_screenful_or_two() -> None:
    wrong = []
    for path in SOURCES:
        count = len(path.read_text(encoding="utf-8").splitlines())
        if count > LONGEST_FILE:
            wrong.append(f"{path.name}: {count} lines, at most {LONGEST_FILE}")
    for path, node in functions():
        body = node.body[1:] if ast.get_docstring(node) and len(node.body) > 1 else node.body
        count = (body[-1].end_lineno or 0) - body[0].lineno + 1
        if count > LONGEST_BODY:
            wrong.append(f"{path.name}: {node.name} has a body of {count} lines, at most {LONGEST_BODY}")
    assert not wrong, "\n".join(wrong)


def loops_that_call(*names: str) -> list[str]:
    """Loops of the package whose body calls one of these functions, by file and line."""
    found = []
    for module in MODULES:
        if not any(name in (PACKAGE / module).read_text(encoding="utf-8") for name in names):
            continue
        for loop in nodes(module):
            if not isinstance(loop, ast.For | ast.While | ast.ListComp | ast.GeneratorExp):
                continue
            called_there = {
                ast.unparse(node.func).split(".")[-1] for node in ast.walk(loop) if isinstance(node, ast.Call)
            }
            if called_there & set(names):
                found.append(f"{module}:{loop.lineno}")
    return found


def test_there_is_one_loop_over_the_iterations_and_one_over_the_instants() -> None:
    """What processes, laws in NumPy, observers and fall-backs need is called from there (``kernels.callouts``)."""
    iterations = loops_that_call("next_stage", "judge", "stage", "advance_iterate")
    instants = loops_that_call("solve_instant", "iterate")
    assert [place.split(":")[0] for place in iterations] == ["kernels/iteration.py"], iterations
    assert [place.split(":")[0] for place in instants] == ["kernels/instants.py"], instants


def test_files_are_rooms() -> None:
    """Half of the files hold enough to be worth a name; folders are not nested."""
    assert median(len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES) >= SMALLEST_MEDIAN
    deep = [str(m) for m in MODULES if len(m.parts) > 2]
    assert not deep, f"depth two: {deep}"


@pytest.mark.parametrize("room", MAPPED)
def test_a_map_of_a_room_names_its_modules(room: str) -> None:
    """The table in the docstring of a folder: every module, and none that is not there."""
    here = PACKAGE / room
    lines = (ast.get_docstring(tree(Path(room) / "__init__.py")) or "").splitlines()
    first, last = (i for i, line in enumerate(lines) if line.startswith("==="))
    width = len(lines[first].split()[0])
    named = [name.strip() for line in lines[first + 1 : last] for name in line[:width].split(",") if name.strip()]
    modules = {path.stem for path in here.glob("*.py")} - {"__init__"}
    folders = {path.name for path in here.iterdir() if path.is_dir() and not path.name.startswith("__")}
    assert len(named) == len(set(named))
    assert modules <= set(named) <= modules | folders


def test_public_docstrings_say_something() -> None:
    wrong = [
        f"{path.name}:{node.lineno} {node.name}: {text}"
        for path, node in functions()
        if not node.name.startswith("_") and (text := ast.get_docstring(node)) and len(text.split()) < 3
    ]
    assert not wrong, "\n".join(wrong)


def classes() -> Iterator[ast.ClassDef]:
    """Classes of the package and of the builder of FMUs."""
    for path in SOURCES:
        yield from (node for node in nodes(path) if isinstance(node, ast.ClassDef))


def test_classes_are_not_too_large() -> None:
    large = {
        node.name
        for node in classes()
        if (node.end_lineno or 0) - node.lineno >= LONGEST_CLASS
        or sum(isinstance(part, ast.FunctionDef) for part in node.body) > MOST_METHODS
    }
    assert not large, sorted(large)


def test_signatures_are_not_too_long() -> None:
    """Kernels take arrays and numbers one by one, and may have more. Functions of ``latin_fmu.__all__`` may have any
    number of options that are given by keyword: a script names the one that it needs, and would have to import a
    further class to say the same through an object."""
    long = []
    for path, node in functions():
        public = getattr(latin_fmu, node.name) if node.name in latin_fmu.__all__ else None
        offered = public is not None and public.__module__.endswith(f".{path.stem}")
        given = [*node.args.posonlyargs, *node.args.args, *([] if offered else node.args.kwonlyargs)]
        compiled = any("kernel" in (text := ast.unparse(d)) or "entry" in text for d in node.decorator_list)
        if len({a.arg for a in given} - {"self", "cls"}) > (MOST_OF_KERNEL if compiled else MOST_PARAMETERS):
            long.append(f"{path.stem}.{node.name}")
    assert not long, long


def test_a_name_of_a_class_means_one_thing() -> None:
    counts = Counter(node.name for node in classes())
    assert not (shared := sorted(name for name, count in counts.items() if count > 1)), shared


def checks(node: ast.AST, helpers: set[str]) -> bool:
    """Whether a function asserts or raises, or calls something that does: of pytest, NumPy or these ``helpers``."""
    for part in ast.walk(node):
        if isinstance(part, ast.Assert | ast.Raise):
            return True
        if isinstance(part, ast.Call):
            of, _, name = ast.unparse(part.func).rpartition(".")
            if (
                name in helpers
                or name.startswith("assert_")
                or (of == "pytest" and name in ("raises", "warns", "fail"))
            ):
                return True
    return False


def test_every_test_checks_something() -> None:
    """A test that runs to its end and asserts nothing passes whatever comes out."""
    everything = [
        node
        for path in TESTS
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    ]
    helpers: set[str] = set()
    while more := {node.name for node in everything if node.name not in helpers and checks(node, helpers)}:
        helpers |= more
    wrong = sorted(node.name for node in everything if node.name.startswith("test_") and node.name not in helpers)
    assert not wrong, wrong


def test_the_tests_run_with_the_compilers_of_the_build() -> None:
    """numba is pinned where the library of kernels is built, alike in the extra by which a developer builds it; these
    tests have it, and a run needs none."""
    table = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    build, project = table["build-system"]["requires"], table["project"]
    extras = project["optional-dependencies"]
    assert set(extras["kernels"]) == {name for name in build if name.startswith(("numba", "ziglang"))}
    assert f"numba=={'.'.join(version('numba').split('.')[:2])}.*" in extras["kernels"]
    assert not [name for name in project["dependencies"] if name.startswith(("numba", "llvmlite", "ziglang"))]
    assert all(any("kernels" in name for name in extras[extra]) for extra in ("test", "dev"))
