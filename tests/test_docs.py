"""README.md and the pages in docs/: their code runs, what they name exists, the written pages are up to date.

A comment before a block of code defines how it is run:

<!-- file: NAME -->       its text is written to a file; <!-- added to: NAME --> adds it to one
<!-- slow -->             it takes more than a few seconds, or needs what a slow block makes
<!-- needs: MODULE -->    it is left out where this Python module is missing
<!-- same as: FILE -->    it is a block of that file, which runs there
<!-- not run: REASON -->  it is not run

Several are joined by "; ". Blocks of a page run one after the other in a folder that has the shipped models and the
examples, the blocks in Python in one namespace. Commands that make and fill an environment are left out: that of the
tests stands for it. A block in TOML without a comment is a part of a scene: its keys and values are checked.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import pytest
from pydantic import TypeAdapter, ValidationError

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.scene.schema import Scene

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "latin_fmu"
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
BLOCK = re.compile(r"^(?:<!-- (?P<said>[^\n]*?) -->\n)?```(?P<language>\w*)\n(?P<text>.*?)^```$", re.M | re.S)
SAID = ("file", "added to", "slow", "needs", "same as", "not run", "test command")
NO_FILE = "the file does not exist"
INSTALLATION = ("python3 -m venv", "pip install", ". activate")


@dataclass(frozen=True)
class Block:
    """A block of code of a page: line, language, options in the comment before it, text."""

    line: int
    language: str
    said: dict[str, str]
    text: str


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found = []
    for m in BLOCK.finditer(text):
        parts = [part.partition(": ") for part in (m["said"] or "").split("; ") if part]
        said = {key.strip(): value.strip() for key, _, value in parts}
        found.append(Block(text.count("\n", 0, m.start()) + 1, m["language"], said, m["text"]))
    return found


def name(page: Path) -> str:
    return page.name


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for shared in ("models", "examples"):
        (tmp_path / shared).symlink_to(ROOT / shared)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_block_has_a_language_and_a_known_comment(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(re.findall(r"^```", text, re.M)) == 2 * len(blocks(page)), "a block is not closed, or is indented"
    for block in blocks(page):
        where = f"{page.name}:{block.line}"
        assert block.language in ("sh", "python", "pycon", "toml", "text", "csv"), where
        assert set(block.said) <= set(SAID), where
        assert all(
            block.said[key] for key in ("not run", "same as", "needs", "file", "added to") if key in block.said
        ), where


@pytest.mark.parametrize("page", PAGES, ids=name)
@pytest.mark.usefixtures("folder")
@pytest.mark.filterwarnings("ignore::UserWarning:xugrid")  # it takes plain coordinates
def test_quick_blocks_run(page: Path) -> None:
    run(page, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if any("slow" in b.said for b in blocks(p))], ids=name)
@pytest.mark.usefixtures("folder")
@pytest.mark.filterwarnings("ignore::UserWarning:xugrid")
def test_all_blocks_run(page: Path) -> None:
    run(page, slow=True)


def run(page: Path, slow: bool) -> None:
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks(page):
        said = block.said
        if {"not run", "test command"} & set(said) or ("slow" in said and not slow):
            continue
        if "needs" in said and importlib.util.find_spec(said["needs"]) is None:
            continue
        where = f"{page.name}:{block.line}"
        if "same as" in said:
            assert block.text in {other.text for other in blocks(ROOT / said["same as"])}, where
        elif "file" in said:
            Path(said["file"]).write_text(block.text, encoding="utf-8")
        elif "added to" in said:
            with Path(said["added to"]).open("a", encoding="utf-8") as file:
                file.write(block.text)
        elif block.language == "toml":
            assert_part_of_a_scene(tomllib.loads(block.text), where)
        elif block.language == "sh":
            for command in commands(block.text):
                run_command(command, where)
        elif block.language == "python":
            exec(compile(block.text, where, "exec"), namespace)


def commands(text: str) -> Iterator[str]:
    """Commands of a block, continued lines joined; those that make an environment are left out."""
    for line in text.replace("\\\n", " ").splitlines():
        for part in re.split(r"&&", line):
            command = part.strip().replace(".venv/bin/", "")
            if command and not command.startswith((*INSTALLATION, "#")):
                yield command


def run_command(command: str, where: str) -> None:
    words = shlex.split(command, comments=True)
    if words[0] == "latin-fmu":
        assert main(words[1:]) == 0, f"{where}: {command}"
        return
    assert words[0] in ("python", "mpiexec"), f"{where}: {command} cannot be run here; say why: <!-- not run: ... -->"
    words = [sys.executable if word == "python" else word for word in words]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{where}: {command}\n{done.stderr}"


def assert_part_of_a_scene(tables: dict[str, Any], where: str) -> None:
    """Keys and values are those of a scene; keys that a whole scene needs may be missing, and files."""
    bolts = tables.get("bolt", {})
    # a table for many parts is one for each of them before it is read
    one_by_one = {
        n: {"substructure": n, **{k: v for k, v in bolt.items() if k != "parts"}} for n, bolt in bolts.items()
    }
    for key, value in (tables | ({"bolt": one_by_one} if bolts else {})).items():
        assert key in Scene.model_fields, f"{where}: no table {key}"
        wrong: set[str] = set()
        try:
            field = Scene.model_fields[key]
            TypeAdapter(Annotated[field.annotation, "", *field.metadata]).validate_python(value)
        except ValidationError as error:
            wrong = {str(e) for e in error.errors() if e["type"] != "missing" and e["msg"] != NO_FILE}
        assert not wrong, where


@pytest.mark.parametrize("tables", [{"loads": {}}, {"load": {"a": {"face": "b.zmax", "presure": 1.0}}}])
def test_parts_with_unknown_keys_are_noticed(tables: dict[str, Any]) -> None:
    with pytest.raises(AssertionError):
        assert_part_of_a_scene(tables, "here")


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_files_that_a_page_names_exist(page: Path) -> None:
    """Links, scripts, tests and modules between backticks, functions that link to their source."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for label, target in re.findall(r"\[([^\]]*)\]\(([^)#\s]+)[^)]*\)", text):
        if "://" in target:
            continue
        path = page.parent / target
        assert path.exists(), f"{page.name}: {target}"
        for function in re.findall(r"`(\w+)`", label) if path.suffix == ".py" else ():
            assert re.search(rf"^(def|class) {function}\b", path.read_text(encoding="utf-8"), re.M), (function, target)
    if page.name == "history.md":  # names what is gone, too
        return
    files = re.findall(r"(?:models|examples|tests|docs|latin_fmu|fmu_build)/[\w/]*\w(?:\.\w+)?", text)
    for file in files:
        if not file.endswith(("NAME", "fmu_")):
            assert (ROOT / file).exists(), f"{page.name}: {file}"


def module_of(path: Path) -> ModuleType:
    """A script as a module."""
    spec = importlib.util.spec_from_file_location(f"docs_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # for its dataclasses
    spec.loader.exec_module(module)
    return module


def pages_module() -> ModuleType:
    """``docs/pages.py``, which writes pages."""
    return module_of(ROOT / "docs" / "pages.py")


def test_written_pages_are_up_to_date() -> None:
    for name, text in pages_module().written().items():
        assert text == (ROOT / "docs" / name).read_text(encoding="utf-8"), f"{name}: run: python docs/pages.py"


def test_every_type_in_a_signature_of_the_api_is_described() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    foreign = {"Any", "Callable", "Iterator", "Mapping", "None", "Path", "Self", "Sequence", "True", "False"}
    arrays = {"Array", "ArrayLike", "NDArray", "DataArray", "DataTree", "Dataset"}
    described = set(re.findall(r"^### (\w+)", text, re.M)) | foreign | arrays | {"SI"}
    named = pages_module().named_in_signatures(text)
    assert len(named) > 40
    assert not named - described


@pytest.mark.parametrize(
    "page", [*PAGES, *sorted(ROOT.glob("models/*/README.md"))], ids=lambda p: f"{p.parent.name}-{p.stem}"
)
def test_a_list_stands_behind_a_blank_line(page: Path) -> None:
    """The site shows the marks of other lists, and of the items behind a block of code that is not set in by four."""
    text = re.sub(r"^( *)```.*?^\1```", "CODE", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    paragraphs = [part.splitlines() for part in text.split("\n\n")]
    wrong = [
        line
        for lines in paragraphs
        for line in lines[1:]
        if re.match(r"([*+-]|\d+\.) ", line) and not re.match(r"([*+-]|\d+\.) ", lines[0].lstrip("\n"))
    ]
    assert not wrong


def test_every_page_is_in_the_contents() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert f": {page.name}\n" in text, page.name


def test_every_figure_is_in_the_gallery() -> None:
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    for figure in (ROOT / "examples" / "figures").glob("*.png"):
        assert f"]({os.path.relpath(figure, ROOT / 'docs')})" in text, figure.name


def figures_module() -> ModuleType:
    """``examples/figures.py``, which draws the figures of the pages."""
    return module_of(ROOT / "examples" / "figures.py")


def test_every_figure_has_its_command() -> None:
    figures = figures_module()
    assert set(figures.DRAWINGS) == {path.stem for path in figures.FOLDER.glob("*.png")}


@pytest.mark.parametrize("figure", sorted(path.stem for path in (ROOT / "examples" / "figures").glob("*.png")))
def test_no_figure_shows_code_of_two_releases_ago(figure: str) -> None:
    """A figure is drawn anew when the code that it shows has changed and two releases have passed."""
    figures = figures_module()
    drawn, code = figures.drawn_with(figures.FOLDER / f"{figure}.png")
    releases = re.findall(r"^## (\d+\.\d+\.\d+) ", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    later = [v for v in releases if tuple(map(int, v.split("."))) > tuple(map(int, drawn.split(".")))]
    current = code == figures.DRAWINGS[figure].digest()
    assert current or len(later) <= 1, f"drawn with {drawn}, changed since: python examples/figures.py {figure}"


@pytest.mark.slow
def test_the_site_builds(tmp_path: Path) -> None:
    """Without -q, which would keep mkdocs from counting its warnings; ``.ci/run`` builds it, too."""
    for name in ("mkdocs", "material", "nbclient", "ipykernel"):
        pytest.importorskip(name)
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "scene_reference" / "index.html").is_file()


def test_the_citation_has_the_version_of_the_package() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.+)$", text, re.M)[1] == latin_fmu.__version__
    (date,) = re.findall(
        rf"^## {re.escape(latin_fmu.__version__)} \((.+)\)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M
    )
    assert f'date-released: "{date}"' in text


def test_the_quoted_summary_is_that_of_the_run() -> None:
    """Words as printed, numbers to 5 %: other machines round differently."""
    scene = latin_fmu.load_scene(ROOT / "models/lap_joint/shock.toml")
    solution = latin_fmu.solve(scene)
    printed = replace(solution, estimate=latin_fmu.estimate_error(scene, solution)).summary()
    number = re.compile(r"\d+(?:\.\d+)?")
    for page in ("README.md", "docs/reading_the_summary.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        for name in ("lower_upper", "bolt m6"):
            quoted, own = (" ".join(sentence_of(name, source).split()) for source in (text, printed))
            assert number.split(quoted) == number.split(own), page
            assert [*map(float, number.findall(quoted))] == pytest.approx(
                [*map(float, number.findall(own))], rel=0.05
            ), page


def sentence_of(name: str, text: str) -> str:
    """The sentence on a name in a summary, with its indented lines."""
    found = re.search(rf"^  {name}  .*(?:\n {{16}}.*)*", text, re.M)
    assert found is not None, name
    return found[0]


def test_the_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 130
    prose = re.sub(r"^```.*?^```$|^\|[^\n]*$|<!--.*?-->", "", text, flags=re.M | re.S)
    prose = re.sub(r"\]\([^)]*\)", "]", prose)
    assert len(re.findall(r"[A-Za-z0-9][^\s]*", prose)) <= 600
