"""`python -m jumpvision` is `jumpvision`."""

from __future__ import annotations

import sys

from jumpvision.cli import main

if __name__ == "__main__":
    sys.exit(main())
