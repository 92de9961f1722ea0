"""`python -m vioapr`."""

import sys

from vioapr.cli import main

sys.exit(main())
