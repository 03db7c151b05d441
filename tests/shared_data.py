"""Where the reference data is: beside the project or in $CAMCAL_DATA; tests that need it skip without it."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("CAMCAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))

needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="the reference data is not here (../shared/data or $CAMCAL_DATA)"
)
