"""`python -m qcball` is the command `qcball`."""

import sys

from ._command import main

sys.exit(main())
