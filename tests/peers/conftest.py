"""Finds the recordings of other systems; skips, with the reason, where there are none."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[2] / ".." / "shared")
PEERS = SHARED / "peers"


@pytest.fixture(scope="session")
def peers() -> Path:
    if not PEERS.is_dir():
        pytest.skip(f"no recordings of other systems at {PEERS} (set FOOTIK_SHARED)")
    return PEERS
