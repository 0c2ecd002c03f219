"""What several test files share: the samples analysed once, and where real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "data_samples"


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real recordings by others; tests that need it skip where it is not given."""
    folder = os.environ.get("JUMPVISION_REAL_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("JUMPVISION_REAL_DATA does not name the folder of real recordings")
    return Path(folder)
