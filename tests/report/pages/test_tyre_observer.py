"""The observed axle forces on the tyre page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from ident.report.page import Table
from ident.report.pages import tyre_observer
from ident.report.pages.tyres import tyres_page
from ident.results import ForceObserver

TOLD = ForceObserver(
    rate=0.31,
    noise={"yaw_rate": 0.002},
    noise_from="the <b>fit</b>",
    half_width={"front": 310.4, "rear": 402.0},
    from_inversion={"front": 122.0, "rear": 133.0},
    from_wheels={"front": {"observer": 557.0, "inversion": 593.0}},
    innovations={"yaw_rate": [1.02, 0.8, 1.2], "lateral_velocity": [11.5, 0.8, 1.2]},
)


def points(gap: float = 0.0) -> pd.DataFrame:
    time = np.arange(1000) * 0.01
    time = np.where(time > 5.0, time + gap, time)
    force = 1e4 * np.sin(time)
    return pd.DataFrame(
        {"time": time, "force": force, "observed_force": force + 100.0, "observed_std": np.full(1000, 50.0)}
    )


def test_the_band_holds_the_line_in_kilonewtons() -> None:
    band, line = tyre_observer.traces(points())
    corners = np.isfinite(band["y"])
    assert band["y"][corners].max() == pytest.approx(10.1 + 0.098, abs=0.01)
    assert np.nanmax(line["y"]) == pytest.approx(10.1, abs=0.001)
    half = (np.count_nonzero(corners)) // 2
    middle = (band["y"][:half] + band["y"][half : 2 * half][::-1]) / 2
    assert middle == pytest.approx(10 * np.sin(band["x"][:half]) + 0.1, abs=1e-9)


def test_a_gap_is_bridged_by_neither_band_nor_line() -> None:
    band, line = tyre_observer.traces(points(gap=20.0))
    assert np.count_nonzero(np.isnan(band["x"])) == 2
    for trace in (band, line):
        drawn = np.asarray(trace["x"], dtype=float)
        inside = (drawn > 5.02) & (drawn < 25.0)
        assert not np.any(inside)


def test_nothing_is_drawn_where_nothing_was_observed() -> None:
    assert tyre_observer.traces(points().drop(columns=["observed_force", "observed_std"])) == []
    assert tyre_observer.traces(points().assign(observed_force=np.nan)) == []


def test_the_tables_hold_bands_differences_and_innovations() -> None:
    text, axles, sensors = tyre_observer.tables(TOLD)
    assert "0.31 of the load" in text.text
    assert isinstance(axles, Table)
    assert [cell.text for cell in axles.rows[0]] == ["front", "310", "122", "557", "593"]
    assert [cell.text for cell in axles.rows[1]] == ["rear", "402", "133", "–", "–"]
    assert [cell.text for cell in sensors.rows[1]] == ["lateral velocity", "11.50", "0.80 … 1.20"]


def test_the_page_has_them_in_the_section_of_the_forces(tyres_case) -> None:
    result, tables = tyres_case
    forces = tables["tyre_forces"]
    seen = forces.assign(observed_force=forces["force"] + 50.0, observed_std=80.0)
    page = tyres_page(replace(result, observer=TOLD), {**tables, "tyre_forces": seen})
    (own,) = [one for one in page.sections if one.title == "Axle forces"]
    assert len(own.blocks) == 4
    names = {trace["name"] for trace in own.blocks[0].spec["data"]}
    assert {"observed", "95 % band", "from the motion", "modelled"} <= names
    assert tyre_observer.CAPTION in own.blocks[0].caption
    (bare,) = [one for one in tyres_page(result, tables).sections if one.title == "Axle forces"]
    assert len(bare.blocks) == 1
    assert "Observed" not in bare.blocks[0].caption
