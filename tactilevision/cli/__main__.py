"""Run `python -m tactilevision.cli` as the console script."""

import sys

from tactilevision.cli import main

sys.exit(main())
