"""What is taken away is what is on the screen: of every table of every page."""

import re

import pytest

from ident.report.page import Columns, Details, Table
from ident.report.pages.evaluate import evaluate_page
from ident.report.pages.info import info_page
from ident.report.pages.steering import steering_page
from ident.report.pages.tyres import tyres_page

NUMBER = re.compile(r"(?:[✗≈]\u00a0)?(−?\d+(?:\.\d+)?)")


def tables_of(page):
    waiting = [*page.lead, *(block for section in page.sections for block in section.blocks)]
    while waiting:
        block = waiting.pop(0)
        if isinstance(block, Table):
            yield block
        if isinstance(block, Columns):
            waiting += [inner for column in block.blocks for inner in column]
        if isinstance(block, Details):
            waiting += block.blocks


@pytest.fixture(scope="module")
def tables(steering_case, info_result, tyres_case, evaluate_case):
    pages = [
        steering_page(*steering_case),
        info_page(info_result),
        tyres_page(*tyres_case),
        evaluate_page(*evaluate_case),
    ]
    return [table for page in pages for table in tables_of(page)]


def test_a_number_is_downloaded_in_the_unit_in_which_it_is_shown(tables):
    compared, wrong = 0, []
    for table in tables:
        for row in table.cells():
            for column, cell in zip(table.columns, row, strict=True):
                shown = NUMBER.fullmatch(cell.text)
                if shown is None or not isinstance(cell.raw, (int, float)):
                    continue
                compared += 1
                value = float(shown[1].replace("−", "-"))
                places = len(shown[1].partition(".")[2])
                if abs(value - cell.raw) > 0.51 * 10.0**-places and abs(value - cell.raw) > 0.006 * abs(
                    value
                ):
                    wrong.append((table.download, column.head, cell.text, cell.raw))
    assert compared > 300
    assert wrong == []


def test_every_table_with_numbers_can_be_taken_away(tables):
    own = [table for table in tables if any(column.align == "number" for column in table.columns)]
    assert len(own) > 30
    assert [table.columns[0].head for table in own if table.download is None] == []
