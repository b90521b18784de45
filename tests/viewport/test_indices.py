# SPDX-License-Identifier: GPL-3.0-or-later
"""What drivers refuse that the software driver of the other tests takes."""

import re

import pytest

from glass_refraction.viewport import glsl, vertex_glsl

BLOCK_INDEX = re.compile(r"\b(?:glasses\.rows|view\.captures)\[([^\]]*)\]")


@pytest.mark.parametrize("module", [glsl, vertex_glsl])
def test_blocks_of_uniforms_are_indexed_within_bounds_wherever_that_is(module):
    """NVIDIA's compiler ended at ``row(9 + GLASS_ROWS * g)``, called with g = -1 behind a test."""
    texts = [text for text in vars(module).values() if isinstance(text, str)]
    found = [index for text in texts for index in BLOCK_INDEX.findall(text)]
    assert found or module is vertex_glsl
    assert {
        index for index in found if not re.match(r"max\(\w+, 0\)|clamp\(\w+, 0,", index)
    } == set()


def test_a_sample_is_of_the_pixel_that_a_list_names():
    """Pixels at edges are drawn side by side: where the driver draws them tells nothing of them."""
    for text in (glsl.PICTURE, vertex_glsl.PICTURE):
        before, main = text.split("void main()")
        assert "gl_FragCoord" not in before
        assert main.count("gl_FragCoord") == 1
