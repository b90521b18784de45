# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups as code, one module a group; ``build.py`` writes ``refractive_glass.blend``.

The extension loads that file; this code runs only when the file is made.
"""
