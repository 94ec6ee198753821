"""What tests share: where the real recordings are."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings (../shared/data beside the repository, or PIDO_REAL_DATA)."""
    place = Path(os.environ.get("PIDO_REAL_DATA") or Path(__file__).parents[2] / "shared" / "data")
    if not place.is_dir():
        pytest.skip(f"real recordings are not at {place}; PIDO_REAL_DATA names another place")
    return place
