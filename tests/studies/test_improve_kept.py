"""What a study has made is kept, whatever ends it, and is not made again."""

import json

from improve_kept import grow, kept_rows


def squares(cell):
    name, number = cell
    return [{"square": number**2, "name": name}]


def two_rows(_cell):
    return [{"row": 1}, {"row": 2}]


def never(cell):
    raise AssertionError(cell)


def test_each_cell_is_made_once(tmp_path):
    path = tmp_path / "deep" / "rows.jsonl"
    first = grow(path, [["a", 2], ["a", 3]], squares)
    assert [row["square"] for row in first] == [4, 9]
    assert [row["cell"] for row in first] == [["a", 2], ["a", 3]]
    again = grow(path, [["a", 2], ["a", 3]], never)
    assert again == first == kept_rows(path)


def test_a_study_goes_on_where_it_was(tmp_path):
    path = tmp_path / "rows.jsonl"
    grow(path, [["a", 2]], squares)
    rows = grow(path, [["a", 2], ["b", 2], ["b", 5]], squares, jobs=2)
    assert sorted((*row["cell"], row["square"]) for row in rows) == [("a", 2, 4), ("b", 2, 4), ("b", 5, 25)]
    assert kept_rows(path) == rows


def test_a_line_that_was_cut_off_is_made_again(tmp_path):
    path = tmp_path / "rows.jsonl"
    grow(path, [["a", 2], ["a", 3]], squares)
    path.write_text(path.read_text()[:-9])
    assert [row["cell"] for row in kept_rows(path)] == [["a", 2]]
    rows = grow(path, [["a", 2], ["a", 3]], squares)
    assert [row["square"] for row in rows] == [4, 9]
    assert [json.loads(line) for line in path.read_text().splitlines()] == rows


def test_nothing_is_begun_when_the_time_is_over(tmp_path):
    assert grow(tmp_path / "rows.jsonl", [["a", 2]], never, hours=0.0) == []


def test_all_rows_of_a_cell_are_kept(tmp_path):
    rows = grow(tmp_path / "rows.jsonl", [["x", 1]], two_rows)
    assert rows == [{"cell": ["x", 1], "row": 1}, {"cell": ["x", 1], "row": 2}]
