import base64
import csv
import hashlib
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from ident.report.html import (
    content_policy,
    csv_address,
    download_name,
    embed_json,
    json_address,
    plotly_script,
    render,
    table_csv,
    table_json,
    write_report,
)
from ident.report.page import Cell, Code, Column, Details, Facts, Lines, Page, Section, Table, Text, Verdict

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>{{ 7 * 7 }}"


def hostile_page(name="steering"):
    table = Table(
        [Column(HOSTILE)],
        [[Cell(HOSTILE, detail=HOSTILE)]],
        caption=HOSTILE,
        notes=[HOSTILE],
        download="t.csv",
    )
    blocks = [table, Text(HOSTILE), Code(HOSTILE), Lines([(HOSTILE, HOSTILE)]), Facts([(HOSTILE, HOSTILE)])]
    sections = [Section("one", HOSTILE, [Details(HOSTILE, blocks)])]
    return Page(name, HOSTILE, Verdict(HOSTILE, HOSTILE, "good", HOSTILE), blocks, sections)


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.scripts, self.images, self.handlers, self.addresses = [], 0, [], []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag == "script":
            self.scripts.append(attributes.get("type", "run"))
        self.images += tag == "img"
        self.handlers += [name for name in attributes if name.startswith("on")]
        self.addresses += [attributes[name] for name in ("href", "src") if name in attributes]


@pytest.fixture(scope="module")
def document():
    return render([hostile_page()])


def test_text_from_a_log_becomes_no_markup(document):
    tags = Tags()
    tags.feed(document)
    assert tags.scripts == ["application/json", "run", "run"]
    assert tags.images == 0
    assert tags.handlers == []
    assert "49" not in document.replace(plotly_script(), "").split("<body")[1].split("dark-of-light")[0]


def test_nothing_points_outside_the_file(document):
    tags = Tags()
    tags.feed(document)
    assert tags.addresses
    assert all(address.startswith(("#", "data:")) for address in tags.addresses)


def test_plotly_is_there_once(document):
    assert document.count("plotly.js v") == 1


def test_the_policy_allows_just_the_scripts_that_are_in_the_file(document):
    body = document[document.index("<body") :]
    run = re.findall(r"<script>(.*?)</script>", body, re.DOTALL)
    hashes = {base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in run}
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', document).group(1).replace("&#39;", "'")
    assert set(re.findall(r"'sha256-([^']+)'", policy)) == hashes
    assert "default-src 'none'" in policy
    assert "unsafe-inline" not in policy.split("script-src")[1].split(";")[0]
    assert policy == content_policy(run)


def test_the_last_stage_opens_first_unless_another_is_named():
    pages = [hostile_page("info"), hostile_page("steering")]
    assert 'data-shown="steering"' in render(pages)
    assert 'data-shown="info"' in render(pages, "info")


def test_json_in_a_script_block_can_neither_end_it_nor_hold_what_json_lacks():
    text = embed_json({"a": "</script>&\u2028<!--", "b": np.array([np.nan, np.inf, 1 / 3]), "c": (1, None)})
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == {"a": "</script>&\u2028<!--", "b": [None, None, 0.3333333], "c": [1, None]}


def test_a_download_holds_the_unrounded_numbers():
    table = Table([Column("run"), Column("gain")], [["a, b", Cell("0.99", raw=0.98765432)]])
    assert list(csv.reader(io.StringIO(table_csv(table)))) == [["run", "gain"], ["a, b", "0.98765432"]]
    address = csv_address(table)
    assert base64.b64decode(address.partition("base64,")[2]).decode() == table_csv(table)


@pytest.mark.parametrize("text", ["=1+1", "+1", "-cmd", "@sum", "\t=1"])
def test_a_spreadsheet_does_not_compute_a_name_from_a_log(text):
    table = Table([Column("run")], [[text]])
    assert list(csv.reader(io.StringIO(table_csv(table))))[1] == [f"'{text}"]


def test_a_negative_number_stays_a_number():
    assert table_csv(Table([Column("a")], [[Cell("−0.8", raw=-0.8)]])).splitlines()[1] == "-0.8"


def test_a_table_is_given_as_json_too_with_a_name_for_each_column():
    table = Table(
        [Column(""), Column("run"), Column("run")], [["a", "b", Cell("0.9", raw=0.98765432)], ["c", "d", "–"]]
    )
    expected = [
        {"column 1": "a", "run": "b", "run (3)": 0.98765432},
        {"column 1": "c", "run": "d", "run (3)": "–"},
    ]
    assert json.loads(table_json(table)) == expected
    address = json_address(table)
    assert address.startswith("data:application/json;")
    assert json.loads(base64.b64decode(address.partition("base64,")[2])) == expected


def test_records_stand_for_the_rows_in_both_downloads():
    records = [{"model": "=linear", "rms": 0.1}, {"model": "brush", "rms": float("nan"), "low": None}]
    table = Table([Column("shown")], [["rounded"]], records=records)
    assert list(csv.reader(io.StringIO(table_csv(table)))) == [
        ["model", "rms", "low"],
        ["'=linear", "0.1", ""],
        ["brush", "nan", ""],
    ]
    assert json.loads(table_json(table)) == [
        {"model": "=linear", "rms": 0.1, "low": None},
        {"model": "brush", "rms": None, "low": None},
    ]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tyre_runs.csv", "tyre_runs.json"),
        ("../../etc/passwd", "etc_passwd.json"),
        ('a"b<c>.csv', "a_b_c.json"),
        ("..", "table.json"),
    ],
)
def test_a_download_has_a_name_that_is_safe_on_every_system(name, expected):
    assert download_name(name, "json") == expected


def test_every_table_of_a_page_with_a_download_gives_both(document):
    names = re.findall(r'<a download="([^"]+)" href="data:(text/csv|application/json);', document)
    assert names == 2 * [("t.csv", "text/csv"), ("t.json", "application/json")]


def test_replaces_the_report_whole_and_leaves_nothing_else(tmp_path):
    out = tmp_path / "new" / "out"
    first = write_report(out, [hostile_page()])
    second = write_report(out, [Page("info", "Logs", None, [Text("second")])])
    assert first == second == out / "index.html"
    assert [path.name for path in out.iterdir()] == ["index.html"]
    assert "second" in second.read_text(encoding="utf-8")


def test_a_name_that_is_not_unicode_does_not_stop_the_report(tmp_path):
    page = Page("info", "Logs", None, [Table([Column("run")], [["caf\udce9"]], download="a.csv")])
    assert "caf?" in write_report(tmp_path, [page]).read_text(encoding="utf-8")


def test_a_report_without_pages_is_still_a_document(tmp_path):
    assert write_report(tmp_path, []).read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
