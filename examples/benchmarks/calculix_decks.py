"""Every deck of a folder, as it is: runs or is refused, and how far its numbers are from those of CalculiX.

A folder of decks (``.inp``, also packed as ``.inp.gz``) with reference results beside them (``NAME.dat.ref``, or
``NAME.frd.ref`` where that is empty), as the test suite of CalculiX has them. Each deck that is not refused runs in a
process of its own, with a limit of CPU seconds, and by ``ccx`` where it is installed; nothing of the folder is kept but
facts:

  cards, elements, nodes    of the deck
  runs / refused because    the first card that is refused, with its line
  small                     whether rotations and strains of the elements stay below 1e-2
  from the reference        largest difference of a printed block over the largest value of that quantity in the set of
                            the block; of forces over the largest force of the deck; where
                            the reference has nothing to compare, displacements of all nodes by the ccx here
  exact                     the same of a run with exact contact in the place of the penalty of the deck: what it costs
  ccx from the reference    the same of the installed version: what its own versions differ by
  CPU s                     of both, from the deck to the end of the solution, one thread each

Prints a table and its statistics, and writes decks.csv and decks.md. With --decks NAME ... some of them only.
"""

from __future__ import annotations

import csv
import gzip
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time as clock
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.decks.dat_file import DatBlock, read_dat
from latin_fmu.decks.exact import without_penalty
from latin_fmu.decks.frd_file import read_frd
from latin_fmu.decks.importing import ImportedDeck, import_deck
from latin_fmu.decks.print_cards import DeckPrints
from latin_fmu.decks.printed import printed_blocks
from latin_fmu.decks.translation import PrintRequest
from latin_fmu.errors import InputError, MeshError
from latin_fmu.fem.elements import CellBlock, points_in
from latin_fmu.fem.reference_cells import volume_rule
from latin_fmu.mesh_files.reading import read_content
from latin_fmu.results.solution import Solution

SMALL = 1e-2
EVERY_NODE = "EVERY_NODE"
FORCES = ("RF", "total RF", "CF")
NUMBERS = 1000  # unknowns from which CPU times are compared


@dataclass(frozen=True)
class Row:
    """A deck in the table; empty fields: not known."""

    deck: str
    cards: int = 0
    elements: int = 0
    nodes: int = 0
    types: str = ""
    outcome: str = ""
    small: str = ""
    difference: float | None = None
    worst: str = ""
    exact: float | None = None
    theirs: float | None = None
    cpu: float | None = None
    cpu_ccx: float | None = None


# -- a deck in a process of its own -----------------------------------------------------------------------------------
def alone(file: Path, units: str | None) -> dict[str, Any]:
    """Import and run a deck, compare with its reference; facts for ``Row``."""
    begin = clock.process_time()
    try:
        deck = imported(file, units)
        tables = dict(deck.tables)
        tables["output"] = {**tables.get("output", {}), "fields": True}
        scene = latin_fmu.scene_from_dict(tables, file.parent)
        solution = latin_fmu.solve(scene)
    except InputError as error:
        return {"outcome": refusal(error)}
    facts: dict[str, Any] = {"cpu": clock.process_time() - begin}
    facts["outcome"] = "runs" if solution.trustworthy else f"runs, not trustworthy: {solution.status}"
    moved = largest_gradient(deck, solution)
    if moved is not None:
        facts["small"] = "yes" if max(moved) < SMALL else "no"
    prints, theirs = deck.prints, read_dat(reference(file, ".dat.ref"))
    if not theirs:
        filed = read_frd(reference(file, ".frd.ref"))
        theirs = [DatBlock("U", EVERY_NODE, b.time, b.labels[:, None], b.values) for b in filed if b.kind == "U"]
        prints = of_every_node(deck.prints)
    facts["difference"], facts["worst"] = distance(list(printed_blocks(prints, solution)), theirs)
    if facts["difference"] is None:
        prints, theirs = of_every_node(deck.prints), printed_besides(file)
        facts["difference"], facts["worst"] = distance(list(printed_blocks(prints, solution)), theirs)
        facts["worst"] += " (ccx here)" * bool(facts["worst"])
    if (rigid := without_penalty(tables)) is not None:
        exact = latin_fmu.solve(latin_fmu.scene_from_dict(rigid, file.parent))
        if exact.trustworthy:
            facts["exact"] = distance(list(printed_blocks(prints, exact)), theirs)[0]
    return facts


def printed_besides(file: Path) -> list[DatBlock]:
    """Displacements of all nodes by the installed ``ccx``, of a deck whose reference has nothing to compare: its first
    step with two cards more."""
    if shutil.which("ccx") is None:
        return []
    highest = int(read_content(file).labels.max())
    text = re.sub(
        r"(?im)^(\*STEP\b)", rf"*NSET, NSET={EVERY_NODE}, GENERATE\n1, {highest}\n\1", file.read_text(), count=1
    )
    text = re.sub(r"(?im)^(\*END ?STEP\b)", rf"*NODE PRINT, NSET={EVERY_NODE}\nU\n\1", text, count=1)
    end = re.search(r"(?im)^\*END ?STEP.*$", text)
    if end is not None:
        text = text[: end.end()] + "\n"
    besides = file.with_name(f"{file.stem}_besides.inp")
    besides.write_text(text)
    done = subprocess.run(["ccx", "-i", besides.stem], cwd=file.parent, capture_output=True, check=False)
    printed = besides.with_suffix(".dat")
    besides.unlink()
    if done.returncode or not printed.is_file():
        return []
    return read_dat(printed.read_text())


def described(file: Path) -> dict[str, Any]:
    """Cards, elements and nodes of a deck."""
    content = read_content(file)
    if content.deck is None:
        return {}
    return {
        "cards": len(content.deck.cards),
        "elements": sum(len(cells) for cells in content.solids.values()),
        "nodes": len(content.points),
        "types": " ".join(sorted(content.deck.element_types)),
    }


def refusal(error: InputError | MeshError) -> str:
    """The first reason of a refusal, and how many there are."""
    first = error.problems[0]
    more = f" (and {len(error.problems) - 1} more)" if len(error.problems) > 1 else ""
    return f"refused: {first.where}: {first.what}{more}"


def imported(file: Path, units: str | None) -> ImportedDeck:
    """The scene of a deck, in numbers without units where its materials do not tell them."""
    try:
        return import_deck(file, None, units)  # type: ignore[arg-type]
    except InputError as error:
        if "units" not in str(error).splitlines()[0]:
            raise
    return import_deck(file, None, "none")


def reference(file: Path, suffix: str) -> str:
    """Text of a reference, empty where there is none."""
    path = file.with_suffix(suffix)
    return path.read_text(errors="replace") if path.is_file() else ""


def of_every_node(prints: DeckPrints) -> DeckPrints:
    """Displacements of all nodes at all instants."""
    prints.content.add_nodes(EVERY_NODE, np.arange(len(prints.content.labels)))
    request = PrintRequest("NODE PRINT", ("U",), EVERY_NODE, "NO", False)
    return replace(prints, requests={instant.step: [request] for instant in prints.instants})


def largest_gradient(deck: ImportedDeck, solution: Solution) -> tuple[float, float] | None:
    """Largest strain and rotation of any element at any instant, at its middle; None without displacements."""
    content, found = deck.prints.content, None
    for group, part in deck.prints.parts.items():
        history = solution.substructures.get(part)
        if history is None or history.displacement is None:
            continue
        nodes = content.nodes_of(group)
        for kind, rows in content.volumes[group].items():
            cells = np.searchsorted(nodes, content.solids[kind][rows])
            points = points_in(content.points[nodes], CellBlock(kind, cells), volume_rule(kind, 1))
            for moved in history.displacement:
                slope = np.einsum("cpaj,cai->cpij", points.gradients, moved[cells])
                strain = float(np.abs(slope + np.swapaxes(slope, -1, -2)).max()) / 2.0
                turn = float(np.abs(slope - np.swapaxes(slope, -1, -2)).max()) / 2.0
                before = found or (0.0, 0.0)
                found = max(strain, before[0]), max(turn, before[1])
    return found


# -- references -------------------------------------------------------------------------------------------------------
def distance(ours: Sequence[DatBlock], theirs: Sequence[DatBlock]) -> tuple[float | None, str]:
    """Largest difference of a block from its reference, and which block it is; None where no two are of one instant."""
    largest: Counter[tuple[str, str]] = Counter()
    for block in theirs:
        if block.values.size:
            key = _scale_of(block)
            largest[key] = max(largest[key], float(np.abs(block.values[:, : _compared(block)]).max()))
    worst, name = None, ""
    for block in ours:
        for other in theirs:
            same = (block.kind, block.target) == (other.kind, other.target)
            if not same or abs(block.time - other.time) > 2e-6 * max(abs(other.time), 1e-30):
                continue
            rows, others = _common(block, other)
            if not len(rows) or not largest[_scale_of(other)]:
                continue
            count = _compared(block)
            apart = np.abs(block.values[rows, :count] - other.values[others, :count]).max() / largest[_scale_of(other)]
            if worst is None or apart > worst:
                worst, name = float(apart), f"{block.kind} of {block.target} at {block.time:.6g}"
            break
    return worst, name


def _scale_of(block: DatBlock) -> tuple[str, str]:
    """Forces are compared with all forces, other quantities with those of their set."""
    if block.kind in FORCES:
        return "force", ""
    return block.kind, block.target


def _compared(block: DatBlock) -> int | None:
    """Number of values that are compared: of a contact its force."""
    return 3 if block.kind == "CF" else None


def _common(one: DatBlock, other: DatBlock) -> tuple[np.ndarray, np.ndarray]:
    """Rows of two blocks with the same labels."""
    places = {tuple(labels): i for i, labels in enumerate(other.labels.tolist())}
    pairs = [(i, places[tuple(labels)]) for i, labels in enumerate(one.labels.tolist()) if tuple(labels) in places]
    table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


# -- all decks --------------------------------------------------------------------------------------------------------
def rows_of(folder: Path, options: Namespace) -> Iterator[Row]:
    """A row for each deck of a folder."""
    with TemporaryDirectory() as name:
        place = unpacked(folder, Path(name))
        for file in sorted(place.glob("*.inp")):
            if not options.decks or file.stem in options.decks:
                yield row_of(file, options)


def unpacked(folder: Path, place: Path) -> Path:
    """Copies of all files, those that are packed unpacked."""
    for file in sorted(folder.iterdir()):
        if file.suffix == ".gz":
            (place / file.stem).write_bytes(gzip.decompress(file.read_bytes()))
        elif file.is_file():
            shutil.copy(file, place / file.name)
    return place


def row_of(file: Path, options: Namespace) -> Row:
    """One deck."""
    facts: dict[str, Any] = {}
    try:
        facts = described(file)
        imported(file, options.units)
    except (InputError, MeshError) as error:
        return Row(file.stem, **facts, outcome=refusal(error))
    command = [sys.executable, str(Path(__file__).resolve()), "--alone", str(file)]
    if options.units:
        command += ["--units", options.units]
    code, output, _ = limited(command, file.parent, options.limit)
    answers = [line for line in output.splitlines() if line.startswith("{")]
    if answers:
        facts |= json.loads(answers[-1])
    elif code < 0:
        facts["outcome"] = f"stopped after {options.limit:g} s"
    else:
        facts["outcome"] = f"error: {(output.strip().splitlines() or ['nothing'])[-1][:100]}"
    row = Row(file.stem, **facts)
    if not row.outcome.startswith("runs") or shutil.which("ccx") is None:
        return row
    code, _, cpu = limited(["ccx", "-i", file.stem], file.parent, 5.0 * options.limit)
    printed = file.with_suffix(".dat")
    theirs = None
    if code == 0 and printed.is_file():
        theirs = distance(read_dat(printed.read_text()), read_dat(reference(file, ".dat.ref")))[0]
    return replace(row, cpu_ccx=cpu if code == 0 else None, theirs=theirs)


ONE_THREAD = {"OMP_NUM_THREADS": "1", "CCX_NPROC_STIFFNESS": "1", "CCX_NPROC_RESULTS": "1"}


def limited(command: Sequence[str], folder: Path, limit: float) -> tuple[int, str, float]:
    """Exit code, output and CPU seconds of a command with a limit of CPU seconds, on one thread."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    top = int(limit) + 1
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        # modules compiled once, as they are where the package is installed
        env=os.environ | ONE_THREAD | {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(folder / "pycache")},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (top, top)),
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.returncode, done.stdout + done.stderr, cpu


# -- the table --------------------------------------------------------------------------------------------------------
TITLES = (
    "deck",
    "cards",
    "elements",
    "nodes",
    "outcome",
    "small",
    "from the reference",
    "block",
    "exact",
    "ccx",
    "CPU s",
    "CPU s, ccx",
)


def cells_of(row: Row) -> list[str]:
    """A row as text."""
    percent = ["" if x is None else f"{100.0 * x:.2g} %" for x in (row.difference, row.exact, row.theirs)]
    seconds = ["" if x is None else f"{x:.2g}" for x in (row.cpu, row.cpu_ccx)]
    counts = [str(row.cards or ""), str(row.elements or ""), str(row.nodes or "")]
    return [row.deck, *counts, short(row.outcome), row.small, percent[0], row.worst, *percent[1:], *seconds]


def short(outcome: str) -> str:
    """An outcome in a few words."""
    return re.sub(r"\s+", " ", outcome).replace("|", "/")[:110]


def statistics(rows: Sequence[Row]) -> list[str]:
    """What the table says as a whole."""
    running = [row for row in rows if row.outcome.startswith("runs")]
    trusted = [row for row in running if row.outcome == "runs"]
    lines = [f"{len(rows)} decks, {len(running)} run, {len(trusted)} to a trustworthy end"]
    compared = [row.difference for row in trusted if row.small != "no" and row.difference is not None]
    if compared:
        near = sum(x <= 0.03 for x in compared)
        lines.append(
            f"{len(compared)} of small displacements compared: median {100.0 * median(compared):.2g} %, "
            f"{near} within 3 %"
        )
    ratios = [row.cpu / row.cpu_ccx for row in trusted if row.cpu and row.cpu_ccx and 3 * row.nodes > NUMBERS]
    if ratios:
        text = f"median CPU over that of ccx {median(ratios):.2g}"
        lines.append(f"{len(ratios)} meshes of more than {NUMBERS} unknowns: {text}")
    return lines


def write(rows: Sequence[Row], folder: Path) -> None:
    """The table as CSV and Markdown."""
    names = [field.name for field in fields(Row)]
    with (folder / "decks.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([getattr(row, name) for name in names] for row in rows)
    (folder / "decks.md").write_text("\n".join(markdown(rows)) + "\n")


def markdown(rows: Iterable[Row]) -> Iterator[str]:
    """Lines of a table."""
    yield "| " + " | ".join(TITLES) + " |"
    yield "|---" * len(TITLES) + "|"
    for row in rows:
        yield "| " + " | ".join(cells_of(row)) + " |"


def main() -> None:
    """The table of a folder, or the facts of one deck."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder of decks and references")
    parser.add_argument("--decks", nargs="+", default=[], help="names of some decks")
    parser.add_argument("--limit", type=float, default=60.0, help="CPU seconds of a run (default: 60)")
    parser.add_argument("--units", help="units of the decks, as of latin-fmu import")
    parser.add_argument("--alone", action="store_true", help="the folder is one deck: its facts as JSON")
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder of the tables")
    options = parser.parse_args()
    if options.alone:
        print(json.dumps(alone(options.folder, options.units)))
        return
    rows = []
    for row in rows_of(options.folder, options):
        rows.append(row)
        print("  ".join(text for text in cells_of(row) if text), flush=True)
    print("", *statistics(rows), sep="\n")
    write(rows, options.output)


if __name__ == "__main__":
    main()
