"""Pages that a program makes, and the files of the repository that the pages link to.

``python docs/pages.py`` writes the scene reference (from the tables of the scene), api.md (from the docstrings) and
gallery.md (from the heads of the examples). mkdocs calls the functions ``on_...``: a page links to files of the
repository by their relative path, such as ``../models/README.md``; the site has a copy of each under ``repository/``,
sources as pages of code. That of an example has its head as text, its figures, and where its numbers stand. The
notebook is a page with what its cells show, executed while the site is built (20 seconds).
"""

from __future__ import annotations

import ast
import html
import inspect
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any, ForwardRef

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
TERM = 15  # columns of the terms in the conventions of the reference
LINK = re.compile(r"(?<=\]\()([^)#\s]+)")
MADE = "<!-- Written by docs/pages.py; do not edit. -->"
WIDTH = 88
"""Columns of code that a page shows without scrolling."""
PARTS = {
    "Bodies": ("material", "damping", "mesh", "substructure", "temperature"),
    "Joints": ("interface", "contact", "bolt", "spring", "coupling", "point_mass"),
    "Loads and supports": ("load", "boundary", "gravity", "rotation", "port"),
    "Time and solver": ("time", "motion", "initial_state", "solver", "effects", "accuracy"),
    "Sensors and output": ("sensor", "limit", "output", "fmu"),
}
"""Tables of a scene by the page of the reference that describes them."""
SHARED = ("figures", "example_tools", "harness", "calculix")
"""Scripts that others use, and that show nothing themselves."""
# Modules beside the package itself whose public names the page of the API lists.
MODULES = {
    "latin_fmu": "The package",
    "latin_fmu.interface": "Interface laws of your own",
    "latin_fmu.cosim": "Sessions and co-simulation",
}


# The site -------------------------------------------------------------------------------------------------------------


def on_files(files: Any, config: Any) -> Any:
    """Add the files of the repository that pages link to, and those that these link to."""
    from mkdocs.structure.files import File

    waiting = [f"docs/{file.src_uri}" for file in files.documentation_pages()]
    done = set(waiting)
    while waiting:
        page = waiting.pop()
        for target in _targets(page):
            path = ROOT / target
            if target in done or target.startswith("docs/") or not path.is_file():
                continue
            done.add(target)
            uri = _uri(target)
            if path.suffix in (".md", ".png"):
                files.append(File.generated(config, uri, abs_src_path=str(path)))
            else:
                files.append(File.generated(config, uri, content=_code_page(target)))
            if path.suffix == ".md":
                waiting.append(target)
    files.append(File.generated(config, "notebook.md", content=notebook_page()))
    return files


def notebook_page() -> str:
    """The notebook as Markdown, executed from its first cell to its last: code, and what each cell shows.

    Raises
    ------
    nbclient.exceptions.CellExecutionError : a cell fails; the message has its code and its error.
    """
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(DOCS / "quick_start.ipynb", as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        place = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=300, coalesce_streams=True, resources=place).execute()
    parts = []
    for cell in notebook.cells:
        code = cell.cell_type == "code"
        parts.append(f"```python\n{cell.source}\n```" if code else cell.source)
        for output in cell.outputs if code else ():
            data = output.get("data", {"text/plain": output.get("text", "")})
            if output.get("name") == "stderr":
                continue
            if "image/png" in data:
                parts.append(f'<img alt="" src="data:image/png;base64,{data["image/png"].strip()}">')
            else:
                plain = f"<pre>{html.escape(data['text/plain'].rstrip())}</pre>"
                shown = data.get("text/html", plain)
                # xarray's has a style sheet of its own, which that of the site breaks
                parts.append(f'<div class="output">{plain if "<style" in shown else shown}</div>')
    return "\n\n".join([*parts, "The [notebook](quick_start.ipynb) itself.\n"])


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:  # noqa: ARG001, names are mkdocs'
    """Links between files of the repository become links between pages of the site."""
    uri = page.file.src_uri
    own = uri.removeprefix("repository/") if uri.startswith("repository/") else f"docs/{uri}"
    if not own.endswith(".md") or not (ROOT / own).is_file():
        return markdown

    def moved(found: re.Match[str]) -> str:
        target = _target(own, found[0])
        return found[0] if target is None else os.path.relpath(_uri(target), PurePosixPath(uri).parent)

    return LINK.sub(moved, markdown)


def _targets(page: str) -> list[str]:
    """Files of the repository that a page links to, as paths from its top."""
    path = ROOT / page
    links = LINK.findall(path.read_text(encoding="utf-8")) if path.suffix == ".md" and path.is_file() else []
    return [target for link in links if (target := _target(page, link)) is not None]


def _target(page: str, link: str) -> str | None:
    """Path from the top of the repository that a link of a page leads to; None for other links."""
    if "://" in link or link.startswith(("/", "mailto:")):
        return None
    path = os.path.normpath(PurePosixPath(page).parent / link)
    return None if path.startswith("..") or not (ROOT / path).is_file() else path


def _uri(target: str) -> str:
    """Place of a file of the repository in the site."""
    if target.startswith("docs/"):
        return target.removeprefix("docs/")
    return f"repository/{target}" + ("" if target.endswith((".md", ".png")) else ".md")


def _code_page(target: str) -> str:
    """A page that shows a source file; of an example its head, figures and numbers before the code."""
    text = (ROOT / target).read_text(encoding="utf-8")
    language = {".py": "python", ".toml": "toml"}.get(Path(target).suffix, "text")
    code = f"````{language}\n{text}\n````\n"
    if not (target.startswith("examples/") and target.endswith(".py")):
        return f"# {target}\n\n{code}"
    title, what = _head(target)
    up = "../" * _uri(target).count("/")
    parts = [f"# {title}", _doc(what)]
    for name, drawing in _drawings().items():
        if drawing.source() == target:
            parts.append(f"![{title}]({up}repository/examples/figures/{name}.png)\n\n`{drawing.command}`")
    parts += [f"**{what}**: {measured}." for what, measured in _measured(target)]
    if places := [f"[{heading}]({up}{page}#{anchor})" for heading, page, anchor in _places(target)]:
        parts.append(f"Numbers and text on it: {', '.join(places)}.")
    return "\n\n".join([*parts, f"## {target}", code])


def _head(script: str) -> tuple[str, str]:
    """First sentence of the head of a script, without its point, and the rest."""
    text = ast.get_docstring(ast.parse((ROOT / script).read_text(encoding="utf-8"))) or script
    first, _, rest = text.partition("\n\n")
    return " ".join(first.split()).rstrip("."), rest


@cache
def _drawings() -> dict[str, Any]:
    """Figures of the repository by name, with their commands."""
    sys.path.insert(0, str(ROOT / "examples"))
    drawings: dict[str, Any] = import_module("figures").DRAWINGS
    return drawings


def _measured(script: str) -> Iterator[tuple[str, str]]:
    """Rows of tables of the pages, what and measured, that name a script."""
    for page in sorted(DOCS.glob("*.md")):
        for line in page.read_text(encoding="utf-8").splitlines():
            cells = [cell.strip() for cell in line.strip("|").split(" | ")]
            if line.startswith("| ") and len(cells) == 3 and f"`{script}" in cells[2]:
                yield re.sub(r" \(\[figure\]\([^)]*\)\)", "", cells[0]).strip(), cells[1]


def _places(script: str) -> Iterator[tuple[str, str, str]]:
    """Sections of the pages, beside the gallery, that show a figure of a script: heading, page, anchor."""
    names = [name for name, drawing in _drawings().items() if drawing.source() == script]
    for page in sorted(DOCS.glob("*.md")):
        heading = ""
        for line in page.read_text(encoding="utf-8").splitlines():
            heading = line.lstrip("# ") if line.startswith("#") else heading
            if page.name != "gallery.md" and any(f"figures/{name}.png" in line for name in names):
                yield heading, page.name, _slug(heading)


# Pages from the sources -----------------------------------------------------------------------------------------------


def scene_reference() -> dict[str, str]:
    """Every table and key of a scene, as Markdown by page: the first one, and one for each of ``PARTS``."""
    from latin_fmu.scene import reference
    from latin_fmu.scene.describe import is_named, tables_in
    from latin_fmu.scene.schema import Scene

    tables = {
        key: (field, found) for key, field in Scene.model_fields.items() if (found := tables_in(field.annotation))
    }
    assert set(tables) == {key for keys in PARTS.values() for key in keys}
    inner = _inner_tables()
    # an inner table stands on the page that needs it first; laws stand with the loads
    place = dict[tuple[Any, ...], str]()
    for title, keys in sorted(PARTS.items(), key=lambda part: "load" not in part[1]):
        waiting = [table for key in keys for table in tables[key][1]]
        while waiting:
            for field in waiting.pop(0).model_fields.values():
                found = tuple(tables_in(field.annotation))
                if found and found not in place:
                    place[found] = f"{_part_page(title)}#{_slug(_inner_heading(inner[found]))}"
                    waiting += found
    pages = {}
    for title, keys in PARTS.items():
        page = _part_page(title)
        parts = [f"{MADE}\n\n# Scene reference: {title}"]
        for key in keys:
            field, found = tables[key]
            need = "required" if field.is_required() else "optional"
            parts.append(f"## [{key}.NAME] ({need})" if is_named(field) else f"## [{key}] ({need})")
            parts += [_table(table, place) for table in found]
        for found, names in inner.items():
            if place[found].startswith(page):
                parts += [f"## {_inner_heading(names)}", *(_table(table, place) for table in found)]
        pages[page] = "\n\n".join(parts) + "\n"
    plain = {key: field for key, field in Scene.model_fields.items() if key not in tables}
    parts = [
        f"{MADE}\n\n# Scene reference",
        "`latin-fmu reference` prints these pages as text, `latin-fmu reference --schema` the schema.",
        reference.INTRODUCTION.strip("\n"),
        "## Tables",
        "| page | tables |\n|---|---|\n"
        + "\n".join(
            f"| [{title}]({_part_page(title)}) | {', '.join(f'`[{key}]`' for key in keys)} |"
            for title, keys in PARTS.items()
        ),
        "## Top of the file",
        _keys(plain, place),
        "## Conventions",
        *_conventions(reference.CONVENTIONS),
        "## Example",
        f"<!-- file: example.toml -->\n```toml\n{reference.EXAMPLE}```",
        "```sh\nlatin-fmu check example.toml\n```",
    ]
    return {"scene_reference.md": "\n\n".join(parts) + "\n", **pages}


def _part_page(title: str) -> str:
    return f"scene_{title.split()[0].lower()}.md"


def _inner_tables() -> dict[tuple[Any, ...], list[str]]:
    """Keys that hold a table, by the classes of the table: a law is the same under each of its keys."""
    from latin_fmu.scene import reference

    keys: dict[tuple[Any, ...], list[str]] = {}
    for key, tables in reference.inner_tables().items():
        keys.setdefault(tuple(tables), []).append(key)
    return keys


def _inner_heading(keys: list[str]) -> str:
    return f"{', '.join(keys)} = {{...}}"


def _slug(heading: str) -> str:
    """Anchor of a heading in the site."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def _table(table: Any, place: dict[tuple[Any, ...], str]) -> str:
    """Meaning and keys of one table of a scene; ``place`` : links to the tables inside."""
    from latin_fmu.scene.describe import tag_of

    tag, meaning = tag_of(table), _escaped(" ".join((table.__doc__ or "").split()))
    fields = {name: field for name, field in table.model_fields.items() if tag is None or name != "type"}
    parts = [] if tag is None else [f'### type = "{tag}"']
    return "\n\n".join([*parts, meaning, *([_keys(fields, place)] if fields else [])])


def _keys(fields: dict[str, Any], place: dict[tuple[Any, ...], str]) -> str:
    """A table with a row for each key."""
    from latin_fmu.scene.describe import allowed_text, tables_in
    from latin_fmu.scene.reference import default_text

    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for name, field in fields.items():
        allowed = _escaped(allowed_text(field) or "")
        if link := place.get(tuple(tables_in(field.annotation))):
            allowed = f"[{allowed.replace('[', chr(92) + '[').replace(']', chr(92) + ']')}]({link})"
        texts = (_escaped(default_text(field).removeprefix("default ")), _escaped(field.description or ""))
        rows.append("| " + " | ".join(text.replace("|", "\\|") for text in (f"`{name}`", allowed, *texts)) + " |")
    return "\n".join(rows)


def _conventions(text: str) -> Iterator[str]:
    """Paragraphs of a list whose terms stand in the first columns of their lines."""
    term, lines = "", list[str]()
    for line in text.splitlines():
        if line[:1].strip():
            if lines:
                yield f"**{term}.** {_escaped(' '.join(lines))}"
            term, lines = line[:TERM].strip(), [line[TERM:]]
        else:
            lines.append(line.strip())
    yield f"**{term}.** {_escaped(' '.join(lines))}"


def _escaped(text: str) -> str:
    """Text whose signs are no marks of Markdown outside of code."""
    parts = text.split("`")
    parts[::2] = [part.replace("*", "\\*").replace("<", "&lt;") for part in parts[::2]]
    return "`".join(parts)


def gallery() -> str:
    """Every figure with its command, and the scripts that draw none, as Markdown."""
    parts = [
        f"{MADE}\n\n# Gallery",
        "A figure leads to its script, or to its model. It is drawn by the command beside it, and again by `python "
        "examples/figures.py NAME`; it carries the version of the package that drew it (`--list`).",
    ]
    rows, shown = ["| | what to see |", "|---|---|"], set()
    for name, drawing in _drawings().items():
        source = drawing.source()
        shown.add(source)
        title, what = (drawing.says, "") if drawing.says else _head(source)
        paragraph = "" if what.startswith(" ") else " ".join(what.split("\n\n")[0].split())
        lead = _escaped(". ".join(paragraph.split(". ")[:2]).rstrip(".") + ".") if paragraph else ""
        command = "" if drawing.command == "-" else f"<br>`{drawing.command}`"
        picture = f"[![{title.split(':')[0]}](../examples/figures/{name}.png)](../{source})"
        rows.append(f"| {picture} | **{title.rstrip('.')}.** {lead.replace('|', chr(92) + '|')}{command} |")
    others = [
        path.relative_to(ROOT).as_posix()
        for folder in (ROOT / "examples", ROOT / "examples" / "benchmarks")
        for path in sorted(folder.glob("*.py"))
    ]
    scripts = [
        f"| [{script.removeprefix('examples/')}](../{script}) | {_escaped(_head(script)[0])} |"
        for script in others
        if script not in shown and Path(script).stem not in SHARED
    ]
    return (
        "\n\n".join(
            [
                *parts,
                "\n".join(rows),
                "## Scripts without a figure here",
                "\n".join(["| script | shows |", "|---|---|", *scripts]),
            ]
        )
        + "\n"
    )


def api() -> str:
    """Names that the public modules export, with signatures and docstrings, as Markdown."""
    parts = [
        f"{MADE}\n\n# Python API",
        "Arrays have SI units. Errors of input derive from `InputError`, and all "
        "errors of the package from `LatinError`.",
    ]
    for module, title in MODULES.items():
        namespace = import_module(module)
        parts.append(f"## {title}: `{module}`")
        parts += [_entry(module, name, getattr(namespace, name)) for name in sorted(namespace.__all__, key=str.lower)]
    parts += [
        "## Types in the signatures",
        "`np` is NumPy, `sp` scipy.sparse, `xr` xarray; `Array` is an array of double precision.",
        *_types("\n".join(parts)),
    ]
    return "\n\n".join(parts) + "\n"


def named_in_signatures(page: str) -> set[str]:
    """Names with a capital in the signatures of the page of the API."""
    signatures = re.findall(r"^```text\n(latin_fmu\..*?)^```|^\* `([^`\n]*)`", page, re.M | re.S)
    return set(re.findall(r"\b[A-Z]\w+", " ".join(map("".join, signatures))))


def _types(page: str) -> Iterator[str]:
    """Types of the package that the signatures of a page name and that it does not describe, classes first."""
    wanted = named_in_signatures(page) - set(re.findall(r"^### (\w+)", page, re.M)) - {"Array"}
    bodies = {p: ast.parse(p.read_text(encoding="utf-8")).body for p in sorted((ROOT / "latin_fmu").rglob("*.py"))}
    for path, body in bodies.items():
        for name in [node.name for node in body if isinstance(node, ast.ClassDef) and node.name in wanted]:
            wanted.remove(name)
            thing = getattr(import_module(".".join(path.relative_to(ROOT).with_suffix("").parts)), name)
            own = [one for one, what in vars(thing).items() if not one.startswith("_") and inspect.isfunction(what)]
            methods = f"Methods: {', '.join(f'`{one}`' for one in own)}." if own else ""
            text = _doc(_docstring(thing).split("\n\nExamples")[0])
            yield "\n\n".join(part for part in (f"### {name}", text, methods) if part)
    for body in bodies.values():
        for node, after in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.Assign) and (name := ast.unparse(node.targets[0])) in wanted:
                wanted.remove(name)
                said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                text = f"\n\n{_paragraph(' '.join(str(after.value.value).split()))}" if said else ""
                yield f"### {name}\n\n`{name} = {ast.unparse(node.value)}`{text}"


def _entry(module: str, name: str, thing: Any) -> str:
    """Signature and docstring of one name; of a class also its public methods and properties."""
    if not callable(thing):
        return f"### {name}\n\n`{module}.{name}` = `{thing!r}`"
    parts = [f"### {name}", f"```text\n{_signature(f'{module}.{name}', thing)}\n```", _doc(_docstring(thing))]
    if inspect.isclass(thing) and not issubclass(thing, Exception):
        for own, member in vars(thing).items():
            plain = member.__func__ if isinstance(member, (staticmethod, classmethod)) else member
            if own.startswith("_") or not (inspect.isfunction(plain) or isinstance(plain, property)):
                continue
            text = _signature(own, plain) if inspect.isfunction(plain) else own
            first = " ".join((inspect.getdoc(plain) or "").split("\n\n")[0].split())
            parts.append(f"* `{text}`: {_escaped(first.replace('``', '`'))}")
    return "\n\n".join(part for part in parts if part)


class _Bare(str):
    """Text of an annotation that is shown without quotes."""

    __slots__ = ()
    __repr__ = str.__str__


def _signature(name: str, thing: Any) -> str:
    """A name with its parameters and their annotations; the name alone of a scene, and where there is none."""
    if hasattr(thing, "model_fields"):  # a table of a scene: its keys are in the reference
        return name
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return name
    kept = [
        one.replace(annotation=_Bare(getattr(one.annotation, "__forward_arg__", one.annotation)))
        if isinstance(one.annotation, str | ForwardRef)
        else one
        for one in found.parameters.values()
        if one.name not in ("self", "cls")
    ]
    result = found.return_annotation
    result = _Bare(result) if isinstance(result, str) else result
    text = name + str(found.replace(parameters=kept, return_annotation=result))
    if len(text) <= WIDTH:
        return text
    # one parameter a line: a line is not cut at the edge of the page
    inner = "".join(f"    {one},\n" for one in _separated(kept))
    end = "" if result is inspect.Signature.empty else f" -> {inspect.formatannotation(result)}"
    return f"{name}(\n{inner}){end}"


def _separated(parameters: list[inspect.Parameter]) -> Iterator[str]:
    """Parameters as text, with the star before those that are given by keyword."""
    starred = False
    for one in parameters:
        if one.kind is inspect.Parameter.KEYWORD_ONLY and not starred:
            starred = True
            yield "*"
        starred |= one.kind is inspect.Parameter.VAR_POSITIONAL
        yield str(one)


ABOVE = re.compile(r" \((?:\w+ in the )?module docstring\)")


def _docstring(thing: Any) -> str:
    """The docstring; behind its first paragraph that of the module, where it refers to it."""
    first, gap, rest = (inspect.getdoc(thing) or "").partition("\n\n")
    module = inspect.getmodule(thing)
    if not ABOVE.search(first) or module is None:
        return ABOVE.sub("", first + gap + rest)
    above = inspect.cleandoc(module.__doc__ or "").partition("\n\n")[2]
    return "\n\n".join(part for part in (ABOVE.sub("", first), above, ABOVE.sub("", rest)) if part)


SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "Examples")


def _doc(docstring: str) -> str:
    """A docstring as Markdown: sections as lists of names, indented lines as they are, examples as code."""
    parts, section = [], ""
    for block in docstring.split("\n\n"):
        lines = block.splitlines()
        if len(lines) > 1 and lines[0] in SECTIONS:
            section, lines = lines[0], lines[2:]
            parts.append(f"**{section}**")
        text = "\n".join(lines)
        if section == "Examples" or text.lstrip().startswith(">>>"):
            parts.append(f"```pycon\n{inspect.cleandoc(text)}\n```")
        elif all(line.startswith("    ") for line in lines):
            parts.append(f"```text\n{inspect.cleandoc(text)}\n```")
        else:
            points = re.split(r"\n(?=\d+\. )", text)  # of a numbered list
            parts.append("\n".join(_paragraph(" ".join(point.split())) for point in points))
    return "\n\n".join(parts)


def _paragraph(text: str) -> str:
    """A paragraph, or a list where it describes names: ``name : what it is. other : what that is.``"""
    from latin_fmu.commands.options import described

    items = described(text)
    if not items:
        return _escaped(text.replace("``", "`"))
    return "\n".join(f"* **{name}**: {_escaped(what)}" for name, what in items)


def written() -> dict[str, str]:
    """The pages that this program writes, by their names."""
    return {**scene_reference(), "api.md": api(), "gallery.md": gallery()}


def main() -> None:
    """Write the pages."""
    for name, text in written().items():
        (DOCS / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
