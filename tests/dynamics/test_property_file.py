"""Tyre property files: nothing is lost on a round trip, a change changes its line, what is wrong is told."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tyre_files import OTHERS, tyre_text

from ident.dynamics.tyres.property_file import (
    PropertyFile,
    parse_property_file,
    read_property_file,
    write_property_file,
)
from ident.errors import BadRecipe

FILES = sorted(OTHERS.glob("*.tir"))
NAMES = [path.name for path in FILES]
STYLES = """\
! free text above the first section
$--------------------------------------------------mdi
[MDI_HEADER]
FILE_TYPE                ='tir'
FILE_VERSION             =3.0
! : COMMENT :  Tire = 'not a keyword'
[units]
LENGTH = 'meter'            $chosen
FORCE = "newton"
ANGLE='radians'
TIME = second
MASS =
[GOODYEAR]
DATESTAMP = '10-JUN-2010'
TEST_NUMBER = ''
PRICE = 'a $ and a ! inside'
[SHAPE]
{radial width}
 1.0    0.0
-.5e+000\t1.D+01 $ row
[VERTICAL]
FNOMIN = 3.2e+004  ! rated
VERTICAL_STIFFNESS = 1E6$close
   lowercase_name = .5
EMPTY =
DOUBLE = 1.5d-01
[OWN_THINGS]
DATESTAMP = 'another one'
"""


def file_of(text: str) -> PropertyFile:
    return parse_property_file(text.encode(), "some.tir")


def with_line(line: str) -> str:
    return f"[UNITS]\nLENGTH = 'meter'\n[MODEL]\n{line}\n"


def read_or_refused(data: bytes) -> bytes | None:
    """What a file is written back as; None where it is refused, which has to be said in one line."""
    try:
        return parse_property_file(data, "some.tir").to_bytes()
    except BadRecipe as refused:
        return None if "\n" not in str(refused) else b"more than one line"


@pytest.mark.skipif(not FILES, reason="no property files of others: set IDENT_TYRE_FILES to a folder of .tir")
@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_a_file_of_others_survives_a_round_trip_byte_for_byte(path: Path, tmp_path: Path) -> None:
    copy = tmp_path / path.name
    write_property_file(read_property_file(path), copy)
    assert copy.read_bytes() == path.read_bytes()


@pytest.mark.skipif(not FILES, reason="no property files of others: set IDENT_TYRE_FILES to a folder of .tir")
@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_every_number_of_a_file_of_others_is_found(path: Path) -> None:
    file = read_property_file(path)
    expected = {}
    for line in path.read_text().splitlines():
        keyword, equals, rest = line.partition("=")
        value = rest.split("$")[0].strip()
        if equals and not line.lstrip().startswith(("!", "$")) and value and "'" not in value:
            expected[keyword.strip().upper()] = float(value)
    assert len(expected) > 80
    assert {name: file.number(name) for name in expected} == expected


@pytest.mark.skipif(not FILES, reason="no property files of others: set IDENT_TYRE_FILES to a folder of .tir")
@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_a_changed_value_changes_its_line_only(path: Path) -> None:
    file = read_property_file(path)
    changed = file.with_numbers({"LKY": 1.0625, "PKY1": -12.34567890123})
    different = [(old, new) for old, new in zip(file.lines, changed.lines, strict=True) if old != new]
    assert [old.split()[0] for old, _ in different] == ["LKY", "PKY1"]
    assert [new.split()[2] for _, new in different] == ["1.0625", "-12.34567890123"]
    for old, new in different:
        assert old[old.find("$") :] == new[new.find("$") :]
    back = changed.with_numbers({name: file.number(name) or 0.0 for name in ("LKY", "PKY1")})
    assert back.number("PKY1") == file.number("PKY1")


def test_every_style_of_line_is_read() -> None:
    file = file_of(STYLES)
    assert file.to_bytes() == STYLES.encode()
    assert file.text("FILE_TYPE") == "tir"
    assert file.units == {
        "LENGTH": "meter",
        "FORCE": "newton",
        "ANGLE": "radians",
        "TIME": "second",
        "MASS": "",
    }
    assert file.number("FILE_VERSION") == 3.0
    assert file.number("FNOMIN") == 32000.0
    assert file.number("VERTICAL_STIFFNESS") == 1e6
    assert file.number("LOWERCASE_NAME") == 0.5
    assert file.number("DOUBLE") == 0.15
    assert file.text("PRICE") == "a $ and a ! inside"
    assert file.text("EMPTY") is None
    assert file.text("TEST_NUMBER") is None
    assert file.number("NOT_THERE") is None
    assert "OWN_THINGS" in file.sections


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_line_ends_are_kept_where_values_change_and_are_added(ending: str) -> None:
    file = parse_property_file(STYLES.replace("\n", ending).encode(), "some.tir")
    changed = file.with_numbers({"FNOMIN": 25000.0, "FREFF": 0.25}, section="VERTICAL")
    assert changed.number("FNOMIN") == 25000.0
    assert changed.number("FREFF") == 0.25
    assert all(line.endswith(ending) for line in changed.lines)
    kept = [line for line in changed.lines if line not in file.lines]
    assert len(kept) == 2
    assert len(changed.lines) == len(file.lines) + 1


def test_a_value_that_is_the_same_leaves_the_file_alone() -> None:
    file = file_of(STYLES)
    assert file.with_numbers({"FNOMIN": 32000.0, "DOUBLE": 0.15}).to_bytes() == file.to_bytes()


def test_a_keyword_is_added_at_the_end_of_a_file_without_a_last_line_end() -> None:
    file = file_of("[MODEL]\nA = 1")
    assert (
        file.with_numbers({"B": 2.5}, section="model").to_bytes()
        == f"[MODEL]\nA = 1\n{'B':<24} = 2.5\n".encode()
    )


def test_latin_1_and_a_byte_order_mark_are_kept() -> None:
    latin = "[MODEL]\nLKY = 1 $ Schräglaufsteifigkeit, 5\xb0\n".encode("latin-1")
    file = parse_property_file(latin, "some.tir")
    assert (file.encoding, file.to_bytes()) == ("latin-1", latin)
    assert b"1.5 $ Schr\xe4g" in file.with_numbers({"LKY": 1.5}).to_bytes()
    marked = b"\xef\xbb\xbf[MODEL]\r\nLKY = 2\r\n"
    assert parse_property_file(marked, "some.tir").number("LKY") == 2.0
    assert parse_property_file(marked, "some.tir").to_bytes() == marked


UNITS = """[UNITS]
LENGTH = 'inch'
FORCE = 'pound_force'
ANGLE = 'degrees'
MASS = 'slug'
TIME = 'millisecond'
{pressure}
[VERTICAL]
UNLOADED_RADIUS = 20
FNOMIN = 1000
VERTICAL_STIFFNESS = 100
VERTICAL_DAMPING = 2
ALPMAX = 90
LONGVL = 1
MBELT = 2
IP = 110
PKY1 = -12
"""


def test_units_are_converted_to_si() -> None:
    file = file_of(UNITS.format(pressure="PRESSURE = 'psi'"))
    inch, pound = 0.0254, 4.4482216152605
    expected = {
        "UNLOADED_RADIUS": 20 * inch,
        "FNOMIN": 1000 * pound,
        "VERTICAL_STIFFNESS": 100 * pound / inch,
        "VERTICAL_DAMPING": 2 * pound * 1e-3 / inch,
        "ALPMAX": 1.5707963267948966,
        "LONGVL": 25.4,
        "MBELT": 2 * 14.593902937,
        "IP": 110 * 6894.757293168,
        "PKY1": -12.0,
    }
    assert {name: file.number(name) for name in expected} == pytest.approx(expected, rel=1e-9)


def test_a_value_is_written_in_the_units_of_the_file() -> None:
    file = file_of(UNITS.format(pressure="PRESSURE = 'psi'")).with_numbers({"UNLOADED_RADIUS": 0.508})
    assert any(line.split() == ["UNLOADED_RADIUS", "=", "20"] for line in file.lines)


def test_a_pressure_without_a_unit_is_one_of_force_and_length() -> None:
    file = file_of(UNITS.format(pressure=""))
    assert file.number("IP") == pytest.approx(110 * 6894.757293168, rel=1e-9)


def test_a_number_needs_only_the_units_that_it_has() -> None:
    file = file_of("[VERTICAL]\nFNOMIN = 1\nPKY1 = -3\n")
    assert file.number("PKY1") == -3.0
    with pytest.raises(BadRecipe, match=r"FNOMIN has a unit, but \[UNITS\] has no FORCE"):
        file.number("FNOMIN")


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "is empty"),
        (b" \r\n ", "is empty"),
        (b"LKY = 1\n", r"has no \[SECTION\]"),
        ("[MODEL]\nLKY = 1\n".encode("utf-16"), "zero bytes"),
        (b"\x89PNG\r\n\x1a\n\0\0", "zero bytes"),
        (b"[MODEL]\nLKY 1.0\n[NEXT]\n", "line 2: 'LKY 1.0' is no"),
        (b"[MODEL]\nLKY", "line 2: 'LKY' is no .*the file ends here: is it whole"),
        (b"[MODEL]\nTYRESIDE = 'LEF", "line 2: .*is it whole"),
        (b"[MODEL]\nLKY = 1\n[LATERAL_COEFF", "line 3: .*is it whole"),
        (b'{"LKY": 1}', r"has no \[SECTION\]"),
        (b"[MODEL]\n1.0 0.5 cm\n[NEXT]\n", "line 2: '1.0 0.5 cm' is no"),
        (b"[MODEL]\n" + b"x" * 5000, r"line 2: 'x{57}\.\.\.' is no"),
    ],
)
def test_what_is_no_property_file_is_refused_in_one_line(data: bytes, told: str) -> None:
    with pytest.raises(BadRecipe, match=told) as refused:
        parse_property_file(data, "some.tir")
    assert str(refused.value).startswith("some.tir: ")
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 250


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("LKY = 0,95", "line 4: LKY = '0,95' .not a number., need a finite number"),
        ("LKY = 1 000", "line 4: LKY = '1 000' .not a number."),
        ("LKY = '1.0'", "line 4: LKY = '1.0' .text., need a finite number"),
        ("LKY = yes", "line 4: LKY = 'yes' .not a number."),
        ("LKY = nan", "line 4: LKY = 'nan' .not a number."),
        ("LKY = 1e999", "line 4: LKY = '1e999' .not a number."),
        ("LKY = \x1b[31m", r"line 4: LKY = '\\x1b\[31m' .not a number."),
        ("LKY = 1\n[SCALING]\nLKY = 1.1", "LKY = '1' on line 4 and LKY = '1.1' on line 6, need one value"),
    ],
)
def test_a_value_that_is_no_number_is_refused_where_it_is_asked_for(line: str, told: str) -> None:
    file = file_of(with_line(line))
    with pytest.raises(BadRecipe, match=told):
        file.number("LKY")


def test_a_keyword_that_stands_twice_with_one_value_is_read() -> None:
    assert file_of(with_line("LKY = 1\nLKY = 1.0e0")).number("LKY") == 1.0


def test_an_unknown_unit_is_refused_with_the_nearest_known_one() -> None:
    file = file_of("[UNITS]\nLENGTH = 'metr'\n[DIMENSION]\nWIDTH = 1\n")
    with pytest.raises(
        BadRecipe, match=r"some.tir: \[UNITS\] LENGTH = 'metr' is not known, did you mean 'meter'"
    ):
        file.number("WIDTH")


def test_a_new_keyword_needs_a_section_and_a_value_a_finite_number() -> None:
    file = file_of(with_line("A = 1"))
    with pytest.raises(BadRecipe, match="NEW is not in the file, need a section"):
        file.with_numbers({"NEW": 1.0})
    added = file.with_numbers({"NEW": 1.0, "NEWER": 2.0}, section="another")
    assert added.lines[: len(file.lines)] == file.lines
    assert [entry.section for entry in added.entries[-2:]] == ["ANOTHER", "ANOTHER"]
    assert (added.number("NEW"), added.number("NEWER")) == (1.0, 2.0)
    with pytest.raises(BadRecipe, match="A = nan, need a finite number"):
        file.with_numbers({"A": float("nan")})


@given(st.floats(allow_nan=False, allow_infinity=False))
@settings(max_examples=100, deadline=None)
def test_a_number_that_is_written_reads_back_as_itself(value: float) -> None:
    assert file_of(with_line("LKY = 1 $ stiffness")).with_numbers({"LKY": value}).number("LKY") == value


def test_a_file_that_cannot_be_read_or_is_huge_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadRecipe, match="cannot be read: No such file"):
        read_property_file(tmp_path / "none.tir")
    with pytest.raises(BadRecipe, match="cannot be read: Is a directory"):
        read_property_file(tmp_path)
    huge = tmp_path / "huge.tir"
    with huge.open("wb") as file:
        file.truncate(6_000_000)
    with pytest.raises(BadRecipe, match="6000000 bytes, need at most 5000000"):
        read_property_file(huge)
    with pytest.raises(BadRecipe, match="cannot be written"):
        write_property_file(file_of("[A]\n"), tmp_path / "no" / "folder.tir")


@given(st.integers(0, len(tyre_text())))
@settings(max_examples=60, deadline=None)
def test_a_file_cut_off_anywhere_is_read_or_refused_in_one_line(length: int) -> None:
    data = tyre_text().encode()[:length]
    assert read_or_refused(data) in {data, None}


@given(st.lists(st.sampled_from(STYLES.splitlines()) | st.text("ab[]={}$!'\" 1.-é\x85\u2028\t", max_size=12)))
@settings(max_examples=150, deadline=None)
def test_whatever_is_read_is_written_back_as_it_was(lines: list[str]) -> None:
    data = "\r\n".join(["[MODEL]", *lines]).encode()
    assert read_or_refused(data) in {data, None}


def test_a_long_line_takes_no_time() -> None:
    for body in (b"1" * 200_000, b" " * 200_000 + b"x", b"[" + b" " * 200_000, b"1 " * 100_000 + b"x"):
        with pytest.raises(BadRecipe, match="line 2"):
            parse_property_file(b"[MODEL]\n" + body + b"x", "some.tir")
