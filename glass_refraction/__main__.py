# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m glass_refraction COMMAND …`` with the bpy wheel."""

import sys

from .cli import main

sys.exit(main())
