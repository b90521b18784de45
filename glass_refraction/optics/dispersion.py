# SPDX-License-Identifier: GPL-3.0-or-later
"""How a medium's ior depends on the wavelength of the light."""

from __future__ import annotations

import math

LINES = {"red": 656.28e-9, "green": 587.56e-9, "blue": 486.13e-9}
"""Wavelengths, metres, of the lines C, d and F: an Abbe number says how far apart they go."""


def dispersed_ior(ior: float, abbe_number: float, wavelength: float) -> float:
    """A medium's ior for light of another wavelength, by Cauchy's equation A + B / wavelength^2.

    Parameters
    ----------
    ior : for the line d, as catalogues give it.
    abbe_number : (ior - 1) / (ior at F - ior at C); 0 or infinity: the same for all light.
    wavelength : in air, metres.

    Raises
    ------
    ValueError
        A number that is not what it should be, or an ior that comes out not positive.
    """
    if math.isnan(abbe_number) or abbe_number < 0:
        raise ValueError(f"abbe_number must not be negative: {abbe_number:g}")
    if not (math.isfinite(wavelength) and wavelength > 0):
        raise ValueError(f"wavelength must be positive, not {wavelength:g}")
    if abbe_number == 0 or math.isinf(abbe_number):
        return ior
    c, d, f = (1.0 / length**2 for length in LINES.values())
    found = ior + (ior - 1.0) / abbe_number * (1.0 / wavelength**2 - d) / (f - c)
    if not found > 0:
        raise ValueError(f"abbe_number {abbe_number:g} is too small for an ior of {ior:g}")
    return found
