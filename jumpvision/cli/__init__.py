"""The command line: arguments to stages. No science, and nothing heavy imported before a command runs."""

from __future__ import annotations

import gc
import os
import sys
from typing import TYPE_CHECKING

from jumpvision import __version__
from jumpvision.base.compiling import GARBAGE_EVERY

from .codes import BAD_CALL, DONE, FAILED
from .streams import lasting

if TYPE_CHECKING:
    from cyclopts import App

# before NumPy is imported: the matrices are small, threads of BLAS wait for each other and round by their number
for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")


def main(argv: list[str] | None = None) -> int:
    """Entry point: 0 done, 1 something failed, 2 wrong call or bad input."""
    asked = sys.argv[1:] if argv is None else argv
    if argv is None:  # a process of its own
        gc.set_threshold(GARBAGE_EVERY)
    with lasting():
        if asked == ["--version"]:
            print(__version__)
            return DONE
        return _carry_out(asked)


def _carry_out(asked: list[str]) -> int:
    from cyclopts import CycloptsError

    from jumpvision.base.schema import InputError, harmless

    try:
        return int(application()(asked, exit_on_error=False, print_error=False, result_action="return_value") or DONE)
    except InputError as e:
        print("\n".join(f"jumpvision: {harmless(p)}" for p in e.problems), file=sys.stderr)
        return BAD_CALL
    except CycloptsError as e:
        print(f"jumpvision: {harmless(str(e))}; see jumpvision --help", file=sys.stderr)
        return BAD_CALL
    except OSError as e:  # a full disk, a folder that may not be written
        where = f": {e.filename}" if e.filename else ""
        print(
            f"jumpvision: {e.strerror or e}{where}; free or change it and run the same command again", file=sys.stderr
        )
        return FAILED
    except KeyboardInterrupt:
        print("jumpvision: interrupted; run the same command again to resume", file=sys.stderr)
        return 130


def application() -> App:
    """The application with all of its commands: those that the modules of this folder register."""
    from jumpvision.experiment.workflow.stage import import_all

    from .app import app

    import_all(__name__)
    return app
