"""A program that ends with the process that started it, however that one ends.

`python -m jumpvision.base.leash PROGRAM ARGUMENTS` as a child with a pipe as its input: a pipe closes by itself also
when its owner is killed. The program and all that it started is then interrupted, as by Ctrl-C.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from typing import IO

PATIENCE = 60.0  # s, after which what is still there is killed


def on_a_leash(call: Sequence[str], stdout: IO[str]) -> int:
    """Runs a program to its end, in a group of processes of its own; its exit code."""
    leash = [sys.executable, "-m", "jumpvision.base.leash", *call]
    with subprocess.Popen(leash, stdin=subprocess.PIPE, stdout=stdout, start_new_session=True) as child:
        return child.wait()


def main(call: Sequence[str]) -> int:
    if hasattr(os, "killpg"):
        signal.signal(signal.SIGINT, lambda *_: None)  # it is of the group; a handler, unlike SIG_IGN, is not inherited
    child = subprocess.Popen(call, stdin=subprocess.DEVNULL)
    threading.Thread(target=_let_go, args=(child,), daemon=True).start()
    return child.wait()


def _let_go(child: subprocess.Popen[bytes]) -> None:
    """Wait until nobody holds the other end of the input, then end the program."""
    os.read(0, 1)  # sys.stdin's own lock would be held as this process ends
    if not hasattr(os, "killpg"):
        child.terminate()
        return
    os.killpg(0, signal.SIGINT)
    with contextlib.suppress(subprocess.TimeoutExpired):
        child.wait(PATIENCE)
    os.killpg(0, signal.SIGKILL)  # what ended in time leaves this process alone in the group


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
