"""The command line: arguments to stages. No science, and nothing heavy imported before a command runs."""

from __future__ import annotations

import io
import os
import sys

from cyclopts import CycloptsError

from . import (  # noqa: F401  (each adds its commands to --help)
    explore,
    export,
    folders,
    init,
    machine,
    matter,
    sweep,
    workbench,
)
from .app import BAD_CALL, DONE, FAILED, app

# before NumPy is imported: the matrices are small, threads of BLAS wait for each other and round by their number
for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")


def main(argv: list[str] | None = None) -> int:
    """Entry point: 0 done, 1 something failed, 2 wrong call or bad input."""
    from jumpvision.base.schema import InputError, harmless

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal, or LANG=C, without a letter is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    try:
        return int(app(argv, exit_on_error=False, print_error=False, result_action="return_value") or DONE)
    except InputError as e:
        print("\n".join(f"jumpvision: {harmless(p)}" for p in e.problems), file=sys.stderr)
        return BAD_CALL
    except CycloptsError as e:
        print(f"jumpvision: {harmless(str(e))}; see jumpvision --help", file=sys.stderr)
        return BAD_CALL
    except BrokenPipeError:
        return FAILED
    except OSError as e:  # a full disk, a folder that may not be written
        where = f": {e.filename}" if e.filename else ""
        print(
            f"jumpvision: {e.strerror or e}{where}; free or change it and run the same command again", file=sys.stderr
        )
        return FAILED
    except KeyboardInterrupt:
        print("jumpvision: interrupted; run the same command again to resume", file=sys.stderr)
        return 130
