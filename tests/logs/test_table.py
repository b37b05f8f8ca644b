"""CSV and Parquet files: times, units, refusals."""

import subprocess
import sys

import pandas as pd
import pytest

from ident.errors import UnusableLog
from ident.logs import FieldError, open_log


def table(tmp_path, text):
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("head", "first", "second", "expected"),
    [
        ("time", "0.5", "0.75", [500_000_000, 750_000_000]),
        ("t_ms", "500", "750", [500_000_000, 750_000_000]),
        ("Time [us]", "500", "750", [500_000, 750_000]),
        (
            "timestamp",
            "1700000000000000001",
            "1700000000000000003",
            [1700000000000000001, 1700000000000000003],
        ),
        ("timestamp", "1700000000001", "1700000000002", [1700000000001000000, 1700000000002000000]),
        ("stamp", "2024-01-01 00:00:00.5", "2024-01-01 00:00:01", [1704067200500000000, 1704067201000000000]),
    ],
)
def test_times_are_found_with_their_unit(tmp_path, head, first, second, expected):
    log = open_log(table(tmp_path, f"{head},angle\n{first},1.5\n{second},0.1\n"))
    assert log.times("/run").tolist() == expected
    columns = log.columns("/run", ["angle"])
    assert columns.values["angle"].tolist() == [1.5, 0.1]  # noqa: PD011 no frame of pandas
    assert (columns.header_stamp, log.damage) == (None, [])


def test_seconds_and_nanoseconds_go_together(tmp_path):
    log = open_log(table(tmp_path, "sec;nanosec;a\n1700000000;5;1\n1700000001;7;2\n"))
    assert log.times("/run").tolist() == [1700000000000000005, 1700000001000000007]
    assert log.fields("/run") == {"a": "float64"}


def test_rows_that_are_cut_or_without_time_are_counted(tmp_path):
    log = open_log(table(tmp_path, "t,a,b\n0,1,2\n1,x,3\n2,3\n,4,5\n3,6,7\n"))
    assert log.times("/run").tolist() == [0, 10**9, 3 * 10**9]
    values = log.columns("/run", ["a"]).values["a"]  # noqa: PD011 no frame of pandas
    assert (values[0], values[2]) == (1.0, 6.0)
    assert values[1] != values[1]
    assert [(item.what.removeprefix("run.csv: "), item.messages_lost) for item in log.damage] == [
        ("rows that have not the 3 cells of the first line, first at row 3", 1),
        ("rows without a time, first at row 3", 1),
        ("column 'a' holds 1 cells that are no numbers, first at row 2", None),
    ]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a,b\n1,2\n", "no column of times among 'a', 'b'"),
        ("t,b\n5,1\n4,2\n3,3\n", "rise in 0 % of the rows"),
        ("time,b\n5,1\n5,2\n5,3\n", "rise in 100 % of the rows"),
        ("time,b\n1,1\n", "1 rows with a time, need at least 2"),
        ("time,b\n0,1\n20,2\n40,2\n", "are 20 s apart, need at most 10 s"),
        ("hello\nworld\n", "no table"),
        ("time,b\nx,1\ny,2\n", "holds neither numbers nor dates"),
    ],
)
def test_what_gives_no_times_is_refused_in_one_line(tmp_path, text, reason):
    with pytest.raises(UnusableLog, match=reason) as caught:
        open_log(table(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_parquet_holds_the_same(tmp_path):
    path = tmp_path / "run.parquet"
    frame = pd.DataFrame({"time": [0.0, 0.1], "angle": [0.25, 0.5], "name": ["a", "b"]})
    frame.to_parquet(path)
    log = open_log(path)
    assert (log.format, list(log.fields("/run"))) == ("parquet", ["angle"])
    with pytest.raises(FieldError, match="did you mean 'angle'"):
        log.columns("/run", ["angel"])
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(UnusableLog, match="Parquet file that cannot be read"):
        open_log(path)


def test_of_columns_of_one_name_the_first_is_read_and_the_others_are_told(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,x,x,time\n0,1,5,9\n1,2,6,9\n", encoding="utf-8")
    log = open_log(path)
    columns = log.columns("/a", ["x"])
    assert columns.values["x"].tolist() == [1, 2]  # noqa: PD011 no frame of pandas
    assert [item.what for item in log.damage] == [
        "a.csv: several columns 'x', only the first is read",
        "a.csv: several columns 'time', only the first is read",
    ]


def said(log):
    return [(item.what.removeprefix("run.csv: "), item.messages_lost) for item in log.damage]


def test_a_last_line_without_its_end_may_be_cut_off_and_is_left_out(tmp_path):
    log = open_log(table(tmp_path, "time,a\n0,1.25\n1,2.25\n2,3.2"))
    assert log.columns("/run", ["a"]).values["a"].tolist() == [1.25, 2.25]  # noqa: PD011 no frame
    assert said(log) == [("the last line has no end and may be cut off, it is left out, at row 3", None)]


@pytest.mark.parametrize("text", ["time_ns,a\n{}", "timestamp,a\n{}"])
def test_one_bad_cell_among_many_costs_no_other_and_times_stay_exact(tmp_path, text):
    first = 1_700_000_000_000_000_001
    rows = [f"{first + k * 10**7},{k / 8}" for k in range(100_000)]  # more than one block of the reader
    rows[90_000] = f"{first + 90_000 * 10**7},\ufffd\ufffd"
    rows[95_000] = "\ufffd,7.0"
    path = table(tmp_path, "")
    path.write_bytes(text.format("\n".join([*rows, ""])).encode("latin-1", "replace").replace(b"?", b"\xff"))
    log = open_log(path)
    kept = [k for k in range(100_000) if k != 95_000]
    assert log.times("/run").tolist() == [first + k * 10**7 for k in kept]
    values = log.columns("/run", ["a"]).values["a"].tolist()  # noqa: PD011 no frame
    assert [k for k, value in zip(kept, values, strict=True) if value != k / 8] == [90_000]
    assert [what.partition(", first")[0] for what, _ in said(log)] == [
        "bytes that are no UTF-8 text",
        "rows without a time",
        "column 'a' holds 1 cells that are no numbers",
    ]
    assert [count for _, count in said(log)] == [None, None, None]


@pytest.mark.parametrize(
    "cell", ["\x1d1700000002", "\u06611700000002", "1_700_000_002", "+", "1e400", "9" * 40]
)
def test_a_time_that_only_looks_like_a_whole_number_costs_its_row(tmp_path, cell):
    rows = [f"{1_700_000_000 + k},{k}" for k in range(6)]
    rows[2] = f"{cell},2"
    log = open_log(table(tmp_path, "\n".join(["time,a", *rows, "x,7", ""])))
    assert log.columns("/run", ["a"]).values["a"].tolist() == [0, 1, 3, 4, 5]  # noqa: PD011 no frame
    assert log.times("/run").tolist() == [(1_700_000_000 + k) * 10**9 for k in (0, 1, 3, 4, 5)]
    assert ("rows without a time, first at row 3", 2) in said(log)


def test_zeros_at_the_end_of_a_file_cost_nothing_else(tmp_path):
    path = table(tmp_path, "time,a\n0,1\n1,2\n")
    size = path.stat().st_size
    path.write_bytes(path.read_bytes() + bytes(5000))
    log = open_log(path)
    assert log.times("/run").tolist() == [0, 10**9]
    assert said(log) == [(f"bytes that are no UTF-8 text, first at byte {size}", None)]


def test_rows_with_falling_times_are_put_in_order_where_they_can_only_be_times(tmp_path):
    log = open_log(table(tmp_path, "time,a\n3,30\n2,20\n1,10\n"))
    assert log.times("/run").tolist() == [10**9, 2 * 10**9, 3 * 10**9]
    assert log.columns("/run", ["a"]).values["a"].tolist() == [10, 20, 30]  # noqa: PD011 no frame
    assert said(log) == [("the times in 'time' rise in 0 % of the rows, which are put in their order", None)]


def test_a_column_of_numbers_none_of_which_is_finite_is_read(tmp_path):
    log = open_log(table(tmp_path, "time,a\n1,inf\n2,nan\n3,-inf\n"))
    values = log.columns("/run", ["a"]).values["a"]  # noqa: PD011 no frame
    assert str(values.tolist()) == "[inf, nan, -inf]"
    assert log.damage == []


def test_logs_that_are_no_tables_are_read_without_what_reads_tables():
    text = "import sys; import ident.logs; print([m for m in ('pandas', 'pyarrow') if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
