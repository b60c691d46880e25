"""The report of a run, and the limits that it is judged by."""

from __future__ import annotations

import base64
import copy
import html
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.report import document, loads, markup, sections
from latin_fmu.report.document import report_page
from latin_fmu.results.bolt_margins import CHECKS
from latin_fmu.results.bolt_results import safety_text
from latin_fmu.results.groups import datasets_of
from latin_fmu.results.spectra import LINES, shock_response_spectrum
from latin_fmu.results.summary import stored_summary
from latin_fmu.scene.limits import Check
from latin_fmu.scene.readable_numbers import readable
from tests.scenes import clamp, given_motion, half_sine

NAMES = (
    "Verdict",
    "Model and mesh",
    "Loads and base motion",
    "Bolts",
    "Sensors",
    "Interfaces",
    "Accuracy",
    "What was simulated, and what was not",
)
FREQUENCIES = [1e4, 2e4]


def description() -> dict[str, Any]:
    """The clamp on a moving wall: one bolt, one sensor, and limits of each kind, met and exceeded."""
    tables = clamp(
        load={},
        boundary={"wall": given_motion("lower.xmin", [0.0, 0.0, 2e4], half_sine(5e-5), "xyz", "acceleration")},
        sensor={"tip": {"face": "upper.xmax", "spectrum": {"lowest": 1e4, "highest": 3e4}}},
        limit={
            "low": {"sensor": "tip", "frequencies": FREQUENCIES, "values": [1.0, 10.0]},
            "high": {"sensor": "tip", "kind": "pseudo_velocity", "frequencies": FREQUENCIES, "values": [1e4, 1e4]},
            "strict": {"bolt": "b*", "check": "service_yield", "least": 500.0},
            "mild": {"bolt": "b", "check": "fatigue", "least": 1e-6},
            "dark": {"bolt": "b", "check": "slip", "least": 1.0},
        },
    )
    tables["description"] = "5 < 6 <b>bold</b> & <script>alert(1)</script>"
    tables["bolt"]["b"] |= {"thread": "M8", "property_class": "8.8", "thread_friction": 0.12}
    tables["output"] = {"fields": True, "nodal_stress": True}
    return tables


@cache
def solution() -> latin_fmu.Solution:
    """The run, solved once."""
    return latin_fmu.solve(latin_fmu.scene_from_dict(description()))


@cache
def page() -> str:
    """Its report."""
    return report_page(solution().to_datatree(), Path())


class Reader(HTMLParser):
    """Texts of the cells by section, images, tags."""

    def __init__(self) -> None:
        super().__init__()
        self.cells: list[list[str]] = []
        self.bad: list[str] = []
        self.images: list[str] = []
        self.heads: list[str] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self._red = False
        self._in = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in ("meta", "img"):
            self.open.append(tag)
        self._in = tag
        if tag == "img":
            self.images.append(str(dict(attrs)["src"]))
        if tag == "tr":
            self.cells.append([])
            self._red = dict(attrs).get("class") == "bad"
        if tag in ("td", "th"):
            self.cells[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        self._in = ""

    def handle_data(self, data: str) -> None:
        if self._in == "h2":
            self.heads.append(data)
        if self._in in ("td", "th"):
            self.cells[-1][-1] += data.replace("\N{NO-BREAK SPACE}", " ")
            if self._red:
                self.bad.append(data)


@cache
def read() -> Reader:
    """The report, parsed; every tag is closed."""
    reader = Reader()
    reader.feed(page())
    assert not reader.open
    return reader


def row(*begin: str) -> list[str]:
    """The row of the report whose first cells are these."""
    return next(cells for cells in read().cells if tuple(cells[: len(begin)]) == begin)


def test_report_has_every_section_and_nothing_from_elsewhere() -> None:
    assert read().heads == [f"{i} {name}" for i, name in enumerate(NAMES, 1)]
    assert "The run has none." not in page()
    assert "http" not in page()
    assert "script" not in read().tags
    assert "link" not in read().tags
    assert len(read().images) >= 9
    for image in read().images:
        head, _, data = image.partition(",")
        assert head == "data:image/png;base64"
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG")


def test_numbers_are_those_of_the_dataset() -> None:
    tree = solution().to_datatree()
    model, bolt = tree["model"].to_dataset(), tree["bolts/b"].to_dataset()
    mass = float(model["mass"].sum())
    assert mass == pytest.approx(7800.0 * (2 * 60 * 20 * 10 + 2 * 20 * 15 * 10 + 10 * 5 * 20) * 1e-9)
    assert row("all")[2] == readable(mass, "kg")
    assert row("lower")[4:] == ["96 hexahedron", "195"] == ["96 hexahedron", str(int(model["node_count"][0]))]
    safeties = dict(zip(bolt["check"].values.tolist(), bolt["safety"].values.tolist(), strict=True))
    margins = row("b", *(safety_text(check, value) for check, value in safeties.items()))
    assert len(margins) == len(safeties) + 1
    finite = {check: s for check, s in safeties.items() if check != "separation" and np.isfinite(s)}
    worst = min(finite, key=lambda check: finite[check])
    assert row("smallest margin")[1].startswith(f"{safety_text(worst, finite[worst])}, bolt b, ")
    assert f"({worst}, VDI 2230-1 " in row("smallest margin")[1]
    largest = float(np.abs(bolt["section_force"].sel(section="head", direction="axial")).max())
    assert row("b", "head")[2] == readable(largest, "N")
    joint = tree["interfaces/joint"].to_dataset()
    assert row("joint", "contact")[4] == readable(float(joint["area"].sum()), "m2")
    acceleration = tree["sensors/tip/acceleration"].values
    assert readable(float(np.linalg.norm(acceleration, axis=1).max()), "m s-2") in row("tip")[4]
    # the half sine at the instant that is nearest to its middle
    assert row("boundary.wall")[4] == readable(2e4 * np.sin(0.4 * np.pi), "m s-2")
    assert row("wall", "acceleration")[2:] == ["lower.xmin", "x, y, z"]


def test_words_are_those_of_the_summary() -> None:
    said = " ".join(solution().summary().split())
    texts = {cells[0]: cells[1] for cells in read().cells if len(cells) == 2}
    for name in ("bolt b", "sensor tip", "joint", "limit low", "limit dark"):
        assert f"{name} {texts[name]}" in said
    assert texts["limits not judged"] == "dark"
    assert "no face of clamped parts surrounds the shank" in texts["limit dark"]
    assert html.escape(solution().status) in page()


def test_limits_are_judged() -> None:
    judged = solution().report()["limits"]
    assert {name: of["state"] for name, of in judged.items()} == {
        "low": "exceeded",
        "high": "met",
        "strict": "exceeded",
        "mild": "met",
        "dark": "not judged",
    }
    time, acceleration = solution().time, solution().sensors["tip"].acceleration
    frequency = judged["low"]["frequency"]
    spectrum = shock_response_spectrum(acceleration, time[1] - time[0], [frequency], interpolation=LINES)
    value = spectrum.acceleration[0, 0].max()
    assert judged["low"]["value"] == pytest.approx(value, rel=1e-12)
    # 1 at 10 kHz and 10 at 20 kHz: a straight line in logarithms
    allowed = (frequency / 1e4) ** (1.0 / np.log10(2.0))
    assert judged["low"]["allowed"] == pytest.approx(allowed)
    assert judged["low"]["factor"] == pytest.approx(value / allowed)
    assert judged["strict"]["factor"] == pytest.approx(500.0 / judged["strict"]["safety"])
    red = " ".join(read().bad)
    assert "limit exceeded: low" in red
    assert "limit strict" in red
    assert readable(frequency, "Hz", 3) in red
    assert "limit high" not in red
    assert "limit mild" not in red
    stored = datasets_of(solution().to_datatree(), "limits")["low"]
    assert float((stored["spectrum"] / stored["allowed"]).max()) == judged["low"]["factor"]


def test_base_motion_has_its_spectrum() -> None:
    (history,) = loads.acting(latin_fmu.scene_from_dict(description()))
    assert history.spectrum is not None
    assert history.spectrum.frequency[-1] == pytest.approx(4e4)
    expected = shock_response_spectrum(history.values, 1e-5, [4e4], interpolation=LINES).acceleration[0, 0]
    assert history.spectrum.acceleration[0, -1] == pytest.approx(expected)


def test_texts_of_users_are_escaped() -> None:
    assert description()["description"] in row("description")
    assert "<script>" not in page()
    assert "&lt;script&gt;" in page()
    figure = markup.table([["a", "<i>"], ["1 < 2", "'\""]])
    assert "<i>" not in figure
    assert "1 &lt; 2" in figure


def test_checks_of_limits_are_those_of_bolts() -> None:
    assert Check.__args__ == tuple(CHECKS)  # type: ignore[attr-defined]


def wrong(change: dict[str, Any]) -> str:
    """What is said of a scene whose only limit is this one."""
    tables = copy.deepcopy(description())
    tables["limit"] = {"l": change}
    with pytest.raises(latin_fmu.SceneError) as error:
        latin_fmu.scene_from_dict(tables)
    return str(error.value)


SENSOR = {"sensor": "tip", "frequencies": FREQUENCIES, "values": [1.0, 2.0]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, "limit.l: neither 'sensor' nor 'bolt' is given"),
        (SENSOR | {"sensor": "top"}, "limit.l.sensor: no sensor of this name (value: 'top'); allowed: tip"),
        (SENSOR | {"values": [1.0]}, "frequencies and values differ in number (value: [2, 1])"),
        (SENSOR | {"values": [1.0, -2.0]}, "breakpoint 2: the value is not positive (value: -2); allowed: a value > 0"),
        (SENSOR | {"frequencies": [1e4, 1e6]}, "lies beyond 0.4 of the sampling rate (value: 1e+06 Hz)"),
        (SENSOR | {"unit": "mm"}, "unit: a unit of a length, not of an acceleration (value: mm); allowed: m/s2"),
        (SENSOR | {"least": 1.0}, "limit.l.least: has no meaning in a limit of a sensor; remove it"),
        (SENSOR | {"file": "f.csv"}, "a limit of a spectrum is a file, or breakpoints"),
        ({"sensor": "tip", "file": "nowhere.csv"}, "the file does not exist"),
        ({"bolt": "m6*", "least": 1.0}, "limit.l.bolt: no bolt has this name (value: 'm6*'); allowed: b"),
        ({"bolt": "b"}, "limit.l.least: this key is missing"),
        ({"bolt": "b", "least": 1.0, "check": "yield"}, "limit.l.check: unknown value (value: 'yield')"),
    ],
)
def test_wrong_limits_are_refused(change: dict[str, Any], words: str) -> None:
    assert words in wrong(change)


def test_limits_of_files_have_units_and_are_stored(tmp_path: Path) -> None:
    (tmp_path / "limit.csv").write_text("frequency [Hz], limit [g]\n10000, 2\n20000, 4\n")
    tables = description() | {"limit": {"l": {"sensor": "tip", "file": "limit.csv", "damping": 0.05}}}
    scene = latin_fmu.scene_from_dict(tables, tmp_path)
    limit = scene.limit["l"]
    assert limit.values == pytest.approx((2 * 9.80665, 4 * 9.80665))
    assert limit.quality == 10.0
    (tmp_path / "limit.csv").unlink()
    assert latin_fmu.scene_from_dict(scene.tables(), tmp_path).limit["l"].values == limit.values
    (tmp_path / "bare.csv").write_text("10000, 2\n20000, 4\n")
    with pytest.raises(latin_fmu.SceneError, match="the header names no unit"):
        latin_fmu.scene_from_dict(
            tables | {"limit": {"l": {"sensor": "tip", "file": "bare.csv", "kind": "pseudo_velocity"}}}, tmp_path
        )


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and not drawn: this takes most of the time of a page, and one page of these tests has it."""
    for module in (document, sections):
        monkeypatch.setattr(module, "picture", lambda _, caption: markup.paragraph(caption))


@pytest.fixture
def first_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages have their first section alone."""
    every = sections.sections

    def first(of: sections.RunContent) -> list[markup.PageSection]:
        return [next(every(of))]

    monkeypatch.setattr(document, "sections", first)
    monkeypatch.setattr(document, "_built", lambda tree, scene: sections.RunContent(tree, stored_summary(tree), scene))


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    file = tmp_path / "out.nc"
    solution().save(file)
    return file


@pytest.mark.usefixtures("first_alone")
def test_command_writes_the_page_and_refuses_what_is_none(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "r.html"
    assert main(["report", str(stored), "-o", str(target)]) == 0
    assert "limit exceeded: low" in target.read_text(encoding="utf-8")
    assert capsys.readouterr().out == f"report: {target}\n"
    assert main(["report", str(stored), "-o", str(tmp_path / "r.pdf")]) == 2
    assert "which a browser prints to PDF (value: " in capsys.readouterr().err
    (tmp_path / "folder.html").mkdir()
    assert main(["report", str(stored), "-o", str(tmp_path / "folder.html")]) == 2
    assert "this is a folder, a file is needed" in capsys.readouterr().err
    bare = tmp_path / "bare.nc"
    xr.Dataset(attrs={"source": "another program"}).to_netcdf(bare)
    assert main(["report", str(bare)]) != 0
    assert "bare.nc" in capsys.readouterr().err
    assert not (tmp_path / "bare.html").exists()


def test_page_without_summary_is_refused() -> None:
    tree = solution().to_datatree()
    del tree["summary"]
    with pytest.raises(latin_fmu.ResultsError, match="run its scene again"):
        report_page(tree, Path())
    with pytest.raises(latin_fmu.ResultsError, match="holds no run"):
        report_page(xr.DataTree(), Path())


@pytest.mark.usefixtures("undrawn")
def test_meshes_that_are_gone_are_said() -> None:
    tree = solution().to_datatree()
    text = tree.attrs["scene"]
    begin = text.index("box = ", text.index("[substructure.nut]"))
    tree.attrs["scene"] = text[:begin] + 'mesh = {file = "gone.msh"}' + text[text.index("\n", begin) :]
    text = report_page(tree, Path("elsewhere"))
    assert "No picture of the assembly: " in text
    assert "--folder names another one" in text
    assert text.count("<section") == len(NAMES)


@pytest.mark.usefixtures("first_alone")
def test_verdict_says_what_is_not_trustworthy() -> None:
    tree = solution().to_datatree()
    tree.attrs |= {"trustworthy": np.int8(0), "status": "not converged: window 3"}
    text = report_page(tree, Path())
    assert '<p class="verdict bad">The results are NOT trustworthy: not converged: window 3</p>' in text
    assert '<p class="verdict">' in page()


@pytest.mark.usefixtures("first_alone")
def test_run_writes_the_report_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tables = description()
    tables["output"] = {}
    scene = tmp_path / "scene.toml"
    scene.write_text(latin_fmu.scene_from_dict(tables).text())
    target = tmp_path / "r.html"
    code = main(["run", str(scene), "-o", str(tmp_path / "o.nc"), "--report", str(target), "--no-estimate"])
    out = capsys.readouterr().out
    assert code == 0
    assert f"report: {target}" in out
    assert "limit low" in out
    assert "EXCEEDED" in out
    assert "limit exceeded: low" in target.read_text(encoding="utf-8")
