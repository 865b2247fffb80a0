"""The command `qcball`."""

from __future__ import annotations

import os
import shutil
import signal
import sys

from . import _qcball


def main() -> int:
    # Python's handler would only note Ctrl-C until the command is over.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    called = shutil.which(sys.argv[0]) or sys.argv[0]
    return _qcball.main(os.path.abspath(called), sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
