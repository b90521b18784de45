# SPDX-License-Identifier: GPL-3.0-or-later
"""No harm to any file: random walks through what users do, in the installed extension."""

import os
import re

CRASH = re.compile(r"Traceback|\bcrash|Segmentation")
"""An operator that says what is wrong says "Error"; the walk asks for such."""
STEPS = 500
SEED = os.environ.get("REFRACTIVE_GLASS_SEED", "2013")


def test_what_the_user_has_stays_the_users(installed):
    found = installed.script("no_harm", STEPS, SEED, trouble=CRASH)
    assert found["failures"] == []
    did = found["did"][SEED]
    assert did["compared"] > STEPS / 2
    assert did["undo"] > 0
