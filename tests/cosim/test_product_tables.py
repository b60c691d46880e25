"""Tables of an image that are products of others: what a file leaves out, and what comes back."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu import scene_from_dict
from latin_fmu.assembly.interfaces import completed
from latin_fmu.cosim.communication import CommunicationRun, _from_planes, read, write
from latin_fmu.cosim.product_tables import Product, StridedTable, multiply, products
from latin_fmu.kernels.records import CLASS, GROUP, RUN
from tests.cosim.test_modal_sessions import modal
from tests.verification.test_modal_studies import stacked

from .scenes import blocks


@pytest.fixture(scope="module")
def run() -> CommunicationRun:
    """An assembly that is marched by its modes, with damping by ratios."""
    return CommunicationRun(completed(scene_from_dict(modal(stacked()))))


def fixed_in(content: bytes, words: dict[str, int]) -> np.ndarray:
    """The fixed block as it lies in a file."""
    records = RUN.itemsize + words["n_class"] * CLASS.itemsize + words["n_group"] * GROUP.itemsize
    start = 8 * 41 + records
    return _from_planes(np.frombuffer(content, float, words["n_fixed"], start))


def test_damping_and_factor_of_modes_are_products_with_their_stiffness(run: CommunicationRun) -> None:
    row = run.image.classes[0]
    columns = {product.target.column for product in run.products}
    assert columns == {1, int(row["n_interior"])}  # rows of damping, columns of the factor
    assert all(product.source.place >= int(row["elastic_rows"]) for product in run.products)


def test_a_file_has_zeros_in_their_place_and_gives_their_bits(run: CommunicationRun) -> None:
    content = write(run)
    words, _, pools = read(content)
    stored, whole = fixed_in(content, words), run.image.fixed[: run.image.n_fixed]
    assert words["n_product"] == sum(len(product.words) for product in run.products) > 0
    for product in run.products:
        assert product.target.of(whole).any()
        assert not product.target.of(stored).any()
    assert (pools.fixed == whole).all()


def test_words_give_the_product_and_leave_all_else() -> None:
    """By rows and by columns; numbers before, between and behind stay."""
    rng = np.random.default_rng(1)
    fixed, source, factors = rng.normal(size=400), StridedTable(3, 40, 1, 3, 30), rng.normal(size=(4, 3))
    for target in (StridedTable(200, 1, 5, 4, 30), StridedTable(200, 35, 1, 4, 30)):
        found, others = fixed.copy(), np.ones(400, dtype=bool)
        target.of(others)[:] = False
        multiply(Product(target, source, factors).words, found)
        np.testing.assert_allclose(target.of(found), factors @ source.of(fixed), rtol=1e-13)
        assert others.sum() == 400 - 120
        assert (found[others] == fixed[others]).all()


def test_a_table_with_rows_of_its_own_is_kept(run: CommunicationRun) -> None:
    fixed = run.image.fixed[: run.image.n_fixed].copy()
    product = run.products[0]
    product.target.of(fixed)[0, 0] += 1e-9 * np.abs(product.target.of(fixed)).max()
    assert product.target not in [other.target for other in products(run.image.classes, fixed)]


def test_bodies_have_no_products() -> None:
    run = CommunicationRun(completed(blocks()))
    assert run.products == []
    assert read(write(run))[0]["n_product"] == 0
