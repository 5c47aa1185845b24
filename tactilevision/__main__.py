"""`python -m tactilevision` does what the console script does."""

import sys

from tactilevision.cli import main

sys.exit(main())
