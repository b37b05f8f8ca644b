"""Settings of all tests, made before numpy is loaded."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

os.environ.setdefault("OMP_NUM_THREADS", "1")
settings.register_profile("suite", derandomize=True)  # the same examples each time
settings.load_profile("suite")

TOGETHER = {
    *("test_actuator_layer", "test_improve_measured", "test_improve_undeclared", "test_motion_effects"),
    *("test_motion_injected", "test_motion_layer", "test_tyre_coverage", "test_two_track_fit"),
    *("test_evaluate", "test_tyres", "test_tyres_measured", "test_tyres_pac2002", "test_validate"),
    *("test_run_end_to_end", "test_end_to_end", "test_improve_null", "test_kill"),
}
"""Modules whose tests share what takes long to make: one process runs all of them."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of a module together (``pytest -n 2 --dist loadgroup``)."""
    for item in items:
        if item.path.stem in TOGETHER:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
