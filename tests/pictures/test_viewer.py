"""The page of a results file: its numbers are those of the file, its size is bounded, a browser draws it."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import zlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import latin_fmu
from latin_fmu import api
from latin_fmu.cli import main
from latin_fmu.fem.mesh import Array
from latin_fmu.pictures import viewer
from latin_fmu.reader import scene_from_dict

from .test_pictures import tower


@pytest.fixture(scope="module")
def tree() -> xr.DataTree:
    """The tower with the slip of its faces; it is drawn as a run that cannot be trusted, with a name of HTML."""
    scene = tower()
    scene["output"]["surfaces"] = True
    scene["sensor"] = {"top": {"substructure": "c", "point": [5e-3, 5e-3, 3e-2]}}
    made = api.solve(scene_from_dict(scene)).to_datatree()
    made.attrs.update(scene_name="</script>&<b>", trustworthy=0)
    return made


class Scripts(HTMLParser):
    """Contents of the scripts of a page by their id, as a browser separates them."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: dict[str | None, str] = {}
        self._at: str | None = None
        self._inside = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside, self._at = tag == "script", dict(attrs).get("id")

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.found[self._at] = self.found.get(self._at, "") + data

    def handle_endtag(self, tag: str) -> None:  # noqa: ARG002, as html.parser calls it
        self._inside = False


def contents(page: str) -> tuple[dict[str, Any], bytes]:
    """Header and block of a page."""
    scripts = Scripts(page).found
    return json.loads(scripts["head"]), zlib.decompress(base64.b64decode(scripts["block"]))


def array(block: bytes, place: list[int], dtype: str) -> Array:
    return np.frombuffer(block, dtype, place[1], place[0])


def test_numbers_are_those_of_the_file(tree: xr.DataTree) -> None:
    page = viewer.page(tree)
    assert "<title>&lt;/script&gt;&amp;&lt;b&gt;</title>" in page
    head, block = contents(page)
    np.testing.assert_allclose(np.array(head["times"]), tree["substructures/a"]["time"].values * 1e6)
    assert head["second"] == "µs"
    assert head["title"] == "</script>&<b>"
    assert head["trustworthy"] is False
    for body in head["bodies"]:
        stored = tree[f"substructures/{body['name']}"]
        nodes = np.stack([stored[f"node_{x}"].values for x in "xyz"], axis=1)
        points = array(block, body["points"], "<f4").reshape(-1, 3) * head["size"] + [5e-3, 5e-3, 1.5e-2]
        assert len(points) == 26  # of 27 nodes one is inside
        number = np.array([np.linalg.norm(nodes - p, axis=1).argmin() for p in points])
        np.testing.assert_allclose(nodes[number], points, atol=1e-8)
        moved = array(block, body["moved"], "<i2").reshape(len(head["times"]), -1, 3) / 32767
        moved = moved * head["reach"] * head["size"]
        np.testing.assert_allclose(
            moved, stored["displacement"].values[:, number], atol=head["reach"] * head["size"] / 6e4
        )
        corners = points[array(block, body["triangles"], "<u4").reshape(-1, 3)]
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        assert area.sum() == pytest.approx(6e-4, rel=1e-5)
        assert body["edges"][1] == 2 * 12 * 2  # twelve edges of two pieces


def test_fields_of_interfaces(tree: xr.DataTree) -> None:
    """Pressures are positive in compression, states 0, 1, 2 stand for 0, 1/2, 1, and both sides know their bodies."""
    head, block = contents(viewer.page(tree))
    assert [face["name"] for face in head["interfaces"]] == ["ab", "bc"]
    for face in head["interfaces"]:
        stored = tree[f"interfaces/{face['name']}"]
        shape = stored["contact_status"].shape
        pressure = face["fields"]["pressure"]
        expected = -(stored["traction"] * stored["normal"]).sum("component").values
        values = array(block, pressure["values"], "<u2").reshape(shape) / 65535 * pressure["largest"]
        assert expected.max() > 5e4
        np.testing.assert_allclose(values, np.clip(expected, 0.0, None), atol=pressure["largest"] / 1e5)
        state = array(block, face["fields"]["state"]["values"], "<u2").reshape(shape)
        np.testing.assert_array_equal(np.rint(state / 65535 * 2), stored["contact_status"].values)
        assert face["fields"]["slip"]["unit"] == "m"
        assert [head["bodies"][side["body"]]["name"] for side in face["sides"]] == list(face["name"])
        for side in face["sides"]:  # meshes match: a point is a node of both bodies
            nodes = array(block, head["bodies"][side["body"]]["points"], "<f4").reshape(-1, 3)
            points = array(block, face["points"], "<f4").reshape(-1, 3)
            np.testing.assert_allclose(nodes[array(block, side["nodes"], "<u4")], points, atol=1e-6)
    titles = [panel["title"] for panel in head["curves"]]
    assert titles[:2] == ["normal force (compression > 0)", "friction force"]
    assert "top: velocity, unfiltered" in titles


def test_stresses_of_bodies() -> None:
    """Of a file that has them: shares of the largest away from edges of contacts, which larger ones are cut to."""
    scene = {
        "name": "rod",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {"rod": {"material": "steel", "box": {"size": [0.01, 0.01, 0.04], "elements": [2, 2, 8]}}},
        "boundary": {"base": {"type": "fixed", "face": "rod.zmin"}},
        "load": {"bend": {"face": "rod.zmax", "traction": [1e7, 0.0, 0.0]}},
        "time": {"end": 1.0, "instants": 1, "quasi_static": True},
        "output": {"nodal_stress": True},
    }
    stored = latin_fmu.solve(latin_fmu.scene_from_dict(scene)).to_datatree()
    head, block = contents(viewer.page(stored))
    assert not head["relative"]
    rod = stored["substructures/rod"]
    scale, edge = head["stresses"]["von_mises"], rod["contact_edge"].values == 1
    mises = rod["nodal_von_mises"].values
    assert scale["largest"] == pytest.approx(mises[:, ~edge].max())
    assert scale["beyond"] == pytest.approx(mises.max())
    (body,) = head["bodies"]
    points = array(block, body["points"], "<f4").reshape(-1, 3) * head["size"] + [5e-3, 5e-3, 2e-2]
    nodes = np.stack([rod[f"node_{x}"].values for x in "xyz"], axis=1)
    number = np.array([np.linalg.norm(nodes - p, axis=1).argmin() for p in points])
    shares = array(block, body["stresses"]["von_mises"], "<u2").reshape(2, -1) / 65535
    np.testing.assert_allclose(shares, np.clip(mises[:, number] / scale["largest"], 0.0, 1.0), atol=1e-4)


def test_bodies_move_apart_upwards(tree: xr.DataTree) -> None:
    head, _ = contents(viewer.page(tree))
    heights = [body["shift"][2] for body in head["bodies"]]
    np.testing.assert_allclose(np.diff(heights), 0.5 * 1e-2 / 3e-2, rtol=1e-6)


def test_as_many_instants_as_fit(tree: xr.DataTree, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "MOST_BYTES", 12_000)
    page = viewer.page(tree)
    head, block = contents(page)
    assert 2 <= len(head["times"]) < 10
    assert head["times"][-1] == pytest.approx(2.0)
    assert len(block) < 12_000 + 8_000  # colour maps and curves
    assert len(contents(viewer.page(tree, 1e-6, 2e-6, 3))[0]["times"]) == 3


def test_curves_keep_their_peaks() -> None:
    time = np.linspace(0.0, 1.0, 100_001)
    values = np.sin(20 * time)
    values[[777, 54_321]] = -3.0, 5.0
    thin_time, thin = viewer._thinned(time, values)
    assert len(thin) <= 2002
    assert (thin.min(), thin.max()) == (-3.0, 5.0)
    assert (thin_time[0], thin_time[-1]) == (0.0, 1.0)
    np.testing.assert_array_equal(values[np.searchsorted(time, thin_time)], thin)


def test_command(tree: xr.DataTree, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "out.nc"
    tree.to_netcdf(file)
    assert main(["view", str(file), "--frames", "4"]) == 0
    assert capsys.readouterr().out == f"page: {tmp_path / 'out.html'}\n"
    assert len(contents((tmp_path / "out.html").read_text(encoding="utf-8"))[0]["times"]) == 4
    for options, words in (
        (["--frames", "1"], "2 to 1000"),
        (["--from", "-1"], "a number >= 0"),
        (["--from", "1"], "fewer than two stored instants"),
        (["-o", "page.txt"], ".html"),
    ):
        assert main(["view", str(file), *options]) == 2
        assert words in capsys.readouterr().err
    tree.drop_nodes("substructures").to_netcdf(tmp_path / "bare.nc")
    assert main(["view", str(tmp_path / "bare.nc")]) == 2
    assert "output.fields=true" in capsys.readouterr().err


@pytest.mark.slow
def test_a_browser_draws_the_page(tree: xr.DataTree, tmp_path: Path) -> None:
    """The colours of three bodies are in the picture, which an error would leave white."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium here")
    from matplotlib.image import imread

    page, picture = tmp_path / "tower.html", tmp_path / "tower.png"
    page.write_text(viewer.page(tree), encoding="utf-8")
    command = [browser, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    command += ["--window-size=1280,800", "--virtual-time-budget=8000", f"--screenshot={picture}"]
    address = f"{page.as_uri()}#frame=5&lines=false&field=none"
    subprocess.run([*command, address], capture_output=True, timeout=120, check=True)
    colours = {tuple(c) for c in np.rint(imread(picture)[:600, :1000, :3] * 255).astype(int).reshape(-1, 3)[::7]}
    for tint in ("#A6BDD7", "#E8C9A0", "#B5D3A8"):
        plain = np.array([int(tint[i : i + 2], 16) for i in (1, 3, 5)])
        lit = [c for c in colours if np.abs(np.array(c) / plain - (np.array(c) / plain).mean()).max() < 0.02]
        assert any(max(c) < 245 for c in lit), tint
