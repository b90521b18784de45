# SPDX-License-Identifier: GPL-3.0-or-later
"""No harm to any file: random walks through what users do, in the installed extension."""

import os
import re

import pytest

CRASH = re.compile(r"Traceback|\bcrash|Segmentation")
"""An operator that says what is wrong says "Error"; the walk asks for such."""
STEPS = 500
SEEDS = ["2013", *filter(None, [os.environ.get("REFRACTIVE_GLASS_SEED")])]


@pytest.mark.parametrize("seed", SEEDS)
def test_what_the_user_has_stays_the_users(installed, seed):
    found = installed.script("no_harm", STEPS, seed, trouble=CRASH)
    assert found["failures"] == []
    did = found["did"][seed]
    assert did["compared"] > STEPS / 2
    assert did["undo"] > 0
