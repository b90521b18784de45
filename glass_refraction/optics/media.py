# SPDX-License-Identifier: GPL-3.0-or-later
"""Indices of refraction of named media, from the DirectX refraction note among the sources."""

from types import MappingProxyType

MEDIA = MappingProxyType(
    {
        "Vacuum": 1.00000,
        "Air": 1.00029,
        "Ice": 1.30900,
        "Alcohols": 1.32900,
        "Water": 1.33333,
        "Sugar solution (30 %)": 1.38000,
        "Fused quartz": 1.46000,
        "Sugar solution (80 %)": 1.49000,
        "Glass": 1.50000,
        "Crown glass": 1.53000,
        "Salt": 1.54400,
        "Emerald": 1.57000,
        "Topaz": 1.61000,
        "Quartz": 1.64400,
        "Heavy flint glass": 1.65000,
        "Ruby/Sapphire": 1.77000,
        "Crystal": 2.00000,
        "Diamond": 2.41700,
    }
)
