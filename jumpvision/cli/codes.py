"""Exit codes of every command."""

from __future__ import annotations

DONE, FAILED, BAD_CALL = 0, 1, 2  # done; an experiment or stage failed; wrong call or bad input
