"""What tests share: where the real recordings are, and that no property is judged by how long it takes."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings (../shared/data beside the repository, or PIDO_REAL_DATA)."""
    place = Path(os.environ.get("PIDO_REAL_DATA") or Path(__file__).parents[2] / "shared" / "data")
    if not place.is_dir():
        pytest.skip(f"real recordings are not at {place}; PIDO_REAL_DATA names another place")
    return place
