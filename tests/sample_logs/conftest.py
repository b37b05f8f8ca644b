"""What the tests of the simulated truck share."""

from pathlib import Path

import pytest
from generator.truth import Truth, load_truth

SAMPLE_LOGS = Path(__file__).resolve().parents[2] / "sample_logs"


@pytest.fixture(scope="session")
def truth() -> Truth:
    return load_truth()


@pytest.fixture(scope="session")
def sample_logs() -> Path:
    return SAMPLE_LOGS
