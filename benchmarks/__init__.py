# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed against error, and hard cases, as a report that anyone can run.

Each part is a module with ``TITLE``, ``run(settings) -> dict`` (plain values), ``describe(found)``
(lines of Markdown) and ``charts(found)``; ``runner`` runs them and writes the report. Times are
only ever compared within one part, which runs in one process.
"""
