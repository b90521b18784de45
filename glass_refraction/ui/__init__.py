# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties, operators, panels and menus; thin, over ``scene`` and ``reference``."""
