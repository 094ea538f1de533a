"""``python -m pinadapt``."""

import sys

from .cli.main import main

sys.exit(main())
