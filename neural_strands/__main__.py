"""`python -m neural_strands` is the command `neural-strands`."""

import sys

from neural_strands.cli import main

sys.exit(main())
