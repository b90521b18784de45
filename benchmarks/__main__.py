# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m benchmarks -o FOLDER``."""

import sys

from .command import main

sys.exit(main())
