"""What the bundled program starts with."""

import multiprocessing
import sys

from jumpvision.cli import main

if __name__ == "__main__":
    multiprocessing.freeze_support()  # workers are this program too
    sys.exit(main())
