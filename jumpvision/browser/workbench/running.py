"""`jumpvision run` on the experiment or its whole campaign, in a process of its own; its lines are the progress."""

from __future__ import annotations

import re
import subprocess
import threading
from collections import deque
from pathlib import Path

from jumpvision.experiment.workflow.cluster import SELF

LINES = 200  # kept
COUNTED = re.compile(r"\[(\d+)/(\d+)\]")


class Running:
    """One run of a folder."""

    def __init__(self, folder: Path):
        self.folder, self.lines = folder, deque[str](maxlen=LINES)
        self.done, self.total, self._stopped = 0, 0, False
        self._process = subprocess.Popen(
            [*SELF, "run", str(folder)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def running(self) -> bool:
        return self._reader.is_alive()

    @property
    def said(self) -> str:
        """How it stands, in words; what is computed is kept when it is stopped, and taken up again."""
        if self.running:
            return f"{self.done} of {self.total} experiments" if self.total else "running"
        if self._stopped:
            return "stopped; run again to go on where it was"
        code = self._process.wait()
        return "done" if code == 0 else "done, but something failed: see the last lines" if code == 1 else "not run"

    def stop(self) -> None:
        """Ends it; does nothing when it has ended."""
        if self.running:
            self._stopped = True
            self._process.terminate()
        self._reader.join(timeout=10)

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append(line.rstrip())
            if m := COUNTED.search(line):
                self.done, self.total = int(m[1]), int(m[2])
        self._process.wait()
